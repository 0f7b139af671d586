"""The exemplar pyramid and the lengths of the synthesis at each stage (section 3.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from motiongen.generators.genmm.basis import Basis


@dataclass(frozen=True)
class StageExamples:
    """The examples at one stage, end to end.

    Attributes:
        scale: length here over full length.
        frames: (T, R) coordinates of all examples.
        starts: (T,) True where a patch may start: not so near the end of an example that it would run into the next.
        augmented: (R + 2, T) what `matching` multiplies with: see `matching.augment_examples`.
    """

    scale: float
    frames: Tensor
    starts: Tensor
    augmented: Tensor


@dataclass(frozen=True)
class Pyramid:
    """The examples at all stages, and what is needed to begin.

    Attributes:
        stages: coarsest first.
        basis: the axes along which `stages` hold coordinates.
        mean: (D,) mean feature of the coarsest examples.
        deviation: (D,) deviation of the coarsest examples' features.
    """

    stages: tuple[StageExamples, ...]
    basis: Basis
    mean: Tensor
    deviation: Tensor

    @property
    def features(self) -> int:
        """How many features D a frame has, before they are reduced to coordinates."""
        return len(self.mean)


def stage_scales(length: float, patch_size: int, coarse_patches: float, scale_factor: float) -> list[float]:
    """Scales of the stages, coarsest first, ending with 1.

    The coarsest example is K patches long, and every stage r times the one before; r gives way a little, so that the
    steps are even and end exactly at full length.

    Args:
        length: T, frames of the example (the mean, where there are several).
        patch_size: p.
        coarse_patches: K.
        scale_factor: r, more than 1.
    """
    ratio = length / (coarse_patches * patch_size)
    if ratio <= 1:
        return [1.0]
    steps = max(1, round(math.log(ratio) / math.log(scale_factor)))
    return [float(ratio ** (step / steps - 1)) for step in range(steps)] + [1.0]


def stage_length(frames: int, scale: float, patch_size: int) -> int:
    """Frames at a stage: never fewer than one patch."""
    return max(patch_size, round(frames * scale))


def resize(frames: Tensor, length: int) -> Tensor:
    """(B, F, D) or (F, D) features at another number of frames, linearly interpolated; first and last frame stay."""
    if frames.shape[-2] == length:
        return frames
    batched = frames if frames.dim() == 3 else frames[None]
    resized = functional.interpolate(batched.transpose(1, 2), size=length, mode="linear", align_corners=True)
    resized = resized.transpose(1, 2).contiguous()
    return resized if frames.dim() == 3 else resized[0]


def patch_starts(lengths: Sequence[int], patch_size: int) -> Tensor:
    """(T,) True for each frame of examples of `lengths`, end to end, at which a whole patch starts."""
    return torch.cat([torch.arange(length) <= length - patch_size for length in lengths])
