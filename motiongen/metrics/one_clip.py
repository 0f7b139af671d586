"""How well syntheses cover their one example, or few, and how far they stray from it (GenMM, section 4.1).

All four figures look at 6D local rotations at 30 frames per second and nothing else. The cost c(i, j) of showing
synthesis frame i for example frame j is the Euclidean norm of their difference over all 6J numbers.

- coverage: share of the example's 30-frame windows whose nearest window of the synthesis has a mean c below 2;
- local patch distance: mean over the synthesis' 15-frame windows of the mean c of the nearest example window;
- global patch distance: the synthesis is cut into runs of 30 frames or more, each run laid on one contiguous run of the
  example; least total c over all cuts and all places, divided by the number of frames;
- set diversity: how much several syntheses differ from each other, over how much the example differs from itself.

Several examples lie side by side, but no window and no run crosses from one to the next.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.metrics.costs import CoveredWindows, LeastCut, NearestWindows, feed, shortest_run
from motiongen.motion import Motion

Array = NDArray[np.float64]

FRAME_RATE = 30.0
"""The rate in Hz at which motions are compared: windows and thresholds mean something at this rate only."""

COVERAGE_WINDOW = 30
COVERAGE_THRESHOLD = 2.0
LOCAL_WINDOW = 15
GLOBAL_MIN_RUN = 30


@dataclass(frozen=True)
class OneClipMetrics:
    """The metrics of N syntheses against their examples: means over the syntheses, then each one's own.

    Attributes:
        coverage: share of the windows of all examples that are covered.
        coverage_per_example: the same for each example alone.
        local_patch_distance: to the nearest windows of any example.
        global_patch_distance: to the best runs of any example.
        set_diversity: None for a single synthesis, and for examples that do not move.
        coverages: (N,) of each synthesis.
        local_patch_distances: (N,) of each synthesis.
        global_patch_distances: (N,) of each synthesis.
    """

    coverage: float
    coverage_per_example: tuple[float, ...]
    local_patch_distance: float
    global_patch_distance: float
    set_diversity: float | None
    coverages: tuple[float, ...]
    local_patch_distances: tuple[float, ...]
    global_patch_distances: tuple[float, ...]

    def to_dict(self) -> dict[str, float | tuple[float, ...] | None]:
        """The figures by name, ready for JSON."""
        return dataclasses.asdict(self)


# -- motions


def rotation_features(motion: Motion) -> Array:
    """(T, 6J) what the metrics compare: 6D local rotations of all joints at 30 frames per second."""
    same_rate = math.isclose(motion.frame_rate, FRAME_RATE, rel_tol=1e-4)  # a file may say 0.033333 s a frame
    resampled = motion if same_rate else motion.resample(FRAME_RATE)
    return rot.to_6d(resampled.rotations).reshape(len(resampled), -1)


def one_clip_metrics(examples: Sequence[Motion], syntheses: Sequence[Motion]) -> OneClipMetrics:
    """The four metrics of syntheses against the examples that they were made from.

    Short clips are measured with shorter windows and runs, as each metric says.

    Raises:
        MotionGenError: if there is no example or no synthesis, or joints differ in names or tree.
    """
    _check_motions(examples, syntheses)
    example_features = [rotation_features(motion) for motion in examples]
    synthesis_features = [rotation_features(motion) for motion in syntheses]
    lengths = [len(example) for example in example_features]
    covered, local_distances, global_distances = [], [], []
    for synthesis in synthesis_features:
        windows = _coverage_consumers(lengths, len(synthesis), COVERAGE_WINDOW)
        nearest = NearestWindows(lengths, min(LOCAL_WINDOW, len(synthesis), max(lengths)))
        cut = LeastCut(lengths, shortest_run(lengths, len(synthesis), GLOBAL_MIN_RUN))
        feed(example_features, synthesis, [*windows, nearest, cut])
        covered.append([window.below(COVERAGE_THRESHOLD) for window in windows])
        local_distances.append(nearest.mean())
        global_distances.append(cut.mean())
    coverages = [float(np.concatenate(flags).mean()) for flags in covered]
    moves = _deviation(example_features) > 0
    return OneClipMetrics(
        coverage=float(np.mean(coverages)),
        coverage_per_example=tuple(float(np.mean(flags)) for flags in zip(*covered)),
        local_patch_distance=float(np.mean(local_distances)),
        global_patch_distance=float(np.mean(global_distances)),
        set_diversity=set_diversity(example_features, synthesis_features) if moves and len(syntheses) > 1 else None,
        coverages=tuple(coverages),
        local_patch_distances=tuple(local_distances),
        global_patch_distances=tuple(global_distances),
    )


def _check_motions(examples: Sequence[Motion], syntheses: Sequence[Motion]) -> None:
    for motions, what in ((examples, "example"), (syntheses, "synthesis")):
        if not motions:
            raise MotionGenError(f"the one-clip metrics need at least one {what}; none came")
    first = examples[0]
    for motion in [*examples[1:], *syntheses]:
        if not first.skeleton.same_tree(motion.skeleton):
            raise MotionGenError(
                f"'{motion.name}' has another skeleton than '{first.name}': "
                f"{first.skeleton.difference(motion.skeleton)}; only motions of one skeleton can be compared"
            )


# -- arrays


def coverage(
    example: Array | Sequence[Array],
    synthesis: Array,
    window: int = COVERAGE_WINDOW,
    threshold: float = COVERAGE_THRESHOLD,
) -> float:
    """Share of the example's windows whose nearest window of the synthesis has a mean c below `threshold`.

    Args:
        example: (E, D) features of the example, or several such arrays: their windows are counted together.
        synthesis: (S, D) features of the synthesis.
        window: frames in a window. Where an example or the synthesis is shorter, its windows are as long as that is.
        threshold: what counts as covered.

    Raises:
        MotionGenError: if arrays are empty, not finite or of different width, or a setting is not positive.
    """
    examples, synthesis = _check_arrays(example, synthesis)
    _check_positive(window=window, threshold=threshold)
    windows = _coverage_consumers([len(e) for e in examples], len(synthesis), window)
    feed(examples, synthesis, windows)
    return float(np.concatenate([w.below(threshold) for w in windows]).mean())


def local_patch_distance(example: Array | Sequence[Array], synthesis: Array, window: int = LOCAL_WINDOW) -> float:
    """Mean over the synthesis' windows of the mean c of the nearest example window.

    Args:
        example: (E, D) features of the example, or several such arrays: the nearest window of any of them counts.
        synthesis: (S, D) features of the synthesis.
        window: frames in a window. Where the synthesis or the longest example is shorter, windows are as long as that;
            other examples that are shorter than a window are left out.

    Raises:
        MotionGenError: if arrays are empty, not finite or of different width, or `window` is not positive.
    """
    examples, synthesis = _check_arrays(example, synthesis)
    _check_positive(window=window)
    lengths = [len(e) for e in examples]
    nearest = NearestWindows(lengths, min(window, len(synthesis), max(lengths)))
    feed(examples, synthesis, [nearest])
    return nearest.mean()


def global_patch_distance(example: Array | Sequence[Array], synthesis: Array, min_run: int = GLOBAL_MIN_RUN) -> float:
    """Least mean c of a synthesis cut into runs, each laid on one contiguous run of the example.

    A run cannot be longer than the example that it lies on. Some lengths have no cut then (59 frames over an example
    of 40 cannot be cut into runs of 30 to 40): there, and for a synthesis shorter than a run, the shortest run allowed
    becomes the longest that leaves a cut (29; the synthesis' own length).

    Args:
        example: (E, D) features of the example, or several such arrays: each run lies on one of them.
        synthesis: (S, D) features of the synthesis.
        min_run: frames in the shortest run.

    Raises:
        MotionGenError: if arrays are empty, not finite or of different width, or `min_run` is not positive.
    """
    examples, synthesis = _check_arrays(example, synthesis)
    _check_positive(min_run=min_run)
    lengths = [len(e) for e in examples]
    cut = LeastCut(lengths, shortest_run(lengths, len(synthesis), min_run))
    feed(examples, synthesis, [cut])
    return cut.mean()


def set_diversity(example: Array | Sequence[Array], syntheses: Sequence[Array]) -> float:
    """Mean standard deviation of a feature over the syntheses, over its mean standard deviation within the example.

    Over the syntheses: at each frame and feature, averaged over both. Syntheses of different lengths are compared over
    the frames that all of them have. Within the example: over time, of all examples together, averaged over features.

    Args:
        example: (E, D) features of the example, or several such arrays.
        syntheses: (N,) arrays (S, D), two or more.

    Raises:
        MotionGenError: if arrays are empty, not finite or of different width, there are fewer than two syntheses, or
            the example does not move.
    """
    if len(syntheses) < 2:
        raise MotionGenError(f"set diversity needs two syntheses or more, not {len(syntheses)}")
    pairs = [_check_arrays(example, synthesis) for synthesis in syntheses]
    examples = pairs[0][0]
    deviation = _deviation(examples)
    if deviation == 0:
        raise MotionGenError("set diversity has no meaning for an example that does not move; give one that does")
    frames = min(len(synthesis) for _, synthesis in pairs)
    # Sums of differences from the first synthesis: hundreds of syntheses need no more memory than two.
    origin = pairs[0][1][:frames]
    total, squares = np.zeros_like(origin), np.zeros_like(origin)
    for _, synthesis in pairs[1:]:
        apart = synthesis[:frames] - origin
        total += apart
        squares += apart**2
    mean = total / len(pairs)
    variance = np.maximum(squares / len(pairs) - mean**2, 0.0)
    return float(np.sqrt(variance).mean() / deviation)


def _deviation(examples: Sequence[Array]) -> float:
    """Standard deviation over time of each feature, over all examples together, averaged over the features."""
    frames = np.concatenate(examples)
    return float((frames - frames[0]).std(axis=0).mean())  # exactly zero for a pose that is held


def _coverage_consumers(lengths: Sequence[int], synthesis_length: int, window: int) -> list[CoveredWindows]:
    starts = np.concatenate([[0], np.cumsum(lengths)])
    return [
        CoveredWindows(slice(start, start + length), min(window, length, synthesis_length))
        for start, length in zip(starts.tolist(), lengths)
    ]


def _check_positive(**settings: float) -> None:
    for name, value in settings.items():
        if not value > 0:
            raise MotionGenError(f"{name} must be positive, not {value}")


def _check_arrays(example: Array | Sequence[Array], synthesis: Array) -> tuple[list[Array], Array]:
    """The examples as a list and the synthesis, as float64 of one width."""
    examples = [example] if isinstance(example, np.ndarray) else list(example)
    if not examples:
        raise MotionGenError("the one-clip metrics need at least one example; none came")
    arrays = []
    for array, what in [*((e, "an example") for e in examples), (synthesis, "a synthesis")]:
        checked = np.asarray(array, dtype=np.float64)
        if checked.ndim != 2 or checked.size == 0:
            raise MotionGenError(f"{what} must be an array (frames, features), not one of shape {checked.shape}")
        if not np.isfinite(checked).all():
            raise MotionGenError(f"{what} must hold finite numbers; frame {_first_bad(checked)} does not")
        arrays.append(checked)
    widths = sorted({array.shape[1] for array in arrays})
    if len(widths) > 1:
        raise MotionGenError(f"examples and synthesis must have the same number of features, not {widths}")
    return arrays[:-1], arrays[-1]


def _first_bad(array: Array) -> int:
    return int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
