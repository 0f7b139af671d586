"""The one-clip metrics: slow twins on small inputs, laws on any, sanity on real clips."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.metrics import costs as cost_module
from motiongen.metrics import (
    coverage,
    global_patch_distance,
    local_patch_distance,
    one_clip_metrics,
    set_diversity,
)
from motiongen.metrics.costs import diagonal_sums, frame_costs
from motiongen.metrics.one_clip import rotation_features
from motiongen.motion import Motion
from tests.metrics import twins
from tests.puppets import load_clip
from tests.strategies import generators, random_motion, random_skeleton

Array = NDArray[np.float64]


def walk(rng: np.random.Generator, frames: int, width: int = 3) -> Array:
    """(frames, width) features that wander, so that near frames are alike."""
    return np.cumsum(rng.normal(size=(frames, width)), axis=0) / 2


def pieces(rng: np.random.Generator, examples: list[Array], frames: int, noise: float) -> Array:
    """(frames, width) a synthesis pasted from pieces of the examples, with noise."""
    parts: list[Array] = []
    while sum(map(len, parts)) < frames:
        example = examples[rng.integers(len(examples))]
        start = int(rng.integers(len(example)))
        parts.append(example[start : start + int(rng.integers(1, 6))])
    pasted = np.concatenate(parts)[:frames]
    return pasted + noise * rng.normal(size=pasted.shape)


@st.composite
def small_cases(draw: Callable[..., Any]) -> tuple[list[Array], Array]:
    """One to three short examples, and a synthesis that copies, nearly copies or resembles them."""
    rng = draw(generators())
    examples = [walk(rng, draw(st.integers(1, 9))) for _ in range(draw(st.integers(1, 3)))]
    return examples, pieces(rng, examples, draw(st.integers(1, 12)), draw(st.sampled_from([0.0, 1e-9, 1e-4, 0.5])))


# -- slow twins

sizes = st.integers(1, 6)


@given(small_cases(), sizes, st.floats(0.05, 3.0))
def test_coverage_equals_its_definition(case: tuple[list[Array], Array], window: int, threshold: float) -> None:
    assert coverage(*case, window=window, threshold=threshold) == twins.coverage(*case, window, threshold)


@given(small_cases(), sizes)
def test_local_patch_distance_equals_its_definition(case: tuple[list[Array], Array], window: int) -> None:
    fast = local_patch_distance(*case, window=window)
    assert fast == pytest.approx(twins.local_patch_distance(*case, window), abs=1e-6)


@given(small_cases(), sizes)
def test_global_patch_distance_is_the_best_of_all_cuts(case: tuple[list[Array], Array], min_run: int) -> None:
    fast = global_patch_distance(*case, min_run=min_run)
    assert fast == pytest.approx(twins.global_patch_distance(*case, min_run), abs=1e-6)


@given(generators(), st.integers(1, 3), st.integers(2, 5))
def test_set_diversity_equals_its_definition(rng: np.random.Generator, examples: int, count: int) -> None:
    ours = [10 + walk(rng, int(rng.integers(2, 9))) for _ in range(examples)]
    theirs = [10 + walk(rng, int(rng.integers(1, 9))) for _ in range(count)]
    assert set_diversity(ours, theirs) == pytest.approx(twins.set_diversity(ours, theirs), rel=1e-9)


@given(small_cases(), sizes, st.integers(1, 40))
def test_blocks_change_nothing(case: tuple[list[Array], Array], window: int, block: int) -> None:
    """Costs come in blocks of synthesis frames; here they are as small as they can be."""

    def figures() -> list[float]:
        return [
            coverage(*case, window=window, threshold=0.7),
            local_patch_distance(*case, window=window),
            global_patch_distance(*case, min_run=window),
        ]

    whole = figures()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost_module, "_BLOCK_NUMBERS", block)
        np.testing.assert_allclose(figures(), whole, atol=1e-6)


@given(generators(), st.sampled_from([0.0, 1e-12, 1e-8, 1e-5, 1e-2]), st.floats(0.0, 3.0))
def test_costs_are_exact_even_for_frames_that_are_nearly_equal(
    rng: np.random.Generator, apart: float, away: float
) -> None:
    ours = away + rng.uniform(-1, 1, size=(4, 390))
    theirs = np.concatenate([ours + apart * rng.normal(size=ours.shape), rng.uniform(-1, 1, size=(3, 390))])
    exact = np.linalg.norm(ours[:, None] - theirs[None], axis=-1)
    np.testing.assert_allclose(frame_costs(ours, theirs), exact, atol=1e-5)


@given(generators(), st.integers(1, 17), st.integers(0, 5), st.integers(0, 5))
def test_diagonal_sums_equal_traces(rng: np.random.Generator, window: int, rows: int, columns: int) -> None:
    costs = rng.uniform(size=(window + rows, window + columns))
    slow = [[np.trace(costs[i : i + window, j : j + window]) for j in range(columns + 1)] for i in range(rows + 1)]
    np.testing.assert_allclose(diagonal_sums(costs, window), slow, rtol=1e-12)


# -- laws


@given(generators(), st.integers(1, 80))
def test_a_clip_is_all_of_itself(rng: np.random.Generator, frames: int) -> None:
    clip = walk(rng, frames)
    assert coverage(clip, clip) == 1.0
    assert local_patch_distance(clip, clip) == pytest.approx(0.0, abs=1e-6)
    assert global_patch_distance(clip, clip) == pytest.approx(0.0, abs=1e-6)


@given(generators(), st.integers(30, 60), st.integers(30, 60))
def test_a_chain_of_long_runs_costs_nothing(rng: np.random.Generator, first: int, second: int) -> None:
    """Runs of 30 frames and more, from any of the examples, in any order: no cost but at no run's joint either."""
    examples = [walk(rng, 60), walk(rng, 70)]
    starts = rng.integers(0, 61 - max(first, second), size=2)
    synthesis = np.concatenate([examples[1][starts[0] :][:first], examples[0][starts[1] :][:second]])
    assert global_patch_distance(examples, synthesis) == pytest.approx(0.0, abs=1e-6)
    assert global_patch_distance(examples, np.concatenate([examples[0], examples[0]])) == pytest.approx(0.0, abs=1e-6)
    # Runs that are too short do cost: the same frames with a break every 10.
    broken = np.concatenate([synthesis[i : i + 10] for i in range(0, 60, 10)][::-1])
    assert global_patch_distance(examples, broken) > 0.05


