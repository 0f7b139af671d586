"""The few shapes that everything on the stage is made of: vertices (V, 3) and triangles (F, 3), seen from outside."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

LIMB_TAPER = 0.76
"""A limb's radius at its lower end, in radii of its upper end."""

_LIMB_PROFILE = ((0.0, 0.0), (0.0, 1.0), (0.3, 0.97), (1.0, LIMB_TAPER), (1.0, 0.0))


class Mesh(NamedTuple):
    """A surface of triangles.

    Attributes:
        vertices: (V, 3) where its corners are.
        faces: (F, 3) the corners of each triangle, counter-clockwise seen from outside.
    """

    vertices: Float32
    faces: NDArray[np.uint32]


def limb(sides: int = 12) -> Mesh:
    """A tapered limb from the origin to (0, 1, 0), of radius 1 at its upper end, the origin."""
    return _turned([(height, radius) for height, radius in _LIMB_PROFILE], sides)


def ball(rings: int = 8, sides: int = 12) -> Mesh:
    """A ball of radius 1 around the origin."""
    angles = np.linspace(0.0, np.pi, rings + 1)
    return _turned([(-np.cos(angle), np.sin(angle)) for angle in angles], sides)


def disc(sides: int = 32) -> Mesh:
    """A flat disc of radius 1 around the origin, facing up."""
    return _turned([(0.0, 1.0), (0.0, 0.0)], sides)


def _turned(profile: list[tuple[float, float]], sides: int) -> Mesh:
    """What a profile of (height, radius), from the lowest point up, sweeps out when it is turned about the up axis."""
    angles = np.arange(sides) * (2 * np.pi / sides)
    around = np.stack([np.sin(angles), np.zeros(sides), np.cos(angles)], axis=1)  # (sides, 3)
    vertices = np.concatenate([radius * around + [0.0, height, 0.0] for height, radius in profile])
    here = np.arange(sides)
    after = (here + 1) % sides
    faces = []
    for ring, ((_, below), (_, above)) in enumerate(itertools.pairwise(profile)):
        low, high = ring * sides, (ring + 1) * sides
        if below > 1e-9:
            faces.append(np.stack([low + here, low + after, high + here], axis=1))
        if above > 1e-9:
            faces.append(np.stack([low + after, high + after, high + here], axis=1))
    return Mesh(vertices.astype(np.float32), np.concatenate(faces).astype(np.uint32))
