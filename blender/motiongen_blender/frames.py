"""Arrays of rotations, and motions as JSON: NumPy only, no Blender.

Quaternions are xyzw here and on the wire, wxyz in Blender.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotation `b` followed by `a`, (..., 4) x (..., 4) -> (..., 4)."""
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def inverse(quaternions: np.ndarray) -> np.ndarray:
    """The inverse of unit quaternions, (..., 4)."""
    return quaternions * np.array([-1.0, -1.0, -1.0, 1.0])


def rotate(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors turned, (..., 4) x (..., 3) -> (..., 3)."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    across = 2 * np.cross(axis, vectors)
    return vectors + w * across + np.cross(axis, across)


def continuous(quaternions: np.ndarray) -> np.ndarray:
    """The same rotations (T, ..., 4) with signs that never jump from one frame to the next."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2 == 1, -1.0, 1.0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])


def to_local(parents: list[int], rotations: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (T, J, 4) and positions (T, J, 3) to those in the frame of each joint's parent."""
    local, moved = rotations.copy(), positions.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            back = inverse(rotations[:, parent])
            local[:, joint] = multiply(back, rotations[:, joint])
            moved[:, joint] = rotate(back, positions[:, joint] - positions[:, parent])
    return local, moved


def to_world(parents: list[int], rotations: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of `to_local`."""
    turned, positions = rotations.copy(), translations.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            turned[:, joint] = multiply(turned[:, parent], rotations[:, joint])
            positions[:, joint] = positions[:, parent] + rotate(turned[:, parent], translations[:, joint])
    return turned, positions


def encode(values: Any) -> dict[str, Any]:
    """An array as the protocol writes it."""
    array = np.ascontiguousarray(values, dtype="<f8")
    return {"dtype": "<f8", "shape": list(array.shape), "data": base64.b64encode(array.tobytes()).decode("ascii")}


def decode(given: dict[str, Any]) -> np.ndarray:
    """The inverse of `encode`."""
    array = np.frombuffer(base64.b64decode(given["data"]), np.dtype(given["dtype"]))
    return array.reshape(given["shape"]).astype(np.float64)


def height(parents: list[int], offsets: np.ndarray) -> float:
    """The longest side of the resting joints' bounding box."""
    places = offsets.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            places[joint] += places[parent]
    return float(np.ptp(places, axis=0).max()) or 1.0


def local_translations(motion: dict[str, Any], offsets: np.ndarray) -> np.ndarray:
    """Where each joint of a motion as JSON is in its parent's frame, on a rig with these offsets.

    Joints sit at the rig's offsets (J, 3), but for those that translate: these go as far as in the motion, in heights.
    """
    own = decode(motion["offsets"])
    factor = height(motion["parents"], offsets) / height(motion["parents"], own)
    full = np.repeat(offsets[None], motion["rotations"]["shape"][0], axis=0)  # (T, J, 3)
    if motion["translating"]:
        full[:, motion["translating"]] = decode(motion["translations"]) * factor
    return full
