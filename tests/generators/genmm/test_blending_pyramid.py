"""Blending and the pyramid against their definitions."""

from __future__ import annotations

import itertools
import math
from unittest import mock

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from motiongen.generators.genmm import blending
from motiongen.generators.genmm.basis import principal_axes
from motiongen.generators.genmm.blending import blend
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import (
    PartSource,
    build_pyramid,
    patch_starts,
    resize,
    stage_length,
    stage_scales,
)
from motiongen.generators.genmm.synthesis import first_guess, synthesise
from tests.generators.genmm.test_matching import features
from tools import plain_genmm


@given(
    st.integers(0, 99), st.integers(2, 9), st.integers(1, 12), st.integers(1, 4), st.integers(1, 3), st.booleans(),
    st.sampled_from([1, 50, 2**20]),
)  # fmt: skip
def test_every_frame_is_the_mean_of_the_patches_over_it(
    seed: int, size: int, count: int, stride: int, batch: int, circular: bool, votes_at_once: int
) -> None:
    """Whether all is blended at once or a few steps at a time."""
    count = max(count, size) if circular else count
    examples = features(seed, (size + 20) * stride, 3)
    nearest = torch.randint(0, 20, (batch, count), generator=torch.Generator().manual_seed(seed))
    with mock.patch.object(blending, "VOTES_AT_ONCE", votes_at_once):
        blended = blend(nearest, examples, size, stride, circular=circular)
    reach = (size - 1) * stride + 1
    frames = count * stride if circular else (count - 1) * stride + reach
    assert blended.shape == (batch, frames, 3)
    for b in range(batch):
        total, votes = torch.zeros(frames, 3, dtype=torch.float64), torch.zeros(frames, 1, dtype=torch.float64)
        for i, start in enumerate(nearest[b].tolist()):
            for k in range(reach):
                vote = min(1.0, (k + 1) / stride) * min(1.0, (reach - k) / stride)  # in over a step, and out
                total[(i * stride + k) % frames] += vote * examples[start * stride + k]
                votes[(i * stride + k) % frames] += vote
        literal = total / votes
        torch.testing.assert_close(blended[b], literal)


@given(st.integers(12, 60), st.integers(2, 11), st.integers(1, 4))
def test_patches_in_order_give_back_the_example(length: int, size: int, stride: int) -> None:
    examples = features(length, length * stride, 2)
    whole = blend(torch.arange(length - size + 1)[None], examples, size, stride)
    torch.testing.assert_close(whole[0], examples[: (length - 1) * stride + 1])


@given(st.floats(1, 5000), st.integers(2, 30), st.floats(1, 20), st.floats(1.01, 8))
def test_scales_rise_evenly_to_one(length: float, size: int, patches: float, factor: float) -> None:
    scales = stage_scales(length, size, patches, factor)
    assert scales[-1] == 1.0
    assert all(a < b for a, b in itertools.pairwise(scales))
    if len(scales) > 1:
        assert scales[0] * length == pytest.approx(patches * size)  # the coarsest example is K patches long
        steps = [b / a for a, b in itertools.pairwise(scales)]
        assert max(steps) == pytest.approx(min(steps))
        assert len(steps) == max(1, round(math.log(length / (patches * size)) / math.log(factor)))
    else:
        assert length <= patches * size


def test_resize_keeps_ends_and_straight_lines() -> None:
    line = torch.linspace(0, 1, 7, dtype=torch.float64)[:, None] * torch.tensor([1.0, -3.0], dtype=torch.float64)
    torch.testing.assert_close(resize(line, 19), torch.linspace(0, 1, 19, dtype=torch.float64)[:, None] * line[-1])
    assert resize(line[None], 3).shape == (1, 3, 2)


def test_starts_leave_room_for_a_patch() -> None:
    assert patch_starts([4, 3, 6], 3).int().tolist() == [1, 1, 0, 0, 1, 0, 0, 1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("lengths", [[90], [60, 41]])
def test_the_whole_synthesis_is_that_of_the_plain_method(lengths: list[int]) -> None:
    """All stages, in double precision, so that rounding decides nothing."""
    options = GenMMOptions(patch_size=7)
    examples = [features(i, length, 6) for i, length in enumerate(lengths)]
    basis = principal_axes(examples)
    pyramid = build_pyramid([PartSource(examples)], 7, 4.0, 4 / 3, basis, dtype=torch.float64)
    assert len(pyramid.stages) > 2
    sizes = [stage_length(150, stage.scale, 7) for stage in pyramid.stages]
    nearest = synthesise(pyramid, 150, [5], options)[0]
    fast = blend(nearest, torch.cat(examples), 7)[0]

    stages = [[plain_genmm.resize(e, stage_length(len(e), s.scale, 7)) for e in examples] for s in pyramid.stages]
    coordinates = first_guess(pyramid, sizes[0], [5], options.noise)[0]
    noise = coordinates @ basis.axes.T + basis.mean
    plain = plain_genmm.synthesise(stages, sizes, noise, 7, 0.01, options.iterations)
    torch.testing.assert_close(fast, plain, atol=1e-6, rtol=1e-6)


def test_a_basis_keeps_distances_and_drops_what_does_not_vary() -> None:
    """Ten features that follow three numbers need three axes, and lose nothing."""
    hidden = features(1, 80, 3)
    examples = [(hidden @ features(2, 3, 10) + 5.0)[:50], (hidden @ features(2, 3, 10) + 5.0)[50:]]
    basis = principal_axes(examples)
    assert basis.axes.shape == (10, 3)
    torch.testing.assert_close(basis.axes.T @ basis.axes, torch.eye(3, dtype=torch.float64))
    together = torch.cat(examples)
    torch.testing.assert_close(
        torch.cdist(basis.coordinates(together), basis.coordinates(together)),
        torch.cdist(together, together),
        atol=1e-5,
        rtol=1e-5,
    )


def test_examples_that_stand_still_have_a_basis_too() -> None:
    basis = principal_axes([torch.ones(20, 4, dtype=torch.float64)])
    assert basis.axes.shape[1] == 1
    assert float(basis.coordinates(torch.ones(3, 4, dtype=torch.float64)).abs().max()) == 0.0


@given(st.integers(0, 99))
def test_dropped_axes_hold_no_more_than_is_negligible(seed: int) -> None:
    examples = [features(seed, 40, 12) * torch.logspace(0, -8, 12, dtype=torch.float64)]
    basis = principal_axes(examples, negligible=1e-6)
    centred = examples[0] - basis.mean
    lost = (centred**2).sum() - (basis.coordinates(examples[0]) ** 2).sum()
    assert basis.axes.shape[1] < 12
    assert float(lost / (centred**2).sum()) <= 1e-6
