"""What is wrong with a clip: sliding feet, shaking, jumps, feet in the ground, a loop that does not close."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.contact import contact_labels, foot_heights, foot_joints
from motiongen.motion import METRES_PER_UNIT, Motion

Array = NDArray[np.float64]

SKATE_HEIGHT = 0.015
"""Where a foot joint counts no more as near the ground, in skeleton heights: 2.5 cm on a person (Zhang et al. 2018)."""

SKATE_SPAN_SECONDS = 1 / 30
"""Sliding is measured over steps of about this time, so that the same motion at another rate slides as much."""


@dataclass(frozen=True)
class Quality:
    """Figures of one clip. None: the clip is too short for it, no foot comes near the ground, or the unit is unknown.

    Lengths are in skeleton heights. Captured motion has some of everything: compare a synthesis with its example, at
    one frame rate.

    Attributes:
        foot_skate_heights_per_second: mean horizontal speed of the foot joints while near the ground (`foot_skate`).
        foot_skate_cm_per_second: the same in centimetres, where the clip's unit is known.
        jitter_heights_per_second_cubed: mean size of the third time-derivative of joint positions (`jitter`).
        largest_step_degrees: largest turn of any joint in its parent's frame from one frame to the next.
        largest_step_degrees_frame: the frame that this step leads to.
        largest_step_degrees_joint: the name of the joint.
        largest_step_heights: largest way of any joint through the world from one frame to the next.
        largest_step_heights_frame: the frame that this step leads to.
        largest_step_heights_joint: the name of the joint.
        penetration_heights: how deep the lowest joint or end site comes below the ground (`kinematics.ground_height`).
        contact_ratio: share of the time that a foot joint stands on the ground, averaged over the foot joints.
        seam_degrees: if the clip is to loop, largest turn of any joint from the last frame to the first.
        seam_heights: largest distance of any joint between the last frame and the first.
        seam_heights_per_second: largest difference of any joint's velocity between the last frame and the first. For
            the three seam figures the last frame is first moved over the ground and turned about the up axis to where
            the root of the first one is: a loop may lead somewhere.
    """

    foot_skate_heights_per_second: float | None
    foot_skate_cm_per_second: float | None
    jitter_heights_per_second_cubed: float | None
    largest_step_degrees: float | None
    largest_step_degrees_frame: int | None
    largest_step_degrees_joint: str | None
    largest_step_heights: float | None
    largest_step_heights_frame: int | None
    largest_step_heights_joint: str | None
    penetration_heights: float
    contact_ratio: float | None
    seam_degrees: float | None
    seam_heights: float | None
    seam_heights_per_second: float | None

    def to_dict(self) -> dict[str, float | int | str | None]:
        """The figures by name, ready for JSON."""
        return dataclasses.asdict(self)


def measure_quality(motion: Motion, feet: Sequence[int] | None = None) -> Quality:
    """Measure a clip.

    Args:
        motion: the clip.
        feet: (C,) its foot joints; `motiongen.contact.foot_joints(motion)` by default.

    Raises:
        MotionGenError: if there is no such joint.
    """
    feet = foot_joints(motion) if feet is None else feet
    skate = foot_skate(motion, feet)
    degrees, degrees_frame, degrees_joint = _largest(motion, np.degrees(_turns(motion)))
    heights, heights_frame, heights_joint = _largest(motion, _moves(motion))
    seam_degrees, seam_heights, seam_velocity = _seam(motion)
    labels = contact_labels(motion, feet)
    return Quality(
        foot_skate_heights_per_second=skate,
        foot_skate_cm_per_second=_in_cm(motion, skate),
        jitter_heights_per_second_cubed=jitter(motion),
        largest_step_degrees=degrees,
        largest_step_degrees_frame=degrees_frame,
        largest_step_degrees_joint=degrees_joint,
        largest_step_heights=heights,
        largest_step_heights_frame=heights_frame,
        largest_step_heights_joint=heights_joint,
        penetration_heights=penetration(motion),
        contact_ratio=float(labels.mean()) if labels.size else None,
        seam_degrees=seam_degrees,
        seam_heights=seam_heights,
        seam_heights_per_second=seam_velocity,
    )


def foot_skate(motion: Motion, feet: Sequence[int]) -> float | None:
    """Mean horizontal speed of the foot joints while near the ground, in skeleton heights per second.

    Each step weighs 2 - 2^(h / SKATE_HEIGHT), within 0 and 1 (Zhang et al. 2018, Mode-Adaptive Neural Networks), with h
    the height of the joint over its standing level at the higher end of the step. Height alone decides: where speed did
    too, a slide fast enough would count as a step. A foot that swings low in passing counts, so real motion has skate
    as well.

    Returns:
        The mean, or None for a single frame and where no foot joint comes near the ground.

    Raises:
        MotionGenError: if there is no such joint.
    """
    heights = foot_heights(motion, feet)  # (T, C)
    span = min(max(1, round(SKATE_SPAN_SECONDS * motion.frame_rate)), len(motion) - 1)
    if span == 0:
        return None
    ground = motion.positions[:, list(feet)][..., [0, 2]]  # (T, C, 2)
    moved = np.linalg.norm(ground[span:] - ground[:-span], axis=-1) / motion.skeleton.height
    higher = np.maximum(heights[span:], heights[:-span])
    # Far above the ground the power would overflow; from one SKATE_HEIGHT on the weight is zero anyway.
    weights = np.clip(2 - np.exp2(np.minimum(higher / SKATE_HEIGHT, 1.0)), 0.0, 1.0)
    if not weights.any():
        return None
    return float((weights * moved).sum() / weights.sum() * motion.frame_rate / span)


def jitter(motion: Motion) -> float | None:
    """Mean size of the third time-derivative of joint positions, in skeleton heights per second cubed.

    In the world, not relative to the root: a root that shakes shakes every joint. From neighbouring frames, so that
    no shake hides between them; noise counts the more, the higher the frame rate, so compare clips of one rate.

    Returns:
        The mean over joints and frames, or None for fewer than four frames.
    """
    if len(motion) < 4:
        return None
    third = np.diff(motion.positions, n=3, axis=0) * motion.frame_rate**3
    return float(np.linalg.norm(third, axis=-1).mean() / motion.skeleton.height)


def penetration(motion: Motion) -> float:
    """How deep the lowest joint or end site comes below the ground, in skeleton heights."""
    lowest = motion.positions[..., 1].min()
    if motion.skeleton.end_sites:
        lowest = min(lowest, kinematics.end_site_positions(motion)[..., 1].min())
    return float(max(0.0, kinematics.ground_height(motion) - lowest) / motion.skeleton.height)


def _turns(motion: Motion) -> Array:
    """(T - 1, J) angles in radians of each joint's turn, in its parent's frame, from frame to frame."""
    return rot.angle_between(motion.rotations[:-1], motion.rotations[1:])


def _moves(motion: Motion) -> Array:
    """(T - 1, J) distances of each joint through the world from frame to frame, in skeleton heights."""
    return np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1) / motion.skeleton.height


def _largest(motion: Motion, steps: Array) -> tuple[float | None, int | None, str | None]:
    """The largest of steps (T - 1, J), the frame that it leads to and its joint's name."""
    if len(steps) == 0:
        return None, None, None
    frame, joint = np.unravel_index(int(np.argmax(steps)), steps.shape)
    return float(steps[frame, joint]), int(frame) + 1, motion.skeleton.names[joint]


