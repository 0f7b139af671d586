"""Foot clean-up by inverse kinematics: feet that stand stay where they stand. For any skeleton."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen import rotations as rot
from motiongen.contact import contact_labels, foot_heights, foot_joints
from motiongen.errors import MotionGenError
from motiongen.ik.footprints import GAP_SECONDS, displacements, fill_gaps
from motiongen.ik.legs import Legs, find_legs
from motiongen.ik.solve import KNEE_SECONDS, knee_axes, solve_legs
from motiongen.ik.targets import lowering, place_feet, reach_of, shortened, within_reach
from motiongen.motion import Motion

__all__ = ["clean_feet"]

Array = NDArray[np.float64]
Labels = NDArray[np.bool_]

BLEND_SECONDS = 0.25
"""How long a foot takes to ease into a footprint, and out of it."""

LARGEST_DROP = 0.03
"""How far the root is lowered at most for a foot to reach its footprint, in skeleton heights: 5 cm on a person."""

LARGEST_MOVE = 0.05, 0.1
"""A foot moves freely up to the first distance, and never past the second, in skeleton heights."""

GROUND = (0, 2)

_UP = np.array([0.0, 1.0, 0.0])


def clean_feet(
    motion: Motion,
    feet: Sequence[int] | None = None,
    labels: ArrayLike | None = None,
    steps: ArrayLike | None = None,
    *,
    blend_seconds: float = BLEND_SECONDS,
    largest_drop: float = LARGEST_DROP,
) -> Motion:
    """The motion with feet that do not slide while they stand.

    Heel and toe of a foot get one footprint for each stance, where they are on average while they stand, and ease into
    it and out of it. Over the ground they stay there; their heights remain, for a foot rolls, but a stance that floats
    or sinks as a whole is brought to the ground. Knees bend and hips swing as much as that takes, knees about the axis
    that they bend about anyway, and the feet keep their orientation, but for a turn of some degrees between heel and
    toe. Where a leg is too short, the root is lowered a little; where that is not enough, and where a stance slides
    far (a foot is moved by no more than a tenth of the skeleton's height), the foot slips.

    What is changed: the rotations of hips, knees and foot joints, and the root's height, in and around stances. All
    other frames and joints are kept bit for bit, and so is the whole motion if nothing stands.

    Args:
        motion: the clip.
        feet: (C,) its foot joints; `motiongen.contact.foot_joints(motion)` by default.
        labels: (T, C) whether each of them stands in each frame; by default `motiongen.contact.contact_labels(motion,
            feet)`, which takes a foot that slides fast for one that swings. A synthesis may know better.
        steps: (T, C, 2) how far each of them moves over the ground (x, z) since the frame before while it stands, in
            skeleton heights: a footprint then moves along, and all heights stay as they are. By default it rests. A
            synthesis gives the steps of its example here, and is changed only where it does not follow them.
        blend_seconds: how long a foot takes to ease into a footprint, and out of it.
        largest_drop: how far the root is lowered at most, in skeleton heights; 0 keeps it as it is.

    Raises:
        MotionGenError: if there is no such joint, one comes twice, the labels have another shape or are no labels, the
            steps have another shape, or a setting is negative.
    """
    feet = tuple(foot_joints(motion) if feet is None else (int(joint) for joint in feet))
    _check(feet, blend_seconds, largest_drop)
    heights = foot_heights(motion, feet)  # refuses joints that do not exist
    stands = contact_labels(motion, feet) if labels is None else _checked_labels(labels, heights.shape)
    legs = find_legs(motion, feet)
    contact = fill_gaps(np.where(legs.label >= 0, stands[:, legs.label], False), GAP_SECONDS * motion.frame_rate)
    if not contact.any():
        return motion
    heights = heights[:, legs.label]
    slid = np.zeros((*heights.shape, 3))  # where the feet have got to by themselves
    if steps is not None:
        own = _checked_steps(steps, stands.shape)[:, legs.label]
        slid[..., GROUND] = np.where((legs.label >= 0)[:, None], np.cumsum(own, axis=0), 0.0)
        heights = np.zeros_like(heights)
    return _clean(motion, legs, contact, heights, slid, blend_seconds * motion.frame_rate, largest_drop)


def _clean(
    motion: Motion, legs: Legs, contact: Labels, heights: Array, slid: Array, blend: float, largest_drop: float
) -> Motion:
    """`clean_feet` from labels (T, K), heights over the ground (T, K) and own ways (T, K, 3) of all foot joints."""
    positions = motion.positions / motion.skeleton.height
    feet, hips, ankles = positions[:, legs.feet], positions[:, legs.hips], positions[:, legs.ankles]
    upper, lower = positions[:, legs.knees] - hips, ankles - positions[:, legs.knees]
    moves, hold = displacements(feet - slid, heights, contact, legs, blend)
    turns, targets = place_feet(feet, feet + shortened(moves, *LARGEST_MOVE), hold, legs)

    standing = (hold[:, :, None] * legs.foot).max(axis=1)  # (T, L)
    reach = reach_of(upper, lower)
    drop = lowering(hips, targets, reach, standing, largest_drop, max(1, round(blend)))  # (T,)
    way = within_reach(targets - hips + drop[:, None, None] * _UP, upper + lower, reach)
    axes = knee_axes(upper, lower, motion.world_rotations[:, legs.hips], _forward(feet, legs))
    moved = (moves.any(axis=-1) @ legs.foot) | (drop > 0)[:, None]  # (T, L)
    bend, swing = solve_legs(upper, lower, axes, way, moved, round(KNEE_SECONDS * motion.frame_rate))
    moved |= bend[..., :3].any(axis=-1)
    translating, translations = _lowered(motion, drop * motion.skeleton.height)
    return motion.replace(
        rotations=_turned(motion, legs, bend, swing, turns, moved), translations=translations, translating=translating
    )


def _turned(motion: Motion, legs: Legs, bend: Array, swing: Array, turns: Array, moved: Labels) -> Array:
    """(T, J, 4) local rotations with the legs' joints turned in the world, where they moved.

    Args:
        motion: the clip.
        legs: its legs.
        bend: (T, L, 4) turns of the knees, before those of the hips.
        swing: (T, L, 4) turns of the hips.
        turns: (T, K, 4) turns of the foot joints.
        moved: (T, L) which legs moved; all others are kept bit for bit.
    """
    world, rotations = motion.world_rotations, motion.rotations.copy()

    def turn(joints: NDArray[np.intp], by: Array, above: Array, where: Labels) -> None:
        """Turn joints by `by` in the world, below parents that are turned by `above`, (T, n, 4) each."""
        parents = np.array(motion.skeleton.parents)[joints]
        local = rot.multiply(rot.inverse(rot.multiply(above, world[:, parents])), rot.multiply(by, world[:, joints]))
        rotations[:, joints] = np.where(where[..., None], local, rotations[:, joints])

    shin = rot.multiply(swing, bend)
    turn(legs.hips, swing, np.broadcast_to(rot.IDENTITY, swing.shape), moved)
    turn(legs.knees, shin, swing, moved)
    above_feet = np.where((legs.above >= 0)[:, None], turns[:, legs.above], shin[:, legs.leg])
    turn(legs.feet, turns, above_feet, moved[:, legs.leg])
    return rotations


def _lowered(motion: Motion, drop: Array) -> tuple[tuple[int, ...], Array]:
    """Which joints translate, and their translations (T, M, 3), with the root lower by `drop` (T,), in the unit."""
    if not drop.any():
        return motion.translating, motion.translations
    root, parent = motion.root, motion.skeleton.parents[motion.root]
    down = -drop[:, None] * _UP
    if parent != -1:
        down = rot.rotate(rot.inverse(motion.world_rotations[:, parent]), down)
    translating = tuple(sorted({root, *motion.translating}))
    translations = motion.local_translations[:, translating].copy()
    translations[drop > 0, translating.index(root)] += down[drop > 0]
    return translating, translations


def _forward(feet: Array, legs: Legs) -> Array:
    """(T, L, 3) where each foot points, from the ankle to what hangs on it; nowhere for one of a single joint."""
    hangs = legs.above >= 0
    return np.einsum("tkx,kl->tlx", (feet - feet[:, legs.above]) * hangs[:, None], legs.foot)


def _check(feet: Sequence[int], blend_seconds: float, largest_drop: float) -> None:
    if len(set(feet)) != len(feet):
        raise MotionGenError(f"each foot joint is to be given once; joint {max(feet, key=feet.count)} came twice")
    for name, value in (("blend_seconds", blend_seconds), ("largest_drop", largest_drop)):
        if not (math.isfinite(value) and value >= 0):
            raise MotionGenError(f"{name} must be zero or a positive number, not {value}")


def _checked_steps(steps: ArrayLike, shape: tuple[int, ...]) -> Array:
    given = np.asarray(steps, dtype=np.float64)
    if given.shape != (*shape, 2):
        raise MotionGenError(
            f"steps must have shape {(*shape, 2)}, an x and a z for each frame and foot joint, not {given.shape}"
        )
    return given


def _checked_labels(labels: ArrayLike, shape: tuple[int, ...]) -> Labels:
    given = np.asarray(labels)
    if given.shape != shape:
        raise MotionGenError(
            f"labels must have shape {shape}, a row for each frame and a column for each foot joint, not {given.shape}"
        )
    if not np.isin(given, (0, 1)).all():
        raise MotionGenError("labels must be true or false, or 1 or 0; compare what lies between with 0.5 first")
    return given.astype(bool)
