"""Blending (section 3.3): every frame becomes the mean of the matched patches that cover it."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def blend(
    nearest: Tensor,
    examples: Tensor,
    patch_size: int,
    stride: int = 1,
    frames: int | None = None,
    circular: bool = False,
) -> Tensor:
    """Average voting of overlapping patches.

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
    reach = (patch_size - 1) * stride + 1  # frames that a patch spans
    if frames is None:
        frames = count * stride if circular else (count - 1) * stride + reach
    time = torch.arange(frames, device=nearest.device)
    # Patch i spans frames [i * stride, i * stride + reach): frame t lies in patches `last` and up to p - 1 before it.
    last = torch.div(time, stride, rounding_mode="floor")
    covering = last[:, None] - torch.arange(patch_size, device=nearest.device)  # (frames, p)
    into = time[:, None] - covering * stride  # how far into the patch the frame lies
    inside = into < reach
    if not circular:
        inside &= (covering >= 0) & (covering < count)
    covering = covering % count if circular else covering.clamp(0, count - 1)
    sources = nearest[:, covering] * stride + torch.where(inside, into, 0)  # (B, frames, p)
    weights = (inside / inside.sum(dim=-1, keepdim=True)).to(examples.dtype).expand(batch, -1, -1)
    mixed = functional.embedding_bag(
        sources.reshape(-1, patch_size),
        examples,
        mode="sum",
        per_sample_weights=weights.reshape(-1, patch_size),
    )
    return mixed.view(batch, frames, -1)


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
