"""Where real Blender is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT


@pytest.fixture(scope="session")
def blender() -> str:
    """The Python that can import `bpy`."""
    python = os.environ.get("MOTIONGEN_BLENDER_PYTHON", str(ROOT / ".venv-blender" / "bin" / "python"))
    if not Path(python).is_file():
        pytest.skip(f"no Python with Blender's bpy at {python}; `make test-blender` makes it")
    return python


EXTENSION = ROOT / "blender" / "motiongen_blender"

Run = Callable[..., "subprocess.CompletedProcess[str]"]

# The package of Blender 4.2 and 4.3 crashes at Python's usual end, when all is done; so none of them comes to it.
WITHOUT_AN_END = """
import os, runpy, sys, traceback
del sys.argv[0]
failed = 1
try:
    runpy.run_path(sys.argv[0], run_name="__main__")
    failed = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
os._exit(failed)
"""


@pytest.fixture(scope="session")
def run_inside(blender: str, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs one of the scripts beside this file in Blender, with arguments; what fails in there fails here."""
    place = str(tmp_path_factory.mktemp("user"))
    settings = {**os.environ, "BLENDER_USER_RESOURCES": place, "TMPDIR": place}

    def run(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
        program = [blender, "-c", WITHOUT_AN_END, str(Path(__file__).with_name(script)), *map(str, arguments)]
        ended = subprocess.run(program, check=False, capture_output=True, text=True, env=settings, timeout=280)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended

    return run


@pytest.fixture(scope="session")
def command(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program that runs this checkout's worker."""
    path = tmp_path_factory.mktemp("bin") / "motiongen"
    path.write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(ROOT)!r})\n"
        "from motiongen.commands.worker import run\nrun(sys.argv[2:])\n"
    )
    path.chmod(0o755)
    return path
