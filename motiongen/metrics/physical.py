"""What a set of motions does that a body cannot: feet that slide, shaking, bones that stretch, feet in the ground."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.quality import foot_skate, jitter, penetration


@dataclass(frozen=True)
class Physical:
    """Means over a set of motions; None where none of them is long enough, or no foot comes near the ground.

    Attributes:
        foot_skate_heights_per_second: see `quality.foot_skate`.
        jitter_heights_per_second_cubed: see `quality.jitter`.
        penetration_heights: see `quality.penetration`.
        bone_stretch: largest deviation of a bone's length over time, as a share of its mean; 0 where a motion is made
            of rotations, but for joints whose translation is animated.
    """

    foot_skate_heights_per_second: float | None
    jitter_heights_per_second_cubed: float | None
    penetration_heights: float
    bone_stretch: float

    def to_dict(self) -> dict[str, float | None]:
        """The figures by name, ready for JSON."""
        return dataclasses.asdict(self)


def measure_physical(motions: Sequence[Motion], feet: Sequence[int]) -> Physical:
    """Measure a set of motions of one skeleton.

    Args:
        motions: at one frame rate, or jitter says nothing.
        feet: the foot joints.

    Raises:
        MotionGenError: if there is no motion.
    """
    if not motions:
        raise MotionGenError("physical figures need at least one motion; none came")
    return Physical(
        foot_skate_heights_per_second=_mean([foot_skate(motion, feet) for motion in motions]),
        jitter_heights_per_second_cubed=_mean([jitter(motion) for motion in motions]),
        penetration_heights=float(np.mean([penetration(motion) for motion in motions])),
        bone_stretch=float(np.mean([bone_stretch(motion) for motion in motions])),
    )


def bone_stretch(motion: Motion) -> float:
    """Largest deviation over time of a bone's length, as a share of its mean; bones without length do not count."""
    children = list(range(1, len(motion.skeleton)))
    bones = motion.positions[:, children] - motion.positions[:, [motion.skeleton.parents[j] for j in children]]
    lengths = np.linalg.norm(bones, axis=-1)  # (T, J - 1)
    mean = lengths.mean(axis=0)
    there = mean > 1e-6 * motion.skeleton.height
    return float((lengths[:, there].std(axis=0) / mean[there]).max(initial=0.0))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
