"""Which way a character faces must not depend on what its rig's axes mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion, concatenate
from motiongen.skeleton import Skeleton
from motiongen.stance import facing, stance
from tests.puppets import load_clip
from tests.rigs import on_other_axes, strider
from tests.strategies import generators, random_quaternions

Array = NDArray[np.float64]
AHEAD = np.array([0.0, 0.0, 1.0])


def angles(a: Array, b: Array) -> Array:
    return rot.angle_between(np.broadcast_to(a, np.broadcast_shapes(a.shape, b.shape)), b)


@given(generators(), st.floats(-3.1, 3.1))
def test_facing_and_stance_turn_with_the_world_and_do_not_see_the_rigs_axes(
    rng: np.random.Generator, yaw: float
) -> None:
    motion = strider(rng)
    turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), yaw)
    frames = random_quaternions(rng, len(motion.skeleton))
    world = motion.transform(turn, rng.normal(size=3))
    moved = on_other_axes(world, frames)
    np.testing.assert_allclose(moved.positions, world.positions, atol=1e-9)
    assert angles(rot.multiply(turn, facing(motion)), facing(moved)).max() < 1e-6
    assert angles(rot.multiply(stance([motion]), frames), stance([moved])).max() < 1e-6


@given(generators())
def test_a_turning_body_faces_where_its_root_is_turned(rng: np.random.Generator) -> None:
    """Its limbs hang from the root in mirrored places, so its front is the root's own z, but for the limbs' swing."""
    motion = strider(rng)
    front = rot.rotate(motion.rotations[:, 0], AHEAD)
    found = rot.rotate(facing(motion), AHEAD)
    level = front * [1.0, 0.0, 1.0]
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    turned = np.degrees(np.arctan2(np.cross(level, found)[:, 1], np.sum(level * found, axis=-1)))
    assert np.ptp(turned) < 15  # one constant, and what the lean does
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-12)


@given(generators())
def test_stance_of_a_standing_pose_is_the_pose_facing_ahead(rng: np.random.Generator) -> None:
    pose = strider(rng)[7]
    still = concatenate([pose] * 5, align=False)
    expected = rot.multiply(rot.inverse(facing(pose)), pose.world_rotations[0])
    assert angles(expected, stance([still, pose])).max() < 1e-6


def test_left_is_on_the_left_hand() -> None:
    names = ("Root", "arm_l", "arm_r", "Tip")
    skeleton = Skeleton(names, (-1, 0, 0, 0), np.array([[0, 0, 0], [0, 0, -1.0], [0, 0, 1.0], [0, 1.0, 0]]))
    motion = Motion(skeleton, np.tile(rot.IDENTITY, (3, 4, 1)), np.zeros((3, 0, 3)), (), 30.0)
    np.testing.assert_allclose(rot.rotate(facing(motion), AHEAD), np.tile([1.0, 0, 0], (3, 1)), atol=1e-12)


def nameless(steps: Array) -> Motion:
    """A chain of three joints, without sides, whose root takes the given steps."""
    skeleton = Skeleton(("a", "b", "c"), (-1, 0, 1), np.array([[0, 0, 0], [0, 1.0, 0], [0, 1.0, 0]]))
    places = np.cumsum(steps, axis=0)[:, None]
    return Motion(skeleton, np.tile(rot.IDENTITY, (len(steps), 3, 1)), places, (0,), 30.0)


def test_without_sides_a_body_faces_the_way_it_goes_or_its_own_z() -> None:
    way = np.array([0.6, 0.0, -0.8])
    np.testing.assert_allclose(rot.rotate(facing(nameless(np.tile(way, (5, 1)))), AHEAD)[0], way, atol=1e-9)
    np.testing.assert_allclose(rot.rotate(facing(nameless(np.zeros((5, 3)))), AHEAD)[0], AHEAD, atol=1e-9)


def test_stance_of_nothing_is_refused() -> None:
    with pytest.raises(MotionGenError, match="at least one motion"):
        stance([])


@pytest.mark.parametrize(
    ("clip", "gone"), [("Walk-In-Circle", True), ("xia-normal-walk", True), ("elephant-idle1", False)]
)
def test_real_characters_walk_ahead_and_stand_on_their_feet(shared_data: Path, clip: str, gone: bool) -> None:
    motion = load_clip(shared_data / "characters" / f"{clip}.bvh")
    ahead = rot.rotate(facing(motion), AHEAD)
    np.testing.assert_allclose(np.linalg.norm(ahead, axis=-1), 1.0)
    if not gone:  # its head is in front of its hips
        head = motion.positions[:, motion.skeleton.index("Bip01_Head")] - motion.root_positions
        assert (np.sum(head * ahead, axis=-1) > 0.5).all()
        return
    step = np.diff(motion.root_positions, axis=0) * [1.0, 0.0, 1.0]
    going = np.sum(step * ahead[:-1], axis=-1) / np.linalg.norm(step, axis=-1)
    assert np.median(going) > 0.95
