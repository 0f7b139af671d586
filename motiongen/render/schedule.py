"""Which frame of which clip is shown when: real time, whatever the clips' rates and lengths."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.motion import Motion

_SLOWEST = 8.0
"""A clip of key frames, one a second perhaps, is still shown at about this many pictures a second."""


def natural_rate(motions: Sequence[Motion], highest: float) -> float:
    """The rate to show clips at: the fastest clip's own, divided so that it is no higher than `highest`.

    Dividing by a whole number shows every n-th frame, evenly: 120 and 60 Hz are shown at 30, 50 Hz at 25. Rates as near
    to a whole number as a file's rounded frame time leaves them are taken for that number.
    """
    fastest = max(motion.frame_rate for motion in motions)
    if abs(fastest - round(fastest)) < 2e-4 * fastest:
        fastest = float(round(fastest))
    rate = fastest / max(1, math.ceil(fastest / highest - 1e-9))
    return rate * max(1, math.floor(_SLOWEST / rate + 1e-9)) if rate < _SLOWEST else rate


def trimmed(motion: Motion, seconds: float | None) -> Motion:
    """The first `seconds` of a motion, or all of it.

    Raises:
        MotionGenError: if `seconds` is not a positive number.
    """
    if seconds is None:
        return motion
    if not seconds > 0:
        raise MotionGenError(f"seconds must be a positive number, not {seconds}; leave it out to show all")
    frames = seconds * motion.frame_rate + 1e-6
    return motion if frames >= len(motion) else motion[: max(1, math.floor(frames))]


def frames_at(motions: Sequence[Motion], frame_rate: float) -> list[NDArray[np.int64]]:
    """For each clip the frames (N,) to show at `frame_rate`: at each moment the frame nearest in time, never a blend.

    N lasts to the end of the longest clip. Where a shorter clip is over, the indices run on past its last frame.
    """
    longest = max(motion.duration for motion in motions)
    times = np.arange(math.floor(longest * frame_rate + 1e-6) + 1) / frame_rate  # (N,)
    return [np.floor(times * motion.frame_rate + 0.5 - 1e-6).astype(np.int64) for motion in motions]
