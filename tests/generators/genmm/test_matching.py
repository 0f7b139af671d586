"""Matching against its definition: every fast path has a slow twin here or in `tools.plain_genmm`."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from motiongen.generators.genmm import matching
from motiongen.generators.genmm.matching import (
    augment_examples,
    augment_guess,
    diagonal_sums,
    nearest_patches,
    neighbourhoods,
    normaliser_floor,
    tile_shape,
)
from motiongen.generators.genmm.pyramid import patch_starts
from tools import plain_genmm

sizes = st.integers(1, 20)


def features(seed: int, *shape: int) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@given(st.integers(0, 99), st.integers(1, 3), sizes, sizes, st.integers(1, 9))
def test_products_of_frames_are_squared_differences(
    seed: int, batch: int, frames: int, examples: int, size: int
) -> None:
    x, y = features(seed, batch, frames, size), features(seed + 1, examples, size)
    literal = ((x[:, :, None] - y[None, None]) ** 2).sum(-1)
    torch.testing.assert_close(augment_guess(x) @ augment_examples(y), literal)


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
    assert fast.shape == (batch, n, m)
    torch.testing.assert_close(fast, literal)


@given(
    st.integers(0, 999),
    st.integers(3, 12),
    st.lists(st.integers(0, 20), min_size=1, max_size=3),
    st.integers(0, 25),
    st.sampled_from([None, 0.5, 0.01, 0.0001]),
    st.sampled_from([1, 3_000, 10_000, 50_000, 2**30]),
)
def test_nearest_patches_are_those_of_the_plain_method(
    seed: int, size: int, extra: list[int], more: int, alpha: float | None, memory: int
) -> None:
    """However little memory there is: then tiles are small, and few of them or none are kept."""
    examples = [features(seed + i, size + length, 4) for i, length in enumerate(extra)]
    guess = features(seed + 50, size + more, 4)
    together, starts = torch.cat(examples), patch_starts([len(e) for e in examples], size)
    floor = normaliser_floor(alpha, size, features=4)
    fast = nearest_patches(guess[None], augment_examples(together), starts, size, floor, memory)[0]
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


@given(st.integers(0, 99), st.integers(1, 40), st.integers(1, 40), st.integers(2, 9), st.integers(1, 2**16))
def test_a_batch_is_searched_like_each_of_it(seed: int, more: int, extra: int, size: int, memory: int) -> None:
    guess, examples = features(seed, 3, size + more, 4), features(seed + 1, size + extra, 4)
    arguments = augment_examples(examples), patch_starts([len(examples)], size), size, 0.01, memory
    together = nearest_patches(guess, *arguments)
    assert torch.equal(together, torch.cat([nearest_patches(one[None], *arguments) for one in guess]))


@given(
    st.integers(1, 4), st.integers(1, 10**5), st.integers(1, 10**5), st.integers(2, 20), st.integers(10**4, 10**9),
    st.booleans(),
)  # fmt: skip
def test_tiles_stay_within_the_memory(
    batch: int, count: int, patches: int, size: int, entries: int, cuda: bool
) -> None:
    height, width = tile_shape(batch, count, patches, size, entries, cuda)
    assert 1 <= height <= count
    assert 1 <= width <= patches
    framed = batch * (height + size - 1) * (width + size - 1)
    assert matching.TILES_AT_ONCE * framed <= entries
    # Not needlessly small: four times as large would be too much, or there is no more to take.
    limit = entries // matching.TILES_AT_ONCE if cuda else min(matching.CACHED_ENTRIES, entries // 4)
    assert 4 * batch * (height + size) * (width + size) > limit or (height, width) == (count, patches)


def test_nothing_made_by_a_search_is_larger_than_its_memory() -> None:
    """What is whole is never made: neither all distances, nor all of them for some places."""
    size, memory = 5, 400_000
    guess, examples = features(1, 1, 900, 3), features(2, 1100, 3)
    arguments = augment_examples(examples), patch_starts([len(examples)], size), size, 0.1
    with LargestTensor() as largest:
        nearest_patches(guess, *arguments, memory=memory)
    assert largest.bytes <= memory / matching.TILES_AT_ONCE
    with LargestTensor() as largest:
        nearest_patches(guess, *arguments)
    assert largest.bytes > memory  # the measure measures


class LargestTensor(TorchDispatchMode):
    """Remembers how large the largest tensor is that any operation returns."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        returned = func(*args, **(kwargs or {}))
        for tensor in returned if isinstance(returned, (tuple, list)) else (returned,):
            if isinstance(tensor, Tensor) and tensor.is_contiguous():  # what is not is a view, and takes nothing
                self.bytes = max(self.bytes, tensor.nbytes)
        return returned


