"""Multi-stage synthesis (section 3.2): from noise at the coarsest stage to full detail, on features alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from motiongen.generators.genmm.blending import blend
from motiongen.generators.genmm.matching import augment_examples, nearest_patches
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import StageExamples, patch_starts, resize, stage_length, stage_scales


def build_pyramid(examples: Sequence[Tensor], options: GenMMOptions) -> list[StageExamples]:
    """The examples at every stage, coarsest first.

    Args:
        examples: (T_i, D) features of each example, at least one patch long.
        options: p, K and r.
    """
    patch_size = options.patch_size
    mean_length = sum(len(example) for example in examples) / len(examples)
    stages = []
    for scale in stage_scales(mean_length, patch_size, options.coarse_patches, options.scale_factor):
        resized = [resize(example, stage_length(len(example), scale, patch_size)) for example in examples]
        frames = torch.cat(resized)
        starts = patch_starts([len(example) for example in resized], patch_size).to(frames.device)
        stages.append(StageExamples(scale, frames, starts, augment_examples(frames)))
    return stages


def synthesise(
    pyramid: Sequence[StageExamples],
    frames: int,
    seeds: Sequence[int],
    options: GenMMOptions,
    advance: Callable[[], None] = lambda: None,
) -> Tensor:
    """Choose example patches for new sequences.

    Args:
        pyramid: from `build_pyramid`.
        frames: length of each sequence, at least one patch.
        seeds: one for each of the B sequences.
        options: p, alpha, E, noise.
        advance: called after each stage.

    Returns:
        (B, frames - p + 1) int64: for each place of the result the start of the example patch that stands there, to be
        blended by `blending.blend`.
    """
    coarsest = pyramid[0]
    guess = first_guess(coarsest, stage_length(frames, coarsest.scale, options.patch_size), seeds, options.noise)
    for stage in pyramid:
        guess = resize(guess, stage_length(frames, stage.scale, options.patch_size))
        for _ in range(options.iterations):
            nearest = nearest_patches(guess, stage.augmented, stage.starts, options.patch_size, options.alpha)
            guess = blend(nearest, stage.frames, options.patch_size)
        advance()
    return nearest


def first_guess(stage: StageExamples, frames: int, seeds: Sequence[int], deviation: float) -> Tensor:
    """(B, frames, D) Gaussian noise with the examples' mean and `deviation` times their deviation (F_1 of section 3.2).

    Drawn on the CPU, sequence by sequence, so that a seed gives the same noise on every device and in every batch.
    """
    drawn = [torch.randn(frames, stage.frames.shape[-1], generator=torch.Generator().manual_seed(s)) for s in seeds]
    spread = stage.frames.std(dim=0, unbiased=False) * deviation
    return torch.stack(drawn).to(stage.frames) * spread + stage.frames.mean(dim=0)
