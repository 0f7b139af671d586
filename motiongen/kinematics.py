"""Forward kinematics: from local rotations and translations to where the joints are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.skeleton import Skeleton

if TYPE_CHECKING:
    from motiongen.motion import Motion

Array = NDArray[np.float64]


def forward(skeleton: Skeleton, rotations: Array, translations: Array) -> tuple[Array, Array]:
    """World rotations and positions of all joints.

    Args:
        skeleton: the tree; its offsets are not read, `translations` holds them.
        rotations: (..., J, 4) local rotations, xyzw.
        translations: (..., J, 3) local translations, one for each joint.

    Returns:
        World rotations (..., J, 4) and world positions (..., J, 3).
    """
    world_rotations = np.empty(rotations.shape)
    world_positions = np.empty((*rotations.shape[:-1], 3))
    world_rotations[..., 0, :] = rotations[..., 0, :]
    world_positions[..., 0, :] = translations[..., 0, :]
    # One level of the tree at a time: few, large array operations, whatever the number of joints.
    for level in skeleton.levels[1:]:
        joints = list(level)
        parents = [skeleton.parents[j] for j in joints]
        parent_rotations = world_rotations[..., parents, :]
        world_rotations[..., joints, :] = rot.multiply(parent_rotations, rotations[..., joints, :])
        world_positions[..., joints, :] = (
            rot.rotate(parent_rotations, translations[..., joints, :]) + world_positions[..., parents, :]
        )
    return world_rotations, world_positions


def forward_chain(rotations: Array, translations: Array) -> tuple[Array, Array]:
    """World rotation (T, 4) and position (T, 3) of the last joint of a chain that starts at the root.

    Args:
        rotations: (T, N, 4) local rotations of the chain's joints, root first.
        translations: (T, N, 3) their local translations.
    """
    rotation, position = rotations[:, 0], translations[:, 0]
    for joint in range(1, rotations.shape[1]):
        position = position + rot.rotate(rotation, translations[:, joint])
        rotation = rot.multiply(rotation, rotations[:, joint])
    return rotation, position


def end_site_positions(motion: Motion) -> Array:
    """(T, S, 3) world positions of the end sites, in the order of `skeleton.end_sites`."""
    joints = list(motion.skeleton.end_sites)
    turned = rot.rotate(motion.world_rotations[:, joints], motion.skeleton.end_site_offsets)
    return turned + motion.positions[:, joints]


def ground_height(motion: Motion) -> float:
    """Height of the ground: the 2nd percentile over time of the lowest joint or end site."""
    heights = np.concatenate([motion.positions[..., 1], end_site_positions(motion)[..., 1]], axis=1)  # (T, J + S)
    return float(np.percentile(heights.min(axis=1), 2))
