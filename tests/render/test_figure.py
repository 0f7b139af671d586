"""What is drawn of a skeleton: its bones, their sides, their thickness, and nothing that is no part of the body."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.render.figure import (
    LEFT,
    MIDDLE,
    RIGHT,
    Figure,
    body_root,
    build_figure,
    facing,
    figure_scale,
    node_positions,
)
from motiongen.skeleton import Skeleton
from tests.render.figures import one_joint, spider, standing, walking
from tests.strategies import generators, motions, skeletons


def figure_of(motion: Motion) -> Figure:
    nodes = node_positions(motion)
    return build_figure(motion, nodes, figure_scale(motion, nodes))


@given(motions())
def test_every_bone_of_some_length_is_drawn_once(motion: Motion) -> None:
    """Against a plain walk through the tree."""
    figure, nodes, skeleton = figure_of(motion), node_positions(motion), motion.skeleton
    root, scale = body_root(motion), figure_scale(motion, nodes)
    parents = [*skeleton.parents, *skeleton.end_sites]
    above = {root, *skeleton.ancestors(root)}
    expected = []
    for node, parent in enumerate(parents):
        length = np.median([np.linalg.norm(frame[node] - frame[parent]) for frame in nodes])
        if node not in above and length > 1e-3 * scale:
            expected.append((parent, node))
    assert [tuple(bone) for bone in figure.bones.tolist()] == expected
    assert figure.root in figure.drawn
    assert set(figure.bones.ravel()) <= set(figure.drawn)


@given(motions(skeletons(min_joints=2)))
def test_thickness_goes_with_the_size_and_thins_towards_the_tips(motion: Motion) -> None:
    figure, bigger = figure_of(motion), figure_of(motion.scale(1000.0))
    np.testing.assert_allclose(bigger.radii, 1000.0 * figure.radii, rtol=1e-6)
    np.testing.assert_allclose(bigger.ball_radii, 1000.0 * figure.ball_radii, rtol=1e-6)
    assert (figure.radii[:, 0] >= figure.radii[:, 1]).all()
    for upper, start, _ in zip(figure.bones[:, 0], figure.radii[:, 0], figure.radii):
        into = figure.bones[:, 1] == upper
        assert (start <= figure.radii[into, 1] + 1e-12).all(), "no bone starts thicker than the one above it ends"


def test_sides_by_name() -> None:
    motion = standing()
    figure = figure_of(motion)
    names = [*motion.skeleton.names, *(motion.skeleton.names[j] for j in motion.skeleton.end_sites)]
    for (_, lower), side in zip(figure.bones, figure.sides):
        wanted = LEFT if "Left" in names[lower] else RIGHT if "Right" in names[lower] else MIDDLE
        assert side == wanted, names[lower]


def test_sides_by_place_where_names_say_nothing() -> None:
    motion = spider()
    figure = figure_of(motion)
    x = motion.skeleton.rest_positions[figure.bones[:, 1], 0]
    assert (figure.sides == np.where(x > 0, LEFT, RIGHT)).all()


@given(generators())
def test_no_sides_where_the_body_has_none(rng: np.random.Generator) -> None:
    offsets = rng.normal(loc=(1.0, 0.0, 0.0), size=(5, 3))
    skeleton = Skeleton(tuple("abcde"), (-1, 0, 1, 0, 3), offsets)
    motion = Motion(skeleton, np.tile(rot.IDENTITY, (2, 5, 1)), np.zeros((2, 0, 3)), (), 30.0)
    assert (figure_of(motion).sides == MIDDLE).all()
    assert facing(skeleton, node_positions(motion)) is None


@pytest.mark.parametrize("degrees", [0, 90, 200])
def test_facing(degrees: int) -> None:
    turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.radians(degrees))
    motion = standing().transform(turn)
    front = facing(motion.skeleton, node_positions(motion))
    assert front is not None
    np.testing.assert_allclose(front, np.tile(rot.rotate(turn, np.array([0.0, 0.0, 1.0])), (10, 1)), atol=1e-9)


def test_the_head_is_a_ball_that_ends_where_the_head_ends() -> None:
    motion = standing(1)
    figure, nodes = figure_of(motion), node_positions(motion)[0]
    heads = [(a, b, radius) for (a, b), radius in zip(figure.balls, figure.ball_radii) if a != b]
    assert len(heads) == 1
    neck, crown, radius = heads[0]
    assert motion.skeleton.names[neck] == "Head"
    top = nodes[[neck, crown], 1].mean() + radius
    assert top == pytest.approx(nodes[crown, 1])
    assert (figure.radii[figure.bones[:, 1] == crown, 1] == 0).all(), "the bone does not stick out of the ball"


def test_the_way_from_the_worlds_origin_is_no_bone() -> None:
    """A still or a gliding joint 0 far below or beside the hips, as some files have."""
    walk = walking(20)
    skeleton = Skeleton(
        ("Ground", *walk.skeleton.names),
        (-1, *(parent + 1 for parent in walk.skeleton.parents)),
        np.concatenate([[[0, 0, 0], [500, 0, 0]], walk.skeleton.offsets[1:]]),
        tuple(joint + 1 for joint in walk.skeleton.end_sites),
        walk.skeleton.end_site_offsets,
    )
    rotations = np.concatenate([np.tile(rot.IDENTITY, (20, 1, 1)), walk.rotations], axis=1)
    for still in (True, False):
        if still:
            motion = Motion(skeleton, rotations, walk.translations, (1,), 30.0)
        else:
            both = np.concatenate([walk.translations * [1.0, 0.0, 1.0], walk.translations * [0.0, 1.0, 0.0]], axis=1)
            motion = Motion(skeleton, rotations, both, (0, 1), 30.0)
        nodes = node_positions(motion)
        assert body_root(motion) == 1
        assert figure_scale(motion, nodes) == pytest.approx(walk.skeleton.height)
        figure = figure_of(motion)
        assert 0 not in figure.drawn
        np.testing.assert_array_equal(figure.bones, figure_of(walk).bones + 1)


def test_scale_of_what_has_no_bones() -> None:
    way = np.zeros((10, 3))
    way[:, 0] = np.linspace(0, 7, 10)
    assert figure_scale(one_joint(way), way[:, None]) == pytest.approx(7.0)
    assert figure_scale(one_joint(np.zeros((3, 3))), np.zeros((3, 1, 3))) == 1.0
    figure = figure_of(one_joint(way))
    assert len(figure.bones) == 0
    assert figure.balls.tolist() == [[0, 0]]
    assert figure.thickest > 0


def test_scale_where_translations_make_the_pose() -> None:
    """A cloud of markers: every offset is zero, every joint is translated."""
    rng = np.random.default_rng(0)
    skeleton = Skeleton(tuple("abcd"), (-1, 0, 0, 0), np.zeros((4, 3)))
    places = rng.normal(size=(6, 4, 3)) * 40
    motion = Motion(skeleton, np.tile(rot.IDENTITY, (6, 4, 1)), places, (0, 1, 2, 3), 30.0)
    nodes = node_positions(motion)
    assert figure_scale(motion, nodes) == pytest.approx(np.median(np.ptp(nodes, axis=1).max(axis=1)))
