"""Which joints are a leg."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from motiongen import rotations as rot
from motiongen.contact import foot_joints
from motiongen.ik import clean_feet
from motiongen.ik.legs import find_legs
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.ik.rigs import biped, spider
from tests.puppets import walker


def names_of(motion: Motion, feet: Sequence[int]) -> list[tuple[str, str, str]]:
    legs, names = find_legs(motion, feet), motion.skeleton.names
    return [(names[h], names[k], names[a]) for h, k, a in zip(legs.hips, legs.knees, legs.ankles)]


def rig(parents: dict[str, str | None], offsets: dict[str, Sequence[float]]) -> Motion:
    names = list(parents)
    skeleton = Skeleton(
        tuple(names),
        tuple(-1 if up is None else names.index(up) for up in parents.values()),
        np.array([offsets.get(name, (0.0, -0.3, 0.02)) for name in names]),
    )
    return Motion(skeleton, np.tile(rot.IDENTITY, (3, len(names), 1)), np.zeros((3, 1, 3)), (0,), 30.0)


def test_a_leg_is_thigh_and_shin() -> None:
    motion = biped()
    assert names_of(motion, foot_joints(motion)) == [("Left0", "Left1", "LeftFoot"), ("Right0", "Right1", "RightFoot")]
    legs = find_legs(motion, foot_joints(motion))
    assert legs.above.tolist() == [-1, -1, 0, 1]
    assert legs.leg.tolist() == [0, 1, 0, 1]
    assert legs.label.tolist() == [0, 1, 2, 3]


def test_a_short_joint_between_pelvis_and_thigh_and_a_twist_joint_take_no_part() -> None:
    parents = {"Hips": None, "Spine": "Hips", "Side": "Hips", "Thigh": "Side", "ThighTwist": "Thigh", "Shin": "Thigh"}
    motion = rig({**parents, "Foot": "Shin", "ShinTwist": "Shin"}, {"Side": (0.1, 0.0, 0.0)})
    assert names_of(motion, [6]) == [("Thigh", "Shin", "Foot")]


def test_a_leg_ends_where_the_trunk_branches_and_where_another_foot_is_carried() -> None:
    parents = {"Hips": None, "Back": "Hips", "Neck": "Back", "Head": "Neck"}
    front = {"Shoulder": "Neck", "Arm": "Shoulder", "ForeArm": "Arm", "Hand": "ForeArm"}
    motion = rig({**parents, **front}, {"Shoulder": (0.05, -0.05, 0.0)})
    assert names_of(motion, [7]) == [("Arm", "ForeArm", "Hand")]
    other = {"Shoulder2": "Neck", "Arm2": "Shoulder2", "ForeArm2": "Arm2", "Hand2": "ForeArm2"}
    parents = {name: up for name, up in parents.items() if name != "Head"}  # the neck branches into nothing but legs
    both = rig({**parents, **front, **other}, {"Arm": (0.0, -0.1, 0.0), "Arm2": (0.0, -0.1, 0.0)})
    assert names_of(both, [6, 10]) == [("Arm", "ForeArm", "Hand"), ("Arm2", "ForeArm2", "Hand2")]


def test_a_long_leg_is_bent_where_it_stands_out_most() -> None:
    motion = spider(frames=3)
    legs = find_legs(motion, foot_joints(motion))
    assert len(legs) == 8
    positions = motion.positions[0]
    for hip, knee, tip in zip(legs.hips, legs.knees, legs.ankles):
        line = positions[tip] - positions[hip]
        between = [j for j in motion.skeleton.ancestors(tip) if hip in motion.skeleton.ancestors(j)]
        out = {j: np.linalg.norm(np.cross(line, positions[j] - positions[hip])) for j in between}
        assert out[knee] == max(out.values())


@pytest.mark.parametrize("widest", [1, 2])
def test_it_is_so_for_whichever_joint_that_is(widest: int) -> None:
    offsets = {f"Leg{i}": (0.0, -0.3, 0.0) for i in range(4)}
    offsets[f"Leg{widest}"], offsets[f"Leg{widest + 1}"] = (0.0, -0.3, 0.2), (0.0, -0.3, -0.2)
    parents = {"Hips": None, "Spine": "Hips", "Leg0": "Hips", "Leg1": "Leg0", "Leg2": "Leg1", "Foot": "Leg2"}
    offsets["Foot"] = offsets.pop("Leg3")
    assert names_of(rig(parents, offsets), [5])[0][1] == f"Leg{widest}"


def test_a_leg_swings_at_the_lowest_joint_with_most_of_its_length_below() -> None:
    parents = {"Hips": None, "Spine": "Hips", "Leg0": "Hips", "Leg1": "Leg0", "Leg2": "Leg1", "Foot": "Leg2"}
    for first, hip in ((0.2, "Leg1"), (0.5, "Leg0")):
        motion = rig(parents, {"Leg1": (0.0, -first, 0.0), "Leg2": (0.0, -0.3, 0.0), "Foot": (0.0, -0.3, 0.0)})
        assert names_of(motion, [5])[0][0] == hip


def test_toes_that_meet_near_their_tips_are_one_foot() -> None:
    parents = {"Hips": None, "Spine": "Hips", "Thigh": "Hips", "Shin": "Thigh", "Tarsus": "Shin"}
    toes = {f"Toe{i}": "Tarsus" for i in range(3)}
    motion = rig({**parents, **toes}, {f"Toe{i}": (0.02 * (i - 1), -0.01, 0.05) for i in range(3)})
    legs = find_legs(motion, [5, 6, 7])
    assert names_of(motion, [5, 6, 7]) == [("Thigh", "Shin", "Tarsus")]
    assert legs.feet.tolist() == [4, 5, 6, 7]
    assert legs.label.tolist() == [-1, 0, 1, 2]
    assert legs.above.tolist() == [-1, 0, 0, 0]


def test_feet_without_two_joints_above_them_are_left_out() -> None:
    parents = {"Hips": None, "Spine": "Hips", "Back": "Hips", "Loin": "Back", "Rump": "Loin"}
    stubs = rig({**parents, "Foot1": "Rump", "Foot2": "Rump"}, {"Foot1": (0.3, -0.3, 0.0), "Foot2": (-0.3, -0.3, 0.0)})
    assert len(find_legs(stubs, [5, 6])) == 0
    motion = walker(30.0)  # its feet hang on the hips
    assert len(find_legs(motion, foot_joints(motion))) == 0
    assert clean_feet(motion) is motion
