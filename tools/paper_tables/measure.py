"""One cell: make sequences from examples, and measure them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import motiongen as mg
from motiongen.metrics import one_clip_metrics
from tools.paper_tables.cells import Cells
from tools.paper_tables.examples import Examples, ExampleSet

AS_PUBLISHED: dict[str, dict[str, Any]] = {"genmm": {"standing_feet": "free"}}
"""Options that are off the defaults in all tables: the metrics ask what a method makes, not what a clean-up changes."""


@dataclass
class Bench:
    """What every table is measured with.

    Attributes:
        generators: names of registered generators.
        examples: the clips.
        cells: what is known already.
        seeds: how many sequences a cell is the mean of; None: as many as each table's own default.
    """

    generators: Sequence[str]
    examples: Examples
    cells: Cells
    seeds: int | None = None

    def measure(
        self, generator: str, examples: ExampleSet, times: int, seeds: int, options: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """The metrics of `seeds` sequences, `times` as long as all examples together, see `measure`."""
        frames = times * examples.frames
        options = {**AS_PUBLISHED.get(generator, {}), **(options or {})}
        settings = {
            "generator": generator,
            "options": options,
            "examples": examples.name,
            "joints": examples.joints,
            "frames": frames,
            "seeds": seeds,
            "content": examples.content,
        }
        return self.cells.get(settings, lambda: measure(generator, examples.load(), frames, seeds, options))


def measure(
    generator: str, examples: Sequence[mg.Motion], frames: int, seeds: int, options: Mapping[str, Any]
) -> dict[str, Any]:
    """The metrics of sequences from seeds 0, 1, 2, ..., see `motiongen.metrics.OneClipMetrics`.

    With them `fit_seconds`, and of the times of all sequences the least and the median: `seconds`, `median_seconds`.
    """
    made = mg.create(generator, **options)
    begun = time.perf_counter()
    made.fit(examples)
    fit_seconds = time.perf_counter() - begun
    syntheses, seconds = [], []
    for seed in range(seeds):
        begun = time.perf_counter()
        syntheses += made.sample(frames, seed=seed)
        seconds.append(time.perf_counter() - begun)
    return {
        **one_clip_metrics(examples, syntheses).to_dict(),
        "fit_seconds": fit_seconds,
        "seconds": min(seconds),
        "median_seconds": float(np.median(seconds)),
    }
