"""How far one set of motions is from another, by features that a recogniser has learned (MoDi, appendix D.3).

All figures are of features (N, D), one row for each motion. Fréchet and kernel distances are small where the sets are
alike; precision is how many of the made motions could be real, recall how many of the real ones could be made;
diversity should be that of real motions. Fréchet distance, precision and recall depend on how many motions there are:
compare sets of one size.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.metrics.frechet import frechet_distance

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Figure = Callable[[Rows, Rows], float]

NEIGHBOURS = 3
"""A motion's neighbourhood reaches to its third nearest neighbour (Kynkäänniemi et al. 2019, k = 3)."""

DEVIATIONS = 1.96
"""Half the width of an interval that holds 95 of 100 normal deviates, in deviations."""


@dataclass(frozen=True)
class Estimate:
    """A figure, and the interval in which 95 of 100 others from as many motions would lie."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Three digits each."""
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


@dataclass(frozen=True)
class Comparison:
    """Made motions beside real ones.

    Attributes:
        fid: Fréchet distance of the features (Heusel et al. 2017).
        kid: kernel distance, which is unbiased and may fall below zero (Bińkowski et al. 2018).
        precision: share of the made motions that lie among the real ones.
        recall: share of the real motions that lie among the made ones.
        diversity: mean distance of two made motions.
    """

    fid: Estimate
    kid: Estimate
    precision: Estimate
    recall: Estimate
    diversity: Estimate

    def to_dict(self) -> dict[str, dict[str, float]]:
        """The figures by name, ready for JSON."""
        return dataclasses.asdict(self)


def compare(real: NDArray[Any], made: NDArray[Any], resamples: int = 100, seed: int = 0) -> Comparison:
    """All figures, with bootstrap intervals.

    Each interval is the figure plus and minus 1.96 deviations of what it is in sets drawn from the given ones, with
    repeats, as large as they are. Quantiles of these would not surround the figure: repeats push the sets apart.

    Args:
        real: (N, D) features.
        made: (M, D) features.
        resamples: how many sets are drawn.
        seed: of these draws.

    Raises:
        MotionGenError: if the features do not fit together, there are too few, or fewer than two resamples.
    """
    real, made = _checked(real, made)
    if resamples < 2:
        raise MotionGenError(f"intervals need at least 2 resamples, not {resamples}")
    random = np.random.default_rng(seed)
    sizes = len(real), len(made)
    draws = [tuple(random.integers(size, size=size) for size in sizes) for _ in range(resamples)]
    kernels = _kernel(real, real), _kernel(made, made), _kernel(real, made)
    apart = _distances(made, made)
    realistic, found = _within(made, real), _within(real, made)

    def estimate(figure: Figure, least: float = 0.0, most: float = math.inf) -> Estimate:
        value = figure(np.arange(len(real)), np.arange(len(made)))
        reach = DEVIATIONS * float(np.std([figure(*draw) for draw in draws], ddof=1))
        return Estimate(value, max(value - reach, least), min(value + reach, most))

    return Comparison(
        fid=estimate(lambda a, b: frechet_distance(real[a], made[b])),
        kid=estimate(lambda a, b: _kid(kernels, _counts(a), _counts(b)), least=-math.inf),
        precision=estimate(lambda a, b: float(realistic[b].mean()), most=1.0),
        recall=estimate(lambda a, b: float(found[a].mean()), most=1.0),
        diversity=estimate(lambda a, b: _mean_of_pairs(apart, _counts(b))),
    )


def kernel_distance(real: NDArray[Any], made: NDArray[Any]) -> float:
    """KID: squared maximum mean discrepancy under the kernel (x . y / D + 1)^3, unbiased, of all motions at once.

    Raises:
        MotionGenError: if the features do not fit together or there are fewer than two of each.
    """
    real, made = _checked(real, made, least=2)
    kernels = _kernel(real, real), _kernel(made, made), _kernel(real, made)
    return _kid(kernels, np.ones(len(real)), np.ones(len(made)))


def precision_and_recall(real: NDArray[Any], made: NDArray[Any], neighbours: int = NEIGHBOURS) -> tuple[float, float]:
    """Share of the made motions that lie among the real ones, and of the real that lie among the made.

    Improved precision and recall (Kynkäänniemi et al. 2019): a motion lies among others if it is no further from one of
    them than that one's k-th nearest neighbour among them is.

    Raises:
        MotionGenError: if the features do not fit together or there are no k + 1 of each.
    """
    real, made = _checked(real, made, least=neighbours + 1)
    return float(_within(made, real, neighbours).mean()), float(_within(real, made, neighbours).mean())


def diversity(features: NDArray[Any]) -> float:
    """Mean distance of two motions (Guo et al. 2020), over all pairs rather than over random ones.

    Raises:
        MotionGenError: if there are fewer than two.
    """
    rows, _ = _checked(features, features, least=2)
    return _mean_of_pairs(_distances(rows, rows), np.ones(len(rows)))


def _checked(a: NDArray[Any], b: NDArray[Any], least: int = NEIGHBOURS + 1) -> tuple[Array, Array]:
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1] or min(len(a), len(b)) < least:
        raise MotionGenError(f"features of two sets of {least} motions or more are needed, not {a.shape} and {b.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise MotionGenError("features must be finite numbers; take motions without broken frames")
    return a, b


def _kernel(a: Array, b: Array) -> Array:
    """(N, M) cubic kernel of rows (N, D) and (M, D)."""
    kernel: Array = (a @ b.T / a.shape[1] + 1) ** 3
    return kernel


def _kid(kernels: tuple[Array, Array, Array], real: Array, made: Array) -> float:
    """The distance where each real motion (N,) and each made one (M,) counts as often as said."""
    between = real @ kernels[2] @ made / (real.sum() * made.sum())
    return float(_mean_of_pairs(kernels[0], real) + _mean_of_pairs(kernels[1], made) - 2 * between)


def _mean_of_pairs(values: Array, counts: Array) -> float:
    """Mean of symmetric values (N, N) over pairs, of which row i comes counts[i] times; none pairs with itself.

    Two copies of one row are no pair either: in another draw from what the rows come from there would be no copies.
    """
    pairs = counts.sum() ** 2 - (counts**2).sum()
    return float((counts @ values @ counts - (counts**2) @ values.diagonal()) / pairs)


def _counts(rows: Rows) -> Array:
    """(N,) how often each of N rows was drawn in N draws."""
    return np.bincount(rows, minlength=len(rows)).astype(np.float64)


def _distances(a: Array, b: Array) -> Array:
    """(N, M) Euclidean distances of rows."""
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    distances: Array = np.sqrt(squares.clip(min=0.0))
    return distances


def _within(points: Array, others: Array, neighbours: int = NEIGHBOURS) -> NDArray[np.bool_]:
    """(N,) whether each point lies in the neighbourhood of one of the others (M, D)."""
    among = _distances(others, others)
    np.fill_diagonal(among, 0.0)  # rounding must not make a row its own neighbour
    reach = np.partition(among, neighbours, axis=1)[:, neighbours]  # (M,); the nearest of all is the row itself
    inside: NDArray[np.bool_] = np.any(_distances(points, others) <= reach, axis=1)
    return inside
