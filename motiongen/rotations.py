"""A small vocabulary of unit quaternions over the last axis, order xyzw, as SciPy, roma and glTF write them.

Each is a few lines over whole arrays. `scipy.spatial.transform.Rotation` has them too, and the tests hold these to it,
but it copies, checks and renormalises at every step: a dozen times the time for the products and interpolations of an
ordinary clip's 80,000 rotations, though not for turning vectors, and its import alone takes longer than reading the
clip (`tools/bench_rotations.py`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

IDENTITY: Array = np.array([0.0, 0.0, 0.0, 1.0])
IDENTITY.flags.writeable = False


def multiply(a: Array, b: Array) -> Array:
    """The rotation `b` followed by `a` (Hamilton product), (..., 4) x (..., 4) -> (..., 4); leading axes broadcast."""
    ax, ay, az, aw = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bx, by, bz, bw = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = aw * bx + ax * bw + ay * bz - az * by
    out[..., 1] = aw * by - ax * bz + ay * bw + az * bx
    out[..., 2] = aw * bz + ax * by - ay * bx + az * bw
    out[..., 3] = aw * bw - ax * bx - ay * by - az * bz
    return out


def inverse(quaternions: Array) -> Array:
    """The inverse of unit quaternions, (..., 4)."""
    return quaternions * np.array([-1.0, -1.0, -1.0, 1.0])


def rotate(quaternions: Array, vectors: Array) -> Array:
    """Vectors turned by unit quaternions, (..., 4) x (..., 3) -> (..., 3); leading axes broadcast."""
    x, y, z, w = (quaternions[..., i] for i in range(4))
    vx, vy, vz = (vectors[..., i] for i in range(3))
    # v + 2 w (u x v) + 2 u x (u x v), with t = 2 (u x v)
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    out = np.empty((*np.broadcast_shapes(quaternions.shape[:-1], vectors.shape[:-1]), 3))
    out[..., 0] = vx + w * tx + y * tz - z * ty
    out[..., 1] = vy + w * ty + z * tx - x * tz
    out[..., 2] = vz + w * tz + x * ty - y * tx
    return out


def to_matrix(quaternions: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    columns = [rotate(quaternions, axis) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def from_matrix(matrices: Array) -> Array:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3)."""
    m = np.moveaxis(matrices, (-2, -1), (0, 1))  # (3, 3, ...)
    one = np.ones(m.shape[2:])
    # The rows of the symmetric matrix 4 q q^T: each is the quaternion times one of its parts. Shepperd's method takes
    # the row with the largest part, which is never near zero.
    rows = np.array(
        [
            [one + m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], one - m[0, 0] + m[1, 1] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], one - m[0, 0] - m[1, 1] + m[2, 2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], one + m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )  # (4, 4, ...)
    parts = np.stack([rows[i, i] for i in range(4)])  # (4, ...)
    chosen = np.take_along_axis(rows, np.argmax(parts, axis=0)[None, None], axis=0)[0]  # (4, ...)
    return np.moveaxis(chosen / np.linalg.norm(chosen, axis=0), 0, -1)


def to_6d(quaternions: Array) -> Array:
    """The first two columns of the rotation matrix, (..., 4) -> (..., 6) as [column 0, column 1] (Zhou et al. 2019)."""
    axes = np.eye(3)
    return np.concatenate([rotate(quaternions, axes[0]), rotate(quaternions, axes[1])], axis=-1)


def from_6d(columns: Array) -> Array:
    """The rotation whose first two columns are nearest to the given ones: (..., 6) -> (..., 4).

    Both columns give way alike (symmetric orthonormalisation), where Gram-Schmidt (Zhou et al. 2019, Eq. 15) keeps the
    direction of the first: of a mean of rotations that face opposite ways one column all but vanishes, and its
    direction means nothing. Of columns that vanish or are parallel there is no nearest rotation; what there is of the
    first is kept.
    """
    first, second = columns[..., :3], columns[..., 3:]
    across = np.sum(first * second, axis=-1, keepdims=True)
    squares = np.sum(first * first, axis=-1, keepdims=True), np.sum(second * second, axis=-1, keepdims=True)
    # The inverse square root of the 2 x 2 matrix of products, in closed form.
    area = np.sqrt(np.maximum(squares[0] * squares[1] - across**2, 0.0))
    scale = area * np.sqrt(squares[0] + squares[1] + 2 * area)
    sound = (area > _SOUND * (squares[0] + squares[1]))[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = ((squares[1] + area) * first - across * second) / scale
        y = ((squares[0] + area) * second - across * first) / scale
    if not sound.all():
        x[~sound], y[~sound] = _gram_schmidt(first[~sound], second[~sound])
    return from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))


