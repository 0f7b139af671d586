"""Skeletal parts: found from the tree alone, by a preset, or as given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

import motiongen as mg
from motiongen import MotionGenError, Skeleton
from motiongen.contact import foot_joints
from motiongen.generators.constraints import PART_PRESETS
from motiongen.generators.genmm.parts import automatic_parts, skeletal_parts
from tests.ik.rigs import biped, spider
from tests.strategies import generators, random_skeleton


def hang_together(skeleton: Skeleton, joints: tuple[int, ...]) -> bool:
    """Whether all joints but one have their parent among them."""
    return sum(skeleton.parents[joint] not in joints for joint in joints) == 1


@pytest.mark.parametrize("preset", PART_PRESETS)
@given(rng=generators())
def test_parts_of_any_tree_hold_every_joint(preset: str, rng: np.random.Generator) -> None:
    skeleton = random_skeleton(rng, int(rng.integers(1, 40)))
    feet = tuple(j for j in range(1, len(skeleton)) if not skeleton.children[j] and rng.random() < 0.5)
    parts = skeletal_parts(skeleton, mg.Parts(preset=preset), feet)
    assert {joint for joints in parts.values() for joint in joints} == set(range(len(skeleton)))


@given(rng=generators())
def test_the_trunk_and_each_limb_share_the_joint_where_they_meet(rng: np.random.Generator) -> None:
    skeleton = random_skeleton(rng, int(rng.integers(2, 40)))
    parts = automatic_parts(skeleton)
    trunk = parts.pop("trunk")
    assert hang_together(skeleton, trunk)
    for name, joints in parts.items():
        limb = skeleton.names.index(name)
        assert set(joints) & set(trunk) == {skeleton.parents[limb]}
        assert set(joints) == {skeleton.parents[limb], *skeleton.subtree(limb)}
    for one in parts.values():
        for other in parts.values():
            assert one is other or len(set(one) & set(other)) <= 1


def test_a_biped_has_a_trunk_arms_legs_and_a_head(shared_data: Path) -> None:
    clip = mg.load(shared_data / "characters" / "Salsa-Dancing-6.bvh")
    short = [name.split(":")[-1] for name in clip.skeleton.names]

    def found(preset: str) -> dict[str, set[str]]:
        parts = skeletal_parts(clip.skeleton, mg.Parts(preset=preset), foot_joints(clip))
        return {name.split(":")[-1]: {short[j] for j in joints} for name, joints in parts.items()}

    limbs = found("auto")
    assert len(limbs) == 6
    assert {"Hips", "Spine"} <= limbs["trunk"]
    assert {"Neck", "Head"} <= limbs["Neck"]
    arms, halves = found("arms"), found("upper_lower")
    assert len(arms) == 4
    assert {"LeftFoot", "RightFoot", "Spine"} <= arms["body"]
    assert set(halves) == {"upper", "lower"}
    assert halves["upper"] & halves["lower"] == {"Hips"}
    assert {"LeftHand", "Head"} <= halves["upper"]
    assert {"LeftFoot", "RightUpLeg"} <= halves["lower"]


def test_a_spider_has_as_many_limbs_as_legs() -> None:
    rig = spider()
    assert len(automatic_parts(rig.skeleton)) == 1 + len(foot_joints(rig))


def test_given_parts_are_as_given() -> None:
    skeleton = biped().skeleton
    half = skeleton.names[: len(skeleton) // 2 + 1], skeleton.names[len(skeleton) // 2 :]
    parts = skeletal_parts(skeleton, mg.Parts({"a": half[0], "b": half[1]}))
    assert [len(joints) for joints in parts.values()] == [len(names) for names in half]


def test_an_unknown_preset_is_refused_with_those_there_are() -> None:
    with pytest.raises(MotionGenError, match=r"no preset of parts 'arm'.*there are auto, arms, upper_lower"):
        mg.Parts(preset="arm").check(biped().skeleton, 10)
