"""From where each foot joint should be to where each ankle goes: feet are rigid, and legs are only so long.

All lengths are in skeleton heights.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.ik.footprints import foot_means
from motiongen.ik.legs import Legs
from motiongen.ik.solve import shortest_turn, smoothed, soft_limit

Array = NDArray[np.float64]

FOOT_TURN = math.radians(5), math.radians(10)
"""A foot turns for its toes freely up to the first angle, and never past the second: a pivot stays a pivot."""

STRETCH = 0.998
"""A leg is stretched to this share of its length (a person's knee, to 7 degrees short of straight) or as far as it was.

A last thousandth of length is a last five degrees of the knee.
"""

EDGE = 0.9
"""A foot begins to slip where it has come this share of the way to the end of its reach, lest it do so at a stroke."""


def place_feet(before: Array, wanted: Array, hold: Array, legs: Legs) -> tuple[Array, Array]:
    """Turns and places of rigid feet that bring their joints to where they should be, or near.

    A foot keeps its orientation in the world, but for the turn that brings what hangs on it (the toes on an ankle) into
    the wanted direction. What no turn can do, the joints share as much as they hold the foot.

    Args:
        before: (T, K, 3) the foot joints as they are.
        wanted: (T, K, 3) where they should be.
        hold: (T, K) how much each of them holds its foot.
        legs: how they hang on each other.

    Returns:
        Turns of the foot joints in the world (T, K, 4), and positions of the ankles (T, L, 3).
    """
    turns = np.broadcast_to(rot.IDENTITY, (*before.shape[:2], 4)).copy()
    placed = wanted.copy()
    for k, above in enumerate(legs.above):
        if above >= 0:
            placed[:, k] = placed[:, above] + rot.rotate(turns[:, above], before[:, k] - before[:, above])
        below = legs.above == k
        if below.any():
            was = (before[:, below] - before[:, [k]]).sum(axis=1)
            turn = rot.to_rotation_vector(shortest_turn(was, (wanted[:, below] - wanted[:, [k]]).sum(axis=1)))
            turns[:, k] = rot.from_rotation_vector(shortened(turn, *FOOT_TURN))
    ankles = np.flatnonzero(legs.above < 0)
    return turns, placed[:, ankles[np.argsort(legs.leg[ankles])]] + foot_means(wanted - placed, hold, legs)


def shortened(vectors: Array, free: float, most: float) -> Array:
    """Vectors (..., 3) of the same direction, as long as they are up to `free` and never longer than `most`."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors * np.where(length > free, soft_limit(length, free, most) / np.maximum(length, free), 1.0)


def reach_of(upper: Array, lower: Array) -> Array:
    """How far from the hip each ankle may go, (T, L), given the bones from hip to knee and on to the ankle."""
    full = np.linalg.norm(upper, axis=-1) + np.linalg.norm(lower, axis=-1)
    return np.maximum(STRETCH * full, np.linalg.norm(upper + lower, axis=-1))


def lowering(hips: Array, ankles: Array, reach: Array, hold: Array, most: float, window: int) -> Array:
    """How much lower the root has to be for every foot that stands to be within reach of its leg, (T,).

    Args:
        hips: (T, L, 3) where the hips are.
        ankles: (T, L, 3) where the ankles should be.
        reach: (T, L) from `reach_of`.
        hold: (T, L) how much each foot stands.
        most: the root is lowered by no more than this.
        window: frames over which it goes down and up again.
    """
    way = ankles - hips
    beyond = np.linalg.norm(way, axis=-1) > reach
    allowed = np.sqrt(np.maximum(reach**2 - way[..., 0] ** 2 - way[..., 2] ** 2, 0.0))
    needed = np.where(beyond, np.maximum(-way[..., 1] - allowed, 0.0), 0.0) * hold
    lowest = soft_limit(needed.max(axis=1), 0.5 * most, most) if most else np.zeros(len(hips))
    # The most that is needed within the window, smoothed over the window, is nowhere less than what is needed.
    padded = np.pad(lowest, window, mode="edge")
    return smoothed(sliding_window_view(padded, 2 * window + 1).max(axis=-1), window)


def within_reach(way: Array, was: Array, reach: Array) -> Array:
    """Ways from hip to ankle that are no longer than the leg's reach, (T, L, 3).

    A foot out of reach slips over the ground; it is not lifted, which would be as false and harder to see in figures.

    Args:
        way: (T, L, 3) from the hip to where the ankle should be.
        was: (T, L, 3) from the hip to where it was.
        reach: (T, L) from `reach_of`.
    """
    flat, flat_was = (np.hypot(vectors[..., 0], vectors[..., 2]) for vectors in (way, was))
    most = np.sqrt(np.maximum(reach**2 - way[..., 1] ** 2, 0.0))
    shorter = soft_limit(flat, np.maximum(np.minimum(flat_was, most), EDGE * most), most)
    share = np.where(flat > 0, shorter / np.where(flat > 0, flat, 1.0), 1.0)
    return way * np.stack([share, np.ones_like(share), share], axis=-1)
