"""Blending (section 3.3): every frame becomes the mean of the matched patches that cover it."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

VOTES_AT_ONCE = 2**20
"""How many votes of patches on frames are gathered together: some 8 MB, whatever the length."""


class Coverage:
    """Which patches cover which frames, and how much each counts there: a matter of sizes, the same for many blendings.

    With `stride` 1 patch i spans frames i to i + p - 1. Seen from a frame, it is covered by the patch that begins there
    and the p - 1 before it; at both ends there are fewer, and those that are missing count nothing.
    """

    def __init__(self, count: int, patch_size: int, like: Tensor, stride: int = 1, circular: bool = False) -> None:
        """Work out what only depends on sizes.

        Args:
            count: n, places of the synthesis.
            patch_size: p, in steps.
            like: of the type, and on the device, of what will be blended.
            stride: frames to a step.
            circular: patches near the end run on into the beginning.
        """
        before = patch_size - 1
        self.patch_size, self.stride = patch_size, stride
        self.steps = count if circular else count + before
        self.frames = self.steps * stride if circular else (self.steps - 1) * stride + 1
        self.patches = torch.arange(-before, self.steps, device=like.device)  # some of them missing
        self.held = self.patches % count if circular else self.patches.clamp(0, count - 1)  # by what they are filled
        self.time = torch.arange(self.steps * stride, device=like.device).view(-1, stride, 1)
        votes = torch.ones_like(self.patches) if circular else self.patches == self.held
        ramps = vote_ramps(patch_size, stride).to(like)
        weights = votes.to(like.dtype).unfold(0, patch_size, 1)[:, None] * ramps  # (steps, stride, p)
        self.weights = (weights / weights.sum(dim=-1, keepdim=True)).view(-1, patch_size)

    def blend(self, nearest: Tensor, examples: Tensor) -> Tensor:
        """(B, frames, D) of the starts (B, n) and the example frames (T, D), see `blend`."""
        batch, stride = len(nearest), self.stride
        ahead = nearest[:, self.held] - self.patches  # (B, p - 1 + steps) from a step to its source in the examples
        if stride > 1:
            ahead = ahead * stride
        some = max(1, VOTES_AT_ONCE // (batch * stride * self.patch_size))
        blended = [
            self._mixed(ahead, examples, begin, min(begin + some, self.steps)) for begin in range(0, self.steps, some)
        ]
        whole = blended[0] if len(blended) == 1 else torch.cat(blended, dim=1)
        return whole[:, : self.frames]

    def _mixed(self, ahead: Tensor, examples: Tensor, begin: int, end: int) -> Tensor:
        """(B, frames, D) of steps `begin` to `end`."""
        covering = ahead[:, begin : end + self.patch_size - 1].unfold(1, self.patch_size, 1)  # (B, steps, p)
        sources = covering[:, :, None] + self.time[begin:end]  # (B, steps, stride, p)
        weights = self.weights[begin * self.stride : end * self.stride]
        mixed = functional.embedding_bag(
            sources.reshape(-1, self.patch_size),
            examples,
            mode="sum",
            per_sample_weights=weights.repeat(len(ahead), 1) if len(ahead) > 1 else weights,
        )
        return mixed.view(len(ahead), -1, examples.shape[-1])


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
    return Coverage(nearest.shape[1], patch_size, examples, stride, circular).blend(nearest, examples)[:, :frames]


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
