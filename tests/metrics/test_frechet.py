"""The distance between sets of motions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.metrics.frechet import descriptors, frechet_distance
from tests.datasets.clips import stride

Array = NDArray[np.float64]
UP = np.array([0.0, 1.0, 0.0])


def plain_distance(a: Array, b: Array) -> float:
    """The formula as it is written, with the square root of a product that is not symmetric."""
    from scipy.linalg import sqrtm

    in_a, in_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    apart = a.mean(axis=0) - b.mean(axis=0)
    return float(apart @ apart + np.trace(in_a + in_b - 2 * sqrtm(in_a @ in_b).real))


@given(st.integers(0, 2**31), st.integers(2, 6))
def test_it_is_the_formula(seed: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (rng.normal(size=(40, columns)) @ rng.normal(size=(columns, columns)) + rng.normal() for _ in range(2))
    assert frechet_distance(a, b) == pytest.approx(plain_distance(a, b), rel=1e-5, abs=1e-6)
    assert frechet_distance(b, a) == pytest.approx(frechet_distance(a, b))
    assert frechet_distance(a, a) == pytest.approx(0, abs=1e-6)


def test_it_has_the_value_of_known_gaussians() -> None:
    """In one dimension it is the difference of means, squared, and that of the deviations, squared."""
    rows = np.array([-1.0, 0.0, 1.0])[:, None]  # mean 0, deviation 1
    assert frechet_distance(rows, 3 * rows + 5) == pytest.approx(25 + 4)
    both = np.concatenate([rows, rows[::-1] ** 2], axis=1)
    assert frechet_distance(both, both + np.array([3.0, 4.0])) == pytest.approx(25)


def test_it_grows_with_what_is_added() -> None:
    rng = np.random.default_rng(0)
    clean = rng.normal(size=(300, 5))
    noise = rng.normal(size=clean.shape)
    distances = [frechet_distance(clean, clean + size * noise) for size in (0.0, 0.5, 1.0, 2.0)]
    assert distances == sorted(distances)
    assert distances[1] > 0.01


def test_fewer_motions_than_descriptors_will_do() -> None:
    rows = descriptors([stride(seed) for seed in range(4)])
    assert frechet_distance(rows, rows) == pytest.approx(0, abs=1e-6)
    assert frechet_distance(rows, descriptors([stride(seed) for seed in range(4, 8)])) > 0.01


@given(st.integers(0, 100), st.floats(-3, 3), st.floats(0.1, 50))
def test_neither_where_motions_are_nor_where_they_face_nor_their_unit_matters(
    seed: int, angle: float, size: float
) -> None:
    motion = stride(seed)
    moved = motion.transform(rot.from_axis_angle(UP, np.array(angle)))
    moved = moved.replace(translations=moved.translations + np.array([5.0, 0.0, -2.0]))
    skeleton = dataclasses.replace(
        moved.skeleton,
        offsets=size * moved.skeleton.offsets,
        end_site_offsets=size * moved.skeleton.end_site_offsets,
    )
    moved = moved.replace(skeleton=skeleton, translations=size * moved.translations)
    np.testing.assert_allclose(descriptors([moved]), descriptors([motion]), atol=1e-6)


def test_descriptors_are_mean_place_deviation_and_speed() -> None:
    still = stride(0)[:1]
    frozen = still.replace(
        rotations=np.repeat(still.rotations, 5, axis=0), translations=np.repeat(still.translations, 5, axis=0)
    )
    mean, deviation, speed = np.split(descriptors([frozen])[0], [3 * 7, 6 * 7])
    seen = np.linalg.norm(still.positions[0] - still.root_positions, axis=-1) / still.skeleton.height
    np.testing.assert_allclose(np.linalg.norm(mean.reshape(7, 3), axis=-1), seen, atol=1e-12)
    np.testing.assert_allclose(deviation, 0, atol=1e-12)
    np.testing.assert_allclose(speed, 0, atol=1e-12)


def test_too_little_is_refused() -> None:
    with pytest.raises(MotionGenError, match="'clip0' has a single frame"):
        descriptors([stride(0)[:1]])
    for a, b in ((np.zeros((1, 3)), np.zeros((5, 3))), (np.zeros((5, 3)), np.zeros((5, 4)))):
        with pytest.raises(MotionGenError, match="two motions or more of one kind"):
            frechet_distance(a, b)
