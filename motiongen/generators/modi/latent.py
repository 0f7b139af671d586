"""Places in MoDi's latent space: ways between codes, mixes of two, neighbours of one, clusters of many (section 4).

Codes are arrays of float32: (S,) in W, or (L, S) in W+, one code for each layer of the synthesis network, coarsest
first. Nothing here makes a motion: `MoDi.decode` does.
"""

from __future__ import annotations

import importlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.generators.modi.generator import MoDi
from motiongen.motion import Motion

Codes = NDArray[np.float32]

_MEASURED_CODES = 10_000
_RESTARTS = 4
"""Of K-means, which keeps the best."""

FEWEST_MAPPED = 4
"""Codes that a map can be made of."""


# -- codes


def interpolate(start: NDArray[Any], end: NDArray[Any], steps: int) -> Codes:
    """(steps + 1, ...) codes evenly on the straight line from `start` to `end`, both included, bit for bit.

    With the mean code as `end` this is the truncation of section 4.2.

    Raises:
        MotionGenError: if the codes have different shapes, or there is no step.
    """
    start, end = _pair(start, end)
    if not isinstance(steps, int) or isinstance(steps, bool) or steps < 1:
        raise MotionGenError(f"steps must be a whole number of at least 1, not {steps!r}")
    share = (np.arange(steps + 1) / steps).reshape(-1, *[1] * start.ndim)
    return np.asarray((1 - share) * start + share * end, dtype=np.float32)


def mix(coarse: NDArray[Any], fine: NDArray[Any], first: int) -> Codes:
    """(L, S) the code of `coarse` in the layers before `first`, and that of `fine` from there on (style mixing).

    Args:
        coarse: (L, S).
        fine: (L, S).
        first: 0 to L: at 0 all is `fine`, at L all is `coarse`.

    Raises:
        MotionGenError: if the codes are not of one shape in W+, or there is no such layer.
    """
    coarse, fine = _pair(coarse, fine)
    if coarse.ndim != 2:
        raise MotionGenError(
            f"codes to mix must be in W+, (L, S), not {coarse.shape}; MoDi.check_latents makes them so"
        )
    layers = len(coarse)
    if not isinstance(first, int) or isinstance(first, bool) or not 0 <= first <= layers:
        raise MotionGenError(f"first must be a whole number from 0 to {layers}, the number of layers, not {first!r}")
    return np.concatenate([coarse[:first], fine[first:]])


def vary(code: NDArray[Any], count: int, sigma: float, deviation: NDArray[Any], seed: int = 0) -> Codes:
    """(count, ...) neighbours of a code: Gaussian noise around it (section 4.5).

    In W+ all layers are moved alike, as they are in W: a neighbour differs by as much, and in as many ways.

    Args:
        code: (S,) or (L, S).
        count: how many; neighbour k does not depend on it.
        sigma: deviation of the noise in deviations of W itself; 0 gives copies.
        deviation: (S,) those of W (see `deviation`).
        seed: the same gives the same.

    Raises:
        MotionGenError: if sigma is negative or not finite.
    """
    if not (math.isfinite(sigma) and sigma >= 0):
        raise MotionGenError(f"sigma must be a number of at least 0, not {sigma}")
    code = np.asarray(code, dtype=np.float32)
    noise = np.random.default_rng(seed).standard_normal((count, code.shape[-1]), dtype=np.float32)
    moves = np.float32(sigma) * noise * np.asarray(deviation, dtype=np.float32)
    return code + (moves if code.ndim == 1 else moves[:, None])


@torch.inference_mode()
def deviation(generator: MoDi) -> Codes:
    """(S,) standard deviation of each coordinate of W, over many random codes without truncation."""
    noise = torch.randn(_MEASURED_CODES, generator.latent_size, generator=torch.Generator().manual_seed(0))
    codes = generator.network.mapping(noise.to(generator.device))
    return np.asarray(codes.std(dim=0).cpu(), dtype=np.float32)


