"""GenMM written out plainly: the paper's sentences in PyTorch, one line each, nothing clever.

The yardstick that the real thing is held to: `tests/generators` compares results, `tools.bench_genmm` time. It unfolds
all patches, takes one distance matrix between them (Eq. 1), normalises it (Eq. 2), and averages overlapping patches.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def patches(frames: Tensor, size: int) -> Tensor:
    """All patches of `size` frames: (T, D) -> (T - size + 1, size * D)."""
    return frames.unfold(0, size, 1).transpose(1, 2).reshape(len(frames) - size + 1, -1)


def nearest_patches(guess: Tensor, examples: Sequence[Tensor], size: int, alpha: float | None) -> Tensor:
    """For each patch of the guess (F, D) its best example patch, counted over all patches of all examples."""
    theirs = torch.cat([patches(example, size) for example in examples])
    distances = torch.cdist(patches(guess, size), theirs, compute_mode="use_mm_for_euclid_dist") ** 2
    distances = distances / (size * guess.shape[1])
    if alpha is not None:
        distances = distances / (alpha + distances.min(dim=0, keepdim=True).values)
    return distances.argmin(dim=1)


def blend(chosen: Tensor, frames: int) -> Tensor:
    """The mean of overlapping patches (n, p, D) -> (frames, D)."""
    count, size, _ = chosen.shape
    total, votes = torch.zeros(frames, chosen.shape[2], dtype=chosen.dtype), torch.zeros(frames, 1)
    places = (torch.arange(count)[:, None] + torch.arange(size)).flatten()
    total.index_add_(0, places, chosen.flatten(0, 1))
    votes.index_add_(0, places, torch.ones(count * size, 1))
    return total / votes


def refine(guess: Tensor, examples: Sequence[Tensor], size: int, alpha: float | None, iterations: int) -> Tensor:
    """One stage of the pyramid: (F, D) -> (F, D)."""
    theirs = torch.cat([patches(example, size) for example in examples])
    for _ in range(iterations):
        nearest = nearest_patches(guess, examples, size, alpha)
        guess = blend(theirs[nearest].view(len(nearest), size, -1), len(guess))
    return guess


def resize(frames: Tensor, length: int) -> Tensor:
    """(F, D) -> (length, D) by linear interpolation."""
    return torch.nn.functional.interpolate(frames.T[None], size=length, mode="linear", align_corners=True)[0].T


def synthesise(
    stages: Sequence[Sequence[Tensor]], lengths: Sequence[int], noise: Tensor, size: int, alpha: float, iterations: int
) -> Tensor:
    """All stages: examples at each stage, lengths of the synthesis at each, and the first guess -> (F, D)."""
    guess = noise
    for examples, length in zip(stages, lengths):
        guess = refine(resize(guess, length), examples, size, alpha, iterations)
    return guess
