"""An endless motion in chunks, each of which goes on where the one before it ended."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.generators.base import Generator, sample_seed
from motiongen.generators.constraints import Constraint, Continuation, Parts
from motiongen.motion import Motion, concatenate
from motiongen.trajectory import TRAVEL_SPEED, shifted, travel_speed

Array = NDArray[np.float64]

CHUNK_SECONDS = 10.0
"""Length of a chunk where none is asked for."""

BORDER_SECONDS = 1.0
"""How far into a chunk its border reaches: what the way out of the chunk before may have disturbed."""

TRIES = 6
"""How many chunks are made at most where the way into them is rough."""

HOMING_SPEED = 0.03
"""How fast a character that stays in one place is led back to it, in skeleton heights per second."""


def chunk_length(generator: Generator, frames: int | None, constraints: Sequence[Constraint]) -> int:
    """How many frames each chunk has.

    Raises:
        MotionGenError: if that is no length, a constraint cannot hold in every chunk, or the output rate is not the
            examples' own.
    """
    rate = generator.examples[0].frame_rate
    for constraint in constraints:
        if not isinstance(constraint, Parts):
            raise MotionGenError(f"a stream takes no {type(constraint).__name__}, only Parts; leave it out")
        constraint.check(generator.examples[0].skeleton, 1)
    if not math.isclose(generator.frame_rate, rate, rel_tol=1e-6):
        raise MotionGenError("a stream has the examples' own frame rate; leave output_rate out")
    if frames is None:
        return max(1, round(CHUNK_SECONDS * rate))
    if not isinstance(frames, (int, np.integer)) or isinstance(frames, bool) or frames < 1:
        raise MotionGenError(f"chunk_frames must be a whole number of at least 1, not {frames!r}")
    return int(frames)


def chunks(
    generator: Generator, frames: int, seed: int, context: int, constraints: Sequence[Constraint] = ()
) -> Iterator[Motion]:
    """Chunks without end: played one after the other they are one motion in pose, velocity, place and heading.

    Only the last `context` frames are kept, so memory stays as it is however long the stream runs. Places are those of
    one world, in double precision: after a hundred years of walking they are good to a micrometre. Whoever keeps them
    in single precision takes them relative to a place near by, or a walk begins to shake after some kilometres.

    A chunk whose first second has a larger step than the examples ever take is made anew, `TRIES` times at most, and
    the best one is taken. Where the examples stay in one place, what leads further away than they ever go is led back,
    so slowly that it does not show: a dance of an hour does not leave the room.

    Args:
        generator: takes `Continuation`.
        frames: length of each chunk.
        seed: a chunk depends on it, on its number and on the frames before it.
        context: how many frames before a chunk it goes on from.
        constraints: what each chunk must keep to.
    """
    largest = np.max([_largest_steps(example) for example in generator.examples], axis=0)
    room = _room(generator.examples)
    chunk = generator.sample(frames, 1, sample_seed(seed, 0), constraints)[0]
    home = _places(chunk).mean(axis=0)
    before = chunk[-context:]
    for number in itertools.count(1):
        yield chunk.replace(name=f"chunk_{number - 1:06d}")
        chunk = _next(generator, before, frames, sample_seed(seed, number), constraints, largest)
        chunk = _homing(chunk, home, room)
        before = concatenate([before, chunk], align=False)[-context:]


def _next(
    generator: Generator,
    before: Motion,
    frames: int,
    seed: int,
    constraints: Sequence[Constraint],
    largest: Array,
) -> Motion:
    """The chunk with the smoothest way on from `before` out of a few; the first that steps no further than allowed."""
    border = round(BORDER_SECONDS * before.frame_rate)
    best, least = before, math.inf
    for attempt in range(TRIES):
        chunk = generator.sample(frames, 1, sample_seed(seed, attempt), [*constraints, Continuation(before)])[0]
        steps = _largest_steps(concatenate([before[-1:], chunk[:border]], align=False))
        # Examples that stand still take no steps at all.
        step = max(taken / allowed if allowed > 0 else 0.0 for taken, allowed in zip(steps, largest))
        if step < least:
            best, least = chunk, step
        if least < 1.001:  # up to rounding
            break
    return best


def _homing(chunk: Motion, home: Array, room: float) -> Motion:
    """The chunk led back as far as it ends further than `room` from home, or as far as can be without showing."""
    away = _places(chunk)[-1] - home
    distance = float(np.linalg.norm(away))
    if distance <= room:
        return chunk
    back = min(distance - room, HOMING_SPEED * chunk.skeleton.height * len(chunk) / chunk.frame_rate)
    part = np.arange(1, len(chunk) + 1) / len(chunk)
    return shifted(chunk, -(away * back / distance) * ((1 - np.cos(np.pi * part)) / 2)[:, None])


def _largest_steps(motion: Motion) -> Array:
    """The largest turn of a joint in its parent's frame, and its largest way through the world, in a frame."""
    turns = rot.angle_between(motion.rotations[1:], motion.rotations[:-1])
    ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1)
    return np.array([turns.max(initial=0.0), ways.max(initial=0.0)])


def _places(motion: Motion) -> Array:
    """(T, 2) where the root is over the ground."""
    return motion.root_positions[:, [0, 2]]


def _room(examples: Sequence[Motion]) -> float:
    """How far from home the examples go; no limit for those that travel."""
    if max(travel_speed(example) for example in examples) >= TRAVEL_SPEED:
        return math.inf
    return max(float(np.linalg.norm(np.ptp(_places(example), axis=0))) for example in examples)
