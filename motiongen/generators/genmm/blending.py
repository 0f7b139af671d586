"""Blending (section 3.3): every frame becomes the mean of the matched patches that cover it."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

VOTES_AT_ONCE = 2**20
"""How many votes of patches on frames are gathered together: some 12 MB, whatever the length."""


def blend(
    nearest: Tensor,
    examples: Tensor,
    patch_size: int,
    stride: int = 1,
    frames: int | None = None,
    circular: bool = False,
) -> Tensor:
    """Average voting of overlapping patches.

    At a finer rate than that of matching a patch comes in over the frames of its first step, and goes out over those of
    its last: with full votes at once, all patches would come and go at the coarse rate and shake the result with it.

    Args:
        nearest: (B, n) start of the example patch that stands at each place of the synthesis, in steps of `stride`.
        examples: (T, D) example frames, `stride` of them to one step of `nearest`.
        patch_size: p, in steps.
        stride: frames of `examples` to a step: 1 at the rate of matching; more blends a finer rate by the same choice
            of patches, so that its detail is the example's own and not an interpolation.
        frames: length of the result; by default all frames that patches cover, (n + p - 2) * stride + 1, or n * stride
            in a circle.
        circular: patches near the end run on into the beginning.

    Returns:
        (B, frames, D).
    """
    batch, count = nearest.shape
    before = patch_size - 1  # patches that began earlier and still cover a step
    steps = count if circular else count + before
    if frames is None:
        frames = count * stride if circular else (steps - 1) * stride + 1
    patches = torch.arange(-before, steps, device=nearest.device)
    held = patches % count if circular else patches.clamp(0, count - 1)
    ahead = (nearest[:, held] - patches) * stride  # (B, p - 1 + steps), from a frame to its source in the examples
    ramps = vote_ramps(patch_size, stride).to(examples)
    votes = (patches == held).to(examples.dtype) if not circular else examples.new_ones(len(patches))

    def mixed(begin: int, end: int) -> Tensor:
        """(B, frames, D) of steps `begin` to `end`."""
        time = torch.arange(begin * stride, end * stride, device=nearest.device).view(-1, stride, 1)
        covering = slice(begin, end + before)
        sources = ahead[:, covering].unfold(1, patch_size, 1)[:, :, None] + time  # (B, steps, stride, p)
        weights = votes[covering].unfold(0, patch_size, 1)[:, None] * ramps  # (steps, stride, p)
        weights = (weights / weights.sum(dim=-1, keepdim=True)).expand(batch, -1, -1, -1)
        flat = sources.reshape(-1, patch_size), weights.reshape(-1, patch_size)
        rows = functional.embedding_bag(flat[0], examples, mode="sum", per_sample_weights=flat[1])
        return rows.view(batch, -1, examples.shape[-1])

    some = max(1, VOTES_AT_ONCE // (batch * stride * patch_size))
    if steps <= some:
        return mixed(0, steps)[:, :frames]
    blended = examples.new_empty(batch, steps * stride, examples.shape[-1])
    for begin in range(0, steps, some):
        end = min(begin + some, steps)
        blended[:, begin * stride : end * stride] = mixed(begin, end)
    return blended[:, :frames]


def vote_ramps(patch_size: int, stride: int) -> Tensor:
    """(stride, p) votes of the patches over a step, for each of its frames: the oldest patch first, the newest last.

    At the rate of matching (`stride` 1) every patch has one vote.
    """
    frame = torch.arange(stride, dtype=torch.float64)
    ramps = torch.ones(stride, patch_size, dtype=torch.float64)
    ramps[:, -1] = (frame + 1) / stride
    if patch_size > 1:
        ramps[:, 1] *= ((stride - frame + 1) / stride).clamp_max(1)
        ramps[:, 0] = torch.where(frame == 0, 1 / stride, 0.0)  # a patch ends with the first frame of its last step
    return ramps


def assemble(blended: list[Tensor], columns: list[Tensor | None], size: int) -> Tensor:
    """Whole frames from parts: the mean over the parts that hold a feature (section 3.3, Fig. 4 right).

    Args:
        blended: (B, F, C_b) each part.
        columns: (C_b,) the features that each part holds; None: all.
        size: D.

    Returns:
        (B, F, D).
    """
    if len(blended) == 1 and columns[0] is None:
        return blended[0]
    total = blended[0].new_zeros(*blended[0].shape[:2], size)
    votes = blended[0].new_zeros(size)
    for part, held in zip(blended, columns):
        chosen = torch.arange(size, device=part.device) if held is None else held
        total.index_add_(2, chosen, part)
        votes.index_add_(0, chosen, torch.ones_like(chosen, dtype=votes.dtype))
    return total / votes