def _pair(one: NDArray[Any], other: NDArray[Any]) -> tuple[Codes, Codes]:
    one, other = np.asarray(one, dtype=np.float32), np.asarray(other, dtype=np.float32)
    if one.shape != other.shape:
        raise MotionGenError(f"two codes must have one shape, not {one.shape} and {other.shape}")
    return one, other


# -- how far apart motions are


@dataclass(frozen=True)
class Apart:
    """How far two motions are from each other, on average over frames and joints.

    Attributes:
        degrees: between the joints' rotations in their parents' frames.
        heights: between the joints' places, in skeleton heights.
    """

    degrees: float
    heights: float


def apart(one: Motion, other: Motion) -> Apart:
    """How far two motions of one skeleton and length are from each other, frame by frame."""
    angles = rot.angle_between(one.rotations, other.rotations)
    ways = np.linalg.norm(one.positions - other.positions, axis=-1) / one.skeleton.height
    return Apart(math.degrees(angles.mean()), float(ways.mean()))


def speed(motion: Motion) -> float:
    """Mean speed of the joints, in skeleton heights per second."""
    steps = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1)
    return float(steps.mean()) * motion.frame_rate / motion.skeleton.height if len(steps) else 0.0


@dataclass(frozen=True)
class Smoothness:
    """How evenly a row of motions leads from its first to its last.

    Attributes:
        steps: from each motion to the next.
        ends: from the first to the last.
        speeds: of each motion, in heights per second.
    """

    steps: tuple[Apart, ...]
    ends: Apart
    speeds: tuple[float, ...]

    @property
    def largest_share(self) -> Apart:
        """The largest step over the distance of the ends: one over the number of steps at best, 1 for a jump."""
        degrees, heights = (max(getattr(step, name) for step in self.steps) for name in ("degrees", "heights"))
        return Apart(_share(degrees, self.ends.degrees), _share(heights, self.ends.heights))

    @property
    def detour(self) -> Apart:
        """All steps together over the distance of the ends: 1 for a straight way."""
        degrees, heights = (sum(getattr(step, name) for step in self.steps) for name in ("degrees", "heights"))
        return Apart(_share(degrees, self.ends.degrees), _share(heights, self.ends.heights))


def smoothness(motions: Sequence[Motion]) -> Smoothness:
    """How evenly a row of two or more motions of one skeleton and length leads from its first to its last."""
    steps = tuple(apart(before, after) for before, after in itertools.pairwise(motions))
    return Smoothness(steps, apart(motions[0], motions[-1]), tuple(map(speed, motions)))


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0 else 0.0


# -- clusters


@dataclass(frozen=True, eq=False)
class Clusters:
    """Codes in groups, the largest first.

    Attributes:
        centres: (K, S) means of the groups.
        members: (N,) the group of each code.
    """

    centres: Codes
    members: NDArray[np.int64]

    @property
    def sizes(self) -> NDArray[np.int64]:
        """(K,) how many codes are in each."""
        return np.bincount(self.members, minlength=len(self.centres))

    def of(self, codes: NDArray[Any]) -> NDArray[np.int64]:
        """(M,) the groups that codes (M, S) belong to: those of the nearest centres."""
        return _squares(np.asarray(codes, dtype=np.float64), self.centres).argmin(axis=1)


def cluster(codes: NDArray[Any], count: int, seed: int = 0) -> Clusters:
    """Group codes (N, S) of W by K-means (section 4.1).

    Raises:
        MotionGenError: if there are fewer codes than groups, or the extra `latent` is missing.
    """
    if not 1 <= count <= len(codes):
        raise MotionGenError(f"clusters must be from 1 to {len(codes)}, as many as there are codes, not {count}")
    means = learning("cluster").KMeans(count, n_init=_RESTARTS, random_state=seed).fit(codes)
    order = np.argsort(-np.bincount(means.labels_, minlength=count), kind="stable")
    place = np.argsort(order)
    return Clusters(means.cluster_centers_[order].astype(np.float32), place[means.labels_].astype(np.int64))