@given(small_cases(), sizes)
def test_more_room_never_costs_more(case: tuple[list[Array], Array], size: int) -> None:
    examples, synthesis = case
    thresholds = [coverage(examples, synthesis, window=size, threshold=t) for t in (0.1, 0.5, 1.0, 5.0, 1e6)]
    assert thresholds == sorted(thresholds)
    assert thresholds[-1] == 1.0
    shorter, longer = (global_patch_distance(examples, synthesis, min_run=m) for m in (size, size + 1))
    assert shorter <= longer + 1e-6
    fewer = examples[: len(examples) - 1] or examples
    if max(map(len, fewer)) == max(map(len, examples)):  # else windows and runs of another length are compared
        for distance in (local_patch_distance, global_patch_distance):
            assert distance(examples, synthesis, size) <= distance(fewer, synthesis, size) + 1e-6
    whole = np.concatenate([synthesis, examples[0]])
    if min(map(len, [*examples, synthesis])) >= size:
        assert coverage(examples, whole, size, 0.5) >= coverage(examples, synthesis, size, 0.5)


@given(small_cases(), st.integers(1, 4), generators())
def test_figures_ignore_where_and_which_way_features_point(
    case: tuple[list[Array], Array], size: int, rng: np.random.Generator
) -> None:
    """Norms of differences: a turn and a shift of all features, and time run backwards, leave them as they are."""
    examples, synthesis = case
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    moved = [(array @ turn + shift)[::-1] for array in (*examples, synthesis)]
    for distance in (local_patch_distance, global_patch_distance):
        assert distance(moved[:-1], moved[-1], size) == pytest.approx(distance(examples, synthesis, size), abs=1e-6)
    assert coverage(moved[:-1], moved[-1], size, 0.7) == coverage(examples, synthesis, size, 0.7)
    assert coverage(examples[::-1], synthesis, size, 0.7) == pytest.approx(coverage(examples, synthesis, size, 0.7))


def test_holding_one_pose_covers_little() -> None:
    example = 4 * walk(np.random.default_rng(0), 200)
    assert coverage(example, np.tile(example[100], (200, 1))) < 0.1


