"""Clips for the tests of the stage, and how viser turns things."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from tests.render.figures import biped

Array = NDArray[Any]

SPANS = st.floats(0.05, 3.0)


def turned(wxyz: Array, vectors: Array) -> Array:
    """Vectors turned by quaternions as viser orders them."""
    return rot.rotate(np.asarray(wxyz, dtype=float)[:, [1, 2, 3, 0]], np.asarray(vectors, dtype=float))


def wandering(span: float, frames: int = 12, **settings: Any) -> Motion:
    """The stiff figure on a way of its own."""
    rng = np.random.default_rng(int(1e6 * span))
    way = span * rng.normal(size=(frames, 3)) * [1.0, 0.0, 1.0]
    return biped(np.cumsum(way, axis=0), **settings)
