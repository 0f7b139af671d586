"""Multi-stage synthesis (section 3.2): from noise at the coarsest stage to full detail, on features alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from motiongen.generators.genmm.blending import Coverage, assemble
from motiongen.generators.genmm.guidance import FREE, Guidance
from motiongen.generators.genmm.matching import nearest_patches, normaliser_floor
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import PartExamples, Pyramid, Stage, resize, stage_length

EXACT_PAIRS = {"exact": math.inf, "auto": 2**27, "approximate": 2**20}
"""Pairs of frames up to which all are compared: for `auto` about 11,600 by 11,600 frames."""


COARSEST_SHARE = 0.1
"""Alpha of the coarsest stage is at most this share of the variance of the examples.

That stage decides what of the examples is shown; what it leaves out fits nowhere later. Where most joints hardly
move, as fingers do, all patches differ by less than alpha, and a missing one would not be felt.
"""


def synthesise(
    pyramid: Pyramid,
    frames: int,
    seeds: Sequence[int],
    options: GenMMOptions,
    guidance: Guidance = FREE,
    advance: Callable[[], None] = lambda: None,
) -> list[Tensor]:
    """Choose example patches for new sequences.

    Args:
        pyramid: from `build_pyramid`.
        frames: length of each sequence, at least one patch.
        seeds: one for each of the B sequences.
        options: p, alpha, E, noise.
        guidance: what the sequences are held to; holds need a pyramid without a basis.
        advance: called after each round of each stage.

    Returns:
        For each part (B, n) int64: for each place of the result the start of the example patch that stands there, to
        be blended by `blending.blend`. n is frames - p + 1, or frames in a circle.
    """
    size, circular = options.patch_size, guidance.circular
    floors = [normaliser_floor(options.alpha, size, features) for features in pyramid.features]
    begin = next(i for i, stage in enumerate(pyramid.stages) if stage.scale >= guidance.detail or stage.scale == 1.0)
    length = stage_length(frames, pyramid.stages[begin].scale, size)
    guess = first_guess(pyramid, length, seeds, options.noise, guidance)
    nearest: list[Tensor] = []
    before: Stage | None = None
    for stage in pyramid.stages[begin:]:
        felt = complete(floors, stage, size) if stage is pyramid.stages[0] else floors
        guess = resize(guess, stage_length(frames, stage.scale, size), circular)
        guess = guidance.apply(guess, frames)
        places = guess.shape[1] if circular else guess.shape[1] - size + 1
        coverage = Coverage(places, size, guess, circular=circular)
        if before is not None:
            nearest = [carried(n, old, new, places) for n, old, new in zip(nearest, before.parts, stage.parts)]
        for _ in range(options.iterations):
            nearest = match(guess, stage, options, felt, circular, nearest)
            guess = guidance.apply(put_together(nearest, stage, coverage, guess.shape[-1]), frames)
            advance()
        before = stage
    return nearest


def complete(floors: Sequence[float | None], stage: Stage, patch_size: int) -> list[float | None]:
    """The floors of the parts, lowered to where a patch of the stage that is missing is felt (`COARSEST_SHARE`)."""
    variances = [float(part.frames.var(dim=0, unbiased=False).sum()) for part in stage.parts]
    return [
        None if floor is None else min(floor, COARSEST_SHARE * patch_size * variance)
        for floor, variance in zip(floors, variances)
    ]


def match(
    guess: Tensor,
    stage: Stage,
    options: GenMMOptions,
    floors: Sequence[float | None],
    circular: bool = False,
    likely: Sequence[Tensor] = (),
) -> list[Tensor]:
    """For each part the start (B, n) of the best example patch at each place of the guess (B, F, D).

    Where there are more pairs of patches than `options.search` lets be compared, only what is near `likely` is.
    """
    size, memory = options.patch_size, options.memory_mb * 2**20
    if circular:  # a patch near the end goes on at the beginning
        guess = torch.cat([guess, guess[:, : size - 1]], dim=1)
    nearest = []
    for number, (part, floor) in enumerate(zip(stage.parts, floors)):
        own = guess if part.columns is None else guess[..., part.columns]
        some = likely and guess.shape[1] * len(part.frames) > EXACT_PAIRS[options.search]
        near = likely[number] if some else None
        nearest.append(nearest_patches(own, part.augmented, part.starts, size, floor, memory, near))
    return nearest


def carried(nearest: Tensor, before: PartExamples, part: PartExamples, places: int) -> Tensor:
    """(B, places) where the patches of a stage start if they are those of the stage before it, nearest (B, n)."""
    earlier = torch.arange(places, device=nearest.device) * nearest.shape[1] // places
    return torch.searchsorted(part.times, before.times[nearest[:, earlier]])


def put_together(nearest: Sequence[Tensor], stage: Stage, coverage: Coverage, size: int) -> Tensor:
    """The sequences (B, F, D) that the chosen patches of all parts make."""
    blended = [coverage.blend(n, part.frames) for n, part in zip(nearest, stage.parts)]
    return assemble(blended, [part.columns for part in stage.parts], size)


def first_guess(
    pyramid: Pyramid, frames: int, seeds: Sequence[int], deviation: float, guidance: Guidance = FREE
) -> Tensor:
    """(B, frames, D or R) Gaussian noise around the examples' mean (F_1 of section 3.2), or what is given, with noise.

    Each feature has `deviation` times its own deviation in the coarsest examples. Drawn on the CPU, sequence by
    sequence, so that a seed gives the same noise on every device and in every batch.
    """
    size = len(pyramid.mean)
    drawn = [torch.randn(frames, size, generator=torch.Generator().manual_seed(s)) for s in seeds]
    noise = torch.stack(drawn).to(pyramid.mean) * (pyramid.deviation * deviation * guidance.noise)
    around = pyramid.mean if guidance.guess is None else resize(guidance.guess, frames, guidance.circular)
    guess = noise + around
    if pyramid.basis is not None:
        guess = pyramid.basis.coordinates(guess)
    return guess.to(pyramid.stages[0].parts[0].frames.dtype)
