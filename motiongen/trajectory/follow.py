"""Lead a motion that travels along a path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.contact import contact_labels
from motiongen.ik import clean_feet
from motiongen.motion import Motion
from motiongen.stance import facing
from motiongen.trajectory.path import GroundPath, Route, route_along
from motiongen.trajectory.track import STANDING_SPEED, SWAY_SECONDS, Track, at_times, laid, shifted, smooth, track_of

Array = NDArray[np.float64]

PACE = (0.8, 1.25)
"""How much slower and faster than it is a motion may be played to arrive in time."""

CORNER_SECONDS = 0.15
"""A body rounds corners within about this time to either side, and so the wider, the faster it goes."""

TURN_SECONDS = 0.3
"""A body turns within about this time to either side: it looks a little ahead into a turn."""


@dataclass(frozen=True, eq=False)
class _Course:
    """When a motion is where along a route.

    Attributes:
        times: (F,) frames of the motion, fractions among them.
        distance: (F,) along the route.
        pace: how much faster than it is the motion is played.
        stretch: how much longer than they are its strides get.
        arrives: whether it is at the end of the path with the last frame.
    """

    times: Array
    distance: Array
    pace: float
    stretch: float = 1.0
    arrives: bool = True


def frames_to_follow(frames: int, frame_rate: float) -> int:
    """How long a motion must be to follow a path for `frames` frames, at whatever pace."""
    return math.ceil((frames - 1) * PACE[1]) + 1 + 2 * _edge(frame_rate)


def _edge(frame_rate: float) -> int:
    """Frames at either end of a motion that are left out: its track is not so sure there."""
    return math.ceil(2 * SWAY_SECONDS * frame_rate)


def follow(motion: Motion, path: GroundPath, frames: int, feet: Sequence[int] = ()) -> Motion:
    """Lay a motion along a path: its track comes to lie on it, and every frame is moved and turned as a whole.

    The body keeps its sway about the track and its angle to it; where the path says which way to face, it is turned
    that way instead. Strides stay as long as they are, so the path may be longer or shorter than the way: then the
    motion is played slower or faster to arrive with the last frame, within `PACE`. Where that is not enough, it keeps
    its own pace and gets as far as it gets, or goes on beyond the end, straight on or round a closed path again. On a
    closed path it arrives where it set out after as many rounds as fit its pace best.

    A foot that stands while the body turns about its track would be turned with it. Feet that stood before stand after:
    `ik.clean_feet` gives them footprints.

    What of this happened, and how far the track is from the path, is said in the notes.

    Args:
        motion: a motion that travels, `frames_to_follow` long or longer.
        path: where to, in the motion's unit.
        frames: length of the result.
        feet: (C,) foot joints that must not slide; none: feet are left as they come.
    """
    track, edge = track_of(motion), _edge(motion.frame_rate)
    ways = track.distance[edge : len(motion) - edge] - track.distance[edge]
    route = _route(path, motion, float(ways[-1]))
    pace = _pace(ways, route.length, path.closed, frames)
    times = edge + np.arange(frames, dtype=np.float64) * (pace or 1.0)
    distance = track.at(times).distance - track.distance[edge]
    course = _Course(times, distance, pace or 1.0, arrives=pace is not None)
    notes = _notes(motion, path, route, course)
    return _led(motion, track, route, course, feet).replace(notes=(*motion.notes, *notes))


def follow_in_a_loop(motion: Motion, path: GroundPath, frames: int, feet: Sequence[int] = ()) -> Motion:
    """Lay a motion that loops along a closed path, so that the result loops, too: it goes round and round.

    It is played at another pace as in `follow`, if it has other than `frames` frames; what is left of the difference
    between its way and whole rounds of the path is made up by longer or shorter strides.

    Args:
        motion: leads from its last frame into its first, further on along a straight line.
        path: a closed one, in the motion's unit.
        frames: length of the result.
        feet: as of `follow`.
    """
    count = len(motion)
    ground = motion.root_positions[:, [0, 2]]
    lap = ground[-1] - ground[0] + (ground[1] - ground[0] + ground[-1] - ground[-2]) / 2  # one step further
    # Three rounds, of which the one in the middle knows what comes before it and after it. Track and feet need that.
    around = _repeated(motion, lap, 3)
    track = track_of(around)
    way = float(track.distance[2 * count] - track.distance[count])
    route = _route(path, motion, way, rounds=3)
    stretch = max(1, round(way / route.length)) * route.length / way
    times = np.minimum(np.arange(3 * frames) * (count / frames), 3 * count - 1)
    distance = (track.at(times).distance - track.distance[count]) * stretch + way * stretch
    course = _Course(times, distance, count / frames, stretch)
    middle = slice(frames, 2 * frames)
    once = _Course(times[middle], distance[middle] - way * stretch, count / frames, stretch)
    result = _led(around, track, route, course, feet)[middle]
    return result.replace(notes=(*motion.notes, *_notes(motion, path, route, once)))


def _route(path: GroundPath, motion: Motion, way: float, rounds: int = 1) -> Route:
    """The path as it suits a motion that covers `way`, some times over: a fast one needs wider turns."""
    speed = max(way / len(motion) * motion.frame_rate, STANDING_SPEED * motion.skeleton.height)
    return route_along(path, rounds * way, speed * CORNER_SECONDS, speed * TURN_SECONDS)


def _pace(distance: Array, length: float, closed: bool, frames: int) -> float | None:
    """How fast to play a motion that covers distances (T,), to arrive with the last frame; None: no pace will do."""
    if frames == 1:
        return None
    rounds = max(1, math.floor(distance[-1] / length)) if closed else 1
    goals = np.arange(1, rounds + 1) * length
    goals = goals[goals <= distance[-1]]
    paces = np.interp(goals, distance, np.arange(len(distance))) / (frames - 1)
    paces = paces[(paces >= PACE[0]) & (paces <= PACE[1])]
    return float(paces[np.argmin(np.abs(np.log(paces)))]) if len(paces) else None


def _led(motion: Motion, track: Track, route: Route, course: _Course, feet: Sequence[int]) -> Motion:
    """The motion at the times of the course, laid along the route, on feet that stand where they stood."""
    moving, own = at_times(motion, course.times), track.at(course.times)
    places, heading, faces = route.at(course.distance)
    turns = heading - own.heading
    if faces is not None:
        turns = faces - np.interp(course.times, np.arange(len(motion)), _smooth_facing(motion))
    result = laid(moving, own, places, turns)
    # Before it was turned it stood more clearly than after.
    return clean_feet(result, feet, contact_labels(moving, feet)) if feet else result


def _repeated(motion: Motion, lap: Array, times: int) -> Motion:
    """The motion over and over, each time `lap` (2,) further on."""
    motion = motion.with_translating([motion.root])
    again = motion.replace(
        rotations=np.concatenate([motion.rotations] * times), translations=np.concatenate([motion.translations] * times)
    )
    return shifted(again, np.repeat(np.arange(times), len(motion))[:, None] * lap)


def _smooth_facing(motion: Motion) -> Array:
    """(T,) which way the body faces in radians, without what it does within a stride."""
    turn = facing(motion)
    angles = np.unwrap(2 * np.arctan2(turn[:, 1], turn[:, 3]))
    return smooth(angles[:, None], SWAY_SECONDS * motion.frame_rate)[0][:, 0]


def _notes(motion: Motion, path: GroundPath, route: Route, course: _Course) -> list[str]:
    """What an animator would ask about, in words."""
    height, frames = motion.skeleton.height, len(course.times)
    apart = path.distance_to(route.at(course.distance)[0])
    on_path = apart[course.distance <= route.length] / height if not path.closed else apart / height
    notes = [f"the track keeps within {on_path.max():.3f} heights of the path, {on_path.mean():.3f} on average"]
    if abs(course.pace - 1) > 0.005:
        notes.append(f"it goes at {course.pace:.2f} times its own pace, to arrive with the last frame")
    if abs(course.stretch - 1) > 0.005:
        notes.append(f"its strides are {course.stretch:.2f} times as long as its own, to come round in time")
    length, way = route.length / height, course.distance[-1] / height
    if not course.arrives and way < length:
        needed = f"; all of it takes about {math.ceil(frames * length / way)} frames" if way > 0 else ""
        notes.append(f"the path is too long: it gets {way:.1f} of its {length:.1f} heights{needed}")
    elif path.closed:
        notes.append(f"it goes round the path {way / length:.2f} times")
    elif not course.arrives:
        end = int(np.argmax(course.distance > route.length))
        notes.append(
            f"the path is too short: its end is reached at frame {end} of {frames}, from there it goes straight on"
        )
    return notes
