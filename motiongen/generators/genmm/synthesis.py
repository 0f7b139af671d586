"""Multi-stage synthesis (section 3.2): from noise at the coarsest stage to full detail, on features alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from motiongen.generators.genmm.basis import principal_axes
from motiongen.generators.genmm.blending import blend
from motiongen.generators.genmm.matching import augment_examples, nearest_patches, normaliser_floor
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import Pyramid, StageExamples, patch_starts, resize, stage_length, stage_scales


def build_pyramid(examples: Sequence[Tensor], options: GenMMOptions, dtype: torch.dtype = torch.float32) -> Pyramid:
    """The examples at every stage.

    Args:
        examples: (T_i, D) weighted features of each example in double precision, at least one patch long.
        options: p, K and r.
        dtype: precision to match in.
    """
    patch_size = options.patch_size
    basis = principal_axes(examples)
    coordinates = [basis.coordinates(example).to(dtype) for example in examples]
    mean_length = sum(len(example) for example in examples) / len(examples)
    scales = stage_scales(mean_length, patch_size, options.coarse_patches, options.scale_factor)
    stages = []
    for scale in scales:
        resized = [resize(example, stage_length(len(example), scale, patch_size)) for example in coordinates]
        frames = torch.cat(resized)
        starts = patch_starts([len(example) for example in resized], patch_size).to(frames.device)
        stages.append(StageExamples(scale, frames, starts, augment_examples(frames)))
    coarsest = torch.cat([resize(e, stage_length(len(e), scales[0], patch_size)) for e in examples])
    return Pyramid(tuple(stages), basis, coarsest.mean(dim=0), coarsest.std(dim=0, unbiased=False))


def synthesise(
    pyramid: Pyramid,
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
    floor = normaliser_floor(options.alpha, options.patch_size, pyramid.features)
    coarsest_length = stage_length(frames, pyramid.stages[0].scale, options.patch_size)
    guess = first_guess(pyramid, coarsest_length, seeds, options.noise)
    for stage in pyramid.stages:
        guess = resize(guess, stage_length(frames, stage.scale, options.patch_size))
        for _ in range(options.iterations):
            nearest = nearest_patches(guess, stage.augmented, stage.starts, options.patch_size, floor)
            guess = blend(nearest, stage.frames, options.patch_size)
        advance()
    return nearest


def first_guess(pyramid: Pyramid, frames: int, seeds: Sequence[int], deviation: float) -> Tensor:
    """(B, frames, R) coordinates of Gaussian noise around the examples' mean (F_1 of section 3.2).

    Each feature has `deviation` times its own deviation in the coarsest examples. Drawn on the CPU, sequence by
    sequence, so that a seed gives the same noise on every device and in every batch.
    """
    drawn = [torch.randn(frames, pyramid.features, generator=torch.Generator().manual_seed(s)) for s in seeds]
    noise = torch.stack(drawn).to(pyramid.mean) * (pyramid.deviation * deviation) + pyramid.mean
    return pyramid.basis.coordinates(noise).to(pyramid.stages[0].frames.dtype)
