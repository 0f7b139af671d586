"""A worse model must score worse: real motions spoilt more and more, by the features of a really trained recogniser."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from motiongen.datasets import Dataset
from motiongen.metrics.distribution import kernel_distance
from motiongen.metrics.frechet import frechet_distance
from motiongen.recognition import Recogniser
from motiongen.recognition.positions import positions_of
from tests.recognition.kinds import windows_of

Floats = NDArray[np.float32]

COUNT = 200


@pytest.fixture(scope="module")
def real(kinds: Dataset) -> Floats:
    return positions_of(windows_of(kinds, "training", COUNT, seed=1), kinds.layout)


@pytest.fixture(scope="module")
def held_back(kinds: Dataset, recogniser: Recogniser) -> Floats:
    return recogniser.features(positions_of(windows_of(kinds, "held_back", COUNT), kinds.layout))


def shaken(real: Floats, size: float) -> Floats:
    """Joints that tremble by so much of the height."""
    return real + size * np.random.default_rng(2).standard_normal(real.shape, dtype=np.float32)


def shuffled(real: Floats, share: float) -> Floats:
    """Each motion's frames exchanged among so large a share of its frames."""
    random, mixed = np.random.default_rng(3), real.copy()
    for row in mixed:
        chosen = random.choice(len(row), round(share * len(row)), replace=False)
        row[chosen] = row[random.permutation(chosen)]
    return mixed


def of_fewer_kinds(real: Floats, share: float) -> Floats:
    """So large a share of the motions replaced by a single one."""
    alike = real.copy()
    alike[: round(share * len(real))] = real[0]
    return alike


@pytest.mark.parametrize(
    ("spoil", "amounts"),
    [(shaken, (0.0, 0.02, 0.05, 0.1)), (shuffled, (0.0, 0.5, 1.0)), (of_fewer_kinds, (0.0, 0.3, 0.6, 0.9))],
    ids=["shaken", "shuffled", "collapsed"],
)
def test_what_is_spoilt_more_is_further_away(
    spoil: object, amounts: tuple[float, ...], real: Floats, held_back: Floats, recogniser: Recogniser
) -> None:
    assert callable(spoil)
    features = [recogniser.features(spoil(real, amount)) for amount in amounts]
    for distance in (frechet_distance, kernel_distance):
        distances = [distance(held_back.astype(np.float64), each.astype(np.float64)) for each in features]
        assert distances == sorted(distances), distance.__name__
        assert distances[-1] > 2 * abs(distances[0]), distance.__name__
