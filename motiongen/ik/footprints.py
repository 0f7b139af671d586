"""Where the feet should be: one footprint for each stance, and a way in and out of it without a step.

Everything is a displacement of the foot joints from where they are. While a joint stands, its displacement takes it to
its footprint; from there it eases to the next footprint, or to nothing where the next one is far, and leaves with the
velocity that the foot itself leaves with, so that neither place nor velocity jumps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.contact import CONTACT_HEIGHT
from motiongen.ik.legs import Legs

Array = NDArray[np.float64]
Labels = NDArray[np.bool_]
Indices = NDArray[np.intp]

OFF_GROUND = 0.005
"""A stance whose lowest point is this near to the joints' own standing level keeps its height, in skeleton heights."""

GAP_SECONDS = 0.12
"""A foot that stands on both sides of a time this short stands in it, too: nothing steps so fast."""

# A joint lets go of its foot sooner than its own way out ends, so that the foot goes with what still stands.
_GRIP = 2

# Where joints disagree, one that stands counts 1 / _LOOSE times, and one that half holds about once.
_LOOSE = 0.2

_NEVER = 10**9  # a frame before or after all others


def fill_gaps(labels: Labels, frames: float) -> Labels:
    """Contact labels (T, K) with gaps of fewer than `frames` frames closed."""
    before, after = _neighbours(labels)
    return labels | (after - before <= frames)


def displacements(positions: Array, heights: Array, contact: Labels, legs: Legs, blend: float) -> tuple[Array, Array]:
    """How far each foot joint is to move.

    A joint that stands moves to its own footprint; the others of its foot go with those that stand.

    Args:
        positions: (T, K, 3) world positions of the foot joints, in skeleton heights.
        heights: (T, K) their heights over their standing levels, in skeleton heights.
        contact: (T, K) whether they stand.
        legs: which leg they belong to, and in which order they hang.
        blend: frames to ease in and out.

    Returns:
        Displacements (T, K, 3) in skeleton heights, and how much each joint holds its foot, (T, K): 1 where it stands,
        0 far from there.
    """
    stance = _stances(contact, legs)
    prints = _footprints(positions, contact, stance, legs.above)
    wanted, hold = _eased(positions, contact, stance, prints, _lifts(heights, contact, stance), blend)
    common = foot_means(wanted, hold, legs)[:, legs.leg]
    return hold[..., None] * wanted + (1 - hold[..., None]) * common, hold


def foot_means(values: Array, hold: Array, legs: Legs) -> Array:
    """(T, L, 3) means over each foot of what its joints want, (T, K, 3): of those that stand, or else nearly do."""
    weights = hold / (1 + _LOOSE - hold)
    total = weights @ legs.foot
    return np.einsum("tk,tkx,kl->tlx", weights, values, legs.foot) / np.where(total > 0, total, 1.0)[..., None]


def _neighbours(labels: Labels) -> tuple[Indices, Indices]:
    """The last frame at or before, and the first at or after each frame that is labelled, (T, K) each."""
    frame = np.arange(len(labels))[:, None]
    before = np.maximum.accumulate(np.where(labels, frame, -_NEVER), axis=0)
    after = np.minimum.accumulate(np.where(labels, frame, _NEVER)[::-1], axis=0)[::-1]
    return before, after


def _stances(contact: Labels, legs: Legs) -> Indices:
    """(T, K) the number of the stance, a run of frames in which any joint of the same foot stands; -1 between.

    Stances of all legs are numbered together, from 0.
    """
    stands = contact @ legs.foot  # (T, L)
    begins = stands.copy()
    begins[1:] &= ~stands[:-1]
    earlier = np.cumsum(begins.sum(axis=0)) - begins.sum(axis=0)  # (L,) stances of the legs before
    return np.where(stands, np.cumsum(begins, axis=0) - 1 + earlier, -1)[:, legs.leg]


def _footprints(positions: Array, contact: Labels, stance: Indices, above: Indices) -> Array:
    """(N, K, 3) where the joints of a foot stand, as one rigid print, as near as can be to where they are.

    Toe and heel touch down and leave apart. A print of its own for each would stretch the foot, for a foot that slides
    is elsewhere when each of them stands. So their places within the print come from the frames in which both stand.
    """
    within = np.zeros((stance.max() + 1, len(above), 3))
    for k, parent in enumerate(above):
        if parent >= 0:  # where there is no such frame, all frames of the stance have to do
            both = contact[:, k] * contact[:, parent] + 1e-6
            within[:, k] = within[:, parent] + _means(
                positions[:, k] - positions[:, parent], both, stance[:, k], len(within)
            )
    origins = positions - within[stance, np.arange(len(above))]
    return within + _means(origins[contact], np.ones(contact.sum()), stance[contact], len(within))[:, None]


def _means(values: Array, weights: NDArray[Any], number: Indices, count: int) -> Array:
    """(count, 3) weighted means of the values (n, 3) of each number; those numbered -1 do not count."""
    number = number + 1
    total = np.bincount(number, weights, count + 1)[1:]
    sums = [np.bincount(number, weights * values[:, x], count + 1)[1:] for x in range(3)]
    return np.stack(sums, axis=-1) / np.where(total > 0, total, 1.0)[:, None]


def _lifts(heights: Array, contact: Labels, stance: Indices) -> Array:
    """(N,) how much each whole stance has to be lifted for its lowest point to be on the ground.

    The rise and fall within a stance stays as it is, for a foot rolls. One far off the ground stands on something else.
    """
    lowest = np.full(stance.max() + 1, np.inf)
    np.minimum.at(lowest, stance[contact], heights[contact])
    off = np.where(np.abs(lowest) <= CONTACT_HEIGHT, lowest, 0.0)
    return -np.sign(off) * np.maximum(np.abs(off) - OFF_GROUND, 0.0)


def _eased(
    positions: Array, contact: Labels, stance: Indices, prints: Array, lifts: Array, blend: float
) -> tuple[Array, Array]:
    """Displacements (T, K, 3) of each joint for itself, and how much they hold, (T, K)."""
    columns = np.arange(contact.shape[1])

    def to_print(frames: Indices, of: Indices) -> Array:
        """Displacement from where joints are at `frames` to their prints in the stances at frames `of`, (T, K, 3)."""
        away = prints[stance[of, columns], columns] - positions[frames, columns]
        away[..., 1] = lifts[stance[of, columns]]
        return away

    frame, last = np.arange(len(contact))[:, None], len(contact) - 1
    before, after = _neighbours(contact)
    span = np.maximum(np.minimum(blend, after - before), 1.0)  # two easings fill the gap between two stances together
    wanted, hold = np.zeros(positions.shape), np.zeros(contact.shape)
    for stands, step in ((before, 1), (after, -1)):
        at = np.clip(stands, 0, last)
        part = np.where(stands == at, np.abs(frame - stands) / span, 1.0)  # 0 in the stance, 1 at the end of easing
        part = np.minimum(part, 1.0)
        place = to_print(at, at)
        slope = to_print(np.clip(at + step, 0, last), at) - place
        fall, run = (1 + 2 * part) * (1 - part) ** 2, part * (1 - part) ** 2  # cubic Hermite, to rest at nothing
        wanted += fall[..., None] * place + (span * run)[..., None] * slope
        hold += fall**_GRIP
    here = np.broadcast_to(frame, contact.shape)
    wanted = np.where(contact[..., None], to_print(here, here), wanted)
    return wanted, np.where(contact, 1.0, np.minimum(hold, 1.0))
