"""The extension in real Blender: what it reads, makes and writes, against the library.

`make test-blender` makes the environment with the `bpy` package and names it in MOTIONGEN_BLENDER_PYTHON.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motiongen import rotations as rot
from motiongen.commands.protocol import decode_motion
from motiongen.motion import Motion
from tests.blender.conftest import EXTENSION, Run

CASES = ("plain", "turned", "two_roots")
TOLERANCE = 5e-6  # of the rig's height: Blender's own numbers have 24 bits


@pytest.fixture(scope="session")
def folder(run_inside: Run, command: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `inside.py` has found in Blender."""
    place = tmp_path_factory.mktemp("blender")
    run_inside("inside.py", place, EXTENSION, command)
    return place


@pytest.fixture(scope="session")
def found(folder: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((folder / "found.json").read_text())
    return result


def z_up(motion: Motion, bones: list[str]) -> np.ndarray:
    positions = motion.positions[:, [motion.skeleton.names.index(bone) for bone in bones]]
    return np.stack([positions[..., 0], -positions[..., 2], positions[..., 1]], axis=-1)


@pytest.mark.parametrize("case", CASES)
def test_bones_are_where_the_library_has_them(case: str, folder: Path, found: dict[str, Any]) -> None:
    seen, told = np.load(folder / f"{case}.npz"), found["cases"][case]
    sent, made = decode_motion("sent", told["sent"]), decode_motion("made", told["answers"][0])
    height = sent.skeleton.height
    assert np.ptp(seen["made"], axis=0).max() > 0.1 * height
    for motion, world in ((sent, seen["example"]), (made, seen["made"])):
        np.testing.assert_allclose(z_up(motion, told["bones"]), world, atol=TOLERANCE * height)
    np.testing.assert_allclose(seen["returned"], seen["example"], atol=TOLERANCE * height)


@pytest.mark.parametrize("case", CASES)
def test_results_are_new_actions_and_the_rig_stays(case: str, found: dict[str, Any]) -> None:
    told = found["cases"][case]
    assert told["unchanged"]
    assert told["is_new"]
    assert len(told["answers"]) == 2
    assert told["range"] == [11, 100]


def test_what_is_held_stays(found: dict[str, Any]) -> None:
    held = {name: decode_motion(name, motion) for name, motion in found["hold"].items()}
    sent, keyed, kept, redone = (held[name] for name in ("sent", "use_keys", "keep_bones", "use_segment"))

    def turned(a: Motion, b: Motion, frames: Any, joints: Any = slice(None)) -> float:
        return float(rot.angle_between(a.rotations[frames][:, joints], b.rotations[frames][:, joints]).max())

    assert len(keyed) == 100
    assert turned(keyed, sent, [14, 70], slice(1, None)) < 1e-5
    assert turned(kept, sent, slice(None), list(sent.skeleton.select(["Arm.L", "Hand.L"]))) < 1e-5
    rest = [*range(40), *range(70, len(sent))]
    np.testing.assert_array_equal(redone.rotations[rest], sent.rotations[rest])
    assert turned(redone, sent, range(50, 60)) > 0.01


def test_cancel_ends_the_work_and_not_the_worker(found: dict[str, Any]) -> None:
    assert found["cancel"] == {"ended": ["CANCELLED"], "message": "cancelled", "new_actions": 0, "afterwards": 1}


def test_a_result_can_be_undone(found: dict[str, Any]) -> None:
    assert found["undo"] == {"made": 1, "left": 0, "same": True}


def test_the_button_never_waits_and_ends_its_timer(found: dict[str, Any]) -> None:
    made, cancelled, fault, closing = (found["presses"][name] for name in ("ticks", "escape", "fault", "closing"))
    for told in (made, cancelled, fault, closing):
        assert (told["began"], told["timers"], told["handlers"]) == (["RUNNING_MODAL"], 1, 1)
        assert (told["left"], told["active"]) == (0, False)
    for told in (made, cancelled):
        assert told["waits"] == [0.0]
        assert {"MOUSEMOVE", "TIMER"} <= set(told["passed"])
    assert (made["ended"], made["new_actions"]) == (["FINISHED"], 2)
    assert (cancelled["ended"], cancelled["new_actions"], cancelled["message"]) == (["CANCELLED"], 0, "cancelled")
    assert "ESC" in cancelled["passed"]
    assert fault["fault"] == "'share'"
    assert closing["worker"] == 0


def test_panels_use_what_this_blender_has(found: dict[str, Any]) -> None:
    shown = found["panels"]
    assert shown["no armature"] == ["label"]
    assert {"prop generator", "prop use_segment", "operator motiongen.generate"} <= set(shown["ready"])
    assert {"progress", "operator motiongen.cancel"} <= set(shown["busy"])
    assert "operator motiongen.generate" not in shown["busy"]
    assert "operator motiongen.refresh" in shown["options"]


def test_the_generators_options_are_offered_and_nothing_is_left_behind(found: dict[str, Any]) -> None:
    assert {"alpha", "patch_size", "search"} <= set(found["options"])
    assert found["left"] == []


def test_blender_finds_the_zip_valid_and_takes_it(blender: str, tmp_path: Path) -> None:
    import zipfile

    package = tmp_path / "motiongen_blender.zip"
    with zipfile.ZipFile(package, "w") as archive:
        for path in sorted([*EXTENSION.glob("*.py"), *EXTENSION.glob("*.toml")]):
            archive.write(path, path.name)
    program = (
        "import bpy, os, subprocess, sys\n"
        "checker = os.path.join(bpy.utils.system_resource('SCRIPTS'), 'addons_core/bl_pkg/cli/blender_ext.py')\n"
        "subprocess.run([sys.executable, checker, 'validate', sys.argv[1]], check=True)\n"
        "bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo='user_default', enable_on_install=True)\n"
        "addon = bpy.context.preferences.addons['bl_ext.user_default.motiongen']\n"
        "assert addon.preferences.command == ''\n"
        "assert bpy.context.scene.motiongen.count == 1\n"
        "assert hasattr(bpy.types, 'MOTIONGEN_PT_panel')\n"
    )
    settings = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    ended = subprocess.run(
        [blender, "-c", program, str(package)], check=False, capture_output=True, text=True, env=settings, timeout=120
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
