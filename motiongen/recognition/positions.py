"""Motions as joint positions that do not tell where in the world they were."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen.datasets import Dataset, EntityLayout

Floats = NDArray[np.float32]

GROUND_PERCENTILE = 2
"""Of the lowest joint's height over time; as in `kinematics.ground_height`."""

PLACED_AT_ONCE = 64
"""Windows that forward kinematics runs over together: more take memory and are no faster."""


def positions_of(windows: NDArray[Any], layout: EntityLayout) -> Floats:
    """(B, T, J, 3) joint positions, in skeleton heights, of windows (B, T, E, 4) of entities; the root sets off at 0.

    Args:
        windows: as `Dataset.batch` gives them, not standardised.
        layout: which entity is what.
    """
    starts = range(0, max(1, len(windows)), PLACED_AT_ONCE)
    return np.concatenate([_positions_of(windows[start : start + PLACED_AT_ONCE], layout) for start in starts])


def window_positions(dataset: Dataset, windows: NDArray[np.int64]) -> Floats:
    """(B, T, J, 3) the same of a dataset's windows (B, 2), as `Dataset.draw` gives them."""
    return positions_of(dataset.batch(windows, standardised=False), dataset.layout)


def _positions_of(windows: NDArray[Any], layout: EntityLayout) -> Floats:
    windows = np.asarray(windows, dtype=np.float64)
    rotations = windows[:, :, layout.joints]
    rotations = rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)
    steps = windows[:, :, layout.root, :3].copy()
    steps[:, 0] = 0.0
    offsets = layout.skeleton.offsets / layout.skeleton.height
    translations = np.broadcast_to(offsets, (*rotations.shape[:-1], 3)).copy()
    translations[:, :, 0] = steps.cumsum(axis=1)
    return kinematics.forward(layout.skeleton, rotations, translations)[1].astype(np.float32)


def first_poses(positions: NDArray[Any]) -> NDArray[np.float64]:
    """(B, J, 3) the first frame of positions (B, T, J, 3), seen from the root."""
    first = np.asarray(positions[:, 0], dtype=np.float64)
    return first - first[:, :1]


def placed(positions: NDArray[Any], reference: NDArray[Any]) -> Floats:
    """Positions (B, T, J, 3) brought to one place: the ground at 0, the root's start over the origin, facing ahead.

    A motion faces ahead when, turned about the up axis, its first pose comes closest to `reference`. No names of joints
    are needed for that, so it works on any skeleton.

    Args:
        positions: in skeleton heights.
        reference: (J, 3) usual first pose, seen from the root, of motions that face ahead.
    """
    poses = first_poses(positions)
    x, z, reference_x, reference_z = poses[..., 0], poses[..., 2], reference[:, 0], reference[:, 2]
    angles = np.arctan2(x @ -reference_z + z @ reference_x, x @ reference_x + z @ reference_z)  # (B,)
    cosine, sine = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    moved = np.asarray(positions, dtype=np.float64) - positions[:, :1, :1]  # (B, T, J, 3)
    ground = np.percentile(positions[..., 1].min(axis=2), GROUND_PERCENTILE, axis=1)  # (B,)
    return np.stack(
        [
            cosine * moved[..., 0] + sine * moved[..., 2],
            positions[..., 1] - ground[:, None, None],
            cosine * moved[..., 2] - sine * moved[..., 0],
        ],
        axis=-1,
    ).astype(np.float32)
