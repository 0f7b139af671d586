"""Euler angles, which only files have: to quaternions and back.

A joint's rotation is the product of the turns about its rotation channels' axes, in the order listed: R = Ri(a) Rj(b)
Rk(c), each about an axis of the frame that the ones before it have turned.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 1e6
"""Angles are written in whole millionths of a degree; counted in these, they add up without rounding."""

# Closer than this to a pole, in radians, the first and the third angle turn about one axis, and only their sum counts.
# It is no whole number of millionths of a degree and no half one, so that rounding never carries an angle back over it.
POLE = 1e-7


def to_quaternions(angles_degrees: Array, axes: tuple[int, ...]) -> Array:
    """Unit quaternions of Euler angles.

    Args:
        angles_degrees: (n, len(axes), J) turns about each of `axes`.
        axes: which axis (0, 1, 2) each is about; any number of them.

    Returns:
        (4, n, J): x, y, z and w.
    """
    half = angles_degrees * (math.pi / 360)
    sines, cosines = np.sin(half), np.cos(half)
    parts = np.zeros((4, half.shape[0], half.shape[2]))
    parts[3] = 1.0
    for turn, axis in enumerate(axes):
        sine, cosine = sines[:, turn], cosines[:, turn]
        if turn == 0:
            parts[axis], parts[3] = sine, cosine
            continue
        i, j, k = axis, (axis + 1) % 3, (axis + 2) % 3
        # The Hamilton product with a turn about one axis, whose other two parts are zero.
        parts[i], parts[j], parts[k], parts[3] = (
            cosine * parts[i] + sine * parts[3],
            cosine * parts[j] + sine * parts[k],
            cosine * parts[k] - sine * parts[j],
            cosine * parts[3] - sine * parts[i],
        )
    return parts


def from_quaternions(quaternions: Array, axes: tuple[int, int, int]) -> tuple[Array, Array]:
    """Euler angles of unit quaternions.

    Args:
        quaternions: (n, J, 4), xyzw.
        axes: a permutation of (0, 1, 2).

    Returns:
        The angles (3, n, J) in whole millionths of a degree, the second within -90 to 90 degrees. And (n, J), where
        the second is so close to a pole that the first and third are not determined: 1 or -1 by the pole, where the
        third is 0 and may be chosen freely if the first is lowered by as much (at 1) or raised (at -1); else 0.
    """
    i, j, k = axes
    parity = 1.0 if (j - i) % 3 == 1 else -1.0
    x, y, z, w = quaternions[..., i], parity * quaternions[..., j], quaternions[..., k], quaternions[..., 3]
    # With half angles A, B, C and axes in cyclic order, multiplying out the three turns gives
    #   w + y = (cos B + sin B) cos(A + C)      x + z = (cos B + sin B) sin(A + C)
    #   w - y = (cos B - sin B) cos(A - C)      x - z = (cos B - sin B) sin(A - C)
    # and (cos B - sin B) / (cos B + sin B) = tan(45 degrees - B). The other order turns the second axis round.
    low, high = np.hypot(w - y, x - z), np.hypot(w + y, x + z)
    total, difference = np.arctan2(x + z, w + y), np.arctan2(x - z, w - y)
    second = parity * (math.pi / 2 - 2 * np.arctan2(low, high))
    edge = math.sqrt(2) * math.sin(POLE / 2)
    pole = np.where(low < edge, 1.0, 0.0) - np.where(high < edge, 1.0, 0.0)
    first = np.where(pole > 0, 2 * total, np.where(pole < 0, 2 * difference, total + difference))
    third = np.where(pole == 0, total - difference, 0.0)
    return _wrapped(np.rint(np.stack([first, second, third]) * (180 / math.pi * DEGREE))), pole


def unroll(angles: Array, pole: Array, before: Array | None, channels: int = 3) -> Array:
    """Angles that say the same and follow each other without jumps, as far as there is a choice.

    There are two triples of angles for each rotation, and each angle may have whole turns added; the ones nearest to
    the previous frame are taken. At a pole the third angle stays as it was.

    Args:
        angles: (3, n, J), as `from_quaternions` gives them.
        pole: (n, J), likewise.
        before: (3, J), the last frame of what this continues, or None at the beginning.
        channels: how many of the three angles will be written. With two, the triple is taken whose third angle is zero.

    Returns:
        (3, n, J), in whole millionths of a degree.
    """
    if channels == 3:
        angles = _settle_poles(angles, pole, before)
    start = angles[:, :1] if before is None else before[:, None]
    if channels == 3:
        line = np.concatenate([start, angles], axis=1)  # (3, n + 1, J)
        near = np.abs(_wrapped(line[:, 1:] - line[:, :-1])).sum(axis=0)
        far = np.abs(_wrapped(line[:, 1:] - _other(line[:, :-1]))).sum(axis=0)
        # Whether to change sides between two frames does not depend on the side one is on.
        swapped = np.cumsum(far < near, axis=0) % 2 == 1
    else:
        swapped = (np.abs(angles[2]) > 90 * DEGREE) & (channels == 2)
    line = np.concatenate([start, np.where(swapped, _other(angles), angles)], axis=1)
    if before is None:
        line[:, 0] = line[:, 1]
    return line[:, :1] + np.cumsum(_wrapped(np.diff(line, axis=1)), axis=1)


def misfit(angles: Array, channels: int) -> Array:
    """(n, J) the largest of the angles that are lost when only the first `channels` of the three are written."""
    if channels == 2:
        return np.minimum(np.abs(angles[2]), 180 * DEGREE - np.abs(angles[2]))
    return np.abs(angles[channels:]).max(axis=0, initial=0.0)


def _settle_poles(angles: Array, pole: Array, before: Array | None) -> Array:
    """Third angles at poles taken from the latest frame that is not at one, and the first angles to match."""
    if not pole.any():
        return angles
    first, second, third = angles
    frames = np.where(pole == 0, np.arange(len(pole))[:, None], -1)  # (n, J)
    latest = np.maximum.accumulate(frames, axis=0)
    start = np.zeros_like(third[0])
    if before is not None:
        start = np.where(np.abs(_wrapped(before[1])) > 90 * DEGREE, _other(before)[2], before[2])
    held = np.where(latest >= 0, np.take_along_axis(third, np.maximum(latest, 0), axis=0), start)
    third = np.where(pole == 0, third, held)
    return np.stack([_wrapped(np.where(pole == 0, first, first - pole * third)), second, _wrapped(third)])


def _other(angles: Array) -> Array:
    """The other triple of angles, (3, ...), of the same rotation."""
    half = 180 * DEGREE
    return np.stack([angles[0] + half, half - angles[1], angles[2] + half])


def _wrapped(angles: Array) -> Array:
    """The same angles within -180 (excluded) to 180 degrees, in millionths."""
    turn = 360 * DEGREE
    return angles - turn * np.ceil(angles / turn - 0.5)
