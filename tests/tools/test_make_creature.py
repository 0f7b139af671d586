"""Creatures of any number of joints from one clip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiongen import io, kinematics
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.mirror import counterparts
from motiongen.motion import Motion, concatenate
from motiongen.stance import facing
from tests.puppets import load_clip
from tests.rigs import strider
from tools import make_creature
from tools.make_creature import FULL, Body, creature, plan

KEPT_BY_24 = (
    "Hips Spine Spine1 Spine2 Neck Head "
    "LeftShoulder LeftArm LeftForeArm LeftHand RightShoulder RightArm RightForeArm RightHand "
    "LeftUpLeg LeftLeg LeftFoot LeftToeBase LeftToe_End RightUpLeg RightLeg RightFoot RightToeBase RightToe_End"
)


@pytest.fixture(scope="module")
def dance(shared_data: Path) -> Motion:
    """Two and a half seconds of 65 joints at 60 Hz."""
    return load_clip(shared_data / "characters" / "Salsa-Dancing-6.bvh")[300:450]


@pytest.fixture(scope="module")
def winged(dance: Motion) -> Motion:
    return creature(dance, 433)


# -- how many joints


def test_no_joint_is_left_over() -> None:
    plans = [plan(joints) for joints in range(1, 700)]
    assert [each.joints for each in plans] == list(range(1, 700))
    assert plan(FULL.joints) == FULL
    assert FULL.joints == 433 - 65
    for each in plans[60:]:  # rich enough for all: no chain is spent on the tail alone
        assert each.tail < each.joints / 3
        assert min(vars(each).values()) > 0


@pytest.mark.parametrize("joints", [2, 3, 8, 20, 24, 64, 65, 66, 70, 100, 433, 434])
def test_exactly_as_many_joints_as_asked_for(dance: Motion, joints: int) -> None:
    made = creature(dance[:3], joints)
    assert len(made.skeleton) == len(set(made.skeleton.names)) == joints
    assert len(made) == 3
    assert made.frame_rate == dance.frame_rate


@pytest.mark.parametrize("joints", [5, 11, 12, 30, 120])
def test_on_any_rig(joints: int) -> None:
    made = creature(strider(np.random.default_rng(joints), translating=(0,)), joints)
    assert len(made.skeleton) == joints


@pytest.mark.parametrize("clip", ["elephant-idle1", "xia-normal-walk"])
def test_on_other_characters(shared_data: Path, clip: str) -> None:
    motion = load_clip(shared_data / "characters" / f"{clip}.bvh")[:20]
    made = creature(motion, 150)
    body = Body(motion)
    assert len(made.skeleton) == 150
    assert motion.skeleton.names[body.head] in ("Bip01_Head", "Head")
    tail = made.positions[:, max(j for j, name in enumerate(made.skeleton.names) if name.startswith("Tail"))]
    ahead = rot.rotate(facing(motion), make_creature.AHEAD)
    behind = np.sum((tail - made.root_positions) * ahead, axis=-1) / motion.skeleton.height
    assert (behind < -0.1).all()


def test_fewer_than_two_joints_are_refused(dance: Motion) -> None:
    with pytest.raises(MotionGenError, match="at least 2 joints, not 1"):
        creature(dance, 1)


# -- fewer joints


def test_fingers_go_first_and_sides_together(dance: Motion) -> None:
    made = creature(dance, 24)
    assert [name.partition(":")[2] for name in made.skeleton.names] == KEPT_BY_24.split()
    counterparts(made.skeleton)  # both sides are still there
    for joints in range(25, 65):
        left = {name.partition(":")[2] for name in creature(dance[:1], joints).skeleton.names}
        assert set(KEPT_BY_24.split()) <= left


def test_what_is_left_moves_as_before(dance: Motion) -> None:
    made = creature(dance, 24)
    own = [dance.skeleton.index(name) for name in made.skeleton.names]
    assert np.array_equal(made.rotations, dance.rotations[:, own])
    assert np.array_equal(made.positions, dance.positions[:, own])
    head = made.skeleton.end_sites.index(made.skeleton.index("mixamorig7:Head"))
    top = dance.positions[:, dance.skeleton.index("mixamorig7:HeadTop_End")]
    np.testing.assert_allclose(kinematics.end_site_positions(made)[:, head], top, atol=1e-9)


# -- more joints


def test_its_own_joints_move_as_before(dance: Motion, winged: Motion) -> None:
    own = [winged.skeleton.index(name) for name in dance.skeleton.names]
    assert np.array_equal(winged.rotations[:, own], dance.rotations)
    assert np.array_equal(winged.positions[:, own], dance.positions)
    assert np.array_equal(winged.translations, dance.translations)
    assert np.array_equal(winged.skeleton.offsets[own], dance.skeleton.offsets)
    assert [winged.skeleton.names[j] for j in winged.translating] == ["mixamorig7:Hips"]  # all others only turn


def test_names_tell_what_grew(dance: Motion, winged: Motion) -> None:
    grown = [name for name in winged.skeleton.names if name not in dance.skeleton.names]
    kinds = {name.rstrip("0123456789_") for name in grown}
    assert kinds == {"Tail", "LeftWing", "RightWing", "LeftFeather", "RightFeather", "Skirt", "Hair"}
    pairs = counterparts(winged.skeleton)
    left = [j for j, name in enumerate(winged.skeleton.names) if name.startswith(("LeftWing", "LeftFeather"))]
    assert all(winged.skeleton.names[pairs[j]].startswith("Right") for j in left)


def test_names_that_are_taken_are_not_given_again() -> None:
    motion = strider(np.random.default_rng(0))
    names = ("Hips", "Tail1", *motion.skeleton.names[2:])
    motion = motion.replace(skeleton=type(motion.skeleton)(names, motion.skeleton.parents, motion.skeleton.offsets))
    made = creature(motion, 15)
    assert "CreatureTail1" in made.skeleton.names


def test_the_same_again(dance: Motion, winged: Motion) -> None:
    assert creature(dance, 433) == winged


def test_what_grew_moves_smoothly_and_near_the_body(dance: Motion, winged: Motion) -> None:
    own = [winged.skeleton.index(name) for name in dance.skeleton.names]
    new = [j for j in range(433) if j not in own]
    steps = np.linalg.norm(np.diff(winged.positions, axis=0), axis=-1) * 60 / dance.skeleton.height
    assert steps[:, new].max() < 5 * steps[:, own].max()
    jerks = np.linalg.norm(np.diff(winged.positions, n=3, axis=0), axis=-1).mean(axis=0)
    assert jerks[new].mean() < 3 * jerks[own].mean()
    away = np.linalg.norm(winged.positions[:, new] - winged.root_positions[:, None], axis=-1)
    assert away.max() < 1.5 * dance.skeleton.height


def test_frame_rates_agree(dance: Motion, winged: Motion) -> None:
    coarse = creature(dance.resample(30.0), 433)
    apart = np.linalg.norm(coarse.positions - winged.positions[::2], axis=-1) / dance.skeleton.height
    assert np.sqrt(np.mean(apart**2)) < 0.03


def test_on_a_statue_it_stands_still_but_for_the_wings(dance: Motion) -> None:
    """Settled from the first frame on; the wings idle, by a few degrees."""
    statue = concatenate([dance[0]] * 40, align=False)
    made = creature(statue, 433)
    moved = np.linalg.norm(made.positions - made.positions[:1], axis=-1) / statue.skeleton.height
    wings = np.array([("Wing" in name or "Feather" in name) for name in made.skeleton.names])
    assert moved[:, ~wings].max() < 0.005
    assert 0.005 < moved[:, wings].max() < 0.2


def test_wings_beat_harder_the_livelier_the_clip_is(dance: Motion, winged: Motion) -> None:
    slow = dance.replace(frame_rate=6.0).resample(60.0)[:300]  # the same dance, ten times as slowly
    beaten = []
    for made in (winged, creature(slow, 433)):
        wing = made.skeleton.index("LeftWing1")
        turned = rot.angle_between(made.rotations[1:, wing], made.rotations[:-1, wing])
        beaten.append(turned.mean())
    assert beaten[0] > 2 * beaten[1]


def test_the_tail_follows_the_hips_later(dance: Motion, winged: Motion) -> None:
    """Seen from the hips the tail lags: where they turn to one side it bends to the other."""
    hips = rot.to_rotation_vector(
        rot.multiply(winged.world_rotations[1:, 0], rot.inverse(winged.world_rotations[:-1, 0]))
    )
    joints = [j for j, name in enumerate(winged.skeleton.names) if name.startswith("Tail")]
    spun = np.cumsum([rot.to_rotation_vector(winged.rotations[1:, j])[:, 1] for j in joints], axis=0)[-1]
    assert np.corrcoef(hips[:, 1], spun)[0, 1] < -0.5


def test_it_survives_its_file(winged: Motion, tmp_path: Path) -> None:
    io.save(winged[:30], tmp_path / "creature.bvh")
    again = io.load(tmp_path / "creature.bvh", up="y", unit="cm")
    assert again.skeleton.same_tree(winged.skeleton)
    assert again.allclose(winged[:30], 1e-4)


# -- the program


def test_the_program_writes_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "clip.bvh", tmp_path / "creature.bvh"
    io.save(strider(np.random.default_rng(0), translating=(0,)), source)
    monkeypatch.setattr("sys.argv", ["make_creature", str(source), str(out), "--joints", "40"])
    make_creature.main()
    assert len(io.load(out).skeleton) == 40
    assert "40 frames at 30 Hz, 40 joints" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("clip", "joints", "words"), [("none.bvh", "40", "no such file"), ("clip.bvh", "0", "at least 2")]
)
def test_the_program_refuses_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    clip: str,
    joints: str,
    words: str,
) -> None:
    io.save(strider(np.random.default_rng(0)), tmp_path / "clip.bvh")
    arguments = ["make_creature", str(tmp_path / clip), str(tmp_path / "out.bvh"), "--joints", joints]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit) as caught:
        make_creature.main()
    assert caught.value.code == 2
    assert words in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out.bvh").exists()
