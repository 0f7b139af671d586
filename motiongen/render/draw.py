"""Drawing on a panel: thick rounded bones, shadows, paths and words, each antialiased inside its own small box."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from motiongen.render.camera import NEAR
from motiongen.render.figure import LEFT, MARKED, MIDDLE, RIGHT, Figure
from motiongen.render.palette import BACKDROP, GROUND, PATH, SHADOW, SIDES, STILL, Colour, mix

Array = NDArray[np.float64]

_HALO = 0.006
"""Width, in heights, of the light edge that lets a near bone stand out before a far one."""

_DARKNESS = 72
"""Of shadows, of 255."""

_FLATTENED = np.array([1.0, 0.4])
"""How much lower than wide something round on the ground looks, about."""


def capsules(starts: Array, ends: Array, start_radii: Array, end_radii: Array, corners: int = 7) -> Array:
    """(B, 2 * corners, 2) outlines of tapered bones with round ends, from points (B, 2) and radii (B,), in pixels."""
    along, _ = _directions(starts, ends)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    angles = np.linspace(-np.pi / 2, np.pi / 2, corners)[:, None]
    ahead = np.cos(angles) * along[:, None] + np.sin(angles) * aside[:, None]  # (B, corners, 2)
    return np.concatenate(
        [ends[:, None] + end_radii[:, None, None] * ahead, starts[:, None] - start_radii[:, None, None] * ahead], axis=1
    )


def _directions(starts: Array, ends: Array) -> tuple[Array, Array]:
    """(B, 2) unit directions and (B, 1) lengths; what points straight at the camera is said to point to the right."""
    along = ends - starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return np.where(length > 1e-9, along / np.maximum(length, 1e-9), [1.0, 0.0]), length


def sharpened(
    picture: Image.Image, corners: Array, factor: int, draw: Callable[[ImageDraw.ImageDraw, Array], None]
) -> None:
    """Draw on `picture`, antialiased by `factor` x `factor` samples a pixel.

    Only the box between `corners` (2, 2) is enlarged, drawn on and averaged down again, which leaves the pixels that
    nothing is drawn on exactly as they were. `draw` gets a canvas and the (2,) pixel that is its origin.
    """
    low = np.clip(np.floor(corners[0]), 0, picture.size).astype(int)
    high = np.clip(np.ceil(corners[1]), 0, picture.size).astype(int)
    if (low >= high).any():
        return
    box = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    width, height = (high - low) * factor
    patch = picture.crop(box).resize((int(width), int(height)), Image.Resampling.NEAREST)
    draw(ImageDraw.Draw(patch), low.astype(float))
    picture.paste(patch.reduce(factor), box)


def paint_figure(
    picture: Image.Image, figure: Figure, pixels: Array, depths: Array, *, focal: float, factor: int, still: bool
) -> None:
    """Draw the bones from far to near, the far ones paler.

    Args:
        picture: the panel.
        figure: what to draw.
        pixels: (N, 2) where the nodes are in the panel.
        depths: (N,) how far they are from the camera, in heights.
        focal: of the camera, in pixels.
        factor: samples a pixel, in each direction.
        still: whether the clip is over and its last pose only held: drawn in grey.
    """
    scale = focal / np.maximum(depths, NEAR)  # (N,) pixels per height
    drawn = figure.drawn
    margin = (figure.thickest + _HALO) * scale[drawn].max() + 1
    corners = np.stack([pixels[drawn].min(axis=0) - margin, pixels[drawn].max(axis=0) + margin])
    upper, lower = figure.bones[:, 0], figure.bones[:, 1]
    haloed = figure.radii[:, 0] > 0.5 * figure.radii.max(initial=0.0)  # fingers would only speckle one another
    upper_radii, lower_radii = figure.radii[:, 0] * scale[upper], figure.radii[:, 1] * scale[lower]
    centres, ball_depths = pixels[figure.balls].mean(axis=1), depths[figure.balls].mean(axis=1)
    depth = np.concatenate([(depths[upper] + depths[lower]) / 2, ball_depths - figure.ball_radii])
    pale = np.clip(0.3 + (depth - depths[figure.root]) / 1.2, 0, 1) * 0.5

    sides = np.concatenate([figure.sides, figure.ball_sides])
    hues = np.array([STILL if still else SIDES[side] for side in (MIDDLE, LEFT, RIGHT, MARKED)])[sides]
    colours = np.rint(hues + (np.array(GROUND) - hues) * pale[:, None]).astype(int).tolist()

    def draw(canvas: ImageDraw.ImageDraw, origin: Array) -> None:
        at = (pixels - origin) * factor - 0.5
        halo = _HALO * scale[figure.root] * factor
        wide, narrow = upper_radii * factor, lower_radii * factor
        outlines = _polygons(capsules(at[upper], at[lower], wide, narrow))
        halos = _polygons(_flanks(at[upper], at[lower], wide + halo, narrow + halo))
        middles, balls = (centres - origin) * factor - 0.5, figure.ball_radii * focal / ball_depths * factor
        for i in np.argsort(-depth).tolist():
            if i < len(upper):
                if haloed[i]:
                    canvas.polygon(halos[i], fill=GROUND)
                canvas.polygon(outlines[i], fill=tuple(colours[i]))
            else:
                (x, y), r = middles[i - len(upper)], balls[i - len(upper)]
                canvas.ellipse((x - r, y - r, x + r, y + r), fill=tuple(colours[i]))

    sharpened(picture, corners, factor, draw)


def _flanks(starts: Array, ends: Array, start_radii: Array, end_radii: Array) -> Array:
    """(B, 4, 2) the flanks of tapered bones, from points (B, 2) and radii (B,).

    They end square and short of the joints, so that a halo cuts what is behind the bone and not the neighbour's end.
    """
    along, length = _directions(starts, ends)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    wide, narrow = start_radii[:, None], end_radii[:, None]
    starts, ends = starts + np.minimum(wide, 0.4 * length) * along, ends - np.minimum(narrow, 0.4 * length) * along
    return np.stack(
        [starts + wide * aside, ends + narrow * aside, ends - narrow * aside, starts - wide * aside], axis=1
    )


def _polygons(corners: Array) -> list[list[float]]:
    """Corners (B, C, 2) as Pillow takes them: rounded, for Pillow would cut them off."""
    return np.rint(corners).reshape(len(corners), 2 * corners.shape[1]).tolist()


def paint_shadow(picture: Image.Image, figure: Figure, pixels: Array, depths: Array, *, focal: float) -> None:
    """Lay the shadow of bones and balls, whose nodes fall on pixels (N, 2) of the ground at depths (N,), softly."""
    ends, radii = (
        np.concatenate([figure.bones, figure.balls]),
        np.concatenate([figure.radii, figure.ball_radii[:, None].repeat(2, axis=1)]),
    )
    seen = (depths[ends] > NEAR).all(axis=1)
    if not seen.any():
        return
    ends = ends[seen]  # (B', 2)
    radii = radii[seen] * focal / depths[ends]
    reach = radii[..., None] + 3  # (B', 2, 1)
    low = np.clip(np.floor((pixels[ends] - reach).min(axis=(0, 1))), 0, picture.size).astype(int)
    high = np.clip(np.ceil((pixels[ends] + reach).max(axis=(0, 1))), 0, picture.size).astype(int)
    if (low >= high).any():
        return
    mask = Image.new("L", (2 * int(high[0] - low[0]), 2 * int(high[1] - low[1])))
    canvas = ImageDraw.Draw(mask)
    at = 2 * (pixels - low) / _FLATTENED
    outlines = capsules(at[ends[:, 0]], at[ends[:, 1]], 2 * radii[:, 0], 2 * radii[:, 1], corners=5) * _FLATTENED
    for outline in _polygons(outlines):
        canvas.polygon(outline, fill=_DARKNESS)
    picture.paste(SHADOW, (int(low[0]), int(low[1])), mask.reduce(2).filter(ImageFilter.BoxBlur(1)))


def paint_path(picture: Image.Image, pixels: Array, visible: NDArray[np.bool_], *, now: int, factor: int) -> None:
    """Draw the way over the ground through pixels (P, 2): strong up to point `now`, faint from there on."""
    for first, last, colour in ((now, len(pixels), mix(PATH, GROUND, 0.72)), (0, now + 1, mix(PATH, GROUND, 0.15))):
        for run in _runs(visible[first:last]):
            line = pixels[first:last][run]
            if np.ptp(line, axis=0).max() < 1:  # it stands: a speck would be no way
                continue
            corners = np.stack([line.min(axis=0) - 3, line.max(axis=0) + 3])

            def draw(canvas: ImageDraw.ImageDraw, origin: Array, line: Array = line, colour: Colour = colour) -> None:
                at = np.rint((line - origin) * factor - 0.5).ravel().tolist()
                canvas.line(at, fill=colour, width=round(1.8 * factor), joint=None)

            sharpened(picture, corners, factor, draw)


def _runs(visible: NDArray[np.bool_]) -> list[slice]:
    """The stretches of two or more points that can be seen."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], visible.astype(np.int8), [0]])))
    return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist() if b - a > 1]


