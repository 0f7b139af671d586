"""The turns of knee and hip that bring an ankle to its target."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.ik.solve import knee_axes, knee_bend, shortest_turn, smoothed, soft_limit, solve_legs
from tests.ik.rigs import SIDE
from tests.strategies import generators

Array = NDArray[np.float64]


def random_legs(rng: np.random.Generator, *shape: int) -> tuple[Array, Array, Array]:
    """Upper and lower bones of any length and direction, and the axis that the knee is bent about."""
    upper, lower = rng.normal(size=(2, *shape, 3))
    axis = np.cross(upper, lower)
    return upper, lower, axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def random_ways(rng: np.random.Generator, upper: Array, lower: Array, share: tuple[float, float]) -> Array:
    """Ways from the hip to places at a share of the way from the folded to the stretched leg."""
    long, short = np.linalg.norm(upper, axis=-1), np.linalg.norm(lower, axis=-1)
    nearest, furthest = np.abs(long - short), long + short
    distance = nearest + rng.uniform(*share, size=nearest.shape) * (furthest - nearest)
    direction = rng.normal(size=upper.shape)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True) * distance[..., None]


def ankle(upper: Array, lower: Array, bend: Array, swing: Array) -> Array:
    return rot.rotate(swing, upper + rot.rotate(bend, lower))


def solve(upper: Array, lower: Array, axis: Array, way: Array) -> tuple[Array, Array]:
    return solve_legs(upper, lower, axis, way, np.ones(way.shape[:-1], dtype=bool), 0)


@given(generators())
def test_every_target_within_reach_is_met(rng: np.random.Generator) -> None:
    upper, lower, axis = random_legs(rng, 20, 3)
    way = random_ways(rng, upper, lower, (0.001, 0.999))
    bend, swing = solve(upper, lower, axis, way)
    np.testing.assert_allclose(ankle(upper, lower, bend, swing), way, atol=1e-7)


@given(generators())
def test_it_is_met_about_an_axis_askew_to_the_leg_too(rng: np.random.Generator) -> None:
    upper, lower, axis = random_legs(rng, 20, 3)
    axis = axis + 0.3 * rng.normal(size=axis.shape)
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    turned = rot.rotate(rot.from_axis_angle(axis, rng.uniform(-0.5, 0.5, size=(20, 3))), lower)  # so it can be met
    way = rot.rotate(rot.from_rotation_vector(rng.normal(size=upper.shape)), upper + turned)
    bend, swing = solve(upper, lower, axis, way)
    # A knee that is bent backwards comes round to the front, and passes the exact place on its way.
    backwards = np.einsum("tlx,tlx->tl", axis, np.cross(upper, lower)) < 0
    np.testing.assert_allclose(ankle(upper, lower, bend, swing)[~backwards], way[~backwards], atol=1e-6)


@given(generators())
def test_an_ankle_that_is_where_it_should_be_turns_nothing(rng: np.random.Generator) -> None:
    upper, lower, axis = random_legs(rng, 20, 3)
    axis[0] *= -1  # knees bent backwards
    bend, swing = solve(upper, lower, axis, upper + lower)
    assert rot.angle_between(bend, rot.IDENTITY).max() < 1e-6
    assert rot.angle_between(swing, rot.IDENTITY).max() < 1e-6


@given(generators())
def test_targets_a_little_apart_turn_joints_a_little_apart(rng: np.random.Generator) -> None:
    upper, lower, axis = random_legs(rng, 50, 2)
    way = random_ways(rng, upper, lower, (0.1, 0.9))
    small = np.minimum(np.linalg.norm(upper, axis=-1), np.linalg.norm(lower, axis=-1))[..., None]
    near = way + 1e-6 * small * rng.uniform(-1, 1, size=way.shape)
    (bend, swing), (bend_near, swing_near) = solve(upper, lower, axis, way), solve(upper, lower, axis, near)
    assert rot.angle_between(bend, bend_near).max() < 2e-5
    # Where the leg points away from the target, or has no length to point with, no shortest turn is near any other.
    sure = rot.angle_between(swing, rot.IDENTITY) < 2.5
    assert rot.angle_between(swing, swing_near)[sure].max() < 1e-4


@given(generators())
def test_knees_stay_bent_to_their_side(rng: np.random.Generator) -> None:
    upper, lower, axis = random_legs(rng, 20, 3)
    way = random_ways(rng, upper, lower, (-0.5, 1.5))  # out of reach too
    bend, _ = solve(upper, lower, axis, way)
    side = np.einsum("tlx,tlx->tl", axis, np.cross(upper, rot.rotate(bend, lower)))
    assert side.min() > -1e-6


@given(generators())
def test_out_of_reach_the_leg_is_straight_or_folded_and_points_there(rng: np.random.Generator) -> None:
    upper, lower, axis = random_legs(rng, 20)
    far = 10 * random_ways(rng, upper, lower, (0.9, 1.0))
    reached = ankle(upper, lower, *solve(upper, lower, axis, far))
    long, short = np.linalg.norm(upper, axis=-1), np.linalg.norm(lower, axis=-1)
    np.testing.assert_allclose(reached, far * ((long + short) / np.linalg.norm(far, axis=-1))[:, None], atol=1e-6)
    near = 1e-3 * random_ways(rng, upper, lower, (0.0, 0.001))
    reached = ankle(upper, lower, *solve(upper, lower, axis, near))
    np.testing.assert_allclose(np.linalg.norm(reached, axis=-1), np.abs(long - short), atol=1e-6)


def test_a_knee_bent_backwards_comes_to_the_front_as_it_bends() -> None:
    upper, lower = np.array([0.0, -1.0, 0.0]), np.array([0.0, -np.cos(0.05), np.sin(0.05)])
    axis = SIDE  # a knee bends towards -z about it
    distances = np.linspace(np.linalg.norm(upper + lower), 1.2, 2000)
    bends = knee_bend(np.tile(upper, (2000, 1)), np.tile(lower, (2000, 1)), np.tile(axis, (2000, 1)), distances) - 0.05
    reached = 2 * np.cos(bends / 2)
    assert bends[0] == pytest.approx(-0.05)
    assert bends[-1] == pytest.approx(2 * np.arccos(0.6))
    assert np.abs(reached - distances).max() < 1.5 * 0.05**2  # of the second order, and only on the way round
    assert np.abs(reached - distances)[bends > 0.4].max() < 1e-6
    # No step but what the leg's length itself asks for next to straight.
    assert np.abs(np.diff(bends)).max() < 3 * np.abs(np.diff(2 * np.arccos(distances / 2))).max()


def test_bones_without_length_bend_nothing() -> None:
    bone, none, axis = np.array([[0.0, -1.0, 0.0]]), np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])
    way = np.array([[0.3, -0.5, 0.2]])
    for upper, lower in ((bone, none), (none, bone), (none, none)):
        bend, swing = solve(upper, lower, axis, way)
        np.testing.assert_array_equal(bend, rot.IDENTITY[None])
        assert np.isfinite(swing).all()


def test_the_same_turns_as_found_by_a_general_optimiser() -> None:
    """Frame by frame: the least swing that, with some bend of the knee, puts the ankle on the target."""
    from scipy.optimize import minimize

    rng = np.random.default_rng(5)
    upper, lower, axis = random_legs(rng, 6)
    # Near the leg as it is, as in use; far from there the optimiser may find the knee bent the other way.
    turned = rot.rotate(rot.from_axis_angle(axis, rng.uniform(-0.2, 0.2, size=6)), lower)
    way = rot.rotate(rot.from_rotation_vector(0.3 * rng.normal(size=(6, 3))), upper + turned)
    bend, swing = solve(upper, lower, axis, way)
    for t in range(6):

        def missed(x: Array, t: int = t) -> Array:
            knee = rot.from_axis_angle(axis[t], x[0])
            return ankle(upper[t], lower[t], knee, rot.from_rotation_vector(x[1:])) - way[t]

        found = minimize(
            lambda x: x[1:] @ x[1:],
            np.full(4, 1e-3),
            constraints={"type": "eq", "fun": missed},
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert found.success
        assert rot.angle_between(rot.from_axis_angle(axis[t], found.x[0]), bend[t]) < 1e-4
        assert rot.angle_between(rot.from_rotation_vector(found.x[1:]), swing[t]) < 1e-4


@given(generators())
def test_the_shortest_turn_turns_one_into_the_other_about_what_is_square_to_both(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(2, 30, 3))
    turn = shortest_turn(a, b)
    turned = rot.rotate(turn, a)
    np.testing.assert_allclose(turned / np.linalg.norm(a, axis=-1)[:, None], b / np.linalg.norm(b, axis=-1)[:, None])
    assert np.abs(np.einsum("nx,nx->n", turn[:, :3], a)).max() < 1e-9
    np.testing.assert_array_equal(shortest_turn(a, a)[:, :3], 0.0)
    np.testing.assert_array_equal(shortest_turn(a, np.zeros_like(a)), np.broadcast_to(rot.IDENTITY, (30, 4)))


@given(generators())
def test_knee_axes_are_square_to_bent_legs_and_steady_on_straight_ones(rng: np.random.Generator) -> None:
    bends = rng.uniform(0.5, 1.5, size=(40, 1))
    bends[10:20] = rng.uniform(-0.02, 0.02, size=(10, 1))  # straight
    tilt = rot.from_axis_angle(SIDE, bends)
    hips = np.broadcast_to(rot.from_rotation_vector(rng.normal(size=3)), (40, 1, 4))
    upper = rot.rotate(hips, np.broadcast_to([0.0, -1.0, 0.0], (40, 1, 3)))
    lower = rot.rotate(rot.multiply(hips, tilt), np.broadcast_to([0.0, -1.0, 0.0], (40, 1, 3)))
    axes = knee_axes(upper, lower, hips, np.zeros_like(upper))
    np.testing.assert_allclose(axes, rot.rotate(hips, np.broadcast_to(SIDE, (40, 1, 3))), atol=1e-7)


def test_a_leg_that_is_always_straight_bends_towards_its_toes() -> None:
    upper = lower = np.array([[[0.0, -1.0, 0.0]]])
    toes = np.array([[[0.0, 0.0, 1.0]]])
    axis = knee_axes(upper, lower, np.broadcast_to(rot.IDENTITY, (1, 1, 4)), toes)
    bend, swing = solve(upper, lower, axis, np.array([[[0.0, -1.8, 0.0]]]))
    knee = rot.rotate(swing, upper)[0, 0]
    np.testing.assert_allclose(ankle(upper, lower, bend, swing)[0, 0], [0.0, -1.8, 0.0], atol=1e-9)
    assert knee[2] > 0.3
    unknown = knee_axes(upper, lower, np.broadcast_to(rot.IDENTITY, (1, 1, 4)), np.zeros((1, 1, 3)))
    np.testing.assert_allclose(np.linalg.norm(unknown), 1.0)


@given(st.floats(0, 5), st.floats(0.1, 2), st.floats(0.01, 2))
def test_a_soft_limit_keeps_what_is_allowed_and_bends_smoothly(value: float, free: float, room: float) -> None:
    limited = soft_limit(np.array([value, value + 1e-6]), free, free + room)
    assert limited[0] <= min(value, free + room)
    assert value > free or limited[0] == value
    assert 0 <= limited[1] - limited[0] <= 1.001e-6


@given(generators(), st.integers(0, 6))
def test_smoothing_keeps_constants_and_lies_within_the_window(rng: np.random.Generator, window: int) -> None:
    values = rng.normal(size=(20, 2))
    out = smoothed(values, window)
    for t in range(20):
        near = values[max(0, t - window) : t + window + 1]
        assert (out[t] <= near.max(axis=0) + 1e-12).all()
        assert (out[t] >= near.min(axis=0) - 1e-12).all()
    np.testing.assert_allclose(smoothed(np.full((9, 1), 3.0), window), 3.0)
    assert not smoothed(np.zeros((9, 1)), window).any()


def test_knees_next_to_straight_do_not_snap() -> None:
    frames = np.arange(60)
    upper, lower = np.tile([0.0, -1.0, 0.0], (60, 1, 1)), np.tile([0.0, -1.0, 1e-4], (60, 1, 1))
    axes = np.tile(-SIDE, (60, 1, 1))
    way = np.tile([0.0, -2.0, 0.0], (60, 1, 1)) * (1 - 2e-3 * (frames >= 30))[:, None, None]
    moved = np.ones((60, 1), dtype=bool)
    exact, soft = (solve_legs(upper, lower, axes, way, moved, window) for window in (0, 3))
    steps = [rot.angle_between(bend[1:], bend[:-1]).max() for bend, _ in (exact, soft)]
    assert steps[1] < 0.5 * steps[0]
    reached = ankle(upper, lower, *soft)
    assert np.linalg.norm(reached - way, axis=-1).max() < 4e-3  # what the leg shortens by at a stroke
    # Bent knees are exact all the time.
    bent = np.tile([0.0, -0.8, -0.6], (60, 1, 1))
    way = np.tile([0.0, -1.8, 0.0], (60, 1, 1)) * (1 - 0.01 * np.sin(frames / 9))[:, None, None]
    bend, swing = solve_legs(upper, bent, -axes, way, moved, 3)
    np.testing.assert_allclose(ankle(upper, bent, bend, swing), way, atol=1e-9)
