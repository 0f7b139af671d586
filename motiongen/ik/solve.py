"""Two turns that bring an ankle to a target: the knee bends until the distance is right, the hip swings to aim.

Closed form, over any leading axes. There is nothing to iterate and nothing to converge, and a target that is where the
ankle already is gives no turn at all.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot

Array = NDArray[np.float64]
Labels = NDArray[np.bool_]

STRAIGHT = math.radians(10), math.radians(25)
"""The bend of a knee is smoothed over time below the first angle, and is exact above the second."""

KNEE_SECONDS = 0.05
"""How far to either side it is smoothed."""

# The sine of the bend at which a knee's own plane and its usual one count alike.
_FLAT = 0.2
_TINY = 1e-12


def knee_bend(upper: Array, lower: Array, axis: Array, distance: Array) -> Array:
    """The turn of the lower bone that brings the ankle to a distance from the hip.

    The knee stays bent to the side it is bent to; one that is bent backwards comes to the front as it bends. A distance
    out of reach gives the straight leg, or the folded one.

    Args:
        upper: (..., 3) from hip to knee, in the world.
        lower: (..., 3) from knee to ankle.
        axis: (..., 3) unit axis that the knee bends about, to which it is bent by the right-hand rule.
        distance: (...) from hip to ankle as it should be.

    Returns:
        Angle in radians about `axis`, (...).
    """
    along = _dot(upper, axis) * _dot(lower, axis)  # what lies along the axis does not take part
    upper_part, lower_part = (v - _dot(v, axis)[..., None] * axis for v in (upper, lower))
    lever = np.sqrt(_dot(upper_part, upper_part) * _dot(lower_part, lower_part))
    usable = lever > _TINY * (_dot(upper, upper) + _dot(lower, lower))  # a bone without length bends nothing
    bent = np.arctan2(_dot(axis, np.cross(upper_part, lower_part)), _dot(upper_part, lower_part))
    # |upper + lower|^2 = upper^2 + lower^2 + 2 along + 2 lever cos(bent)
    needed = (distance**2 - _dot(upper, upper) - _dot(lower, lower)) / 2 - along
    wanted = np.arccos(np.clip(needed / np.where(usable, lever, 1.0), -1.0, 1.0))
    back = np.maximum(-bent, 0.0)
    more = (wanted - back) / np.maximum(2 * back, _TINY)
    coming_round = wanted - 2 * back * np.exp(-(more**2))
    now = np.where(wanted <= back, -wanted, np.where(back > 0, coming_round, wanted))
    return np.where(usable, now - bent, 0.0)


def solve_legs(upper: Array, lower: Array, axis: Array, way: Array, moved: Labels, window: int) -> tuple[Array, Array]:
    """Turns of knees and hips, in the world, that bring ankles to where they should be.

    Near straight, a leg's length hardly tells how far its knee is bent: a millimetre is degrees. There the
    bend is smoothed over time, for what that does to the length is as little; so knees do not snap.

    Args:
        upper: (T, L, 3) from hip to knee, in the world.
        lower: (T, L, 3) from knee to ankle.
        axis: (T, L, 3) from `knee_axes`.
        way: (T, L, 3) from the hip to where the ankle should be.
        moved: (T, L) where that is elsewhere than it is; knees bend there alone, and `window` frames before and after.
        window: frames to either side over which the bend of straight knees is smoothed; 0: every target is met.

    Returns:
        Turn of the lower bone before that of the whole leg, and the turn of the whole leg, (T, L, 4) each.
    """
    exact = np.where(moved, knee_bend(upper, lower, axis, np.linalg.norm(way, axis=-1)), 0.0)
    bend = exact
    if window:
        angle = np.arctan2(np.linalg.norm(np.cross(upper, lower), axis=-1), _dot(upper, lower))
        bent = smoothed(np.minimum(angle, np.abs(angle + exact)), window)
        share = np.clip((bent - STRAIGHT[0]) / (STRAIGHT[1] - STRAIGHT[0]), 0.0, 1.0)
        share = share * share * (3 - 2 * share)
        bend = share * exact + (1 - share) * smoothed(exact, window)
    knee = rot.from_axis_angle(axis, bend)
    return knee, shortest_turn(upper + rot.rotate(knee, lower), way)


def shortest_turn(a: Array, b: Array) -> Array:
    """The shortest rotation (..., 4) that turns the direction of vector `a` into that of `b`, (..., 3) each.

    Vectors of no length, and opposite ones, have no such rotation; the identity is returned for them.
    """
    lengths = np.sqrt(_dot(a, a) * _dot(b, b))
    turn = np.concatenate([np.cross(a, b), (lengths + _dot(a, b))[..., None]], axis=-1)
    norm = np.linalg.norm(turn, axis=-1, keepdims=True)
    known = norm > 1e-9 * lengths[..., None]
    return np.where(known, turn / np.where(known, norm, 1.0), rot.IDENTITY)


def soft_limit(values: Array, free: Array | float, most: Array | float) -> Array:
    """Values as they are up to `free`; beyond, they near `most` with a slope that falls smoothly from one to zero."""
    room = np.maximum(np.asarray(most) - free, _TINY)
    return np.where(values > free, free + room * np.tanh((values - free) / room), values)


def smoothed(values: Array, window: int) -> Array:
    """Means over `window` frames to either side of each, (T, ...), with weights that fall as a raised cosine."""
    kernel = np.hanning(2 * window + 3)[1:-1]
    padded = np.pad(values, [(window, window), *[(0, 0)] * (values.ndim - 1)], mode="edge")
    return np.apply_along_axis(np.convolve, 0, padded, kernel / kernel.sum(), mode="valid")


def knee_axes(upper: Array, lower: Array, hip_rotations: Array, forward: Array) -> Array:
    """The axis that each knee bends about, in the world.

    It is square to the plane of the leg where the leg is bent. A straight leg has no plane: there, the axis about which
    the knee bends over the rest of the clip, seen from the thigh, takes over; and for a leg that is never bent one
    across `forward`.

    Args:
        upper: (T, L, 3) from hip to knee, in the world.
        lower: (T, L, 3) from knee to ankle.
        hip_rotations: (T, L, 4) world rotations of the hips.
        forward: (T, L, 3) where the foot points.

    Returns:
        Unit vectors (T, L, 3).
    """
    upper, lower = _unit(upper), _unit(lower)
    seen_from_thigh = rot.inverse(hip_rotations)
    bends = rot.rotate(seen_from_thigh, np.cross(upper, lower))  # as long as the sine of the bend
    spare = np.eye(3)[np.argmin(np.abs(upper), axis=-1)]
    guess = rot.rotate(seen_from_thigh, np.cross(_unit(forward), upper) + 1e-3 * np.cross(spare, upper))
    usual = _unit((bends + 1e-6 * guess).sum(axis=0))
    return rot.rotate(hip_rotations, _unit(bends + _FLAT * usual))


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...x,...x->...", a, b)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), _TINY)
