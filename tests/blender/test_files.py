"""Files that Blender's own importers read: every bone stands where the library has it, at every frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import Motion
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError
from tests.blender.conftest import Run
from tests.strategies import random_motion, random_skeleton

CLOSE = 5e-6
"""Of the height."""


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Motion]:
    """What is in each file, as the library reads it back."""
    folder = tmp_path_factory.mktemp("files")
    rng = np.random.default_rng(4)
    skeleton = random_skeleton(rng, 14)
    noise = random_motion(rng, skeleton, frames=12, translating=(0,), smooth=True).replace(frame_rate=30.0, unit="m")
    known = {}
    for name, motion in (("clip", mg.load(EXAMPLE_CLIP)[:40]), ("noise", noise)):
        for suffix in (".glb", ".bvh"):
            motion.change_up("y").save(folder / f"{name}{suffix}")
            known[folder / f"{name}{suffix}"] = mg.load(
                folder / f"{name}{suffix}", up=None if suffix == ".glb" else "y"
            )
    return known


def test_bones_stand_where_the_library_has_them(run_inside: Run, motions: dict[Path, Motion], tmp_path: Path) -> None:
    out = tmp_path / "places.json"
    run_inside("import_files.py", out, *(f"{path}:30:1.0" for path in motions))
    found = json.loads(out.read_text())
    for path, motion in motions.items():
        size = np.abs(motion.positions).max() + motion.skeleton.height
        for joint, name in enumerate(motion.skeleton.names):
            theirs = np.array(found[str(path)][name])
            ours = motion.positions[:, joint][:, [0, 2, 1]] * [1, -1, 1]
            assert len(theirs) == len(ours), path.name
            np.testing.assert_allclose(theirs, ours, atol=CLOSE * size, err_msg=f"{path.name}, {name}")


def test_fbx_goes_through_blender_and_back(
    blender: str, motions: dict[Path, Motion], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MOTIONGEN_BLENDER", blender)
    for motion in motions.values():
        motion.save(tmp_path / "there.fbx")
        again = mg.load(tmp_path / "there.fbx")
        assert (len(again), again.frame_rate) == (len(motion), motion.frame_rate)
        own = [again.skeleton.index(name) for name in motion.skeleton.names]
        size = np.abs(motion.positions).max() + motion.skeleton.height
        np.testing.assert_allclose(again.positions[:, own], motion.positions, atol=1e-4 * size)
    (tmp_path / "none.fbx").write_bytes(b"no FBX at all")
    with pytest.raises(MotionGenError, match="Blender cannot convert it"):
        mg.load(tmp_path / "none.fbx")
