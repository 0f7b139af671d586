"""The extension's button in a Blender with a window: its own loop, timer, events and undo.

The `bpy` package has no window, so this asks for the program, on a display: `MOTIONGEN_BLENDER_WINDOW=/path/to/blender
xvfb-run -a pytest tests/blender/test_window.py`. What can be seen without a window is in `by_hand.py`.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.blender.conftest import EXTENSION

VARIABLE = "MOTIONGEN_BLENDER_WINDOW"


def test_the_window_lives_on_and_escape_cancels(command: Path, tmp_path: Path) -> None:
    program = os.environ.get(VARIABLE)
    if not program or not os.environ.get("DISPLAY"):
        pytest.skip(f"{VARIABLE} names no Blender, or there is no display")
    script = Path(__file__).with_name("in_window.py")
    call = [program, "--factory-startup", "--enable-event-simulate", "--python", str(script)]
    settings = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path), "TMPDIR": str(tmp_path)}
    ended = subprocess.run(
        [*call, "--", str(tmp_path), str(EXTENSION), str(command)],
        check=False, capture_output=True, text=True, env=settings, timeout=200,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    found = json.loads((tmp_path / "window.json").read_text())
    made, escaped = found["made"], found["escaped"]
    for told in (made, escaped):
        assert told["began"] == ["RUNNING_MODAL"]
        assert told["active"]
        assert told["turns"] > 0
    assert (made["new_actions"], made["assigned"]) == (2, True)
    assert found["undone"] == [True, 1]
    assert escaped["under_way"] > 0
    assert (escaped["new_actions"], escaped["message"]) == (0, "cancelled")
