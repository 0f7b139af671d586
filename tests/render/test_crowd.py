"""Figures that share a scene, and points on a map."""

from __future__ import annotations

import numpy as np
import pytest

from motiongen import kinematics
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.render.crowd import draw_scene, place_crowd
from motiongen.render.palette import BACKDROP
from motiongen.render.scatter import draw_scatter
from tests.datasets.clips import FIGURE, stride


def nodes(motion: Motion, frame: int) -> np.ndarray:
    """(N, 2) joints and end sites over the ground; one that is over stands on its last frame."""
    frame = min(frame, len(motion) - 1)
    return np.concatenate([motion.positions[frame], kinematics.end_site_positions(motion)[frame]])[:, [0, 2]]


@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_nobody_ever_comes_nearer_than_the_gap(gap: float) -> None:
    placed = place_crowd([stride(seed, frames=20 + seed) for seed in range(7)], gap, seed=1)
    for frame in range(26):
        for index, one in enumerate(placed):
            for other in placed[:index]:
                away = nodes(one, frame)[:, None] - nodes(other, frame)
                assert np.linalg.norm(away, axis=-1).min() >= gap * FIGURE.height - 1e-9


def test_motions_are_turned_and_moved_over_the_ground_and_nothing_else() -> None:
    motions = [stride(seed) for seed in range(4)]
    for motion, placed in zip(motions, place_crowd(motions, seed=3)):
        assert placed.name == motion.name
        np.testing.assert_array_equal(placed.rotations[:, 1:], motion.rotations[:, 1:])
        np.testing.assert_allclose(placed.positions[..., 1], motion.positions[..., 1], atol=1e-9)
        before, after = (np.linalg.norm(np.diff(each.root_positions, axis=0), axis=1) for each in (motion, placed))
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_the_first_begins_at_the_origin_and_seeds_repeat() -> None:
    motions = [stride(seed) for seed in range(3)]
    one, again, other = (place_crowd(motions, seed=seed) for seed in (5, 5, 6))
    np.testing.assert_allclose(one[0].root_positions[0, [0, 2]], 0, atol=1e-9)
    assert one == again
    assert one != other


def test_headings_can_be_given() -> None:
    motion = stride(0)
    ahead, back = (place_crowd([motion], heading_degrees=degrees)[0] for degrees in (0.0, 180.0))
    np.testing.assert_allclose(ahead.rotations, motion.rotations, atol=1e-12)
    np.testing.assert_allclose(back.positions[..., [0, 2]], -ahead.positions[..., [0, 2]], atol=1e-9)


def test_a_scene_shows_everyone_whole() -> None:
    placed = place_crowd([stride(seed) for seed in range(5)])
    picture = np.asarray(draw_scene(placed, 12, (320, 200), supersample=1)).astype(int)
    assert picture.shape == (200, 320, 3)
    vivid = np.ptp(picture, axis=-1) > 60
    rim = np.concatenate([vivid[0], vivid[-1], vivid[:, 0], vivid[:, -1]])
    assert vivid.sum() > 100
    assert not rim.any()
    alone = np.asarray(draw_scene(placed[:1], 12, (320, 200), supersample=1)).astype(int)
    rows = np.flatnonzero((np.ptp(alone, axis=-1) > 60).any(axis=1))
    crowd_rows = np.flatnonzero(vivid.any(axis=1))
    assert len(rows) > 60, "one alone fills the picture"
    assert len(crowd_rows) > 60


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: place_crowd([]), "at least one motion"),
        (lambda: place_crowd([stride(0)], gap=-1), "gap must be a number of at least 0 heights, not -1"),
        (lambda: draw_scene([], 0), "nothing to show"),
        (lambda: draw_scene([stride(0)], 24), "moment must be a frame from 0 to 23, not 24"),
        (lambda: draw_scene([stride(0)], 0, (10, 720)), "64 to 8192 pixels a side, not 10 x 720"),
        (lambda: draw_scene([stride(0)], 0, supersample=0), "supersample"),
        (lambda: draw_scatter(np.zeros((0, 2)), np.zeros(0, dtype=int)), "at least one point"),
        (lambda: draw_scatter(np.zeros((1, 2)), np.zeros(1, dtype=int), side=9), "64 to 8192 pixels a side, not 9"),
    ],
)
def test_what_cannot_be_shown_is_refused(call: object, words: str) -> None:
    assert callable(call)
    with pytest.raises(MotionGenError, match=words):
        call()


def test_a_map_keeps_right_right_and_up_up_and_groups_apart() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]).repeat(8, axis=0)
    points += 0.05 * np.random.default_rng(0).standard_normal(points.shape)
    groups = np.array([0, 1, 2]).repeat(8)
    picture = np.asarray(draw_scatter(points, groups, 300))
    assert picture.shape == (300, 300, 3)
    colours = {0: (0, 114, 178), 1: (213, 94, 0), 2: (0, 158, 115)}
    places = {group: np.argwhere((picture == colour).all(axis=-1)).mean(axis=0) for group, colour in colours.items()}
    assert places[0][1] < places[1][1] - 50, "right of it"
    assert places[2][0] < places[1][0] - 50, "above it"
    assert abs(places[0][0] - places[1][0]) < 20, "level with it"
    assert tuple(picture[0, 0]) == BACKDROP


def test_a_map_of_many_groups_has_a_colour_for_each() -> None:
    points = np.stack([np.arange(20.0), np.zeros(20)], axis=1)
    found = {tuple(colour) for colour in np.asarray(draw_scatter(points, np.zeros(20, dtype=int), 200)).reshape(-1, 3)}
    many = {tuple(colour) for colour in np.asarray(draw_scatter(points, np.arange(20), 200)).reshape(-1, 3)}
    assert len(many) > len(found)
