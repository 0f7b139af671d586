"""What an import is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from motiongen.datasets.labels import LabelPattern
from motiongen.errors import MotionGenError
from motiongen.motion import METRES_PER_UNIT, UP_AXES


@dataclass(frozen=True)
class ImportSettings:
    """How clips become a dataset. All of it is kept in the dataset and counts towards its fingerprint.

    Attributes:
        joints: names or shell-style patterns of the joints to keep; none: all from the root down.
        frame_rate: in Hz, what clips are resampled to.
        frames: length of a window; shorter clips are dropped.
        stride: frames from one window of a clip to the next.
        labels: pattern that takes labels out of file names (see `LabelPattern`), or None.
        held_back: share of the clips that is kept out of training, at least 0 and below 1.
        up: up axis of the files; None: found out for each.
        unit: length unit of the files; None: guessed.

    Raises:
        MotionGenError: if a value is out of range.
    """

    joints: tuple[str, ...] = ()
    frame_rate: float = 30.0
    frames: int = 64
    stride: int = 32
    labels: str | None = None
    held_back: float = 0.1
    up: str | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        object.__setattr__(self, "joints", tuple(self.joints))
        if not (math.isfinite(self.frame_rate) and self.frame_rate > 0):
            raise MotionGenError(f"frame_rate must be a positive number of Hz, not {self.frame_rate}")
        object.__setattr__(self, "frame_rate", float(self.frame_rate))
        for name, least in (("frames", 2), ("stride", 1)):
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise MotionGenError(f"{name} must be a whole number of at least {least}, not {value}")
        if not 0 <= self.held_back < 1:
            raise MotionGenError(f"held_back must be a share of at least 0 and below 1, not {self.held_back}")
        if self.up is not None and self.up not in UP_AXES:
            raise MotionGenError(f"up must be 'y' or 'z', or left out to find it out, not '{self.up}'")
        if self.unit is not None and self.unit not in METRES_PER_UNIT:
            raise MotionGenError(f"unit must be one of {', '.join(METRES_PER_UNIT)}, or left out, not '{self.unit}'")
        if self.labels is not None:
            LabelPattern(self.labels)
