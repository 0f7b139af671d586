"""The ground: a plane with a grid that fades with the distance, antialiased by its own formula."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.render.camera import Camera
from motiongen.render.palette import BACKDROP, GRID, GROUND

CELL = 0.5
"""Spacing of the grid's lines, in skeleton heights."""

_LINE = 0.65
"""Half the width of a line, in pixels."""

Float32 = NDArray[np.float32]


class Ground:
    """The ground as one camera sees it, ready to be painted for any shift of that camera along the plane.

    Everything but the phase of the grid depends on the pixel alone, so that a frame costs a few operations over the
    pixels whose lines can be seen.
    """

    def __init__(self, camera: Camera, size: tuple[int, int], radius: float, lines: bool = True) -> None:
        """Work out what each pixel sees.

        Args:
            camera: at shift zero.
            size: width and height of the picture in pixels.
            radius: how far from the world's origin (shifted with the camera), in heights, the ground has faded away.
            lines: whether to draw the grid.
        """
        width, height = size
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        rays = camera.rays(np.stack([x, y], axis=-1))  # (H, W, 3)
        down = np.minimum(rays[..., 1], -1e-6)
        depth = -camera.eye[1] / down
        hits = camera.eye[[0, 2]] + depth[..., None] * rays[..., [0, 2]]  # (H, W, 2) x and z
        seen = (rays[..., 1] < -1e-6) & (depth > 0)
        distance = np.linalg.norm(hits, axis=-1) / radius
        fade = np.where(seen, np.clip(1 - distance**2, 0, 1) ** 2, 0.0)  # (H, W)
        hits[fade == 0] = 0.0
        tint = np.array(GROUND) - np.array(BACKDROP)
        self._base = (np.array(BACKDROP) + 0.5 + fade[..., None] * tint).astype(np.float32)  # (H, W, 3)
        rows = np.flatnonzero(fade.max(axis=1) > 0.01)
        self._rows = slice(int(rows[0]), int(rows[-1]) + 1) if lines and len(rows) else slice(0, 0)
        # One pixel's step over the ground, along x and z: how wide a line of constant width on the screen is there.
        # Derivative of hit = eye + depth * ray for a ray that is linear in the pixel, exact where differences are not.
        footprint = np.empty_like(hits)
        across, downwards = camera.axes[0] / camera.focal, -camera.axes[1] / camera.focal
        for i, axis in enumerate((0, 2)):
            steps = [step[axis] - rays[..., axis] / down * step[1] for step in (across, downwards)]
            footprint[..., i] = np.abs(depth) * np.hypot(*steps)
        self._hits = (hits[self._rows] / CELL).astype(np.float32)  # (H', W, 2)
        self._sharpness = (CELL / np.maximum(footprint[self._rows], 1e-9)).astype(np.float32)
        amount = fade[self._rows] * np.minimum(1.0, 0.25 * self._sharpness.min(axis=-1))  # lines melt where too dense
        self._ink = amount[..., None].astype(np.float32) * (np.array(GRID) - np.array(GROUND)).astype(np.float32)

    def paint(self, shift: NDArray[np.float64]) -> NDArray[np.uint8]:
        """(H, W, 3) the ground as seen after the camera has moved by `shift` (3,) along the plane."""
        picture = self._base.copy()
        phase = (shift[[0, 2]] / CELL % 1.0).astype(np.float32)
        place = self._hits + phase
        off = np.abs(place - np.rint(place)) * self._sharpness  # (H', W, 2) pixels from the nearest line
        line = np.clip(_LINE + 0.5 - off.min(axis=-1), 0, 1)
        picture[self._rows] += line[..., None] * self._ink
        return picture.astype(np.uint8)
