"""Where on the ground of the stage each actor moves, and from which side they are looked at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen.web.body import Body

Array = NDArray[np.float64]

GAP = 0.5
"""Free ground between two lanes, in stage units."""

_MUCH_SHORTER = 0.4
"""Lanes lie side by side along x, unless along z they make a row so much shorter."""


def beside_each_other(bodies: Sequence[Body]) -> tuple[list[Array], Array]:
    """Lanes in a row, as wide as what moves in them, so that nowhere the ground of one body reaches that of another.

    All begin on one line, from left to right as a viewer sees them to whom most of them turn their front.

    Returns:
        (2,) for each body, the x and z of its origin, and (3,) the ground direction in which the viewer is.
    """
    front = facing(bodies)
    rows = [sum(float(body.high[axis] - body.low[axis]) + GAP for body in bodies) for axis in (0, 1)]
    across = 1 if rows[1] < _MUCH_SHORTER * rows[0] and len(bodies) > 1 else 0
    viewer = np.zeros(3)
    viewer[2 - 2 * across] = -1.0 if front[2 - 2 * across] < 0 else 1.0
    right = np.array([viewer[2], -viewer[0]])  # on the ground, x and z
    places, edge = [], 0.0
    for body in bodies:
        ends = sorted((float(right @ body.low), float(right @ body.high)))
        places.append(edge - ends[0])
        edge += ends[1] - ends[0] + GAP
    return [(place - (edge - GAP) / 2) * right for place in places], viewer


def on_one_spot(bodies: Sequence[Body]) -> tuple[list[Array], Array]:
    """All where they are in one world, around where the first begins.

    Returns:
        (2,) for each body, the x and z of its origin, and (3,) the ground direction that they face.
    """
    return [body.origin / body.unit - bodies[0].origin / bodies[0].unit for body in bodies], facing(bodies)


def facing(bodies: Sequence[Body]) -> Array:
    """(3,) the ground direction that most of the bodies face, or else the first of them; +z where there is none."""
    if not bodies:
        return np.array([0.0, 0.0, 1.0])
    mean = np.sum([body.front for body in bodies], axis=0)
    size = float(np.linalg.norm(mean))
    front = mean / size if size > 0.5 else bodies[0].front
    return front / float(np.linalg.norm(front))