@lru_cache(maxsize=32)
def font(size: float) -> Any:
    """Pillow's own scalable font, `size` pixels high."""
    return ImageFont.load_default(size)


@lru_cache(maxsize=256)
def fitting(text: str, size: float, width: float) -> str:
    """`text` on one line, cut with an ellipsis so that it is no wider than `width` pixels."""
    text = " ".join(text.split())
    if font(size).getlength(text) <= width:
        return text
    while text and font(size).getlength(text + "...") > width:
        text = text[:-1]
    return text + "..." if text else ""


def write(
    picture: Image.Image, at: tuple[float, float], text: str, *, size: float, colour: Colour, anchor: str
) -> None:
    """Write one line with Pillow's `anchor` (such as "la": left, ascender) at a pixel."""
    mask, (left, top) = _letters(text, size, anchor)
    picture.paste(colour, (round(at[0]) + left, round(at[1]) + top), mask)


@lru_cache(maxsize=256)
def _letters(text: str, size: float, anchor: str) -> tuple[Image.Image, tuple[int, int]]:
    """The ink of a line of text, and where its corner is from the anchor; frame after frame says the same."""
    left, top, right, bottom = (round(side) for side in font(size).getbbox(text, anchor=anchor))
    mask = Image.new("L", (max(right - left, 1) + 2, max(bottom - top, 1) + 2))
    ImageDraw.Draw(mask).text((1 - left, 1 - top), text, fill=255, font=font(size), anchor=anchor)
    return mask, (left - 1, top - 1)


def blank(size: tuple[int, int]) -> Image.Image:
    """A picture with nothing on it."""
    return Image.new("RGB", size, BACKDROP)
