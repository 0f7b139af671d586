"""Which way a character faces, and how it stands on average, whatever the axes of its rig mean.

A rig's rest pose need not be a pose: in some files all bones lie along one axis. What the character does says more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.mirror import counterparts
from motiongen.motion import Motion

Array = NDArray[np.float64]

APART = 0.02
"""A left and a right joint show which way is left where they are this far apart on average, in skeleton heights."""

TRAVEL = 0.5
"""A character without sides faces the way it goes where it goes this far, in skeleton heights."""


def facing(motion: Motion) -> Array:
    """(T, 4) turns about the up axis (y) that take +z to where the body faces, with its left on the left hand.

    Left is where the left ones of the pairs of joints are, seen from the root, on average over the clip. Without pairs
    the body faces the way it goes, and if it stays where it is, along the z axis of its root, or of its x axis where
    that one lies flatter.
    """
    return rot.heading(rot.multiply(motion.world_rotations[:, motion.root], _body_frame(motion)))


def stance(motions: Sequence[Motion]) -> Array:
    """(J, 4) mean world rotation of each joint while the body is turned to face +z: how the character stands.

    Args:
        motions: clips of one skeleton; every frame counts the same.

    Raises:
        MotionGenError: if no motion came.
    """
    if not motions:
        raise MotionGenError("stance needs at least one motion; none came")
    turned = [rot.multiply(rot.inverse(facing(m))[:, None], m.world_rotations) for m in motions]  # (T, J, 4) each
    # The mean rotation maximises the sum of squared dot products: the main axis of the quaternions (Markley 2007).
    scatter = sum(np.einsum("tja,tjb->jab", q, q) for q in turned)
    return np.linalg.eigh(scatter)[1][..., -1]


def _body_frame(motion: Motion) -> Array:
    """(4,) from axes of the body (x to its left, y up, z ahead) to the root's own."""
    to_root = rot.inverse(motion.world_rotations[:, motion.root])  # (T, 4)
    up = rot.rotate(to_root, np.array([0.0, 1.0, 0.0])).mean(axis=0)
    up = _unit(up) if np.linalg.norm(up) > 0.1 else np.array([0.0, 1.0, 0.0])  # it rolls: any axis is as good
    left = _across(motion, to_root)
    if left is None:
        left = np.cross(up, _ahead(motion, to_root, up))
    left = left - left @ up * up
    if np.linalg.norm(left) < 1e-6:  # one above the other
        left = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    left = _unit(left)
    return rot.from_matrix(np.stack([left, up, np.cross(left, up)], axis=-1))


def _across(motion: Motion, to_root: Array) -> Array | None:
    """(3,) mean direction from right to left in the root's frame, from the inmost pairs of each pair of limbs."""
    skeleton = motion.skeleton
    try:
        pairs = counterparts(skeleton)
    except MotionGenError:
        return None
    total, seen = np.zeros(3), set()
    for joint, pair in enumerate(pairs):
        if skeleton.parents[joint] in seen:
            seen.add(joint)  # further out, where limbs swing
        elif is_left(skeleton.names[joint], skeleton.names[pair]):
            across = rot.rotate(to_root, motion.positions[:, joint] - motion.positions[:, pair]).mean(axis=0)
            if np.linalg.norm(across) > APART * skeleton.height:
                seen.add(joint)
                total += _unit(across)
    return total if np.linalg.norm(total) > 0.1 else None


def is_left(name: str, other: str) -> bool:
    """Whether `name` is the left one of a pair of names: where they first differ it has an l."""
    return next((a for a, b in zip(name.lower(), other.lower()) if a != b), "") == "l"


def _ahead(motion: Motion, to_root: Array, up: Array) -> Array:
    """(3,) the way ahead of a character without sides, in its root's frame."""
    steps = np.diff(motion.root_positions, axis=0) * np.array([1.0, 0.0, 1.0])
    going = rot.rotate(to_root[:-1], steps).sum(axis=0)
    if np.linalg.norm(going - going @ up * up) > TRAVEL * motion.skeleton.height:
        return going
    return np.eye(3)[2 if abs(up[2]) <= abs(up[0]) else 0]


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
