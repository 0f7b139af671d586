"""The exemplar pyramid and the lengths of the synthesis at each stage (section 3.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from motiongen.generators.genmm.basis import Basis
from motiongen.generators.genmm.matching import augment_examples


@dataclass(frozen=True)
class PartExamples:
    """The examples of one skeletal part at one stage, end to end.

    Attributes:
        columns: (C,) the features that belong to the part; None: all of them.
        frames: (T, C) those features of all examples.
        starts: (T,) True where a patch may start: not so near the end of an example that it would run into the next.
        times: (T,) when each frame stands in the examples at full length, in frames, end to end.
        augmented: (C + 2, T) what `matching` multiplies with: see `matching.augment_examples`.
    """

    columns: Tensor | None
    frames: Tensor
    starts: Tensor
    times: Tensor
    augmented: Tensor


@dataclass(frozen=True)
class Stage:
    """One stage of the pyramid.

    Attributes:
        scale: length here over full length.
        parts: the skeletal parts, one at least; together they hold every feature.
    """

    scale: float
    parts: tuple[PartExamples, ...]


@dataclass(frozen=True)
class PartSource:
    """Where one part's patches come from.

    Attributes:
        examples: (T_i, D) weighted features of each example in double precision; only `columns` are read.
        columns: (C,) the features that belong to the part; None: all of them.
    """

    examples: Sequence[Tensor]
    columns: Tensor | None = None


@dataclass(frozen=True)
class Pyramid:
    """The examples at all stages, and what is needed to begin.

    Attributes:
        stages: coarsest first.
        features: how many numbers each part is matched by, before they are reduced to coordinates; alpha is meant for
            one of them.
        basis: the axes along which a single part holds coordinates; None: the features themselves.
        mean: (D,) mean feature of the coarsest examples.
        deviation: (D,) deviation of the coarsest examples' features.
    """

    stages: tuple[Stage, ...]
    features: tuple[int, ...]
    basis: Basis | None
    mean: Tensor
    deviation: Tensor


def build_pyramid(
    sources: Sequence[PartSource],
    patch_size: int,
    coarse_patches: float,
    scale_factor: float,
    basis: Basis | None = None,
    dtype: torch.dtype = torch.float32,
) -> Pyramid:
    """The examples at every stage.

    Args:
        sources: the parts, each with its examples, which are at least one patch long.
        patch_size: p.
        coarse_patches: K.
        scale_factor: r.
        basis: axes to match along, for a single part that holds all features.
        dtype: precision to match in.
    """
    examples = [example for source in sources for example in source.examples]
    mean_length = sum(len(example) for example in examples) / len(examples)
    scales = stage_scales(mean_length, patch_size, coarse_patches, scale_factor)

    def resized(frames: Tensor, scale: float) -> Tensor:
        return resize(frames, stage_length(len(frames), scale, patch_size))

    def matched(source: PartSource) -> list[Tensor]:
        """What is matched of each example, at full length."""
        chosen = [example if source.columns is None else example[:, source.columns] for example in source.examples]
        return [(example if basis is None else basis.coordinates(example)).to(dtype) for example in chosen]

    def part(source: PartSource, full: list[Tensor], scale: float) -> PartExamples:
        small = [resized(example, scale) for example in full]
        frames = torch.cat(small)
        lengths = [len(example) for example in small]
        starts = patch_starts(lengths, patch_size).to(frames.device)
        times = frame_times(lengths, [len(example) for example in full]).to(frames.device)
        return PartExamples(source.columns, frames, starts, times, augment_examples(frames))

    full = [matched(source) for source in sources]
    stages = tuple(
        Stage(scale, tuple(part(source, whole, scale) for source, whole in zip(sources, full))) for scale in scales
    )
    size = examples[0].shape[1]
    features = tuple(_numbers(source) for source in sources)
    mean, deviation = examples[0].new_zeros(size), examples[0].new_zeros(size)
    for source in sources:
        coarsest = torch.cat([resized(example, scales[0]) for example in source.examples])
        columns = slice(None) if source.columns is None else source.columns
        mean[columns] = coarsest.mean(dim=0)[columns]
        deviation[columns] = coarsest.std(dim=0, unbiased=False)[columns]
    return Pyramid(stages, features, basis, mean, deviation)


def _numbers(source: PartSource) -> int:
    """How many of the part's features count: those of weight 0 are 0 throughout."""
    used = torch.stack([(example != 0).any(dim=0) for example in source.examples]).any(dim=0)
    return int((used if source.columns is None else used[source.columns]).sum())


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


def resize(frames: Tensor, length: int, circular: bool = False) -> Tensor:
    """(B, F, D) or (F, D) features at another number of frames, linearly interpolated.

    The first and the last frame stay; with `circular` the first stays, and the last leads on into it.
    """
    if frames.shape[-2] == length:
        return frames
    batched = frames if frames.dim() == 3 else frames[None]
    if circular:
        count = batched.shape[1]
        times = torch.arange(length, device=frames.device, dtype=torch.float64) * count / length
        before = times.long()
        weight = (times - before)[:, None].to(batched.dtype)
        resized = batched[:, before] * (1 - weight) + batched[:, (before + 1) % count] * weight
    else:
        resized = functional.interpolate(batched.transpose(1, 2), size=length, mode="linear", align_corners=True)
        resized = resized.transpose(1, 2).contiguous()
    return resized if frames.dim() == 3 else resized[0]


def patch_starts(lengths: Sequence[int], patch_size: int) -> Tensor:
    """(T,) True for each frame of examples of `lengths`, end to end, at which a whole patch starts."""
    return torch.cat([torch.arange(length) <= length - patch_size for length in lengths])


def frame_times(lengths: Sequence[int], full: Sequence[int]) -> Tensor:
    """(T,) when frames of examples resized to `lengths` stand in examples of `full` lengths, both end to end."""
    begins = itertools.accumulate(full, initial=0)
    return torch.cat(
        [
            torch.linspace(begin, begin + frames - 1, length, dtype=torch.float64)
            for begin, frames, length in zip(begins, full, lengths)
        ]
    )
