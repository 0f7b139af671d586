"""A perspective camera in NumPy, and how it is placed: fixed where the travel is small, else gliding along.

Lengths are skeleton heights, the world is y-up with the ground at y = 0, pixels run right and down.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR = 0.05
"""Depth, in heights, below which a point counts as behind the camera."""

ELEVATION = np.radians(15.0)
"""How far the camera looks down."""

HALF_VIEW = np.radians(13.0)
"""Half the angle of view over the longer side of the panel: narrow, so that proportions stay true at the edges."""

LEASH = 1.0
"""The following camera never aims further than this from the root, in heights."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera without roll.

    Attributes:
        eye: (3,) where it stands.
        axes: (3, 3) its right, up and forward directions in the world, as rows.
        focal: pixels per unit of sideways distance at depth 1.
        centre: the pixel (x, y) that it looks at.
    """

    eye: Array
    axes: Array
    focal: float
    centre: tuple[float, float]

    @classmethod
    def look_at(cls, eye: Array, target: Array, focal: float, centre: tuple[float, float]) -> Camera:
        """A camera at `eye` whose view axis runs through `target`, with the world's up upwards in the picture."""
        forward = np.asarray(target, dtype=float) - eye
        forward /= np.linalg.norm(forward)
        # Straight up or down there is no upward direction in the picture: take the world's -z.
        upright = np.array([0.0, 1.0, 0.0]) if np.hypot(forward[0], forward[2]) > 1e-9 else np.array([0.0, 0.0, -1.0])
        right = np.cross(forward, upright)
        right /= np.linalg.norm(right)
        return cls(np.array(eye, dtype=float), np.stack([right, np.cross(right, forward), forward]), focal, centre)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Pixels (..., 2) and depths (...) of world points (..., 3).

        Depth is the distance along the view axis. Points nearer than `NEAR` or behind the camera get the pixel that
        they would have at that depth: ask their depth before drawing them.
        """
        inside = (points - self.eye) @ self.axes.T  # (..., 3) right, up, forward
        depth = inside[..., 2]
        scale = self.focal / np.maximum(depth, NEAR)
        x = self.centre[0] + scale * inside[..., 0]
        y = self.centre[1] - scale * inside[..., 1]
        return np.stack([x, y], axis=-1), depth

    def rays(self, pixels: Array) -> Array:
        """(..., 3) world directions, one unit deep, of the lines of sight through pixels (..., 2)."""
        sideways = (pixels - np.asarray(self.centre)) / self.focal
        return sideways[..., :1] * self.axes[0] - sideways[..., 1:] * self.axes[1] + self.axes[2]

    def moved(self, shift: Array) -> Camera:
        """The same camera standing elsewhere, looking the same way."""
        return dataclasses.replace(self, eye=self.eye + shift)


@dataclass(frozen=True)
class Frame:
    """The rectangle of a panel that a figure must stay in, in pixels from the panel's top left corner.

    Attributes:
        left, top, right, bottom: its sides.
        focal: of the camera that fills it, in pixels.
    """

    left: float
    top: float
    right: float
    bottom: float
    focal: float

    @property
    def centre(self) -> tuple[float, float]:
        """The middle (x, y)."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    @property
    def slopes(self) -> Array:
        """(2,) how far to the side and up the rectangle reaches, per unit of depth."""
        return np.array([self.right - self.left, self.bottom - self.top]) / 2 / self.focal


def focal_length(side: float) -> float:
    """The focal length, in pixels, with which `side` pixels take up twice the angle `HALF_VIEW`."""
    return side / 2 / float(np.tan(HALF_VIEW))


def view_axes(towards: Array) -> Array:
    """(3, 3) camera axes for looking at a figure from the ground direction `towards` (3,), `ELEVATION` above it."""
    eye = np.array([towards[0], 0.0, towards[2]]) / np.hypot(towards[0], towards[2])
    eye = np.cos(ELEVATION) * eye + np.sin(ELEVATION) * np.array([0.0, 1.0, 0.0])
    return Camera.look_at(eye, np.zeros(3), 1.0, (0.0, 0.0)).axes


def reaches(points: Array, radius: float, axes: Array, frame: Frame) -> Array:
    """(2, 2) how much room points (..., 3), each a ball of `radius`, need: rows sideways and up, columns + and -.

    A camera that aims `c` to the side of the origin from distance `d` sees them all where `plus - c <= slope * d` and
    `minus + c <= slope * d`, so the least distance is half the sum over the slope and the best aim half the difference.
    """
    inside = (points @ axes.T).reshape(-1, 3)
    needs = []
    for axis, slope in enumerate(frame.slopes):
        margin = radius * np.hypot(1.0, slope) - slope * inside[:, 2]  # a ball touches the slanted side of the view
        needs.append([np.max(margin + inside[:, axis]), np.max(margin - inside[:, axis])])
    return np.array(needs)


def place(axes: Array, aim: Array, distance: float, frame: Frame) -> Camera:
    """The camera that looks along `axes` from `distance` at the point `aim` (2,), right of and above the origin."""
    eye = aim[0] * axes[0] + aim[1] * axes[1] - distance * axes[2]
    return Camera(eye, axes, frame.focal, frame.centre)


def glide(track: Array, frame_rate: float, seconds: float = 0.6) -> Array:
    """A calm track (N, 3) for the camera along a root's track (N, 3): a low pass that lags nowhere.

    Only the camera is smoothed, never the figure. A Gaussian of standard deviation `seconds`; the track is continued
    beyond its ends by its point reflection, so that a steady walk is followed steadily from the first frame to the
    last. Where the low pass would stray, over a jump cut for instance, it stays within `LEASH` of the root.
    """
    reach = int(np.ceil(3 * seconds * frame_rate))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (seconds * frame_rate)) ** 2)
    longer = np.pad(track, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = np.stack([np.convolve(longer[:, i], kernel / kernel.sum(), mode="valid") for i in range(3)], axis=1)
    stray = smooth - track
    length = np.linalg.norm(stray, axis=1, keepdims=True)
    return track + stray * LEASH * np.tanh(length / LEASH) / np.maximum(length, 1e-12)
