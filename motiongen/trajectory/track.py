"""The line over the ground that a motion travels along, and laying the motion along another one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion, _moved

Array = NDArray[np.float64]

SWAY_SECONDS = 0.4
"""What the root does within about this time belongs to its steps and not to its track (deviation of a Gaussian)."""

STANDING_SPEED = 0.1
"""Below this speed, in skeleton heights per second, a body has no way of its own."""

TRAVEL_SPEED, TRAVEL_SECONDS = 0.2, 2.0
"""A clip travels that gets on this fast, in skeleton heights per second, over this time: a dance is soon back."""

UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class Track:
    """The smooth line over the ground that a motion travels along.

    Attributes:
        places: (T, 2) where the body is on it, along world x and z, in the motion's unit.
        distance: (T,) how far it has come along it.
        heading: (T,) its direction in radians, counter-clockwise from +z seen from above; never jumps by a turn.
    """

    places: Array
    distance: Array
    heading: Array

    def at(self, times: Array) -> Track:
        """The track at times (T',) between its frames."""
        frames = np.arange(len(self.distance))
        places = np.stack([np.interp(times, frames, axis) for axis in self.places.T], axis=-1)
        return Track(places, np.interp(times, frames, self.distance), np.interp(times, frames, self.heading))


def track_of(motion: Motion) -> Track:
    """The track of a motion: its root's way over the ground without what it does within a stride.

    Where the body stands, it has no direction of its own, and turns evenly from the one before to the one after. A
    motion that stands all the time keeps to +z.
    """
    ground = motion.root_positions[:, [0, 2]]
    places, steps = smooth(ground, SWAY_SECONDS * motion.frame_rate)
    distance = distance_along(places)
    speed = np.linalg.norm(steps, axis=-1) * motion.frame_rate / motion.skeleton.height
    goes = np.flatnonzero(speed > STANDING_SPEED)
    heading = np.zeros(len(motion))
    if len(goes):
        angles = np.unwrap(np.arctan2(steps[goes, 0], steps[goes, 1]))
        heading = np.interp(np.arange(len(motion)), goes, angles)
    return Track(places, distance, heading)


def travel_speed(motion: Motion) -> float:
    """How fast a motion gets on, in skeleton heights per second: mean straight way within `TRAVEL_SECONDS`.

    A step to and fro is no travel, walking in a circle is.
    """
    span = min(max(1, round(TRAVEL_SECONDS * motion.frame_rate)), len(motion) - 1)
    if span == 0:
        return 0.0
    ground = motion.root_positions[:, [0, 2]]
    ways = np.linalg.norm(ground[span:] - ground[:-span], axis=-1)
    return float(ways.mean() / motion.skeleton.height * motion.frame_rate / span)


def straightened(motion: Motion) -> Motion:
    """The motion with its track laid along +z from the origin: what it does, wherever it went.

    Whatever the way turned, the body now is turned back by: a walk in a circle becomes a walk straight on. Its root
    joint is a translating one.
    """
    track = track_of(motion)
    places = np.stack([np.zeros(len(motion)), track.distance], axis=-1)
    return laid(motion, track, places, -track.heading)


def laid(motion: Motion, track: Track, places: Array, turns: Array) -> Motion:
    """The motion moved from its track to other places, and turned there, frame by frame.

    Args:
        motion: (T frames) what to move.
        track: its track.
        places: (T, 2) where each frame's place on the track goes.
        turns: (T,) radians about the up axis by which each frame is turned there.
    """
    motion = motion.with_translating([motion.root])
    turn = rot.from_axis_angle(UP, turns)  # (T, 4)
    about = _on_ground(track.places)
    positions = rot.rotate(turn, motion.root_positions - about) + _on_ground(places)
    rotations = rot.multiply(turn, motion.world_rotations[:, motion.root])
    return _moved(motion, motion.root, rot.continuous(rotations), positions)


def shifted(motion: Motion, shift: Array) -> Motion:
    """The motion with its root moved over the ground by (T, 2), along world x and z, frame by frame."""
    motion = motion.with_translating([motion.root])
    root = motion.root
    return _moved(motion, root, motion.world_rotations[:, root], motion.root_positions + _on_ground(shift))


def at_times(motion: Motion, times: Array) -> Motion:
    """The motion at times (T',) between its frames, with the same frame rate: played at another pace.

    Cubic (Catmull-Rom), so that velocities do not jump at the frames; frames at whole times stay bit for bit.
    """
    before = np.clip(np.floor(times).astype(int), 0, len(motion) - 1)
    part = times - before  # (T',)
    near = np.clip(before[:, None] + np.arange(-1, 3), 0, len(motion) - 1)  # (T', 4)
    squared, cubed = part**2, part**3
    weights = np.stack(
        [
            (-cubed + 2 * squared - part) / 2,
            (3 * cubed - 5 * squared + 2) / 2,
            (-3 * cubed + 4 * squared + part) / 2,
            (cubed - squared) / 2,
        ]
    )  # (4, T')

    def mixed(values: Array) -> Array:
        return sum(w[:, None, None] * values[near[:, k]] for k, w in enumerate(weights))

    rotations, translations = mixed(rot.continuous(motion.rotations)), mixed(motion.translations)
    whole = part == 0
    rotations[whole], translations[whole] = motion.rotations[before[whole]], motion.translations[before[whole]]
    return motion.replace(rotations=rotations, translations=translations)


def smooth(values: Array, width: float) -> tuple[Array, Array]:
    """Values (N, C) without their fast changes, and how they change from one to the next, (N, C) each.

    A straight line is fitted around each place, with Gaussian weights of deviation `width` places, so that straight
    lines stay as they are, up to the ends.
    """
    if len(values) == 1:
        return values.copy(), np.zeros_like(values)
    width = max(width, 0.3)  # a line needs neighbours
    reach = math.ceil(4 * width)
    offsets = np.arange(-reach, reach + 1, dtype=np.float64)
    kernel = np.exp(-0.5 * (offsets / width) ** 2)

    def moment(of: Array, order: int) -> Array:
        moments: Array = np.convolve(np.pad(of, reach), (kernel * offsets**order)[::-1], mode="valid")
        return moments

    total, first, second = (moment(np.ones(len(values)), order)[:, None] for order in range(3))  # (N, 1)
    level = np.stack([moment(column, 0) for column in values.T], axis=-1)  # (N, C)
    tilt = np.stack([moment(column, 1) for column in values.T], axis=-1)
    spread = np.maximum(total * second - first**2, 1e-12)
    return (second * level - first * tilt) / spread, (total * tilt - first * level) / spread


def distance_along(places: Array) -> Array:
    """(N,) distance along a line of places (N, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=-1))])


def _on_ground(places: Array) -> Array:
    """(N, 2) places along x and z as points (N, 3)."""
    return np.stack([places[:, 0], np.zeros(len(places)), places[:, 1]], axis=-1)
