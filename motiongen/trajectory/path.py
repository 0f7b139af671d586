"""Paths over the ground, and the ways of a body along them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.trajectory.track import distance_along, smooth

Array = NDArray[np.float64]

CURVE_SAMPLES = 32
"""Places on a curve from one given point to the next; fewer where there are points by the thousand."""

_BLOCK = 1 << 18  # of gaps between places and pieces of a line, held at a time


@dataclass(frozen=True, eq=False)
class GroundPath:
    """A line over the ground.

    Attributes:
        places: (N, 2) close to each other, along world x and z.
        closed: whether it ends where it begins and goes round.
        facing: (N,) which way a body faces there, in radians as in `Track`; None: as it comes.
    """

    places: Array
    closed: bool = False
    facing: Array | None = None

    @property
    def length(self) -> float:
        """From the beginning to the end, or once round."""
        return float(distance_along(self.places)[-1])

    def distance_to(self, places: Array) -> Array:
        """(T,) how far places (T, 2) are from the line."""
        begins, chords = self.places[:-1], np.diff(self.places, axis=0)
        squared = np.maximum((chords**2).sum(axis=-1), 1e-300)
        nearest = np.empty(len(places))
        block = max(1, _BLOCK // len(chords))
        for start in range(0, len(places), block):
            away = places[start : start + block, None] - begins  # (b, S, 2)
            part = np.clip((away * chords).sum(axis=-1) / squared, 0.0, 1.0)
            gaps = np.linalg.norm(away - part[..., None] * chords, axis=-1)
            nearest[start : start + block] = gaps.min(axis=1)
        return nearest


def path_through(points: Array, facing_radians: Array | None = None) -> GroundPath:
    """A smooth line through points (P, 2): a centripetal Catmull-Rom spline, which has no loops or cusps of its own.

    It leaves the first point straight towards the second, and comes to the last straight from the one before. A point
    given twice in a row is a corner. Where the last point is the first, the line is closed.

    Args:
        points: (P, 2) along world x and z.
        facing_radians: (P,) which way a body faces at each point, the shorter way round from one to the next.

    Raises:
        MotionGenError: if all points are the same.
    """
    new = np.r_[True, np.any(np.diff(points, axis=0) != 0, axis=-1)]
    if new.sum() < 2:
        raise MotionGenError(f"a path needs two different points; all {len(points)} are {points[0].tolist()}")
    first = np.flatnonzero(new)
    corner = np.diff(np.r_[first, len(points)]) > 1  # given twice
    knots = points[first]
    closed = len(knots) > 2 and bool(np.all(knots[0] == knots[-1]))
    chords = np.diff(knots, axis=0)  # (S, 2), one a segment
    spans = np.sqrt(np.linalg.norm(chords, axis=-1, keepdims=True))  # centripetal: time goes as the root of the way
    speeds = chords / spans
    before, after = np.roll(speeds, 1, axis=0), speeds
    through = before + after - (np.roll(chords, 1, axis=0) + chords) / (np.roll(spans, 1, axis=0) + spans)
    sharp = corner[:-1].copy()
    sharp[0] = not closed or corner[0] or corner[-1]
    leaving = np.where(sharp[:, None], after, through)  # (S, 2) velocity at the beginning of each segment
    arriving = np.where(np.roll(sharp, -1)[:, None], speeds, np.roll(through, -1, axis=0))
    samples = min(CURVE_SAMPLES, max(2, 8192 // len(chords)))
    part = (np.arange(samples) / samples)[:, None]  # (n, 1)
    rise = part**2 * (3 - 2 * part)
    curve = (
        knots[:-1, None] * (1 - rise)
        + knots[1:, None] * rise
        + (leaving * spans)[:, None] * part * (1 - part) ** 2
        - (arriving * spans)[:, None] * part**2 * (1 - part)
    )  # (S, n, 2), Hermite
    places = np.concatenate([curve.reshape(-1, 2), knots[-1:]])
    facing = None
    if facing_radians is not None:
        turned = np.unwrap(facing_radians[first])
        if closed:  # it comes round to the way that it faced at first
            turned[-1] = turned[0] + 2 * np.pi * round((turned[-1] - turned[0]) / (2 * np.pi))
        facing = np.interp(np.arange(len(places)) / samples, np.arange(len(first)), turned)
    return GroundPath(places, closed, facing)


@dataclass(frozen=True, eq=False)
class Route:
    """What of a path a body can follow: corners rounded, and on beyond the end, round again or straight on.

    Attributes:
        places: (N, 2).
        distance: (N,) along it; 0 at the beginning of the path.
        heading: (N,) its direction in radians as in `Track`, changing evenly.
        facing: (N,) which way the body faces; None: as it comes.
        length: of the path, rounded.
    """

    places: Array
    distance: Array
    heading: Array
    facing: Array | None
    length: float

    def at(self, distance: Array) -> tuple[Array, Array, Array | None]:
        """Places (T, 2), headings (T,) and facing (T,) after distances (T,)."""

        def read(values: Array) -> Array:
            return np.interp(distance, self.distance, values)

        places = np.stack([read(axis) for axis in self.places.T], axis=-1)
        return places, read(self.heading), None if self.facing is None else read(self.facing)


def route_along(path: GroundPath, reach: float, corner: float, turn: float) -> Route:
    """The way of a body along a path.

    Args:
        path: what to follow.
        reach: distance that it must cover.
        corner: distance within which corners are rounded (deviation of a Gaussian).
        turn: distance within which the body turns, the same way.
    """
    length, margin = path.length, 4 * (corner + turn)
    steps = math.ceil(8 * length / min(corner, length))  # the path's end is one of the places
    spacing = length / steps
    # Beyond what can be reached there is no need of places, however long the path.
    goes = min(max(length, 1.2 * reach), 4 * reach) + margin
    lead, tail = math.ceil(margin / spacing), math.ceil(goes / spacing)
    wanted = np.arange(-lead, tail + 1) * spacing
    along = distance_along(path.places)
    rounds = np.floor(wanted / length) if path.closed else np.zeros(len(wanted))
    inside = wanted - rounds * length
    line = np.stack([np.interp(inside, along, axis) for axis in path.places.T], axis=-1)
    if not path.closed:
        for beyond, end, towards in ((wanted, 0, 1), (wanted - length, -1, -2)):
            out = beyond < 0 if end == 0 else beyond > 0
            ahead = path.places[end] - path.places[towards]
            line[out] = path.places[end] + np.abs(beyond[out])[:, None] * ahead / np.linalg.norm(ahead)
    places, slope = smooth(line, corner / spacing)
    heading = np.unwrap(np.arctan2(slope[:, 0], slope[:, 1]))
    facing = None
    if path.facing is not None:
        a_round = path.facing[-1] - path.facing[0]
        facing = np.interp(inside, along, path.facing) + rounds * a_round
    distance = distance_along(places)
    distance -= distance[lead]

    def evenly(angles: Array) -> Array:
        return smooth(angles[:, None], turn / spacing)[0][:, 0]

    facing = None if facing is None else evenly(facing)
    rounded = float(distance[lead + steps]) if steps <= tail else length
    return Route(places, distance, evenly(heading), facing, rounded)