def _seam(motion: Motion) -> tuple[float | None, float | None, float | None]:
    """Largest turn (degrees), distance (heights) and change of velocity (heights/s) from the last frame to the first.

    Two frames have a pose gap but only one velocity; three are needed for its change.
    """
    if len(motion) < 2:
        return None, None, None
    root, world = motion.root, motion.world_rotations
    apart = rot.multiply(world[-1, root], rot.inverse(world[0, root]))
    back = rot.inverse(rot.heading(apart))  # turns the last frame to the first one's heading
    turns = rot.angle_between(motion.rotations[0], motion.rotations[-1])  # (J,)
    turns[root] = rot.angle_between(rot.multiply(back, apart), rot.IDENTITY)
    turns[list(motion.skeleton.ancestors(root))] = 0.0  # the root's world rotation has them in it
    body = motion.positions[:, list(motion.skeleton.subtree(root))]  # without what stands still above the root
    over_ground = motion.root_positions[:, None] * np.array([1.0, 0.0, 1.0])
    first, last = body[0] - over_ground[0], rot.rotate(back, body[-1] - over_ground[-1])
    degrees, height = float(np.degrees(turns.max())), motion.skeleton.height
    gap = float(np.linalg.norm(last - first, axis=-1).max() / height)
    if len(motion) < 3:
        return degrees, gap, None
    change = rot.rotate(back, body[-1] - body[-2]) - (body[1] - body[0])
    return degrees, gap, float(np.linalg.norm(change, axis=-1).max() / height * motion.frame_rate)


def _in_cm(motion: Motion, heights: float | None) -> float | None:
    if heights is None or motion.unit is None:
        return None
    return heights * motion.skeleton.height * METRES_PER_UNIT[motion.unit] * 100
