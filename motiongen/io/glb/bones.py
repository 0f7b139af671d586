"""A mesh for a bare skeleton: an octahedron along each bone, as riggers draw them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

THICKNESS = 0.08
"""Of a bone, as a share of its length."""

WAIST = 0.15
"""Where a bone is thickest, from its joint, as a share of its length."""

# Corners: joint, tip, and four around the waist; faces seen from outside turn counter-clockwise.
FACES = np.array([(0, 3, 2), (0, 4, 3), (0, 5, 4), (0, 2, 5), (1, 2, 3), (1, 3, 4), (1, 4, 5), (1, 5, 2)])


def bone_mesh(skeleton: Skeleton) -> tuple[Array, Array, NDArray[np.int64]]:
    """Positions (V, 3) in the rest pose, normals (V, 3), and the joint (V,) that each vertex moves with.

    Every three vertices are a triangle. A skeleton without bones gets a cross-shaped one at its joint.
    """
    rest = skeleton.rest_positions
    bones = [(parent, rest[parent], rest[joint]) for joint, parent in enumerate(skeleton.parents) if parent >= 0]
    bones += [
        (joint, rest[joint], rest[joint] + tip) for joint, tip in zip(skeleton.end_sites, skeleton.end_site_offsets)
    ]
    bones = [bone for bone in bones if np.linalg.norm(bone[2] - bone[1]) > 1e-9 * skeleton.height]
    if not bones:
        bones = [(0, rest[0], rest[0] + [0.0, 0.1 * skeleton.height, 0.0])]
    corners = np.stack([_corners(start, end) for _, start, end in bones])  # (N, 6, 3)
    triangles = corners[:, FACES]  # (N, 8, 3, 3)
    normals = np.cross(triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    owners = np.repeat([joint for joint, _, _ in bones], FACES.size)
    return triangles.reshape(-1, 3), np.repeat(normals.reshape(-1, 3), 3, axis=0), owners


def _corners(start: Array, end: Array) -> Array:
    along = end - start
    length = float(np.linalg.norm(along))
    helper = np.eye(3)[np.argmin(np.abs(along))]
    side = np.cross(along, helper)
    side *= THICKNESS * length / np.linalg.norm(side)
    other = np.cross(along, side) / length
    waist = start + WAIST * along
    return np.stack([start, end, waist + side, waist + other, waist - side, waist - other])
