"""The one-clip metrics as their definitions read: loops over windows, frames and all cuts. For small inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cost(frame: Array, other: Array) -> float:
    """c(i, j): the Euclidean norm of the difference of two frames."""
    return math.sqrt(sum((float(a) - float(b)) ** 2 for a, b in zip(frame, other)))


def windows(features: Array, length: int) -> list[Array]:
    return [features[start : start + length] for start in range(len(features) - length + 1)]


def mean_cost(window: Array, other: Array) -> float:
    return sum(cost(a, b) for a, b in zip(window, other)) / len(window)


def coverage(examples: list[Array], synthesis: Array, window: int, threshold: float) -> float:
    covered = []
    for example in examples:
        length = min(window, len(example), len(synthesis))
        for ours in windows(example, length):
            covered.append(min(mean_cost(ours, theirs) for theirs in windows(synthesis, length)) < threshold)
    return sum(covered) / len(covered)


def local_patch_distance(examples: list[Array], synthesis: Array, window: int) -> float:
    length = min(window, len(synthesis), max(len(example) for example in examples))
    theirs = [patch for example in examples for patch in windows(example, length)]
    nearest = [min(mean_cost(ours, other) for other in theirs) for ours in windows(synthesis, length)]
    return sum(nearest) / len(nearest)


def cuts(frames: int, shortest: int, longest: int) -> Iterator[list[int]]:
    """All ways to cut `frames` into runs of `shortest` to `longest` frames."""
    if frames == 0:
        yield []
    for first in range(shortest, min(frames, longest) + 1):
        for rest in cuts(frames - first, shortest, longest):
            yield [first, *rest]


def global_patch_distance(examples: list[Array], synthesis: Array, min_run: int) -> float:
    frames, longest = len(synthesis), max(len(example) for example in examples)
    shortest = next(m for m in range(min_run, 0, -1) if any(True for _ in cuts(frames, m, longest)))

    def run_cost(start: int, length: int) -> float:
        ours = synthesis[start : start + length]
        return min(length * mean_cost(ours, other) for example in examples for other in windows(example, length))

    def cut_cost(cut: list[int]) -> float:
        starts = [sum(cut[:k]) for k in range(len(cut))]
        return sum(run_cost(start, length) for start, length in zip(starts, cut))

    return min(cut_cost(cut) for cut in cuts(frames, shortest, longest)) / frames


def set_diversity(examples: list[Array], syntheses: list[Array]) -> float:
    frames = min(len(synthesis) for synthesis in syntheses)
    among = [
        np.std([synthesis[t, d] for synthesis in syntheses])
        for t in range(frames)
        for d in range(syntheses[0].shape[1])
    ]
    within = [np.std([frame[d] for example in examples for frame in example]) for d in range(examples[0].shape[1])]
    return float(np.mean(among) / np.mean(within))
