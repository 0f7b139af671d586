"""Costs of frame pairs, and what can be read off them: nearest windows and the least cut.

All pairs at once are one matrix product. Neighbouring windows share all but one of their frame pairs, so a window's
cost is a sum along a diagonal of that matrix, made from the sums of half its length. Several examples stand side by
side as one row of columns; what would cross from one to the next costs infinity. Synthesis frames come in blocks, so
that memory stays bounded.

Letters: S synthesis frames, E example frames of all examples together, R rows of a block, D features, w window.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Of 16 MiB: an ordinary pair of clips is one block. Smaller ones would fit the cache, but on a busy machine each matrix
# product waits for its threads.
_BLOCK_NUMBERS = 1 << 21


class Consumer(Protocol):
    """Takes the costs of all synthesis frames, block by block."""

    window: int

    def take(self, costs: Array) -> None:
        """Take a block (R, E) in which the last `window - 1` rows of the block before come first."""


def frame_costs(rows: Array, columns: Array) -> Array:
    """Euclidean distances of all pairs of frames, (R, D) x (E, D) -> (R, E).

    From |x|^2 + |y|^2 - 2xy: where frames are equal up to rounding, what is left of the cancelled squares is some 1e-7
    of the frames' size. In single precision it would be 1e-3.
    """
    squared = rows @ columns.T
    squared *= -2.0
    squared += np.einsum("rd,rd->r", rows, rows)[:, None]
    squared += np.einsum("ed,ed->e", columns, columns)
    np.maximum(squared, 0.0, out=squared)
    return np.sqrt(squared, out=squared)


def diagonal_sums(costs: Array, window: int) -> Array:
    """Sums of `window` neighbours along the diagonals, (R, E) -> (R - w + 1, E - w + 1).

    Entry (i, j) is the sum of costs (i + k, j + k) for k below `window`. By doubling: some 2 log2(w) additions of whole
    arrays, and no differences of running sums, which would lose digits.
    """
    rows, columns = (side - window + 1 for side in costs.shape)
    total = np.zeros((rows, columns))
    sums, size, done = costs, 1, 0  # `sums` are the diagonal sums of `size` neighbours
    while True:
        if window & size:
            total += sums[done : done + rows, done : done + columns]
            done += size
        if done == window:
            return total
        sums = sums[:-size, :-size] + sums[size:, size:]
        size *= 2


def feed(examples: Sequence[Array], synthesis: Array, consumers: Sequence[Consumer]) -> None:
    """Let each consumer see the costs of the synthesis (S, D) against all examples [(E, D)], once and in order."""
    # Distances do not change when both move together, and rounding is the smaller, the closer to zero the frames lie.
    middle = np.concatenate(examples).mean(axis=0)
    columns = np.concatenate(examples) - middle
    overlap = max(consumer.window for consumer in consumers) - 1
    step = max(_BLOCK_NUMBERS // len(columns), overlap + 1)
    costs = np.empty((0, len(columns)))
    for start in range(0, len(synthesis), step):
        lead = costs[max(0, len(costs) - overlap) :]
        costs = np.concatenate([lead, frame_costs(synthesis[start : start + step] - middle, columns)])
        for consumer in consumers:
            consumer.take(costs[max(0, len(lead) - (consumer.window - 1)) :])


def shortest_run(lengths: Sequence[int], frames: int, min_run: int) -> int:
    """`min_run`, or the longest shorter one with which `frames` can be cut into runs that fit the longest example.

    In a cut into k runs the shortest has at most frames // k; the fewest runs leave it longest.
    """
    return min(min_run, frames // math.ceil(frames / max(lengths)))


def _crossing(lengths: Sequence[int], window: int) -> list[int]:
    """First columns of the windows that would cross from one example to the next."""
    ends = np.cumsum(lengths).tolist()
    columns = ends[-1] - window + 1  # where windows can begin
    return [column for end in ends[:-1] for column in range(max(0, end - window + 1), min(end, columns))]


class CoveredWindows:
    """Mean cost of each window of one example at the nearest window of the synthesis."""

    def __init__(self, columns: slice, window: int) -> None:
        """Look at the windows of `window` frames within `columns`, which hold one example."""
        self.window = window
        self._columns = columns
        self._nearest = np.array(np.inf)

    def take(self, costs: Array) -> None:
        """Take a block of costs."""
        self._nearest = np.minimum(self._nearest, diagonal_sums(costs[:, self._columns], self.window).min(axis=0))

    def below(self, threshold: float) -> NDArray[np.bool_]:
        """Whether each window's mean cost is below `threshold`."""
        return self._nearest < threshold * self.window


class NearestWindows:
    """Mean cost of each window of the synthesis at the nearest window of any example."""

    def __init__(self, lengths: Sequence[int], window: int) -> None:
        """Look at the windows of `window` frames; `lengths` are those of the examples."""
        self.window = window
        self._crossing = _crossing(lengths, window)
        self._nearest: list[Array] = []

    def take(self, costs: Array) -> None:
        """Take a block of costs."""
        sums = diagonal_sums(costs, self.window)
        sums[:, self._crossing] = np.inf
        self._nearest.append(sums.min(axis=1))

    def mean(self) -> float:
        """The mean over all windows of the synthesis."""
        return float(np.concatenate(self._nearest).mean() / self.window)


class LeastCut:
    """The cheapest way to cut the synthesis into runs of `window` frames or more, each laid on a run of one example.

    Dynamic programming over synthesis frames, for all example frames at once. What a cut of the frames so far costs at
    least, when its last run shows example frame j now, is the cheaper of two: that run went on from frame j - 1, or it
    has just reached `window` frames, and began where the cheapest cut of all that came before it ended.
    """

    def __init__(self, lengths: Sequence[int], window: int) -> None:
        """Cut into runs of `window` frames or more; `lengths` are those of the examples."""
        self.window = window
        self._crossing = _crossing(lengths, window)
        self._firsts = np.cumsum([0, *lengths[:-1]])  # no run goes on into the first frame of an example
        self._running = np.full(sum(lengths), np.inf)  # (E,) cheapest cut with the last run at each example frame
        self._cheapest = [0.0] + [np.inf] * (window - 1)  # cheapest cut of so many frames

    def take(self, costs: Array) -> None:
        """Take a block of costs."""
        sums = diagonal_sums(costs, self.window)  # a run's first `window` frames
        sums[:, self._crossing] = np.inf
        running, before = self._running, self.window - 1
        for now, begun in zip(costs[before:], sums):
            running[1:] = running[:-1] + now[1:]
            running[self._firsts] = np.inf
            np.minimum(running[before:], begun + self._cheapest[-self.window], out=running[before:])
            self._cheapest.append(running.min())

    def mean(self) -> float:
        """The least total cost, divided by the number of frames."""
        return float(self._cheapest[-1] / (len(self._cheapest) - 1))
