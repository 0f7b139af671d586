"""Matching against its definition: every fast path has a slow twin here or in `tools.plain_genmm`."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from motiongen.generators.genmm.matching import (
    augment_examples,
    diagonal_sums,
    frame_distances,
    nearest_patches,
    normaliser_floor,
)
from motiongen.generators.genmm.pyramid import patch_starts
from tools import plain_genmm

sizes = st.integers(1, 20)


def features(seed: int, *shape: int) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@given(st.integers(0, 99), st.integers(1, 3), sizes, sizes, st.integers(1, 9))
def test_frame_distances_are_squared_differences(seed: int, batch: int, frames: int, examples: int, size: int) -> None:
    x, y = features(seed, batch, frames, size), features(seed + 1, examples, size)
    literal = ((x[:, :, None] - y[None, None]) ** 2).sum(-1)
    torch.testing.assert_close(frame_distances(x, augment_examples(y)), literal)


@given(st.integers(0, 99), st.integers(1, 2), st.integers(1, 30), st.integers(1, 30), st.integers(1, 30))
def test_diagonal_sums_walk_down_every_diagonal(seed: int, batch: int, rows: int, columns: int, width: int) -> None:
    width = min(width, rows, columns)
    distances = features(seed, batch, rows, columns)
    n, m = rows - width + 1, columns - width + 1
    literal = torch.stack(
        [torch.stack([distances[:, i : i + width, j : j + width].diagonal(0, 1, 2).sum(-1) for j in range(m)], -1)
         for i in range(n)], 1
    )  # fmt: skip
    fast = diagonal_sums(distances, width)
    assert fast.shape == (batch, n, columns)
    torch.testing.assert_close(fast[..., :m], literal)


@given(
    st.integers(0, 999),
    st.integers(3, 12),
    st.lists(st.integers(0, 20), min_size=1, max_size=3),
    st.integers(0, 25),
    st.sampled_from([None, 0.5, 0.01, 0.0001]),
)
def test_nearest_patches_are_those_of_the_plain_method(
    seed: int, size: int, extra: list[int], more: int, alpha: float | None
) -> None:
    examples = [features(seed + i, size + length, 4) for i, length in enumerate(extra)]
    guess = features(seed + 50, size + more, 4)
    together, starts = torch.cat(examples), patch_starts([len(e) for e in examples], size)
    floor = normaliser_floor(alpha, size, features=4)
    fast = nearest_patches(guess[None], augment_examples(together), starts, size, floor)[0]
    plain = plain_genmm.nearest_patches(guess, examples, size, alpha)
    numbered = torch.nonzero(starts)[:, 0]  # the plain method counts patches, the fast one frames
    assert torch.equal(fast, numbered[plain])


def test_no_patch_runs_from_one_example_into_the_next() -> None:
    """Even where the best diagonal crosses the border."""
    a, b = features(0, 15, 3), features(1, 15, 3)
    guess = torch.cat([a[-5:], b[:6]])
    starts = patch_starts([15, 15], 11)
    nearest = nearest_patches(guess[None], augment_examples(torch.cat([a, b])), starts, 11, None)
    assert bool(starts[nearest].all())


@pytest.mark.parametrize("floor", [0.0, 0.01])
def test_an_example_as_its_own_guess_finds_itself(floor: float) -> None:
    """Also where every distance on the diagonal is zero and nothing keeps the quotient finite."""
    example = features(2, 40, 6).float()
    starts = patch_starts([40], 7)
    nearest = nearest_patches(example[None], augment_examples(example), starts, 7, floor)
    assert torch.equal(nearest[0], torch.arange(34))


def test_a_smaller_alpha_uses_more_of_the_example() -> None:
    """What Eq. 2 is for: the guess knows only the first half, a small alpha shows the second half all the same."""
    example = torch.cat([features(3, 60, 5), features(4, 60, 5) + 4.0])
    guess = features(5, 200, 5) * 0.5 + example[:60].mean(0)
    starts = patch_starts([120], 5)
    shown = [
        len(nearest_patches(guess[None], augment_examples(example), starts, 5, normaliser_floor(alpha, 5, 5)).unique())
        for alpha in (100.0, 0.1, 0.001)
    ]
    assert shown[0] < shown[1] < shown[2]
