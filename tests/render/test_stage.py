"""Panels: nothing is cropped, proportions are true, pictures change when the figure does and only then."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.motion import Motion
from motiongen.render import draw
from motiongen.render.clips import Movie, build_movie
from motiongen.render.stage import Panel
from tests.puppets import load_clip
from tests.render.figures import biped, changed, one_joint, pixels, spider, standing, walking
from tests.strategies import generators, motions

WORDS = 40
"""Rows of pixels at the top of a panel that words are written in."""


def assert_whole(movie: Movie) -> None:
    """No part of any figure leaves its panel or gets under the words, at any moment."""
    for panel in movie.panels:
        at, depths = panel._pixels
        drawn = panel.actor.figure.drawn
        assert (depths[:, drawn] > 0).all()
        reach = panel.actor.figure.thickest * panel.view.camera.focal / depths[:, drawn]
        x, y = at[:, drawn, 0], at[:, drawn, 1]
        assert (x - reach >= 0).all()
        assert (x + reach <= panel.size[0]).all()
        assert (y - reach >= 1.9 * panel.text_size).all()
        assert (y + reach <= panel.size[1]).all()


def wander(motion: Motion, rng: np.random.Generator, stride: float) -> Motion:
    """The motion on a random walk through space, with steps of `stride` times its height."""
    moving = motion.with_translating([0])
    translations = moving.translations.copy()
    translations[:, 0] += np.cumsum(rng.normal(size=(len(moving), 3)), axis=0) * stride * motion.skeleton.height
    return moving.replace(translations=translations)


@given(
    generators(),
    st.lists(motions(max_frames=20), min_size=1, max_size=3),
    st.sampled_from([0.0, 0.1, 1.0, 1e4]),
    st.sampled_from([(120, 100), (300, 60), (640, 480)]),
)
def test_no_figure_leaves_its_panel(
    rng: np.random.Generator, clips: list[Motion], stride: float, size: tuple[int, int]
) -> None:
    movie = build_movie([wander(clip, rng, stride) for clip in clips], size=(size[0] * len(clips), size[1]))
    assert_whole(movie)


@given(generators(), motions(max_frames=4))
def test_no_pixel_of_a_figure_lies_at_the_edge(rng: np.random.Generator, clip: Motion) -> None:
    """The same, asked of the picture."""
    (panel,) = build_movie([wander(clip, rng, 0.3)], size=(160, 120)).panels
    at, depths = panel._pixels
    for moment in range(len(at)):
        picture = draw.blank(panel.size)
        draw.paint_figure(
            picture,
            panel.actor.figure,
            at[moment],
            depths[moment],
            focal=panel.view.camera.focal,
            factor=2,
            still=False,
        )
        touched = changed(picture, draw.blank(panel.size))
        assert touched.any()
        assert not touched[[0, -1]].any()
        assert not touched[:, [0, -1]].any()


@pytest.mark.parametrize("name", ["Salsa-Dancing-6", "Walk-In-Circle", "elephant-idle1", "xia-normal-walk"])
def test_real_clips_are_whole_and_large(shared_data: Path, name: str) -> None:
    clip = load_clip(shared_data / "characters" / f"{name}.bvh")[::4]
    movie = build_movie([clip], size=(640, 480))
    assert_whole(movie)
    (panel,) = movie.panels
    at, _ = panel._pixels
    spread = np.ptp(at[:, panel.actor.figure.drawn], axis=1)  # (N, 2)
    assert spread.max(axis=1).mean() > 0.35 * 480, "the figure is a good part of the picture"
    assert panel.actor.figure.sides.any(), "its names have sides"


def figure_height(panel: Panel, moment: int = 0) -> float:
    """From the sole to the crown, in pixels."""
    at, _ = panel._pixels
    return float(np.ptp(at[moment, panel.actor.figure.drawn, 1]))


def test_skeletons_of_one_unit_share_a_scale() -> None:
    child, man = build_movie([standing(scale=0.6), standing(name="man")], size=(400, 200)).panels
    assert figure_height(child) / figure_height(man) == pytest.approx(0.6, rel=0.1)  # perspective takes its share


@pytest.mark.parametrize("scale", [100.0, 1e-6, 1e6])
def test_other_units_do_not_matter(scale: float) -> None:
    panels = build_movie([walking(), walking(scale=scale)], size=(400, 200)).panels
    differing = changed(panels[0].paint(12), panels[1].paint(12))
    assert differing.mean() < 1e-3, "but for corners that are rounded the other way"


def test_known_units_are_converted() -> None:
    large, small = build_movie([standing(unit="m"), standing(scale=50.0, unit="cm")], size=(400, 200)).panels
    assert figure_height(small) / figure_height(large) == pytest.approx(0.5, rel=0.1)


def test_proportions_are_true() -> None:
    """What is half as long is half as long in the picture, within what perspective does to it."""
    (panel,) = build_movie([standing()], size=(600, 480)).panels
    at, _ = panel._pixels
    names = panel.actor.figure.bones[:, 1].tolist()
    leg, spine = (abs(np.diff(at[0, panel.actor.figure.bones[names.index(j)], 1]))[0] for j in (4, 1))
    assert leg / spine == pytest.approx(0.9 / 0.5, rel=0.05)


def test_pictures_change_with_the_figure_and_only_then() -> None:
    still = build_movie([standing(30)], size=(200, 200))
    moving = build_movie([walking(30)], size=(200, 200))
    assert not changed(still.picture(0), still.picture(20))[WORDS:].any()
    assert changed(still.picture(0), still.picture(20))[:WORDS].any(), "the clock goes on"
    for moment in (0, 10, 20):
        assert changed(moving.picture(moment), moving.picture(moment + 9))[WORDS:].any()


def test_pictures_do_not_depend_on_what_was_drawn_before() -> None:
    movie, other = (build_movie([walking(90), spider()], size=(300, 150)) for _ in range(2))
    for moment in (0, 50, 20):
        movie.picture(moment)
    assert not changed(movie.picture(20), other.picture(20)).any()


def test_a_long_walk_is_followed_and_a_short_one_is_not() -> None:
    near = build_movie([walking(20), standing(20)], size=(400, 200)).panels
    far = build_movie([walking(300), standing(300)], size=(400, 200)).panels
    assert all(np.ptp(panel.view.track, axis=0).max() == 0 for panel in near)
    walker, idler = far
    heights = walker.view.track[:, 2]
    assert (np.diff(heights) > 0).all(), "the camera goes along"
    assert np.abs(np.diff(heights, 2)).max() < 1e-6, "as steadily as the figure"
    assert np.ptp(idler.view.track, axis=0).max() == pytest.approx(0, abs=1e-9)
    assert figure_height(walker) == pytest.approx(figure_height(idler), rel=0.1), "all cameras at the same distance"


def test_clips_of_one_skeleton_are_seen_from_one_side() -> None:
    turned = standing().transform(np.array([0.0, 1.0, 0.0, 0.0]))
    first, second = build_movie([standing(), turned], size=(400, 200)).panels
    np.testing.assert_array_equal(first.view.camera.axes, second.view.camera.axes)


def test_the_ground_is_at_one_height_in_all_panels() -> None:
    cameras = [panel.view.camera for panel in build_movie([standing(), spider(), walking(50)], size=(600, 200)).panels]
    levels = [camera.project(np.zeros(3))[0][1] for camera in cameras]
    np.testing.assert_allclose(levels, levels[0])


def test_the_figure_is_met_from_its_front() -> None:
    (panel,) = build_movie([standing()]).panels
    toes = panel.actor.nodes[0, [-4, -3]].mean(axis=0) - panel.actor.nodes[0, [4, 6]].mean(axis=0)
    assert toes @ panel.view.camera.axes[2] < -0.3 * np.linalg.norm(toes), "toes point towards the camera"


def test_a_clip_that_is_over_turns_grey_and_stays() -> None:
    movie = build_movie([walking(31), walking(61)], size=(400, 200))
    short, long = movie.panels
    assert short.actor.live.sum() == 31
    assert long.actor.live.all()
    for moment, grey in ((30, False), (45, True)):
        short.paint_figure(picture := draw.blank(short.size), moment)
        colours = pixels(picture)
        assert (np.ptp(colours, axis=-1).max() < 5) == grey
    assert not changed(short.paint(35), short.paint(60)).any(), "it stands, and so does its clock"
    assert changed(short.paint(20), short.paint(30))[WORDS:].any()


@pytest.mark.parametrize(
    "motion",
    [
        one_joint(np.zeros((1, 3))),
        one_joint(np.cumsum(np.ones((40, 3)), axis=0)),
        standing(1),
        spider(1),
        biped(np.linspace([0, 0, 0], [0, 30, 0], 40)),  # straight up
        biped(np.linspace([0, 0, 0], [1e6, 0, 0], 40)),
        standing(scale=1e-9),
    ],
    ids=["point", "moving point", "one frame", "spider", "rising", "fast", "tiny"],
)
def test_odd_clips_are_shown(motion: Motion) -> None:
    movie = build_movie([motion], size=(160, 120))
    assert_whole(movie)
    for moment in {0, movie.length // 2, movie.length - 1}:
        panel = movie.panels[0]
        picture = panel.paint(moment)
        panel.paint_words(empty := draw.blank((160, 120)), moment)
        assert changed(picture, empty)[WORDS:].any()


def test_shadows_and_paths_are_on_the_ground() -> None:
    """Seen from the side that the light comes from, a shadow starts where the sole stands."""
    (panel,) = build_movie([standing()], size=(300, 300)).panels
    at, _ = panel._pixels
    lit, _ = panel._shadow_pixels
    lowest = panel.actor.nodes[0, :, 1].argmin()
    np.testing.assert_allclose(lit[0, lowest], at[0, lowest], atol=0.5)
    assert np.ptp(lit[0, :, 1]) < 0.5 * np.ptp(at[0, :, 1]), "a shadow lies down"
