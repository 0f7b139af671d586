"""Examples and syntheses too long to compare everything with everything."""

from __future__ import annotations

from unittest import mock

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

import motiongen as mg
from motiongen.generators.genmm import matching, synthesis
from motiongen.generators.genmm.basis import principal_axes
from motiongen.generators.genmm.blending import blend
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import PartSource, build_pyramid, frame_times, stage_length
from motiongen.generators.genmm.synthesis import carried, synthesise
from tests.generators.genmm.test_genmm import swinging
from tools import plain_genmm


def waves(frames: int, seed: int, size: int = 6) -> Tensor:
    """(frames, size) features that flow, never quite the same twice."""
    rng = torch.Generator().manual_seed(seed)
    time = torch.arange(frames, dtype=torch.float64)[:, None, None] / 30
    pace = torch.rand(size, 5, generator=rng, dtype=torch.float64) * 6
    begin = torch.rand(size, 5, generator=rng, dtype=torch.float64) * 7
    return torch.sin(time * pace + begin).sum(-1)


def test_little_memory_changes_nothing_but_time() -> None:
    """Bit for bit: 4 MB hold less than half of the distances of 1,000 by 1,000 frames."""
    clip = swinging(frames=1000)
    little, much = (mg.create("genmm", memory_mb=mb, iterations=2).fit([clip]).sample(1000)[0] for mb in (4, 1024))
    assert little == much


@given(st.lists(st.integers(5, 40), min_size=1, max_size=5), st.floats(0.2, 1.0))
def test_frame_times_go_from_the_first_to_the_last_frame_of_each_example(full: list[int], scale: float) -> None:
    lengths = [stage_length(length, scale, 5) for length in full]
    times = frame_times(lengths, full)
    ends = torch.tensor(lengths).cumsum(0)
    last = torch.tensor(full).cumsum(0) - 1
    assert times.shape == (sum(lengths),)
    assert bool((times.diff() > 0).all())
    torch.testing.assert_close(times[ends - 1], last.double())
    torch.testing.assert_close(times[(ends - 1)[:-1] + 1], (last + 1)[:-1].double())
    torch.testing.assert_close(frame_times(full, full), torch.arange(sum(full), dtype=torch.float64))


@pytest.mark.parametrize("lengths", [[300], [150, 7, 200, 90]])
def test_what_is_carried_to_the_next_stage_stays_where_it_was(lengths: list[int]) -> None:
    """Within a patch: frames of the two stages do not stand at the same times."""
    examples = [waves(length, seed) for seed, length in enumerate(lengths)]
    pyramid = build_pyramid([PartSource(examples)], 7, 4.0, 4 / 3)
    for before, stage in zip(pyramid.stages, pyramid.stages[1:]):
        coarse, fine = before.parts[0], stage.parts[0]
        nearest = torch.nonzero(coarse.starts).T  # each patch once, in order
        places = round(nearest.shape[1] * 4 / 3)
        times = fine.times[carried(nearest, coarse, fine, places)[0]]
        expected = coarse.times[nearest[0, torch.arange(places) * nearest.shape[1] // places]]
        assert float((times - expected).abs().max()) < 7 / stage.scale


@pytest.mark.parametrize("circular", [False, True])
def test_looking_only_near_what_was_found_loses_next_to_nothing(circular: bool) -> None:
    """As like the example as the exact synthesis, patch by patch, and with as much of it."""
    options = GenMMOptions(patch_size=7, search="approximate")
    examples = [waves(500, 1), waves(700, 2)]
    pyramid = build_pyramid([PartSource(examples)], 7, 8.0, 4 / 3, principal_axes(examples))
    guidance = synthesis.Guidance(circular=circular)
    together = torch.cat(examples)

    def quality(nearest: Tensor) -> tuple[float, int]:
        result = blend(nearest, together, 7, circular=circular)[0]
        own = plain_genmm.patches(result, 7)
        theirs = torch.cat([plain_genmm.patches(example, 7) for example in examples])
        return float(torch.cdist(own, theirs).amin(dim=1).mean()), nearest.unique().numel()

    exact = quality(synthesise(pyramid, 1200, [3], options, guidance)[0])
    tiles: list[int] = []
    listed = matching.neighbourhoods

    def counted(likely: Tensor, patches: int, patch_size: int) -> matching.Grid:
        grid = listed(likely, patches, patch_size)
        tiles.append(sum(len(spans) for _, spans in grid))
        return grid

    with (
        mock.patch.dict(synthesis.EXACT_PAIRS, approximate=10_000),
        mock.patch.object(matching, "NEIGHBOURHOOD", 40),
        mock.patch.object(matching, "neighbourhoods", counted),
    ):
        near = quality(synthesise(pyramid, 1200, [3], options, guidance)[0])
    assert tiles
    assert tiles[-1] < 30 * 30 / 2  # of 30 x 30 tiles in the last stage
    assert near[0] < 1.1 * exact[0]
    assert near[1] > 0.9 * exact[1]


def test_nothing_in_a_stage_waits_for_a_device() -> None:
    """Tensors without contents pass through matching and blending: nothing there depends on a value being known."""
    examples = waves(60, 0).to("meta")
    starts = torch.ones(60, dtype=torch.bool, device="meta")
    nearest = matching.nearest_patches(
        waves(80, 1)[None].to("meta"), matching.augment_examples(examples), starts, 7, 0.1, memory=100_000
    )
    assert nearest.shape == (1, 74)
    assert blend(nearest, examples, 7).shape == (1, 80, 6)
    assert blend(nearest, examples, 7, circular=True).shape == (1, 74, 6)
