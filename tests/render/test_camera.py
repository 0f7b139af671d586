"""The camera: laws of projection, nothing left out of the picture and no more room than needed, a calm track."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.render import camera as cam
from motiongen.render.camera import Camera, Frame
from tests.strategies import generators

FRAME = Frame(10.0, 30.0, 190.0, 140.0, cam.focal_length(200.0))


def random_camera(rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    eye, target = rng.normal(size=(2, 3))
    return Camera.look_at(eye, target, float(rng.uniform(50, 500)), (120.0, 80.0)), target


@given(generators())
def test_target_in_the_middle_and_axes_orthonormal(rng: np.random.Generator) -> None:
    camera, target = random_camera(rng)
    pixel, depth = camera.project(target)
    np.testing.assert_allclose(pixel, camera.centre, atol=1e-6)
    assert depth == pytest.approx(np.linalg.norm(target - camera.eye))
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(np.stack([camera.axes[0], camera.axes[1], -camera.axes[2]])) == pytest.approx(1.0)
    above, _ = camera.project(target + np.array([0.0, 0.01, 0.0]))
    assert above[1] < pixel[1], "the world's up is up in the picture"
    assert above[0] == pytest.approx(pixel[0], abs=1e-6), "the camera does not roll"


@given(generators())
def test_size_falls_with_depth(rng: np.random.Generator) -> None:
    camera, _ = random_camera(rng)
    depths = np.sort(rng.uniform(0.2, 9.0, size=5))
    at = camera.eye + depths[:, None] * camera.axes[2]
    ends, seen = camera.project(np.stack([at, at + 0.1 * camera.axes[0]]))  # sticks across the view
    lengths = np.linalg.norm(ends[1] - ends[0], axis=-1)
    np.testing.assert_allclose(seen[0], depths)
    np.testing.assert_allclose(lengths * depths, 0.1 * camera.focal)
    assert (np.diff(lengths) < 0).all()


@given(generators())
def test_rays_undo_projection(rng: np.random.Generator) -> None:
    camera, _ = random_camera(rng)
    where = rng.uniform(0, 200, size=(4, 6, 2))
    deep = rng.uniform(0.1, 9.0, size=(4, 6, 1))
    back, depth = camera.project(camera.eye + deep * camera.rays(where))
    np.testing.assert_allclose(back, where, atol=1e-8)
    np.testing.assert_allclose(depth, deep[..., 0])


@given(generators())
def test_a_moved_camera_sees_a_moved_world(rng: np.random.Generator) -> None:
    camera, _ = random_camera(rng)
    points, shift = rng.normal(size=(7, 3)), rng.normal(size=3)
    for a, b in zip(camera.project(points), camera.moved(shift).project(points + shift)):
        np.testing.assert_allclose(a, b, rtol=1e-9)


@pytest.mark.parametrize("height", [-3.0, 3.0])
def test_straight_down_and_up_are_directions_too(height: float) -> None:
    camera = Camera.look_at(np.array([0.0, height, 0.0]), np.zeros(3), 100.0, (0.0, 0.0))
    pixel, _ = camera.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(pixel[0], [0.0, 0.0], atol=1e-9)
    assert pixel[1, 1] < 0


def test_points_behind_the_camera_say_so_and_stay_finite() -> None:
    camera = Camera.look_at(np.array([0.0, 0.0, 5.0]), np.zeros(3), 100.0, (0.0, 0.0))
    pixel, depth = camera.project(np.array([[0.0, 1.0, 9.0], [1.0, 0.0, 5.0]]))
    assert (depth <= 0).all()
    assert np.isfinite(pixel).all()


def sphere(rng: np.random.Generator, count: int) -> np.ndarray:
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@given(generators(), st.sampled_from([0.01, 0.1, 0.4]))
def test_the_nearest_place_from_which_all_is_seen(rng: np.random.Generator, radius: float) -> None:
    """Against a plain twin: the surfaces of the balls, point by point, are in the frame, and just so."""
    points = rng.normal(size=(5, 3)) * rng.uniform(0.1, 5.0, size=3)
    axes = cam.view_axes(rng.normal(size=3))
    needs = cam.reaches(points, radius, axes, FRAME)
    aim, distance = (needs[:, 0] - needs[:, 1]) / 2, float((needs.sum(axis=1) / (2 * FRAME.slopes)).max())
    surface = points[:, None] + radius * sphere(rng, 4000)

    def spill(distance: float) -> float:
        pixel, depth = cam.place(axes, aim, distance, FRAME).project(surface)
        assert (depth > 0).all()
        over = [FRAME.left - pixel[..., 0], pixel[..., 0] - FRAME.right]
        over += [FRAME.top - pixel[..., 1], pixel[..., 1] - FRAME.bottom]
        return float(np.max(over))

    assert spill(distance) <= 1e-6
    assert spill(0.97 * distance) > 0 or distance < radius, "no further away than needed"


@given(generators(), st.sampled_from([1, 2, 40, 200]))
def test_a_steady_walk_is_followed_exactly(rng: np.random.Generator, frames: int) -> None:
    track = rng.normal(size=3) + np.arange(frames)[:, None] * rng.normal(size=3) * [0.1, 0, 0.1]
    np.testing.assert_allclose(cam.glide(track, 30.0), track, atol=1e-9)


@given(generators())
def test_the_camera_is_calmer_than_the_figure_and_stays_near(rng: np.random.Generator) -> None:
    walk = np.cumsum(rng.normal(size=(150, 3)) * 0.02, axis=0)
    calm = cam.glide(walk, 30.0)
    assert np.abs(np.diff(calm, 2, axis=0)).max() < 0.2 * np.abs(np.diff(walk, 2, axis=0)).max()
    np.testing.assert_allclose(cam.glide(walk + 7.0, 30.0), calm + 7.0, atol=1e-9)
    walk[70:] += rng.normal(size=3) * 50  # a jump cut
    assert np.linalg.norm(cam.glide(walk, 30.0) - walk, axis=1).max() <= cam.LEASH + 1e-9