_SOUND = 1e-6
"""Columns that span less than this of what square ones would are taken for parallel."""


def _gram_schmidt(first: Array, second: Array) -> tuple[Array, Array]:
    """Two square unit columns (n, 3) of any two."""
    first = _unit(first, fallback=np.array([1.0, 0.0, 0.0]))
    second = second - np.sum(first * second, axis=-1, keepdims=True) * first
    # Any axis off the first column serves as second where the given one is parallel to it.
    spare = np.eye(3)[np.argmin(np.abs(first), axis=-1)]
    spare = spare - np.sum(first * spare, axis=-1, keepdims=True) * first
    return first, _unit(second, fallback=spare / np.linalg.norm(spare, axis=-1, keepdims=True))


def _unit(vectors: Array, fallback: Array) -> Array:
    norms = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(norms > 1e-9, vectors / np.maximum(norms, 1e-9), fallback)


def from_axis_angle(axis: Array, angle_radians: Array | float) -> Array:
    """Rotation by `angle_radians` (...) about the unit vector `axis` (3,): (..., 4)."""
    half = np.asarray(angle_radians, dtype=float)[..., None] / 2
    return np.concatenate([np.sin(half) * axis, np.cos(half)], axis=-1)


def to_rotation_vector(quaternions: Array) -> Array:
    """Axis times angle in radians, the shorter way round (at most pi): (..., 4) -> (..., 3)."""
    q = np.where(quaternions[..., 3:] < 0, -quaternions, quaternions)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., 3:])
    return q[..., :3] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)


def from_rotation_vector(vectors: Array) -> Array:
    """Unit quaternions of axis times angle in radians, (..., 3) -> (..., 4)."""
    half = np.linalg.norm(vectors, axis=-1, keepdims=True) / 2
    return np.concatenate([vectors / 2 * np.sinc(half / np.pi), np.cos(half)], axis=-1)


def angle_between(a: Array, b: Array) -> Array:
    """The angle in radians, 0 to pi, that turns `a` into `b`: (..., 4) x (..., 4) -> (...)."""
    relative = multiply(inverse(a), b)
    # atan2 stays exact for tiny angles, where arccos of a number near one loses half the digits.
    return 2 * np.arctan2(np.linalg.norm(relative[..., :3], axis=-1), np.abs(relative[..., 3]))


def slerp(a: Array, b: Array, weight: Array) -> Array:
    """Spherical interpolation along the shorter arc: `a` at weight 0, `b` at weight 1; all leading axes broadcast."""
    dot = np.sum(a * b, axis=-1)
    b = np.where(dot[..., None] < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    weight = np.asarray(weight, dtype=float)
    near = angle < 1e-6  # there the sines cancel, and a straight line is exact to rounding
    sine = np.where(near, 1.0, np.sin(angle))
    wa = np.where(near, 1 - weight, np.sin((1 - weight) * angle) / sine)
    wb = np.where(near, weight, np.sin(weight * angle) / sine)
    mixed = wa[..., None] * a + wb[..., None] * b
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


def continuous(quaternions: Array) -> Array:
    """The same rotations with signs that never jump along the first axis: (T, ..., 4) -> (T, ..., 4)."""
    if len(quaternions) < 2:
        return quaternions.copy()
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2 == 1, -1.0, 1.0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])


def heading(quaternions: Array) -> Array:
    """The turn about the up axis (y) within a rotation (swing-twist), (..., 4) -> unit quaternions (..., 4).

    A rotation that turns y upside down has no heading; the identity is returned for it.
    """
    twist = np.zeros_like(quaternions)
    twist[..., 1], twist[..., 3] = quaternions[..., 1], quaternions[..., 3]
    norm = np.linalg.norm(twist, axis=-1, keepdims=True)
    return np.where(norm > 1e-9, twist / np.maximum(norm, 1e-9), IDENTITY)
