"""Rotations: the laws of a group, SciPy as a second opinion, and the places where formulas break."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from motiongen import rotations as rot
from tests.strategies import Array, generators, random_quaternions

TIGHT = 1e-12
SHAPES = [(), (1,), (7,), (3, 2), (0,), (2, 0, 3)]


def same_rotation(a: Array, b: Array, tolerance: float = TIGHT) -> None:
    """Hold two arrays of quaternions to each other, whatever their signs."""
    assert a.shape == b.shape
    signs = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    assert_allclose(a, signs * b, rtol=0, atol=tolerance)


def scipy_of(quaternions: Array) -> Rotation:
    return Rotation.from_quat(quaternions)


def yaw(angle_radians: Array | float) -> Array:
    return rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), angle_radians)


# -- the group


@given(generators())
def test_identity_inverse_and_associativity(rng: np.random.Generator) -> None:
    a, b, c = random_quaternions(rng, 3, 50)
    one = np.broadcast_to(rot.IDENTITY, a.shape)
    assert_allclose(rot.multiply(a, rot.IDENTITY), a, rtol=0, atol=0)
    assert_allclose(rot.multiply(rot.IDENTITY, a), a, rtol=0, atol=0)
    assert_allclose(rot.multiply(a, rot.inverse(a)), one, atol=TIGHT)
    assert_allclose(rot.multiply(rot.inverse(a), a), one, atol=TIGHT)
    assert_allclose(rot.multiply(rot.multiply(a, b), c), rot.multiply(a, rot.multiply(b, c)), atol=TIGHT)
    assert_allclose(rot.inverse(rot.multiply(a, b)), rot.multiply(rot.inverse(b), rot.inverse(a)), atol=TIGHT)


@given(generators())
def test_multiply_and_rotate_agree_with_scipy(rng: np.random.Generator) -> None:
    a, b = random_quaternions(rng, 2, 50)
    v = rng.normal(size=(50, 3))
    same_rotation(rot.multiply(a, b), (scipy_of(a) * scipy_of(b)).as_quat())
    assert_allclose(rot.rotate(a, v), scipy_of(a).apply(v), atol=TIGHT)


@given(generators())
def test_rotating_is_the_matrix_and_composes(rng: np.random.Generator) -> None:
    a, b = random_quaternions(rng, 2, 50)
    v = rng.normal(size=(50, 3))
    assert_allclose(rot.rotate(a, v), np.einsum("nij,nj->ni", rot.to_matrix(a), v), atol=TIGHT)
    assert_allclose(rot.rotate(rot.multiply(a, b), v), rot.rotate(a, rot.rotate(b, v)), atol=TIGHT)
    assert_allclose(rot.to_matrix(rot.multiply(a, b)), rot.to_matrix(a) @ rot.to_matrix(b), atol=TIGHT)
    assert_allclose(np.linalg.norm(rot.rotate(a, v), axis=-1), np.linalg.norm(v, axis=-1), atol=TIGHT)


@pytest.mark.parametrize("left", SHAPES)
@pytest.mark.parametrize("right", SHAPES)
def test_leading_axes_broadcast(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    a, b, v = random_quaternions(rng, *left), random_quaternions(rng, *right), rng.normal(size=(*right, 3))
    try:
        shape = np.broadcast_shapes(left, right)
    except ValueError:
        with pytest.raises(ValueError, match="broadcast"):
            rot.multiply(a, b)
        with pytest.raises(ValueError, match="broadcast"):
            rot.rotate(a, v)
        return
    wide_a, wide_b = np.broadcast_to(a, (*shape, 4)), np.broadcast_to(b, (*shape, 4))
    assert_allclose(rot.multiply(a, b), rot.multiply(wide_a, wide_b), atol=0)
    assert_allclose(rot.rotate(a, v), rot.rotate(wide_a, np.broadcast_to(v, (*shape, 3))), atol=0)
    assert rot.angle_between(a, b).shape == shape


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_of_conversions(shape: tuple[int, ...]) -> None:
    q = random_quaternions(np.random.default_rng(1), *shape)
    assert rot.to_matrix(q).shape == (*shape, 3, 3)
    assert rot.to_6d(q).shape == (*shape, 6)
    for back in (rot.from_matrix(rot.to_matrix(q)), rot.from_6d(rot.to_6d(q)), rot.inverse(q), rot.heading(q)):
        assert back.shape == (*shape, 4)
    assert rot.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.zeros(shape)).shape == (*shape, 4)


# -- conversions


@given(generators())
def test_matrices_agree_with_scipy_and_come_back(rng: np.random.Generator) -> None:
    q = random_quaternions(rng, 60)
    matrices = rot.to_matrix(q)
    assert_allclose(matrices, scipy_of(q).as_matrix(), atol=TIGHT)
    same_rotation(rot.from_matrix(matrices), q)
    same_rotation(rot.from_matrix(matrices), Rotation.from_matrix(matrices).as_quat())


def test_matrices_of_half_turns_come_back() -> None:
    """Where the trace is -1 and the textbook formula divides by zero; about any axis, and just beside it."""
    rng = np.random.default_rng(2)
    axes = np.concatenate([np.eye(3), rng.normal(size=(50, 3))])
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    for angle in (np.pi, np.pi - 1e-9, np.pi + 1e-9, np.pi - 1e-4):
        q = np.stack([rot.from_axis_angle(axis, angle) for axis in axes])
        same_rotation(rot.from_matrix(rot.to_matrix(q)), q, 1e-9)


@given(generators())
def test_6d_is_two_columns_and_comes_back(rng: np.random.Generator) -> None:
    q = random_quaternions(rng, 60)
    matrices = rot.to_matrix(q)
    columns = rot.to_6d(q)
    assert_allclose(columns, np.concatenate([matrices[..., 0], matrices[..., 1]], axis=-1), atol=0)
    same_rotation(rot.from_6d(columns), q)


@given(generators())
def test_6d_ignores_lengths(rng: np.random.Generator) -> None:
    q = random_quaternions(rng, 60)
    lengths = np.repeat(rng.uniform(0.1, 9, size=(60, 2)), 3, axis=-1)
    same_rotation(rot.from_6d(lengths * rot.to_6d(q)), q, 1e-10)


@given(generators())
def test_6d_gives_the_rotation_with_the_nearest_columns(rng: np.random.Generator) -> None:
    """The orthonormal factor of the polar decomposition, by singular values."""
    columns = rng.normal(size=(60, 6))
    left, _, right = np.linalg.svd(np.stack([columns[:, :3], columns[:, 3:]], axis=-1), full_matrices=False)
    nearest = left @ right  # (60, 3, 2)
    assert_allclose(rot.to_6d(rot.from_6d(columns)), np.concatenate([nearest[..., 0], nearest[..., 1]], -1), atol=1e-7)


@given(generators())
def test_6d_of_degenerate_columns_is_still_a_rotation(rng: np.random.Generator) -> None:
    first = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(20, 3))])
    nothing = np.zeros_like(first)
    cases = {"zero": (nothing, nothing), "no first": (nothing, first), "no second": (first, nothing)}
    cases |= {"parallel": (first, 3 * first), "opposite": (first, -first), "nearly": (first, first * (1 + 1e-13))}
    for case, (a, b) in cases.items():
        q = rot.from_6d(np.concatenate([a, b], axis=-1))
        assert np.isfinite(q).all(), case
        assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=TIGHT, err_msg=case)
        if (a != 0).any():  # what is there is kept
            unit = first / np.linalg.norm(first, axis=-1, keepdims=True)
            assert_allclose(rot.to_6d(q)[..., :3], unit, atol=1e-9, err_msg=case)
    same_rotation(rot.from_6d(np.zeros((1, 6))), rot.IDENTITY[None])


@given(generators())
def test_axis_and_angle(rng: np.random.Generator) -> None:
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angles = rng.uniform(-7, 7, size=20)
    q = rot.from_axis_angle(axis, angles)
    same_rotation(q, Rotation.from_rotvec(angles[:, None] * axis).as_quat())
    assert_allclose(rot.rotate(q, axis), np.broadcast_to(axis, (20, 3)), atol=TIGHT)
    same_rotation(rot.multiply(q[0], q[1]), rot.from_axis_angle(axis, angles[0] + angles[1]))
    assert_allclose(rot.from_axis_angle(axis, 0.0), rot.IDENTITY, atol=0)


# -- between rotations


@given(generators())
def test_angle_between_is_a_distance(rng: np.random.Generator) -> None:
    a, b, c, turn = random_quaternions(rng, 4, 50)
    angle = rot.angle_between(a, b)
    assert_allclose(angle, (scipy_of(a).inv() * scipy_of(b)).magnitude(), atol=1e-9)
    assert_allclose(angle, rot.angle_between(b, a), atol=TIGHT)
    assert_allclose(angle, rot.angle_between(-a, b), atol=TIGHT)
    assert_allclose(angle, rot.angle_between(rot.multiply(turn, a), rot.multiply(turn, b)), atol=1e-9)
    assert (angle <= rot.angle_between(a, c) + rot.angle_between(c, b) + 1e-9).all()
    assert ((angle >= 0) & (angle <= np.pi + TIGHT)).all()


@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-9, 1e-7, 1.0, 3.0, np.pi])
def test_angle_between_keeps_its_digits(angle: float) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    assert_allclose(rot.angle_between(rot.IDENTITY, rot.from_axis_angle(axis, angle)), angle, rtol=1e-12)


@given(generators(), st.floats(0, 1))
def test_slerp_agrees_with_scipy(rng: np.random.Generator, weight: float) -> None:
    q = random_quaternions(rng, 2)
    if rot.angle_between(q[0], q[1]) > np.pi - 1e-6:
        return  # two arcs are equally short
    expected = Slerp([0.0, 1.0], scipy_of(q))([weight]).as_quat()[0]
    same_rotation(rot.slerp(q[0], q[1], np.array(weight)), expected, 1e-9)


@given(generators())
def test_slerp_turns_at_constant_speed_along_the_shorter_arc(rng: np.random.Generator) -> None:
    a, b = random_quaternions(rng, 2, 50)
    weights = np.linspace(0, 1, 9)[:, None]  # (9, 1)
    path = rot.slerp(a, b, weights)  # (9, 50, 4)
    assert_allclose(np.linalg.norm(path, axis=-1), 1.0, atol=TIGHT)
    whole = rot.angle_between(a, b)
    assert_allclose(rot.angle_between(a, path), weights * whole, atol=1e-9)
    assert_allclose(rot.angle_between(path, b), (1 - weights) * whole, atol=1e-9)
    same_rotation(path[0], a)
    same_rotation(path[-1], b)


@given(generators())
def test_slerp_of_almost_equal_rotations(rng: np.random.Generator) -> None:
    """From no difference at all up to where the formula of sines takes over from the straight line."""
    a = random_quaternions(rng, 40)
    axis = np.array([0.0, 0.6, 0.8])
    turns = rot.from_axis_angle(axis, np.concatenate([[0.0], np.geomspace(1e-17, 1e-3, 39)]))
    for b in (rot.multiply(a, turns), -rot.multiply(a, turns)):
        middle = rot.slerp(a, b, np.array(0.25))
        assert_allclose(rot.angle_between(a, middle), 0.25 * rot.angle_between(a, b), rtol=1e-5, atol=1e-15)


@given(generators(), st.integers(0, 30), st.sampled_from([(), (4,), (2, 3)]))
def test_continuous_keeps_rotations_and_never_jumps(
    rng: np.random.Generator, frames: int, shape: tuple[int, ...]
) -> None:
    q = random_quaternions(rng, frames, *shape)
    q *= rng.choice([-1.0, 1.0], size=(frames, *shape, 1))
    smooth = rot.continuous(q)
    assert_allclose(np.abs(smooth), np.abs(q), atol=0)
    same_rotation(smooth, q, 0.0)
    assert (np.sum(smooth[1:] * smooth[:-1], axis=-1) >= 0).all()
    assert_allclose(smooth[:1], q[:1], atol=0)
    assert not np.shares_memory(smooth, q)


# -- heading


@given(generators())
def test_heading_is_a_turn_about_the_up_axis(rng: np.random.Generator) -> None:
    q = random_quaternions(rng, 60)
    heading = rot.heading(q)
    assert_allclose(np.linalg.norm(heading, axis=-1), 1.0, atol=TIGHT)
    up = np.broadcast_to([0.0, 1.0, 0.0], (60, 3))
    assert_allclose(rot.rotate(heading, up), up, atol=TIGHT)
    same_rotation(rot.heading(heading), heading)


@given(generators())
def test_heading_follows_a_turn_of_the_world_and_of_the_body(rng: np.random.Generator) -> None:
    q = random_quaternions(rng, 60)
    q = q[np.hypot(q[:, 1], q[:, 3]) > 1e-3]  # the others are upside down
    turn = yaw(rng.uniform(-4, 4))
    same_rotation(rot.heading(rot.multiply(turn, q)), rot.multiply(turn, rot.heading(q)), 1e-9)
    same_rotation(rot.heading(rot.multiply(q, turn)), rot.multiply(rot.heading(q), turn), 1e-9)


@given(generators())
def test_what_heading_leaves_is_a_tilt(rng: np.random.Generator) -> None:
    q = random_quaternions(rng, 60)
    tilt = rot.multiply(rot.inverse(rot.heading(q)), q)
    assert_allclose(tilt[:, 1], 0.0, atol=TIGHT)  # a turn about an axis that lies in the ground
    same_rotation(rot.heading(tilt), np.broadcast_to(rot.IDENTITY, tilt.shape), 1e-9)


def test_upside_down_has_no_heading() -> None:
    level = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0.6, 0, 0.8, 0]])
    assert_allclose(rot.heading(level), np.broadcast_to(rot.IDENTITY, level.shape), atol=0)


def test_nothing_is_changed_in_place() -> None:
    """Every function takes read-only arrays, and says nothing new when asked twice."""
    q = random_quaternions(np.random.default_rng(3), 2, 6)
    q.flags.writeable = False
    functions = (rot.inverse, rot.to_matrix, rot.to_6d, rot.continuous, rot.heading)
    for function in functions:
        assert_allclose(function(q), function(q.copy()), atol=0)
    for columns in (rot.to_6d(q), np.zeros((2, 6))):
        columns.flags.writeable = False
        rot.from_6d(columns)
    with pytest.raises(ValueError, match="read-only"):
        rot.IDENTITY[0] = 1.0
