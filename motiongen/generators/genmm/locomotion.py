"""Along a path of one's own: synthesise a walk straight on, then lay it along the path.

The examples are straightened first. What a body does then no longer depends on where in the world it was going, so
that every step fits to every other, and a walk in a circle serves for any path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from motiongen.contact import foot_joints
from motiongen.errors import MotionGenError
from motiongen.generators.base import Generator, Progress
from motiongen.generators.constraints import Constraint, Loop, Parts, RootPath
from motiongen.motion import Motion
from motiongen.trajectory import (
    PACE,
    TRAVEL_SPEED,
    follow,
    follow_in_a_loop,
    frames_to_follow,
    path_through,
    straightened,
    travel_speed,
)


def root_path_of(constraints: Sequence[Constraint]) -> RootPath | None:
    """The path to follow, if there is one.

    Raises:
        MotionGenError: if there are two, or what comes with it does not go together with a path.
    """
    paths = [constraint for constraint in constraints if isinstance(constraint, RootPath)]
    if not paths:
        return None
    if len(paths) > 1:
        raise MotionGenError("there can be only one RootPath; put the points together in one")
    for constraint in constraints:
        if not isinstance(constraint, (RootPath, Parts, Loop)):
            name = type(constraint).__name__
            raise MotionGenError(f"RootPath and {name} do not go together, only Parts and Loop do; leave {name} out")
        if isinstance(constraint, Loop) and (constraint.in_place or not paths[0].closed):
            why = "in place" if constraint.in_place else "along a path with two ends"
            raise MotionGenError(f"a loop {why} cannot follow it; end the path at its first point, or leave Loop out")
    return paths[0]


def straight_examples(examples: Sequence[Motion]) -> list[Motion]:
    """The examples as they would have gone straight on.

    Raises:
        MotionGenError: if none of them travels.
    """
    speeds = [travel_speed(example) for example in examples]
    if max(speeds) < TRAVEL_SPEED:
        raise MotionGenError(
            f"only examples that travel can follow a path; '{examples[int(np.argmax(speeds))].name}' gets on by "
            f"{max(speeds):.2f} heights a second, a walk by {TRAVEL_SPEED} and more; give a walk or a run"
        )
    return [straightened(example) for example in examples]


def sample_along(
    path: RootPath,
    straight: Generator,
    frames: int,
    count: int,
    seed: int,
    constraints: Sequence[Constraint],
    progress: Progress,
) -> list[Motion]:
    """Motions along a path.

    Args:
        path: where to, checked by `root_path_of`.
        straight: has the straightened examples.
        frames: length of each motion.
        count: how many.
        seed: as of `Generator.sample`.
        constraints: all that came with the path.
        progress: called with the share done.

    Raises:
        MotionGenError: if whole rounds of a closed path cannot be gone in a loop of that length.
    """
    ground = path_through(path.points, path.facing_radians)
    others: list[Constraint] = [each for each in constraints if isinstance(each, Parts)]
    loops = any(isinstance(each, Loop) for each in constraints)
    if loops:
        others.append(Loop(in_place=False))
        length = _frames_around(straight, ground.length, frames)
    else:
        length = frames_to_follow(frames, straight.frame_rate)
    feet = foot_joints(straight.examples)
    motions = straight.sample(length, count, seed, others, progress)
    return [(follow_in_a_loop if loops else follow)(motion, ground, frames, feet) for motion in motions]


def _frames_around(straight: Generator, length: float, frames: int) -> int:
    """How many frames it takes the examples to go round a path of this length as often as fits `frames` best."""
    way = sum(abs(float(np.ptp(example.root_positions[:, 2]))) for example in straight.examples)
    speed = way / sum(example.duration * straight.frame_rate for example in straight.examples)  # a frame
    rounds = max(1, round(frames * speed / length))
    pace = rounds * length / (frames * speed)
    if not PACE[0] <= pace <= PACE[1]:
        raise MotionGenError(
            f"a loop of {frames} frames cannot go round the path at {PACE[0]} to {PACE[1]} times the examples' pace; "
            f"ask for about {math.ceil(length / speed)} frames"
        )
    return round(frames * pace)