def test_nothing_crosses_from_one_example_to_the_next() -> None:
    """The synthesis is what stands at the seam of two examples: as one clip it is a copy, as two it is not."""
    both = np.arange(80.0)[:, None]
    synthesis = both[20:60]
    assert local_patch_distance(both, synthesis) == pytest.approx(0.0, abs=1e-6)
    assert global_patch_distance(both, synthesis) == pytest.approx(0.0, abs=1e-6)
    assert coverage(both, synthesis, threshold=0.5) == pytest.approx(11 / 51)
    halves = [both[:40], both[40:]]
    # A run of 30 or more can only be one run of 40, 20 frames off; a window of 15 is off by 14 - k for k below 7.
    assert global_patch_distance(halves, synthesis) == pytest.approx(20.0)
    offsets = [max(0, min(start + 15 - 20, 20 - start)) for start in range(26)]
    assert local_patch_distance(halves, synthesis) == pytest.approx(np.mean(offsets))
    assert coverage(halves, synthesis, threshold=0.5) == 0.0


@given(generators(), st.integers(2, 6))
def test_set_diversity_laws(rng: np.random.Generator, count: int) -> None:
    example = walk(rng, 30)
    syntheses = [walk(rng, 20) for _ in range(count)]
    figure = set_diversity(example, syntheses)
    assert set_diversity(example, [syntheses[i] for i in rng.permutation(count)]) == pytest.approx(figure)
    assert set_diversity(example, syntheses * 2) == pytest.approx(figure)
    assert set_diversity(3 * example + 1, [3 * s - 2 for s in syntheses]) == pytest.approx(figure)
    assert set_diversity(example, syntheses[:1] * count) == 0.0


# -- mistakes


@pytest.mark.parametrize("metric", [coverage, local_patch_distance, global_patch_distance])
def test_bad_arrays_are_refused_in_one_line(metric: Callable[..., float]) -> None:
    good = np.zeros((40, 3))
    holed = good.copy()
    holed[7, 1] = np.nan
    for examples, synthesis, match in (
        (good, holed, "a synthesis must hold finite numbers; frame 7"),
        ([good, holed], good, "an example must hold finite numbers; frame 7"),
        (good, np.zeros((40, 4)), r"same number of features, not \[3, 4\]"),
        (good, np.zeros((0, 3)), r"a synthesis must be an array .frames, features., not one of shape \(0, 3\)"),
        (good, np.zeros(3), "not one of shape"),
        ([], good, "at least one example"),
    ):
        with pytest.raises(MotionGenError, match=match) as error:
            metric(examples, synthesis)
        assert "\n" not in str(error.value)


def test_bad_settings_are_refused_in_one_line() -> None:
    clip = np.random.default_rng(0).normal(size=(40, 3))
    for call, match in (
        (lambda: coverage(clip, clip, window=0), "window must be positive, not 0"),
        (lambda: coverage(clip, clip, threshold=-1.0), "threshold must be positive"),
        (lambda: local_patch_distance(clip, clip, window=-3), "window must be positive"),
        (lambda: global_patch_distance(clip, clip, min_run=0), "min_run must be positive"),
        (lambda: set_diversity(clip, [clip]), "two syntheses or more, not 1"),
        (lambda: set_diversity(np.ones((9, 3)), [clip, clip]), "does not move"),
    ):
        with pytest.raises(MotionGenError, match=match):
            call()


# -- motions


def swinging(rng: np.random.Generator, count: int, frames: int = 80, frame_rate: float = 30.0) -> list[Motion]:
    skeleton = random_skeleton(rng, joints=4)
    return [
        random_motion(rng, skeleton, frames=frames, smooth=True, translating=(0,), frame_rate=frame_rate)
        for _ in range(count)
    ]


@given(generators())
def test_motions_are_measured_as_their_features_are(rng: np.random.Generator) -> None:
    first, second, *syntheses = swinging(rng, 5)
    found = one_clip_metrics([first, second], syntheses)
    arrays = [rotation_features(m) for m in (first, second)]
    each = [rotation_features(m) for m in syntheses]
    assert each[0].shape == (80, 4 * 6)
    np.testing.assert_allclose(found.coverages, [coverage(arrays, s) for s in each])
    np.testing.assert_allclose(found.coverage_per_example, [np.mean([coverage(a, s) for s in each]) for a in arrays])
    np.testing.assert_allclose(found.local_patch_distances, [local_patch_distance(arrays, s) for s in each], atol=1e-6)
    np.testing.assert_allclose(
        found.global_patch_distances, [global_patch_distance(arrays, s) for s in each], atol=1e-6
    )
    assert found.set_diversity == pytest.approx(set_diversity(arrays, each))
    for mean, values in (
        (found.coverage, found.coverages),
        (found.local_patch_distance, found.local_patch_distances),
        (found.global_patch_distance, found.global_patch_distances),
    ):
        assert mean == pytest.approx(np.mean(values))
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["coverages"] == list(found.coverages)


