"""The attributes that come along. Lengths are in skeleton heights, angles in radians, means are over time."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.attributes.registry import attribute
from motiongen.attributes.roles import SIDES, ankles, arm, trunk
from motiongen.errors import MotionGenError
from motiongen.kinematics import ground_height
from motiongen.motion import Motion
from motiongen.stance import facing

Array = NDArray[np.float64]

WINDOW, STRIDE = 8, 4
"""Frames over which angles are averaged, and from one window to the next (appendix C.2)."""


@attribute("gral", "gradual right arm lift: share of windows over which the arm rises, 0 to 1")
def gral(motion: Motion) -> float:
    """Appendix C.2, with the angle of a joint taken as how far its bone has been lifted from straight down.

    The angle of a rotation by itself is measured from the rest pose, and tells whether an arm goes up only on a rig
    whose arms hang in it (see `gral_rotation`). The lift of upper arm and forearm means the same on every rig, and has
    the property that the paper names: all increases is an arm that goes up, none one that goes down.
    """
    joints = arm(motion.skeleton, "right")
    upper = _lift(motion, joints.shoulder, joints.elbow)
    fore = _lift(motion, joints.elbow, joints.hand)
    return _share_of_increases(np.stack([upper, fore], axis=1))


@attribute("gral_rotation", "gradual right arm lift by the rotation angles of shoulder and elbow, 0 to 1")
def gral_rotation(motion: Motion) -> float:
    """Appendix C.2 to the letter: angles, 0 to pi, of the joints' rotations in their parents' frames."""
    joints = arm(motion.skeleton, "right")
    return _share_of_increases(rot.angle_between(motion.rotations[:, [joints.shoulder, joints.elbow]], rot.IDENTITY))


@attribute("verticality", "how upright the trunk is: 1 standing, 0 lying, -1 on the hands")
def verticality(motion: Motion) -> float:
    """Mean height of the chest over the hips, in lengths of what is between them."""
    hips, chest = trunk(motion)
    along = motion.positions[:, chest] - motion.positions[:, hips]
    return float((along[:, 1] / np.linalg.norm(along, axis=-1)).mean())


@attribute("speed", "mean speed of the hips over the ground, in heights per second")
def speed(motion: Motion) -> float:
    """The way of the root over the ground by the time that it takes."""
    steps = np.diff(_moving(motion).root_positions[:, [0, 2]], axis=0)
    return float(np.linalg.norm(steps, axis=-1).sum() / (motion.duration * motion.skeleton.height))


@attribute("activity", "mean speed of all joints beside the hips, in heights per second")
def activity(motion: Motion) -> float:
    """How much the limbs move, whether or not the body gets anywhere."""
    beside = _moving(motion).positions - motion.root_positions[:, None]
    steps = np.linalg.norm(np.diff(beside, axis=0), axis=-1)  # (T - 1, J)
    return float(steps.mean() * motion.frame_rate / motion.skeleton.height)


@attribute("turning", "mean speed of turning about the up axis, to the left, in radians per second")
def turning(motion: Motion) -> float:
    """Turns of the root from frame to frame, added up, by the time that they take."""
    roots = _moving(motion).world_rotations[:, motion.root]
    turns = rot.heading(rot.multiply(roots[1:], rot.inverse(roots[:-1])))
    return float(rot.to_rotation_vector(turns)[:, 1].sum() / motion.duration)


@attribute("right_elbow_angle", "mean angle between right upper arm and forearm, pi for a straight arm, in radians")
def right_elbow_angle(motion: Motion) -> float:
    """By the places of the joints, so that the axes of the rig do not matter."""
    joints = arm(motion.skeleton, "right")
    upper = motion.positions[:, joints.shoulder] - motion.positions[:, joints.elbow]
    fore = motion.positions[:, joints.hand] - motion.positions[:, joints.elbow]
    across = np.linalg.norm(np.cross(upper, fore), axis=-1)
    return float(np.arctan2(across, (upper * fore).sum(axis=-1)).mean())


@attribute("hand_height", "mean height of both hands over the ground, in heights")
def hand_height(motion: Motion) -> float:
    """Wrists, over the ground where the clip's lowest joints stand."""
    hands = [arm(motion.skeleton, side).hand for side in SIDES]
    return float((motion.positions[:, hands, 1].mean() - ground_height(motion)) / motion.skeleton.height)


@attribute("hand_spread", "mean distance between the hands, in heights")
def hand_spread(motion: Motion) -> float:
    """From wrist to wrist."""
    left, right = (motion.positions[:, arm(motion.skeleton, side).hand] for side in SIDES)
    return float(np.linalg.norm(left - right, axis=-1).mean() / motion.skeleton.height)


@attribute("hip_height", "mean height of the hips over the ground, in heights")
def hip_height(motion: Motion) -> float:
    """Of the root, over the ground where the clip's lowest joints stand."""
    return float((motion.root_positions[:, 1].mean() - ground_height(motion)) / motion.skeleton.height)


@attribute("step_length", "how far one foot gets before the other, in heights")
def step_length(motion: Motion) -> float:
    """Half the span, over the clip, of how far the left ankle is before the right one, as the body faces."""
    return float(np.ptp(_between_feet(motion)[:, 2]) / 2)


@attribute("stance_width", "mean distance between the feet across the way that the body faces, in heights")
def stance_width(motion: Motion) -> float:
    """Of the left ankle to the left of the right one; negative where legs are crossed."""
    return float(_between_feet(motion)[:, 0].mean())


def _lift(motion: Motion, joint: int, tip: int) -> Array:
    """(T,) the angle between straight down and the bone from `joint` to `tip`: 0 hanging, pi pointing up."""
    bone = motion.positions[:, tip] - motion.positions[:, joint]
    return np.arctan2(np.linalg.norm(bone[:, [0, 2]], axis=-1), -bone[:, 1])


def _share_of_increases(angles: Array) -> float:
    """Share of windows (Eq. 12, 13) with a larger mean than the one before, over all columns of angles (T, N).

    There are T / 4 windows, so that the last one is cut by the end of the clip.
    """
    starts = range(0, len(angles) // STRIDE * STRIDE, STRIDE)
    if len(starts) < 2:
        raise MotionGenError(f"windows of {WINDOW} frames need {2 * STRIDE} frames at least; {len(angles)} came")
    means = np.stack([angles[start : start + WINDOW].mean(axis=0) for start in starts])  # (T / 4, N)
    return float((np.diff(means, axis=0) > 0).mean())


@functools.lru_cache(maxsize=1)  # more than one attribute of a motion wants it
def _between_feet(motion: Motion) -> Array:
    """(T, 3) from the right ankle to the left one as the body faces: to its left, up, ahead; in heights."""
    left, right = ankles(motion)
    apart = motion.positions[:, left] - motion.positions[:, right]
    return rot.rotate(rot.inverse(facing(motion)), apart) / motion.skeleton.height


def _moving(motion: Motion) -> Motion:
    """The motion, if it has the two frames that a speed needs."""
    if len(motion) < 2:
        raise MotionGenError(f"'{motion.name}' has one frame; a speed needs two at least")
    return motion
