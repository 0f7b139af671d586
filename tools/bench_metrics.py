"""How long the one-clip metrics take, beside their definitions written out plainly: `python -m tools.bench_metrics`.

The plain twins use NumPy a window, or a run, at a time: no costs are shared between overlapping windows, and no cuts
between lengths. Both are given the same frames in the same run, and must agree. Times are the fastest of several runs;
only the ratio means anything on another machine.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

import motiongen as mg
from motiongen.metrics import coverage, global_patch_distance, local_patch_distance, set_diversity
from motiongen.metrics.one_clip import (
    COVERAGE_THRESHOLD,
    COVERAGE_WINDOW,
    GLOBAL_MIN_RUN,
    LOCAL_WINDOW,
    rotation_features,
)
from motiongen.report import markdown_table

Array = NDArray[np.float64]


def frames_of(clip: str | None, frames: int, joints: int) -> Array:
    """(T, D) the features of a clip, or as many random ones that wander like a motion's."""
    if clip is not None:
        return rotation_features(mg.load(clip))
    steps = np.random.default_rng(0).normal(size=(frames, 6 * joints))
    return 0.05 * np.cumsum(steps, axis=0)


def synthesis_of(example: Array, frames: int, seed: int) -> Array:
    """(frames, D) pieces of the example, pasted, with noise."""
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, len(example) - 40, size=frames // 40 + 1)
    pasted = np.concatenate([example[start : start + 40] for start in starts])[:frames]
    return pasted + 0.02 * rng.normal(size=pasted.shape)


def nearest_window(window: Array, windows: Array) -> float:
    """Least mean cost of one window (w, D) to any of `windows` (N, D, w), from the frames themselves."""
    gaps = windows - window.T
    return float(np.sqrt(np.einsum("ndw,ndw->nw", gaps, gaps)).mean(axis=1).min())


def plain_coverage(example: Array, synthesis: Array) -> float:
    theirs = sliding_window_view(synthesis, COVERAGE_WINDOW, axis=0)
    ours = [example[start : start + COVERAGE_WINDOW] for start in range(len(example) - COVERAGE_WINDOW + 1)]
    return float(np.mean([nearest_window(window, theirs) < COVERAGE_THRESHOLD for window in ours]))


def plain_local_patch_distance(example: Array, synthesis: Array) -> float:
    theirs = sliding_window_view(example, LOCAL_WINDOW, axis=0)
    ours = [synthesis[start : start + LOCAL_WINDOW] for start in range(len(synthesis) - LOCAL_WINDOW + 1)]
    return float(np.mean([nearest_window(window, theirs) for window in ours]))


def plain_global_patch_distance(example: Array, synthesis: Array) -> float:
    """The cheapest cut, with every run from every start to every end laid everywhere on the example."""
    costs = np.stack([np.linalg.norm(example - frame, axis=1) for frame in synthesis])  # (S, E)
    cheapest = np.full(len(synthesis) + 1, np.inf)
    cheapest[0] = 0.0
    for start in range(len(synthesis)):
        if not np.isfinite(cheapest[start]):
            continue
        run = np.zeros(len(example))  # of the run so far, at each place that it can begin at
        for length in range(1, min(len(example), len(synthesis) - start) + 1):
            places = len(example) - length + 1
            run = run[:places] + costs[start + length - 1, length - 1 :]
            if length >= GLOBAL_MIN_RUN:
                cheapest[start + length] = min(cheapest[start + length], cheapest[start] + run.min())
    return float(cheapest[-1] / len(synthesis))


def plain_set_diversity(example: Array, syntheses: list[Array]) -> float:
    return float(np.stack(syntheses).std(axis=0).mean() / example.std(axis=0).mean())


def timed(work: Callable[[], float], repeats: int) -> tuple[float, float]:
    """The result, and the fastest of several runs in seconds."""
    seconds = []
    for _ in range(repeats):
        begun = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - begun)
    return result, min(seconds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_metrics", description=__doc__)
    parser.add_argument("clip", nargs="?", help="the example; random frames by default")
    parser.add_argument("--frames", type=int, default=648, help="random example frames (default: %(default)s)")
    parser.add_argument("--joints", type=int, default=65, help="joints of the random example (default: %(default)s)")
    parser.add_argument("--count", type=int, default=50, help="syntheses for set diversity (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=9, help="runs of each fast metric (default: %(default)s)")
    options = parser.parse_args()
    example = frames_of(options.clip, options.frames, options.joints)
    synthesis = synthesis_of(example, 2 * len(example), seed=0)
    many = [synthesis_of(example, 2 * len(example), seed) for seed in range(options.count)]
    print(f"{len(synthesis)} frames against {len(example)}, {example.shape[1]} features\n")
    rows = [["metric", "value", "ms", "plain twin, ms", "times faster"]]
    for name, fast, plain in (
        ("coverage", lambda: coverage(example, synthesis), lambda: plain_coverage(example, synthesis)),
        (
            "local patch distance",
            lambda: local_patch_distance(example, synthesis),
            lambda: plain_local_patch_distance(example, synthesis),
        ),
        (
            "global patch distance",
            lambda: global_patch_distance(example, synthesis),
            lambda: plain_global_patch_distance(example, synthesis),
        ),
        (
            f"set diversity of {options.count}",
            lambda: set_diversity(example, many),
            lambda: plain_set_diversity(example, many),
        ),
    ):
        value, seconds = timed(fast, options.repeats)
        twin, twin_seconds = timed(plain, 1)
        if not np.isclose(value, twin, rtol=1e-6, atol=1e-6):
            raise SystemExit(f"{name}: {value} is not the plain twin's {twin}")
        rows.append(
            [name, f"{value:.4f}", f"{1e3 * seconds:.1f}", f"{1e3 * twin_seconds:.0f}", f"{twin_seconds / seconds:.0f}"]
        )
    print("\n".join(markdown_table(rows)))


if __name__ == "__main__":
    main()
