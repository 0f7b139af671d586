"""Root motion: taking it out or setting it apart changes nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

import motiongen as mg
from motiongen import rotations as rot
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.root_motion import in_place, split_root
from motiongen.stance import facing
from tests.strategies import motions

UP = np.array([0.0, 1.0, 0.0])


@given(motions())
def test_on_the_spot_it_stays_over_its_beginning_and_moves_as_before(motion: Motion) -> None:
    still = in_place(motion)
    size = np.abs(motion.positions).max() + motion.skeleton.height
    root = still.positions[:, motion.root]
    np.testing.assert_allclose(root[:, [0, 2]], root[[0]][:, [0, 2]].repeat(len(root), axis=0), atol=1e-9 * size)
    np.testing.assert_allclose(root[:, 1], motion.root_positions[:, 1], atol=1e-9 * size)
    assert (still.rotations == motion.rotations).all()
    below = [motion.root, *motion.skeleton.subtree(motion.root)]
    before = motion.positions[:, below] - motion.positions[:, [motion.root]]
    np.testing.assert_allclose(still.positions[:, below] - root[:, None], before, atol=1e-9 * size)


@given(motions())
def test_a_split_root_holds_the_way_and_leaves_everything_where_it_was(motion: Motion) -> None:
    split = split_root(motion)
    size = np.abs(motion.positions).max() + motion.skeleton.height
    assert split.skeleton.names == ("root", *motion.skeleton.names)
    np.testing.assert_allclose(split.positions[:, 1:], motion.positions, atol=1e-9 * size)
    assert rot.angle_between(split.world_rotations[:, 1:], motion.world_rotations).max() < 1e-6
    np.testing.assert_allclose(split.positions[:, 0], motion.root_positions * [1, 0, 1], atol=1e-9 * size)
    assert rot.angle_between(split.rotations[:, 0], facing(motion)).max() < 1e-6
    np.testing.assert_allclose(rot.rotate(split.rotations[:, 0], UP), np.tile(UP, (len(split), 1)), atol=1e-9)


def test_a_name_that_is_taken_is_refused() -> None:
    clip = mg.load(EXAMPLE_CLIP)
    with pytest.raises(MotionGenError, match="has a joint 'Hips' already"):
        split_root(clip, "Hips")