# -- looking only where it is likely


@given(st.integers(1, 2000), st.integers(1, 2000), st.integers(2, 20), st.integers(0, 99))
def test_neighbourhoods_hold_what_is_likely_and_a_patch_around_it(
    count: int, patches: int, size: int, seed: int
) -> None:
    likely = torch.randint(0, patches, (count,), generator=torch.Generator().manual_seed(seed))
    held = torch.zeros(count, patches, dtype=torch.bool)
    covered = 0
    for places, spans in neighbourhoods(likely, patches, size):
        covered += places.stop - places.start
        for examples in spans:
            assert examples.stop - examples.start <= matching.NEIGHBOURHOOD
            assert not held[places, examples].any()  # nothing twice
            held[places, examples] = True
    assert covered == count
    time = torch.arange(count)
    for earlier, shift in itertools.product((-size, 0, size), repeat=2):
        assert held[(time + earlier).clamp(0, count - 1), (likely + shift).clamp(0, patches - 1)].all()


@pytest.mark.parametrize("floor", [None, 0.5])
def test_what_is_found_near_the_likely_is_what_is_found_anywhere(floor: float | None) -> None:
    """Of a guess that is made of runs of the examples, and of a likely place for each run that is a patch off."""
    size, rng = 7, torch.Generator().manual_seed(4)
    lengths = [700, 300, 500]
    examples = features(6, sum(lengths), 5)
    within = torch.cat(
        [torch.arange(600), torch.arange(700, 900), torch.arange(1000, 1400)]
    )  # no run leaves its example
    begins = within[torch.randint(0, len(within), (2, 10), generator=rng)]
    runs = (begins[..., None] + torch.arange(90)).flatten(1)  # (2, 900)
    guess = examples[runs] + 0.01 * features(7, 2, 900, 5)
    likely = (runs[:, : 900 - size + 1] + size - 1).clamp(max=sum(lengths) - size)
    arguments = augment_examples(examples), patch_starts(lengths, size), size, floor
    exact = nearest_patches(guess, *arguments)
    near = nearest_patches(guess, *arguments, likely=likely)
    inside = torch.arange(900 - size + 1) % 90 <= 90 - size  # where no run ends within the patch
    assert torch.equal(near[:, inside], exact[:, inside])
    assert torch.equal(
        near, torch.cat([nearest_patches(g[None], *arguments, likely=n[None]) for g, n in zip(guess, likely)])
    )
    assert patch_starts(lengths, size)[near].all()


@given(st.integers(0, 99), st.integers(1, 60), st.integers(1, 60))
def test_where_all_is_near_the_search_is_exact(seed: int, more: int, extra: int) -> None:
    guess, examples = features(seed, 1, 5 + more, 3), features(seed + 1, 5 + extra, 3)
    likely = torch.zeros(1, 1 + more, dtype=torch.int64)
    arguments = augment_examples(examples), patch_starts([len(examples)], 5), 5, 0.01
    assert torch.equal(nearest_patches(guess, *arguments, likely=likely), nearest_patches(guess, *arguments))