@given(generators())
def test_order_place_and_rate_do_not_matter(rng: np.random.Generator) -> None:
    example, *syntheses = swinging(rng, 4, frames=160, frame_rate=60.0)
    found = one_clip_metrics([example], syntheses)
    turned = one_clip_metrics([example], syntheses[::-1])
    assert turned.coverages == found.coverages[::-1]
    assert turned.set_diversity == pytest.approx(found.set_diversity)
    assert turned.local_patch_distance == pytest.approx(found.local_patch_distance)
    # The root's way does not count, nor the unit, and halving the rate keeps every second frame.
    shifted = [m.transform(shift=[1.0, 2.0, 3.0]).scale(3.0) for m in syntheses]
    halved = one_clip_metrics([example.resample(30.0)], [m.resample(30.0) for m in shifted])
    assert halved == found


def test_a_motion_that_nearly_runs_at_30_hz_is_not_resampled() -> None:
    motion = swinging(np.random.default_rng(0), 1)[0].replace(frame_rate=1 / 0.033333)
    assert len(rotation_features(motion)) == len(motion)


def test_set_diversity_is_left_out_where_it_has_no_meaning() -> None:
    moving, still = swinging(np.random.default_rng(0), 2, frames=40)
    still = still.replace(rotations=np.tile(still.rotations[:1], (40, 1, 1)))
    assert one_clip_metrics([moving], [still]).set_diversity is None
    assert one_clip_metrics([still], [moving, moving[::-1]]).set_diversity is None
    assert one_clip_metrics([moving], [still, moving]).set_diversity is not None


def test_motions_that_do_not_fit_are_refused_in_one_line() -> None:
    rng = np.random.default_rng(0)
    (clip,), (other,) = swinging(rng, 1), swinging(rng, 1)
    other = other.replace(skeleton=random_skeleton(rng, joints=4, names="other{}"), name="other")
    for examples, syntheses, match in (
        ([], [clip], "at least one example"),
        ([clip], [], "at least one synthesis"),
        ([clip], [clip, other], "'other' has another skeleton than 'motion'"),
    ):
        with pytest.raises(MotionGenError, match=match):
            one_clip_metrics(examples, syntheses)


# -- real clips


def test_a_real_dance_against_itself_and_its_halves(shared_data: Path) -> None:
    clip = load_clip(shared_data / "characters/Salsa-Dancing-6.bvh").resample(30.0)
    assert rotation_features(clip).shape == (648, 390)
    itself = one_clip_metrics([clip], [clip])
    assert itself.coverage == 1.0
    assert itself.local_patch_distance < 1e-6
    assert itself.global_patch_distance < 1e-6
    first, second = clip[:324], clip[324:]
    for example, synthesis in ((first, second), (second, first)):  # the same dance, but no copies
        found = one_clip_metrics([example], [synthesis])
        assert found.coverage > 0.9
        assert 1.0 < found.local_patch_distance < found.global_patch_distance < 1.5
    swapped = clip.replace(rotations=np.concatenate([second.rotations, first.rotations]))
    found = one_clip_metrics([clip], [swapped])
    assert found.global_patch_distance < 1e-6  # two runs
    assert 0.0 < found.local_patch_distance < 0.1  # but for the windows across the cut


def test_a_real_dance_covers_no_walk(shared_data: Path) -> None:
    dance = load_clip(shared_data / "characters/Salsa-Dancing-6.bvh")
    walk = load_clip(shared_data / "characters/Walk-In-Circle.bvh")
    found = one_clip_metrics([walk, dance], [dance])
    assert found.coverage_per_example[0] < 0.05
    assert found.coverage_per_example[1] == 1.0
    assert found.coverage < 0.9
    assert one_clip_metrics([walk], [dance]).local_patch_distance > 3.0
