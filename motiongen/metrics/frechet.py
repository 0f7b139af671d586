"""How far one set of motions is from another, without labels and without a trained network.

The Fréchet distance (Heusel et al. 2017) between Gaussians fitted to plain descriptors of the motions: over time, mean
and deviation of where the joints are, as seen from the root, and mean size of their velocities. It follows a training
from one checkpoint to the next; a distance of features that a recogniser has learned says more about content.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.stance import facing

Array = NDArray[np.float64]


def descriptors(motions: Sequence[Motion]) -> Array:
    """(N, 7 J) descriptors: (3 J) mean and (3 J) deviation of the joints over time, and (J,) their mean speeds.

    Places are seen from the root, turned to its heading, in skeleton heights; speeds are in heights per second.

    Raises:
        MotionGenError: if a motion is a single frame.
    """
    rows = []
    for motion in motions:
        if len(motion) < 2:
            raise MotionGenError(f"'{motion.name}' has a single frame, which does not move; two are needed")
        places = motion.positions - motion.root_positions[:, None]
        seen = rot.rotate(rot.inverse(facing(motion))[:, None], places) / motion.skeleton.height
        speeds = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1) * motion.frame_rate / motion.skeleton.height
        rows.append(np.concatenate([seen.mean(axis=0).ravel(), seen.std(axis=0).ravel(), speeds.mean(axis=0)]))
    return np.array(rows)


def frechet_distance(a: Array, b: Array) -> float:
    """|mean a - mean b|^2 + trace(A + B - 2 (A B)^1/2) of the Gaussians of (N, D) and (M, D) descriptors.

    Raises:
        MotionGenError: if either has fewer than two rows, or they have different columns.
    """
    if min(len(a), len(b)) < 2 or a.shape[1] != b.shape[1]:
        raise MotionGenError(f"two sets of two motions or more of one kind are needed, not {a.shape} and {b.shape}")
    in_a, in_b = (np.atleast_2d(np.cov(rows, rowvar=False)) for rows in (a, b))
    root_a = _square_root(in_a)
    # (A B)^1/2 has the trace of (A^1/2 B A^1/2)^1/2, which is symmetric and needs no complex numbers.
    middle = np.linalg.eigvalsh(root_a @ in_b @ root_a)
    spread = in_a.trace() + in_b.trace() - 2 * np.sqrt(middle.clip(min=0)).sum()
    return float(((a.mean(axis=0) - b.mean(axis=0)) ** 2).sum() + max(spread, 0.0))


def _square_root(symmetric: Array) -> Array:
    values, axes = np.linalg.eigh(symmetric)
    return (axes * np.sqrt(values.clip(min=0))) @ axes.T
