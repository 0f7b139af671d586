"""What a visitor asks a generator for, as plain data, and the motions that come of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.commands.constraint_settings import exactly
from motiongen.errors import MotionGenError
from motiongen.generators.base import Generator, Progress
from motiongen.generators.constraints import Constraint, FixedJoints, Keyframes, Loop, RootPath, Segment
from motiongen.motion import Motion
from motiongen.web.limits import Limits

MOST_TAKES = 8
"""Motions that are made for one wish; more cannot be told apart side by side."""

LOOPS = {"no": None, "as the clip": None, "in place": True, "travelling": False}
"""How a motion can be played over and over -> `Loop.in_place`."""


@dataclass(frozen=True)
class Wish:
    """What a visitor asks for, besides the generator and its options.

    Attributes:
        frames: length of each motion.
        count: how many.
        seed: of the first.
        compare: whether each has a seed of its own, `seed`, `seed + 1` and so on, or all are of one.
        keys: frames of the clip whose poses are held at their time.
        segment: first frame to redo of the clip and the first after them, or None.
        kept: names of the joints that move as in the clip.
        path: places on the ground (x, z) that the character travels along.
        loop: one of `LOOPS`.
    """

    frames: int
    count: int = 1
    seed: int = 0
    compare: bool = False
    keys: tuple[int, ...] = ()
    segment: tuple[int, int] | None = None
    kept: tuple[str, ...] = ()
    path: tuple[tuple[float, float], ...] = ()
    loop: str = "no"

    def constraints(self, clip: Motion | None, frame_rate: float) -> list[Constraint]:
        """What the motions must keep to.

        Args:
            clip: what keys, segment and kept joints are taken from; None where the generator needs no examples.
            frame_rate: of the motions, in Hz.

        Raises:
            MotionGenError: if something is asked for that needs a clip, and there is none, or does not fit it.
        """
        made: list[Constraint] = []
        if self.path:
            made.append(RootPath(np.array(self.path)))
        if self.loop != "no":
            made.append(Loop(LOOPS[self.loop]))
        if not (self.keys or self.segment or self.kept):
            return made
        if clip is None:
            raise MotionGenError("keys, a segment and kept joints are taken from a clip; load one first")
        if outside := [frame for frame in self.keys if frame >= len(clip)]:
            raise MotionGenError(f"the key at frame {outside[0]} lies behind the clip, which has {len(clip)} frames")
        if self.keys:
            made.append(Keyframes({round(key / clip.frame_rate * frame_rate): clip[key] for key in self.keys}))
        if self.segment is not None:
            made.append(Segment(clip, *self.segment))
        if self.kept:
            made.append(FixedJoints(clip, exactly(self.kept)))
        return made


@dataclass(frozen=True, eq=False)
class Take:
    """A motion that was made.

    Attributes:
        motion: itself.
        label: what to call it on the page.
        accepted: whether the visitor wants to keep it.
    """

    motion: Motion
    label: str
    accepted: bool = False


def make_takes(generator: Generator, clip: Motion | None, wish: Wish, limits: Limits, progress: Progress) -> list[Take]:
    """The motions that a visitor asks for.

    Args:
        generator: with its examples.
        clip: what keys, segment and kept joints are taken from.
        wish: what is asked for.
        limits: how much of it is granted.
        progress: called with the share done.

    Raises:
        MotionGenError: if it is too much, or the generator cannot make it.
    """
    if not 1 <= wish.count <= MOST_TAKES:
        raise MotionGenError(f"{wish.count} motions are asked for; 1 to {MOST_TAKES} are made at a time")
    # A generator may work at the clip's rate, whatever rate its results have.
    slower = max(1.0, clip.frame_rate / generator.frame_rate) if clip is not None else 1.0
    if wish.frames * wish.count * slower > limits.frames:
        raise MotionGenError(
            f"{wish.count} x {wish.frames} frames are asked for; at most {limits.frames} in all, of the clip's rate, "
            "are made at a time"
        )
    constraints = wish.constraints(clip, generator.frame_rate)
    if not wish.compare:
        motions = generator.sample(wish.frames, wish.count, wish.seed, constraints, progress)
        return [_take(motion, wish.seed, number, wish.count) for number, motion in enumerate(motions)]
    takes = []
    for number in range(wish.count):
        part = _part(progress, number, wish.count)
        (motion,) = generator.sample(wish.frames, 1, wish.seed + number, constraints, part)
        takes.append(_take(motion, wish.seed + number, 0, 1))
    return takes


def _take(motion: Motion, seed: int, number: int, count: int) -> Take:
    label = f"seed {seed}" if count == 1 else f"seed {seed}, {number + 1} of {count}"
    return Take(motion.replace(name=f"seed_{seed}" if count == 1 else f"seed_{seed}_{number + 1}"), label)


def _part(progress: Progress, number: int, count: int) -> Progress:
    """Progress of one of several pieces of work as progress of them all."""
    return lambda share: progress((number + share) / count)
