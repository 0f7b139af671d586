"""Every constraint from the command line: it does what it says, and says what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import Motion
from motiongen import rotations as rot
from motiongen.cli import main
from motiongen.generators.constraints import CONSTRAINTS
from tests.strategies import random_motion, random_skeleton


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    rng = np.random.default_rng(3)
    motion = random_motion(rng, random_skeleton(rng, 6, depth_first=True), frames=90, translating=(0,), smooth=True)
    motion.save(tmp_path / "clip.bvh")
    return tmp_path / "clip.bvh"


def sample(clip: Path, *settings: str) -> Motion:
    folder = clip.parent / "out"
    assert main(["sample", f"input={clip}", "count=1", "preview=none", f"output={folder}", *settings]) == 0
    return mg.load(folder / "sample_0000.bvh")


def test_every_constraint_has_a_configuration() -> None:
    from motiongen.assets import config_folder
    from motiongen.commands.constraint_settings import _READERS

    names = {path.stem for path in (config_folder() / "constraint").glob("*.yaml")}
    assert names == set(_READERS)
    assert {name.replace("_", "") for name in names} == {kind.__name__.lower() for kind in CONSTRAINTS}


def test_keys_hold_at_their_frames(clip: Path) -> None:
    source = mg.load(clip)
    made = sample(
        clip, "constraint=keyframes", "constraints.keyframes.poses=[10,40]", "constraints.keyframes.frames=[5,60]"
    )
    assert len(made) == 61
    for frame, pose in ((5, 10), (60, 40)):
        assert rot.angle_between(made.rotations[frame], source.rotations[pose]).max() < 1e-4


def test_keys_of_a_like_rig_are_taken_over(clip: Path) -> None:
    """Fewer joints, other prefixes, metres instead of centimetres, a pose a second."""
    source = mg.load(clip)
    smaller = source.scale(0.01)
    names = tuple(f"rig:{name}" for name in smaller.skeleton.names)
    renamed = smaller.replace(skeleton=mg.Skeleton(names, smaller.skeleton.parents, smaller.skeleton.offsets))
    keys = renamed[:61:60].replace(frame_rate=1.0)
    keys.save(clip.parent / "keys.bvh")
    made = sample(clip, "constraint=keyframes", f"constraints.keyframes.clip={clip.parent / 'keys.bvh'}")
    assert len(made) == 31
    for frame, pose in ((0, 0), (30, 60)):
        assert rot.angle_between(made.rotations[frame], source.rotations[pose]).max() < 1e-4
        assert made.root_positions[frame, 1] == pytest.approx(source.root_positions[pose, 1], abs=1e-3)


def test_a_segment_is_as_long_as_its_clip_and_keeps_the_rest(clip: Path) -> None:
    source = mg.load(clip)
    made = sample(clip, "constraint=segment", "constraints.segment.start=30", "constraints.segment.stop=60")
    assert len(made) == 90
    kept = [*range(30), *range(60, 90)]
    assert np.abs(made.positions[kept] - source.positions[kept]).max() < 1e-4 * source.skeleton.height


def test_given_joints_keep_their_motion(clip: Path) -> None:
    source = mg.load(clip)
    made = sample(
        clip, "constraint=[fixed_joints,parts]", f"constraints.fixed_joints.joints=[{source.skeleton.names[-1]}]"
    )
    assert rot.angle_between(made.rotations[:, -1], source.rotations[:, -1]).max() < 1e-4


def test_loops_close(clip: Path) -> None:
    source = mg.load(clip)
    made = sample(clip, "constraint=loop", "frames=77")
    largest = rot.angle_between(source.rotations[1:], source.rotations[:-1]).max()
    assert len(made) == 77
    assert rot.angle_between(made.rotations[-1], made.rotations[0]).max() <= largest


@pytest.mark.parametrize(
    "settings",
    [
        ["constraint=continuation"],
        ["constraint=in_between", "constraints.in_between.before={clip}", "constraints.in_between.after={clip}"],
        ["constraint=style", "constraints.style.content={clip}"],
    ],
    ids=lambda settings: settings[0],
)
def test_clips_named_in_settings_are_read(clip: Path, settings: list[str]) -> None:
    assert len(sample(clip, "frames=40", *(setting.format(clip=clip) for setting in settings))) == 40


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["constraint=lop"], ["no constraint 'lop'", "did you mean 'loop'"]),
        (["constraint=segment"], ["constraint=segment needs constraints.segment.start=..."]),
        (["constraint=fixed_joints"], ["fixed_joints.joints is empty", "Leg"]),
        (["constraint=keyframes", "constraints.keyframes.pose=[1]"], ["constraints.keyframes.pose", "keyframes.poses"]),
        (
            ["constraint=keyframes", "constraints.keyframes.poses=[1,2]", "constraints.keyframes.frames=[3]"],
            ["1 entries"],
        ),
        (["constraint=keyframes", "constraints.keyframes.poses=3"], ["keyframes.poses", "list"]),
        (["constraint=loop", "constraints.loop.in_place=maybe"], ["in_place", "true, false or null", "'maybe'"]),
        (
            ["constraint=[segment,loop]", "constraints.segment.start=1", "constraints.segment.stop=5"],
            ["Segment and Loop"],
        ),
        (["constraint=parts", "constraints.parts.joints={{arm: [nothing]}}"], ["no joint matches 'nothing'"]),
        (["constraint=parts", "constraints.parts.joints=[Hips]"], ["parts.joints", "{NAME: [...]}", "['Hips']"]),
        (["constraint=parts", "constraints.parts.joints={{arm: Hips}}"], ["parts.joints.arm", "list", "'Hips'"]),
        (["constraint=parts", "constraints.parts.examples=5"], ["parts.examples", "{NAME: [...]}"]),
        (["constraints=loop"], ["constraints=loop says nothing", "constraint=NAME"]),
        (["constraints=null"], ["constraints=None says nothing"]),
        (["constraint=loop", "constraints.loop=null"], ["constraints.loop=None says nothing", "constraint=loop"]),
        (["constraint=keyframes", "constraints.keyframes=5"], ["constraints.keyframes=5 says nothing"]),
        (["constraint=null"], ["a group is set to nothing"]),
        (["generator=null"], ["a group is set to nothing"]),
        (["~frames"], ["'~frames' takes a setting away", "frames=null"]),
        (["frames=1000000000000"], ["more than a motion can have"]),
    ],
    ids=lambda value: value[-1] if isinstance(value, list) else None,
)
def test_mistakes_in_constraints_cost_one_line(
    clip: Path, settings: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    settings = [setting.replace("{{", "{").replace("}}", "}") for setting in settings]
    folder = clip.parent / "out"
    code = main(["sample", f"input={clip}", "preview=none", f"output={folder}", *settings])
    err = capsys.readouterr().err
    assert code == 2
    assert err.count("\n") == 1
    assert all(word in err for word in words), err
    assert not folder.exists()


def test_parts_are_taken_from_chosen_examples(clip: Path) -> None:
    settings = [
        "constraint=parts",
        "constraints.parts.joints={a: ['*'], b: ['*']}",
        "constraints.parts.examples={a: [0]}",
    ]
    assert len(sample(clip, "frames=40", *settings)) == 40
