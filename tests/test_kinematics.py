"""Forward kinematics against a slow twin: 4x4 matrices, one joint and one frame at a time."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from motiongen import Motion, kinematics
from motiongen import rotations as rot
from tests.strategies import Array, generators, motions, random_motion, random_quaternions, random_skeleton


def slow_world_matrices(motion: Motion) -> Array:
    """(T, J, 4, 4) world transforms of every joint, the textbook way."""
    skeleton = motion.skeleton
    world = np.zeros((len(motion), len(skeleton), 4, 4))
    for frame in range(len(motion)):
        for joint, parent in enumerate(skeleton.parents):
            local = np.eye(4)
            local[:3, :3] = Rotation.from_quat(motion.rotations[frame, joint]).as_matrix()
            local[:3, 3] = skeleton.offsets[joint]
            if joint in motion.translating:
                local[:3, 3] = motion.translations[frame, motion.translating.index(joint)]
            world[frame, joint] = local if parent == -1 else world[frame, parent] @ local
    return world


def tolerance(motion: Motion) -> float:
    return 1e-11 * (motion.skeleton.height + float(np.abs(motion.positions).max()))


@given(motions())
def test_positions_and_rotations_equal_the_slow_twin(motion: Motion) -> None:
    world = slow_world_matrices(motion)
    assert_allclose(motion.positions, world[..., :3, 3], rtol=0, atol=tolerance(motion))
    assert_allclose(rot.to_matrix(motion.world_rotations), world[..., :3, :3], rtol=0, atol=1e-11)


@given(motions())
def test_end_sites_equal_the_slow_twin(motion: Motion) -> None:
    world = slow_world_matrices(motion)
    tips = kinematics.end_site_positions(motion)
    assert tips.shape == (len(motion), len(motion.skeleton.end_sites), 3)
    for site, (joint, offset) in enumerate(zip(motion.skeleton.end_sites, motion.skeleton.end_site_offsets)):
        expected = world[:, joint] @ np.append(offset, 1.0)
        assert_allclose(tips[:, site], expected[:, :3], rtol=0, atol=tolerance(motion))


@given(generators())
def test_any_leading_axes(rng: np.random.Generator) -> None:
    """A batch of sequences, a sequence, and a single pose give the same numbers."""
    skeleton = random_skeleton(rng, 7)
    rotations, translations = random_quaternions(rng, 3, 5, 7), rng.normal(size=(3, 5, 7, 3))
    world_rotations, positions = kinematics.forward(skeleton, rotations, translations)
    for batch in range(3):
        sequence = kinematics.forward(skeleton, rotations[batch], translations[batch])
        assert_allclose(world_rotations[batch], sequence[0], atol=0)
        assert_allclose(positions[batch], sequence[1], atol=0)
        for frame in range(5):
            pose = kinematics.forward(skeleton, rotations[batch, frame], translations[batch, frame])
            assert_allclose(positions[batch, frame], pose[1], atol=0)


@given(motions())
def test_bones_keep_their_lengths(motion: Motion) -> None:
    for joint, parent in enumerate(motion.skeleton.parents):
        if parent != -1 and joint not in motion.translating:
            bone = np.linalg.norm(motion.positions[:, joint] - motion.positions[:, parent], axis=-1)
            assert_allclose(bone, np.linalg.norm(motion.skeleton.offsets[joint]), rtol=0, atol=tolerance(motion))


@given(motions())
def test_the_root_and_what_is_below_it(motion: Motion) -> None:
    """A rotation of one joint moves what hangs below it, and nothing else."""
    joint = len(motion.skeleton) // 2
    rotations = motion.rotations.copy()
    rotations[:, joint] = rot.multiply(rotations[:, joint], rot.from_axis_angle(np.array([0.6, 0.0, 0.8]), 1.0))
    moved = motion.replace(rotations=rotations)
    below = set(motion.skeleton.subtree(joint)) - {joint}
    still = [j for j in range(len(motion.skeleton)) if j not in below]
    assert_allclose(moved.positions[:, still], motion.positions[:, still], rtol=0, atol=tolerance(motion))
    assert_allclose(motion.positions[:, 0], motion.local_translations[:, 0], rtol=0, atol=0)


def test_ground_is_below_nearly_everything() -> None:
    rng = np.random.default_rng(4)
    motion = random_motion(rng, random_skeleton(rng, 9), frames=400, translating=(0,))
    ground = kinematics.ground_height(motion)
    lowest = np.minimum(motion.positions[..., 1].min(axis=1), kinematics.end_site_positions(motion)[..., 1].min(axis=1))
    assert 0.01 <= np.mean(lowest < ground) <= 0.03
    lifted = motion.transform(shift=(3.0, 1.5, -2.0))
    assert_allclose(kinematics.ground_height(lifted), ground + 1.5, atol=1e-9)
