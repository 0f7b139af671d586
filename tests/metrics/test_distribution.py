"""Figures of sets of features: slow twins, torchmetrics, and values that are known."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.metrics.distribution import Comparison, compare, diversity, kernel_distance, precision_and_recall
from motiongen.metrics.frechet import frechet_distance

Array = NDArray[np.float64]

FIGURES = [field.name for field in dataclasses.fields(Comparison)]


def two_sets(seed: int, rows: int = 12, columns: int = 4) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    mixing, shift = random.normal(size=(columns, columns)), random.normal(size=columns)
    return random.normal(size=(rows, columns)), random.normal(size=(rows + 3, columns)) @ mixing + shift


# -- twins


def plain_kernel_distance(real: Array, made: Array) -> float:
    def kernel(x: Array, y: Array) -> float:
        return float(x @ y / len(x) + 1) ** 3

    own = [
        np.mean([kernel(x, y) for i, x in enumerate(rows) for j, y in enumerate(rows) if i != j])
        for rows in (real, made)
    ]
    return float(sum(own) - 2 * np.mean([kernel(x, y) for x in real for y in made]))


def plain_share_within(points: Array, others: Array, neighbours: int) -> float:
    def reach(k: int) -> float:
        return sorted(math.dist(others[k], each) for j, each in enumerate(others) if j != k)[neighbours - 1]

    return float(np.mean([any(math.dist(p, o) <= reach(k) for k, o in enumerate(others)) for p in points]))


@given(st.integers(0, 2**31))
def test_kernel_distance_is_its_sum(seed: int) -> None:
    real, made = two_sets(seed)
    assert kernel_distance(real, made) == pytest.approx(plain_kernel_distance(real, made), rel=1e-9, abs=1e-9)


@given(st.integers(0, 2**31), st.integers(1, 5))
def test_precision_and_recall_are_shares_of_neighbourhoods(seed: int, neighbours: int) -> None:
    real, made = two_sets(seed)
    precision, recall = precision_and_recall(real, made, neighbours)
    assert precision == pytest.approx(plain_share_within(made, real, neighbours))
    assert recall == pytest.approx(plain_share_within(real, made, neighbours))


@given(st.integers(0, 2**31))
def test_diversity_is_the_mean_distance_of_pairs(seed: int) -> None:
    rows, _ = two_sets(seed)
    pairs = [math.dist(a, b) for a, b in itertools.combinations(rows, 2)]
    assert diversity(rows) == pytest.approx(np.mean(pairs))


def test_torchmetrics_finds_the_same() -> None:
    """Its metrics take features in place of images if the network is one that leaves them as they are."""
    pytest.importorskip("torchmetrics", reason="torchmetrics is an extra")
    import torch
    from torchmetrics.image.fid import FrechetInceptionDistance
    from torchmetrics.image.kid import KernelInceptionDistance

    class Unchanged(torch.nn.Module):
        num_features = 6

        def forward(self, features: torch.Tensor) -> torch.Tensor:
            return features

    random = np.random.default_rng(0)
    real, made = random.normal(size=(300, 6)), 1.5 * random.normal(size=(300, 6)) + 0.5
    fid = FrechetInceptionDistance(feature=Unchanged())
    # One subset of all motions leaves nothing to chance.
    kid = KernelInceptionDistance(feature=Unchanged(), subsets=1, subset_size=300)
    for metric in (fid, kid):
        metric.update(torch.from_numpy(real), real=True)
        metric.update(torch.from_numpy(made), real=False)
    assert frechet_distance(real, made) == pytest.approx(float(fid.compute()), rel=1e-5)
    assert kernel_distance(real, made) == pytest.approx(float(kid.compute()[0]), rel=1e-5)


# -- known values


def test_a_set_beside_itself() -> None:
    rows, _ = two_sets(1, rows=60)
    found = compare(rows, rows, resamples=10)
    assert found.fid.value == pytest.approx(0, abs=1e-6)
    assert found.precision.value == found.recall.value == 1
    assert abs(found.kid.value) < 0.05 * abs(kernel_distance(rows, rows + 1))


def test_two_draws_of_one_kind_are_no_further_apart_than_chance() -> None:
    """The kernel distance is unbiased: over many pairs of draws its mean is zero."""
    random = np.random.default_rng(0)
    values = [kernel_distance(random.normal(size=(20, 3)), random.normal(size=(20, 3))) for _ in range(300)]
    assert abs(np.mean(values)) < 3 * np.std(values) / np.sqrt(len(values))


def test_sets_far_apart_share_nothing() -> None:
    rows, _ = two_sets(2, rows=40)
    found = compare(rows, rows + 100, resamples=5)
    assert found.precision.value == found.recall.value == 0
    assert found.fid.value == pytest.approx(4 * 100**2)


def test_motions_that_are_all_alike_have_precision_without_recall_or_diversity() -> None:
    real = np.random.default_rng(3).normal(size=(100, 3))
    alike = real[:1] + 1e-6 * np.random.default_rng(4).normal(size=(100, 3))
    found = compare(real, alike, resamples=5)
    assert found.precision.value == 1
    assert found.recall.value < 0.05
    assert found.diversity.value < 1e-4 < diversity(real)


# -- intervals


def test_intervals_surround_their_figures_within_what_is_possible() -> None:
    real, made = two_sets(5, rows=50)
    found = compare(real, made, resamples=20)
    for name in FIGURES:
        estimate = getattr(found, name)
        assert estimate.low <= estimate.value <= estimate.high, name
    assert found.fid.low >= 0
    assert found.precision.low >= 0
    assert found.recall.high <= 1
    assert found.diversity.low < found.diversity.high


def test_most_intervals_hold_what_many_motions_would_give() -> None:
    """Of diversity, which does not depend on how many motions there are."""
    random = np.random.default_rng(6)
    truth = diversity(random.normal(size=(2000, 2)))
    held = 0
    for seed in range(40):
        estimate = compare(random.normal(size=(30, 2)), random.normal(size=(30, 2)), 20, seed).diversity
        held += estimate.low <= truth <= estimate.high
    assert held >= 33


def test_the_same_seed_gives_the_same_figures() -> None:
    real, made = two_sets(7)
    assert compare(real, made, 5, seed=1) == compare(real, made, 5, seed=1)
    assert compare(real, made, 5, seed=1).fid.value == compare(real, made, 5, seed=2).fid.value
    assert compare(real, made, 5, seed=1).fid.high != compare(real, made, 5, seed=2).fid.high


@pytest.mark.parametrize(
    ("real", "made", "words"),
    [
        (np.zeros((3, 2)), np.zeros((9, 2)), r"4 motions or more are needed, not \(3, 2\) and \(9, 2\)"),
        (np.zeros((9, 2)), np.zeros((9, 3)), r"not \(9, 2\) and \(9, 3\)"),
        (np.full((9, 2), np.nan), np.zeros((9, 2)), "finite"),
    ],
)
def test_what_cannot_be_compared_is_refused(real: Array, made: Array, words: str) -> None:
    for measure in (compare, precision_and_recall):
        with pytest.raises(MotionGenError, match=words):
            measure(real, made)


def test_one_resample_makes_no_interval() -> None:
    with pytest.raises(MotionGenError, match="at least 2 resamples, not 1"):
        compare(*two_sets(8), resamples=1)