def representatives(clusters: Clusters, codes: NDArray[Any], count: int, seed: int = 0) -> list[NDArray[np.int64]]:
    """For each group the codes that stand for it: the nearest to its centre, then others of it at random.

    Args:
        clusters: of these codes.
        codes: (N, S).
        count: how many for each group; a smaller group has no more than it has.
        seed: of the choice.
    """
    rng = np.random.default_rng(seed)
    chosen = []
    for group, centre in enumerate(clusters.centres):
        inside = np.flatnonzero(clusters.members == group)
        nearest = inside[np.linalg.norm(codes[inside] - centre, axis=1).argmin()]
        others = rng.permutation(inside[inside != nearest])
        chosen.append(np.concatenate([[nearest], others[: count - 1]]))
    return chosen


def flattened(codes: NDArray[Any], seed: int = 0) -> NDArray[np.float64]:
    """(N, 2) the codes (N, S) on a map that keeps neighbours together: t-SNE (van der Maaten and Hinton 2008).

    Raises:
        MotionGenError: if there are fewer than `FEWEST_MAPPED`, or the extra `latent` is missing.
    """
    if len(codes) < FEWEST_MAPPED:
        raise MotionGenError(f"a map needs at least {FEWEST_MAPPED} codes, not {len(codes)}")
    # As many neighbours as the method's authors advise for large sets, fewer where there are few.
    neighbours = min(30.0, (len(codes) - 1) / 3)
    map_of = learning("manifold").TSNE(perplexity=neighbours, random_state=seed, n_jobs=1)
    return np.asarray(map_of.fit_transform(np.asarray(codes, dtype=np.float32)), dtype=np.float64)


@dataclass(frozen=True)
class Agreement:
    """How well groups and labels agree, beside the same groups with their labels shuffled.

    Attributes:
        information: adjusted mutual information: 0 by chance, 1 where each tells the other.
        purity: share of the members whose label is the most frequent of their group; it grows with more groups.
        chance_information: mean of `information` over shuffles.
        chance_purity: mean of `purity` over shuffles.
    """

    information: float
    purity: float
    chance_information: float
    chance_purity: float


def agreement(groups: NDArray[Any], labels: Sequence[str], seed: int = 0, shuffles: int = 100) -> Agreement:
    """How well groups (N,) agree with as many labels.

    Raises:
        MotionGenError: if they are not as many, there are none, or the extra `latent` is missing.
    """
    if len(groups) != len(labels) or not len(groups):
        raise MotionGenError(f"groups and labels must be as many, at least one, not {len(groups)} and {len(labels)}")
    score = learning("metrics").adjusted_mutual_info_score
    _, kinds = np.unique(np.asarray(labels), return_inverse=True)
    rng = np.random.default_rng(seed)
    mixed = [rng.permutation(kinds) for _ in range(shuffles)]
    return Agreement(
        float(score(kinds, groups)),
        _purity(groups, kinds),
        float(np.mean([score(each, groups) for each in mixed])),
        float(np.mean([_purity(groups, each) for each in mixed])),
    )


def _purity(groups: NDArray[Any], kinds: NDArray[np.int64]) -> float:
    return sum(int(np.bincount(kinds[groups == group]).max()) for group in np.unique(groups)) / len(groups)


def _squares(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """(N, M) squared distances of all pairs, (N, S) x (M, S)."""
    squares: NDArray[Any] = (one**2).sum(axis=1)[:, None] - 2 * one @ other.T + (other**2).sum(axis=1)
    return squares


def learning(module: str) -> Any:
    """A module of scikit-learn.

    Raises:
        MotionGenError: if it is not installed.
    """
    try:
        return importlib.import_module(f"sklearn.{module}")
    except ImportError as error:
        raise MotionGenError("clusters need the extra 'latent': pip install 'motiongen[latent]'") from error
