"""A clip as a body on the stage of the page: its limbs and balls, its size, its lane, and what it costs."""

from __future__ import annotations

import itertools
import math
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.web import shapes
from motiongen.web.body import STATURE, Body, bodies, upright_to
from motiongen.web.lanes import GAP, beside_each_other, on_one_spot
from tests.render.figures import biped, standing, walking
from tests.strategies import generators, motions, random_motion, random_skeleton, skeletons
from tests.web.wanderers import SPANS, turned, wandering

Array = NDArray[Any]


# -- bones


@given(generators())
def test_limbs_point_along_their_bones(rng: np.random.Generator) -> None:
    along = rng.normal(size=(60, 3)) * 10.0 ** rng.integers(-3, 3, size=(60, 1))
    along[:9] = [
        [0, 1, 0],
        [0, -1, 0],
        [1, 0, 0],
        [-1, 0, 0],
        [0, 0, 1],
        [0, 0, -1],
        [0, 0, 0],
        [1e-4, -1, 0],
        [0, 1e-7, 1],
    ]
    along = along.astype(np.float32)
    lengths = np.linalg.norm(along, axis=1)
    turns = upright_to(along, lengths)
    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-6)
    directions = turned(turns, [0.0, 1.0, 0.0]) * lengths[:, None]
    np.testing.assert_allclose(directions, along, atol=1e-6 * float(lengths.max()))


@given(motions(skeletons(min_joints=2)))
def test_no_limb_ends_in_the_open(motion: Motion) -> None:
    body = bodies([motion])[0]
    balls = {tuple(nodes): radius for nodes, radius in zip(body.joints.tolist(), body.joint_radii)}
    assert len(balls) == len(body.joints), "one ball at a place"
    for (upper, lower), limb in zip(body.figure.bones.tolist(), body.limbs):
        assert balls[upper, upper] >= limb[0] - 1e-6
        if (upper, lower) not in balls:  # but for one that ends inside a head
            assert balls[lower, lower] >= shapes.LIMB_TAPER * limb[0] - 1e-6


@pytest.mark.parametrize("mesh", [shapes.limb(), shapes.ball()])
def test_shapes_are_closed_and_seen_from_outside(mesh: shapes.Mesh) -> None:
    _, corners = np.unique(mesh.vertices.round(5), axis=0, return_inverse=True)
    faces = corners.ravel()[mesh.faces]
    edges = [(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1)) if a != b]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 > 1.0


def test_a_limb_reaches_from_end_to_end_and_a_disc_faces_up() -> None:
    limb, disc = shapes.limb(), shapes.disc()
    assert (limb.vertices[:, 1].min(), limb.vertices[:, 1].max()) == (0.0, 1.0)
    a, b, c = (disc.vertices[disc.faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()


# -- size and place


@given(motions(skeletons(min_joints=3), min_frames=2), st.sampled_from([0.01, 30.0]))
def test_a_clip_looks_the_same_in_any_unit(motion: Motion, factor: float) -> None:
    one, other = bodies([motion])[0], bodies([motion.scale(factor, "ft")])[0]
    np.testing.assert_allclose(other.nodes, one.nodes, atol=1e-4 * max(1.0, float(np.abs(one.nodes).max())))
    np.testing.assert_allclose(other.unit, factor * one.unit, rtol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_a_figure_stands_on_the_ground_and_is_about_a_man_tall(scale: float) -> None:
    body = bodies([standing(scale=scale)])[0]
    assert body.nodes[..., 1].min() == pytest.approx(0.0, abs=1e-5)
    assert body.nodes[..., 1].max() == pytest.approx(STATURE, rel=0.02)


def test_clips_of_known_units_are_shown_at_one_scale() -> None:
    child, man = bodies([walking(scale=60.0, unit="cm"), walking(scale=1.0, unit="m")])
    assert np.ptp(child.nodes[..., 1]) == pytest.approx(0.6 * np.ptp(man.nodes[..., 1]), rel=1e-4)


@given(st.lists(SPANS, min_size=1, max_size=5), st.booleans())
def test_lanes_never_overlap(spans: list[float], around: bool) -> None:
    turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), math.pi) if around else rot.IDENTITY
    cast_ = bodies([wandering(span).transform(turn) for span in spans])
    places, viewer = beside_each_other(cast_)
    right = np.array([viewer[2], -viewer[0]])
    grounds = [body.nodes[..., ::2] + place for body, place in zip(cast_, places)]
    ends = [((ground @ right).min(), (ground @ right).max()) for ground in grounds]
    for (_, end), (begin, _) in itertools.pairwise(ends):
        assert begin - end >= GAP - 1e-4, "from left to right, with free ground between"
    np.testing.assert_allclose([place @ viewer[::2] for place in places], 0.0, atol=1e-9)
    assert viewer @ np.sum([body.front for body in cast_], axis=0) >= -1e-9, "they are seen from the front"


def test_lanes_of_clips_that_go_far_along_x_lie_along_z() -> None:
    way = np.zeros((40, 3))
    way[:, 0] = np.linspace(0, 20, 40)
    places, _ = beside_each_other(bodies([biped(way)] * 3))
    assert np.ptp(places, axis=0)[0] == 0.0
    assert np.ptp(places, axis=0)[1] > 0.0


def test_on_one_spot_clips_are_where_they_are_in_one_world() -> None:
    near = standing(unit="m").transform(shift=(1.0, 0.0, 5.0))
    far = near.transform(shift=(3.0, 0.0, -2.0)).convert_unit("cm")
    cast_ = bodies([near, far])
    places, _ = on_one_spot(cast_)
    apart = (cast_[1].nodes[0, :, ::2] + places[1]) - (cast_[0].nodes[0, :, ::2] + places[0])
    np.testing.assert_allclose(apart * cast_[0].unit, np.tile([3.0, -2.0], (len(apart), 1)), atol=1e-4)


def kept(body: Body) -> int:
    """Bytes that a body holds."""
    return sum(value.nbytes for value in vars(body).values() if isinstance(value, np.ndarray))


def test_a_long_clip_of_many_joints_costs_little_beside_the_clip_itself() -> None:
    rng = np.random.default_rng(1)
    motion = random_motion(rng, random_skeleton(rng, 300, end_sites=False), frames=1200, translating=(0,))
    itself = motion.rotations.nbytes + motion.positions.nbytes + motion.world_rotations.nbytes
    tracemalloc.start()
    body = bodies([motion])[0]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept(body) < 0.2 * itself
    assert peak < 1.2 * itself
