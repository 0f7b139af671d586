"""Blending (section 3.3): every frame becomes the mean of the matched patches that cover it."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def blend(nearest: Tensor, examples: Tensor, patch_size: int, stride: int = 1, frames: int | None = None) -> Tensor:
    """Average voting of overlapping patches.

    Args:
        nearest: (B, n) start of the example patch that stands at each place of the synthesis, in steps of `stride`.
        examples: (T, D) example frames, `stride` of them to one step of `nearest`.
        patch_size: p, in steps.
        stride: frames of `examples` to a step: 1 at the rate of matching; more blends a finer rate by the same choice
            of patches, so that its detail is the example's own and not an interpolation.
        frames: length of the result; by default all frames that patches cover, (n + p - 2) * stride + 1.

    Returns:
        (B, frames, D).
    """
    batch, count = nearest.shape
    reach = (patch_size - 1) * stride + 1  # frames that a patch spans
    frames = (count - 1) * stride + reach if frames is None else frames
    time = torch.arange(frames, device=nearest.device)
    # Patch i spans frames [i * stride, i * stride + reach): frame t lies in patches first ... last.
    first = torch.div(time - reach + stride, stride, rounding_mode="floor").clamp_min(0)
    last = torch.div(time, stride, rounding_mode="floor").clamp_max(count - 1)
    covering = first[:, None] + torch.arange(patch_size, device=nearest.device)  # (frames, p)
    inside = covering <= last[:, None]
    covering = torch.minimum(covering, last[:, None])
    sources = nearest[:, covering] * stride + (time[:, None] - covering * stride)  # (B, frames, p)
    weights = (inside / inside.sum(dim=-1, keepdim=True)).to(examples.dtype).expand(batch, -1, -1)
    mixed = functional.embedding_bag(
        sources.reshape(-1, patch_size),
        examples,
        mode="sum",
        per_sample_weights=weights.reshape(-1, patch_size),
    )
    return mixed.view(batch, frames, -1)
