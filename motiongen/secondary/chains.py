"""What hangs from a character and swings, and what pushes it away."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.skeleton import frozen_array

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chain:
    """A row of N new joints that hangs from one joint.

    Attributes:
        name: its joints are called this with 1 to N behind.
        anchor: name of the joint that it hangs from, of the clip or of another chain.
        offset: (3,) where its first joint sits in the anchor's frame.
        bones: (N, 3) its rest shape in the anchor's frame: from each joint to the next, from the last to its tip.
        hertz: how fast the chain springs back into its rest shape, into however many bones its length is divided.
        damping: share of the critical damping, at least 0.7: with less, bones swell what shakes the one above, and the
            tip of a long chain lashes about.
        drag: share of its speed through the air that is lost a second.
        weight: share of gravity that it feels; 0: it stays in its rest shape where the anchor stands still.
        bend: how far a bone follows the bend of the one above: 1 as in a rod, 0 not at all.
        beside: names of the chains next to it in a cloth.
        cloth: how far its bones follow the bends of those beside it rather than of its own bone above, 0 to 1.
        collides: whether capsules push it away.
        drive: (T, 4) how its rest shape is turned about its first joint, in the anchor's frame; None: not at all.

    Raises:
        MotionGenError: if a bone has no length or a number is out of range.
    """

    name: str
    anchor: str
    offset: Array
    bones: Array
    hertz: float = 1.5
    damping: float = 0.8
    drag: float = 0.5
    weight: float = 0.3
    bend: float = 0.9
    beside: tuple[str, ...] = ()
    cloth: float = 0.0
    collides: bool = False
    drive: Array | None = None

    def __post_init__(self) -> None:
        """Check and freeze."""
        object.__setattr__(self, "offset", frozen_array(self.offset, (3,), f"offset of chain '{self.name}'"))
        bones = frozen_array(self.bones, (-1, 3), f"bones of chain '{self.name}'")
        if len(bones) == 0 or np.linalg.norm(bones, axis=-1).min() == 0:
            raise MotionGenError(f"chain '{self.name}' needs at least one bone, and all of some length")
        object.__setattr__(self, "bones", bones)
        ranges = {"bend": (0.0, 1.0), "cloth": (0.0, 1.0), "damping": (0.7, math.inf)}
        for what in ("hertz", "damping", "drag", "weight", "bend", "cloth"):
            value, (low, high) = getattr(self, what), ranges.get(what, (0.0, math.inf))
            if not (math.isfinite(value) and low <= value <= high):
                allowed = f"at least {low:g}" if high == math.inf else f"from {low:g} to {high:g}"
                raise MotionGenError(f"{what} of chain '{self.name}' must be {allowed}, not {value}")

    @property
    def radians_per_second(self) -> float:
        """How fast each bone must spring back for the whole chain to do so at `hertz`.

        A pull on all bones bends each by 1 / (frequency² bone length), and a bone passes its bend on to those below.
        """
        count, bend = len(self.bones), self.bend
        followers = count if bend == 1 else (1 - bend**count) / (1 - bend)
        return 2 * math.pi * self.hertz * math.sqrt(count * followers)

    @property
    def joints(self) -> tuple[str, ...]:
        """(N,) the names of its joints."""
        return tuple(f"{self.name}{n}" for n in range(1, len(self.bones) + 1))


@dataclass(frozen=True)
class Capsule:
    """What pushes chains away: all that is closer than `radius` to the line between two joints.

    Attributes:
        start: name of one joint.
        end: name of the other; the same for a ball.
        radius: in the unit of the clip.
    """

    start: str
    end: str
    radius: float
