"""Marks on a panel, against plain twins that look at every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from motiongen.render import camera as cam
from motiongen.render import draw
from motiongen.render.figure import LEFT, RIGHT, Figure
from motiongen.render.ground import CELL, Ground
from motiongen.render.palette import BACKDROP, GRID, GROUND, SIDES, gif_colours
from tests.render.figures import changed, pixels
from tests.strategies import generators


def distance_to_bone(points: np.ndarray, start: np.ndarray, end: np.ndarray, radii: tuple[float, float]) -> np.ndarray:
    """Signed distance (below 0: inside) of points (..., 2) to balls that shrink from one end to the other."""
    share = np.linspace(0, 1, 200)[:, None]
    centres, sizes = start + share * (end - start), radii[0] + share[:, 0] * (radii[1] - radii[0])
    return (np.linalg.norm(points[..., None, :] - centres, axis=-1) - sizes).min(axis=-1)


@given(generators(), st.booleans())
def test_capsules_cover_what_is_near_the_bone(rng: np.random.Generator, end_on: bool) -> None:
    start, end = rng.uniform(15, 45, size=(2, 2))
    end = start if end_on else end
    radii = (float(rng.uniform(4, 8)), float(rng.uniform(2, 4)))
    outline = draw.capsules(start[None], end[None], np.array([radii[0]]), np.array([radii[1]]))
    mask = Image.new("L", (60, 60))
    ImageDraw.Draw(mask).polygon(np.rint(outline).ravel().tolist(), fill=255)
    x, y = np.meshgrid(np.arange(60), np.arange(60))
    away = distance_to_bone(np.stack([x, y], axis=-1).astype(float), start, end, radii)
    inside = np.asarray(mask) > 0
    # Pillow's polygons are as exact as their rounded corners; a much shortened bone lacks a part of its thick end.
    slack = 1.5 + (radii[0] - radii[1] if np.linalg.norm(end - start) < radii[0] else 0.0)
    assert inside[away < -slack].all()
    assert not inside[away > 1.5].any()


@pytest.mark.parametrize("factor", [1, 2, 3, 5, 8])
def test_sharpening_leaves_other_pixels_alone(factor: int) -> None:
    rng = np.random.default_rng(factor)
    noise = Image.fromarray(rng.integers(0, 256, size=(40, 50, 3), dtype=np.uint8))
    picture = noise.copy()
    draw.sharpened(picture, np.array([[-5.0, 3.2], [70.0, 33.0]]), factor, lambda canvas, origin: None)
    assert not changed(picture, noise).any()

    def dot(canvas: ImageDraw.ImageDraw, origin: np.ndarray) -> None:
        x, y = ((np.array([20.0, 10.0]) - origin) * factor).tolist()
        canvas.rectangle((x, y, x + 4 * factor - 1, y + 2 * factor - 1), fill=(1, 2, 3))

    draw.sharpened(picture, np.array([[12.0, 4.0], [33.0, 21.0]]), factor, dot)
    expected = pixels(noise)
    expected[10:12, 20:24] = (1, 2, 3)
    np.testing.assert_array_equal(pixels(picture), expected)
    draw.sharpened(picture, np.array([[60.0, 4.0], [70.0, 21.0]]), factor, dot)  # out of the picture: nothing to do


def test_words_are_cut_to_fit() -> None:
    long = "a very long name " * 9
    assert draw.fitting("  two\nlines ", 14, 500) == "two lines"
    cut = draw.fitting(long, 14, 100)
    assert cut.endswith("...")
    assert draw.font(14).getlength(cut) <= 100
    assert draw.fitting(long, 14, 2) == ""


@pytest.mark.parametrize("text", ["", "x", "naïve 動き \U0001f57a", "a\tb"])
def test_any_words_can_be_written(text: str) -> None:
    picture = draw.blank((80, 30))
    draw.write(picture, (10, 8), text, size=12, colour=(0, 0, 0), anchor="la")
    assert changed(picture, draw.blank((80, 30))).any() == bool(text)


def test_the_path_is_strong_behind_and_faint_ahead() -> None:
    way = np.stack([np.linspace(10, 90, 9), np.full(9, 20.0)], axis=1)
    picture = draw.blank((100, 40))
    visible = np.ones(9, dtype=bool)
    visible[7] = False
    draw.paint_path(picture, way, visible, now=4, factor=3)
    ink = np.abs(pixels(picture)[20] - BACKDROP).sum(axis=-1)  # (100,)
    assert (ink[12:48] > 1.5 * ink[52:68].max()).all()
    assert (ink[52:68] > 0).all()
    assert (ink[73:] == 0).all(), "nothing where it cannot be seen"


@given(generators())
def test_grid_lines_lie_where_they_project_to(rng: np.random.Generator) -> None:
    frame = cam.Frame(0, 0, 160, 120, cam.focal_length(160))
    camera = cam.place(cam.view_axes(rng.normal(size=3)), rng.uniform(-0.3, 0.3, size=2), 6.0, frame)
    shift = rng.uniform(-9, 9, size=3) * [1, 0, 1]
    plain = Ground(camera, (160, 120), 3.0, lines=False).paint(shift).astype(int)
    drawn = Ground(camera, (160, 120), 3.0).paint(shift).astype(int)
    assert (drawn <= plain).all()
    assert (drawn >= np.array(GRID) - 1).all()
    ink = (plain - drawn).sum(axis=-1)
    along = rng.uniform(-1.2, 1.2, size=20)
    line = np.round(shift[0] / CELL) * CELL  # the world's line nearest to the camera's point, in the shifted world
    points = np.stack([np.full(20, line), np.zeros(20), shift[2] + along], axis=1)
    between = points + rng.choice([-1, 1]) * np.array([CELL / 2, 0, 0])
    between[:, 2] = (np.floor(between[:, 2] / CELL) + 0.5) * CELL
    for where, on_line in ((points, True), (between, False)):
        at, _ = camera.moved(shift).project(where)
        for x, y in np.floor(at).astype(int):
            if 1 <= x < 159 and 1 <= y < 119:
                near = ink[y - 1 : y + 2, x - 1 : x + 2]
                assert (near.max() > 6) if on_line else (ink[y, x] == 0)


@given(generators())
def test_the_grid_repeats(rng: np.random.Generator) -> None:
    frame = cam.Frame(0, 0, 80, 60, cam.focal_length(80))
    ground = Ground(cam.place(cam.view_axes(rng.normal(size=3)), np.zeros(2), 5.0, frame), (80, 60), 3.0)
    shift = rng.uniform(-9, 9, size=3)
    again = ground.paint(shift + CELL * rng.integers(-5, 6, size=3))
    assert np.abs(ground.paint(shift).astype(int) - again).max() <= 1


@pytest.mark.parametrize("nearer", [0, 1])
def test_near_bones_cover_far_ones_and_are_stronger(nearer: int) -> None:
    bones, radii = np.array([[0, 1], [2, 3]]), np.full((2, 2), 0.03)
    figure = Figure(
        bones, radii, np.array([LEFT, RIGHT]), np.array([[1, 1], [3, 3]]), np.full(2, 0.01), np.zeros(2, int), 0
    )
    crossing = np.array([[20.0, 50.0], [80.0, 50.0], [50.0, 20.0], [50.0, 80.0]])
    depths = np.full(4, 5.5)
    depths[2 * nearer : 2 * nearer + 2] = 5.0
    picture = draw.blank((100, 100))
    draw.paint_figure(picture, figure, crossing, depths, focal=500.0, factor=3, still=False)
    colours = pixels(picture)
    middle, ends = colours[50, 50], (colours[50, 30], colours[30, 50])
    np.testing.assert_array_equal(middle, ends[nearer])
    strength = [
        np.abs(colour - GROUND).sum() / np.abs(np.array(SIDES[side]) - GROUND).sum()
        for colour, side in zip(ends, (LEFT, RIGHT))
    ]
    assert strength[nearer] > 1.1 * strength[1 - nearer]


def test_gif_colours_leave_one_free() -> None:
    colours = gif_colours()
    assert len(colours) == 255
    assert all(0 <= channel <= 255 for colour in colours for channel in colour)
