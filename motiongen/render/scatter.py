"""A map of points in groups, each group in a colour of its own."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from motiongen.errors import MotionGenError
from motiongen.render import draw
from motiongen.render.palette import BACKDROP, INK, Colour

Array = NDArray[np.float64]

# The colour-blind safe hues of Okabe and Ito; further groups take hues of a wheel.
_COLOURS: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (230, 159, 0),
    (74, 74, 78),
    (190, 178, 40),
)

_SMALLEST, _LARGEST = 64, 8192
_SAMPLES = 3
"""A pixel, in each direction."""


def draw_scatter(points: Array, groups: NDArray[np.int64], side: int = 720) -> Image.Image:
    """Points on a square, coloured by group, each group's number at the middle of its points.

    Args:
        points: (N, 2), right and up; the picture keeps their proportions.
        groups: (N,) from 0 on.
        side: of the picture in pixels.

    Raises:
        MotionGenError: if there is no point, or the side is out of range.
    """
    if not len(points):
        raise MotionGenError("there is nothing to show: give at least one point")
    if not _SMALLEST <= side <= _LARGEST:
        raise MotionGenError(f"a map must have {_SMALLEST} to {_LARGEST} pixels a side, not {side}")
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 0.9 * side / max(float((high - low).max()), 1e-9)
    at = (points - (low + high) / 2) * [scale, -scale] + side / 2  # (N, 2) pixels
    radius = max(0.12 * side / np.sqrt(len(points)), 1.5)
    large = Image.new("RGB", (side * _SAMPLES, side * _SAMPLES), BACKDROP)
    canvas = ImageDraw.Draw(large)
    for (x, y), group in zip(at * _SAMPLES, groups.tolist()):
        r = radius * _SAMPLES
        canvas.ellipse((x - r, y - r, x + r, y + r), fill=_colour(group))
    picture = large.reduce(_SAMPLES)
    for group in np.unique(groups).tolist():
        middle = np.median(at[groups == group], axis=0)
        _write_number(picture, (float(middle[0]), float(middle[1])), str(group))
    return picture


def _write_number(picture: Image.Image, at: tuple[float, float], text: str) -> None:
    size = max(0.028 * picture.width, 12.0)
    ImageDraw.Draw(picture).ellipse([at[0] - size, at[1] - size, at[0] + size, at[1] + size], fill=BACKDROP)
    draw.write(picture, at, text, size=size, colour=INK, anchor="mm")


def _colour(group: int) -> Colour:
    if group < len(_COLOURS):
        return _COLOURS[group]
    red, green, blue = colorsys.hsv_to_rgb(group * 0.618 % 1.0, 0.6, 0.75)
    return round(255 * red), round(255 * green), round(255 * blue)
