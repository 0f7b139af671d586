"""MoDi's networks: mapping, synthesis and discriminator (section 3.3, appendix B.3 and D.2)."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from motiongen.errors import MotionGenError
from motiongen.generators.modi.hierarchy import Hierarchy
from motiongen.generators.modi.layers import (
    EPSILON,
    ActivatedConvolution,
    EqualisedLinear,
    ModulatedConvolution,
    SkeletalConvolution,
    SkeletalPooling,
    SkeletalUnpooling,
)
from motiongen.generators.modi.options import NetworkOptions


class MappingNetwork(nn.Module):
    """z to w: a multi-layer perceptron behind a normalisation of z (Fig. 13b).

    Args:
        options: sizes and learning rate.
    """

    def __init__(self, options: NetworkOptions) -> None:
        """Draw the weights."""
        super().__init__()
        size = options.latent_size
        layers = (
            EqualisedLinear(size, size, rate=options.mapping_rate, activate=True) for _ in range(options.mapping_layers)
        )
        self.layers = nn.Sequential(*layers)

    def forward(self, z: Tensor) -> Tensor:
        """(B, latent_size) Gaussian noise to (B, latent_size) codes in W."""
        w: Tensor = self.layers(z * (z.square().mean(dim=1, keepdim=True) + EPSILON).rsqrt())
        return w


class _SynthesisLevel(nn.Module):
    """A level of the synthesis network (Table 4): scaler, but for the coarsest, in-place convolutions, output skip."""

    def __init__(self, hierarchy: Hierarchy, level: int, options: NetworkOptions) -> None:
        super().__init__()
        channels, width = options.channels[level], options.kernel_width
        near = hierarchy.in_place_links(level, options.neighbour_distance)
        convolution = functools.partial(SkeletalConvolution, held_ends=options.held_ends)
        convolutions = [convolution(near, channels, channels, width) for _ in range(options.in_place)]
        self.unpool = SkeletalUnpooling(hierarchy.up_links(level)) if level else None
        self.pooled = level > 0 and options.scaler == "pooling"
        if level:
            above = options.channels[level - 1]
            if self.pooled:
                scaler = convolution(near, above, channels, width)
            else:
                scaler = convolution(hierarchy.up_links(level), above, channels, width + 1, "up")
            convolutions.insert(0, scaler)
        self.layers = nn.ModuleList(
            ModulatedConvolution(each, options.latent_size, smoothing=options.smoothing and each.direction == "up")
            for each in convolutions
        )
        shown = SkeletalConvolution(hierarchy.in_place_links(level, 0), channels, options.features, 1)
        self.output = ModulatedConvolution(shown, options.latent_size, output=True)

    def forward(self, x: Tensor, motion: Tensor, codes: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Activations and motion so far, from those of the level before; `codes` holds one for each layer."""
        if self.unpool is not None and self.pooled:
            x = self.unpool(x)
        for layer, code in zip(self.layers, codes):
            x = layer(x, code)
        shown = self.output(x, codes[-1])
        return x, shown if self.unpool is None else shown + self.unpool(motion)


class SynthesisNetwork(nn.Module):
    """Codes to motion, from a learned constant through finer and finer skeletons (Fig. 4, 13).

    Every level adds what it knows to the motion of the level before (output skips), and each of its layers is modulated
    by a style from a code of its own.

    Args:
        hierarchy: the skeleton at all levels.
        options: the sizes.

    Attributes:
        layers: N, how many layers take a code.
    """

    def __init__(self, hierarchy: Hierarchy, options: NetworkOptions) -> None:
        """Draw the weights and the constant."""
        super().__init__()
        _check_levels(hierarchy, options)
        self.constant = nn.Parameter(torch.randn(hierarchy.entities[0], 1, options.frames_at(0), options.channels[0]))
        self.levels = nn.ModuleList(_SynthesisLevel(hierarchy, level, options) for level in range(len(hierarchy)))
        self.first_codes = [0, *(options.in_place + level * (options.in_place + 1) for level in range(len(hierarchy)))]
        self.layers = self.first_codes[-1]

    def forward(self, codes: Tensor, frames: int | None = None) -> Tensor:
        """(B, N, latent_size) codes in W+ to (B, T, E, K) motions.

        Args:
            codes: one for each layer.
            frames: how many at least; those of training by default. More come from a constant stretched in time.
        """
        if codes.shape[1] != self.layers:
            raise MotionGenError(
                f"the synthesis network takes {self.layers} codes, one for each layer, not {codes.shape[1]}"
            )
        each = codes.unbind(dim=1)
        x, motion = self._stretched(frames).expand(-1, len(codes), -1, -1), None
        for level, (first, end) in zip(self.levels, itertools.pairwise(self.first_codes)):
            x, motion = level(x, motion, each[first:end])
        return x.new_empty(0) if motion is None else motion.permute(1, 2, 0, 3)

    def _stretched(self, frames: int | None) -> Tensor:
        """(E, 1, T, K) the constant, long enough for `frames` frames of motion."""
        coarsest = 0 if frames is None else math.ceil(frames / 2 ** (len(self.levels) - 1))
        if coarsest <= self.constant.shape[2]:
            return self.constant
        flat = self.constant[:, 0].transpose(1, 2)  # (E, K, T)
        longer = functional.interpolate(flat, size=coarsest, mode="linear", align_corners=True)
        return longer.transpose(1, 2)[:, None]


class ModiGenerator(nn.Module):
    """Noise to motion: the mapping network, and the synthesis network that its codes modulate (Fig. 4).

    Args:
        hierarchy: the skeleton at all levels.
        options: the sizes.

    Attributes:
        mean_code: (latent_size,) mean of W, which truncation pulls towards; zero until `measure_mean_code`.
    """

    mean_code: Tensor

    def __init__(self, hierarchy: Hierarchy, options: NetworkOptions) -> None:
        """Draw the weights."""
        super().__init__()
        self.mapping = MappingNetwork(options)
        self.synthesis = SynthesisNetwork(hierarchy, options)
        self.register_buffer("mean_code", torch.zeros(options.latent_size))

    def forward(self, z: Tensor | Sequence[Tensor], truncation: float = 1.0, mixing_index: int | None = None) -> Tensor:
        """(B, T, E, K) motions; see `codes` for the arguments."""
        motion: Tensor = self.synthesis(self.codes(z, truncation, mixing_index))
        return motion

    def codes(self, z: Tensor | Sequence[Tensor], truncation: float = 1.0, mixing_index: int | None = None) -> Tensor:
        """(B, N, latent_size) codes in W+.

        Args:
            z: (B, latent_size) Gaussian noise; or two of them to mix.
            truncation: how much of a code's difference from the mean code is kept, 1: all of it (section 4.2).
            mixing_index: with two z, the first layer, 1 to N - 1, that takes the second.

        Raises:
            MotionGenError: if the arguments do not go together, or there is no mean code to truncate to.
        """
        noises = [z] if isinstance(z, Tensor) else list(z)
        layers = self.synthesis.layers
        if len(noises) != (1 if mixing_index is None else 2):
            raise MotionGenError(
                f"codes takes one z, or two and a mixing_index; {len(noises)} came, and {mixing_index}"
            )
        if mixing_index is not None and not 0 < mixing_index < layers:
            raise MotionGenError(f"mixing_index must be 1 to {layers - 1}, not {mixing_index}")
        codes = [self._truncated(self.mapping(noise), truncation) for noise in noises]
        first = layers if mixing_index is None else mixing_index
        counts = [first, layers - first][: len(codes)]
        return torch.cat([code.unsqueeze(1).expand(-1, count, -1) for code, count in zip(codes, counts)], dim=1)

    def _truncated(self, code: Tensor, truncation: float) -> Tensor:
        if truncation == 1:
            return code
        if not self.mean_code.any():
            raise MotionGenError("truncation needs the mean code; call measure_mean_code first")
        return torch.lerp(self.mean_code, code, truncation)

    @torch.no_grad()
    def measure_mean_code(self, random: torch.Generator, samples: int = 10_000) -> None:
        """Set the mean code to that of `samples` random z."""
        z = torch.randn(samples, len(self.mean_code), generator=random, device=random.device)
        self.mean_code.copy_(self.mapping(z.to(self.mean_code)).mean(dim=0))


class _DiscriminatorLevel(nn.Module):
    """A level of the discriminator (Table 4): in-place convolutions and a scaler, beside a residual skip."""

    def __init__(self, hierarchy: Hierarchy, level: int, options: NetworkOptions) -> None:
        super().__init__()
        channels, below, width = options.channels[level], options.channels[level - 1], options.kernel_width
        near = hierarchy.in_place_links(level, options.neighbour_distance)
        convolution = functools.partial(SkeletalConvolution, held_ends=options.held_ends)
        layers: list[nn.Module] = [
            ActivatedConvolution(convolution(near, channels, channels, width)) for _ in range(options.in_place)
        ]
        down = hierarchy.down_links(level)
        if options.scaler == "pooling":
            near_below = hierarchy.in_place_links(level - 1, options.neighbour_distance)
            layers += [SkeletalPooling(down)]
            layers += [ActivatedConvolution(convolution(near_below, channels, below, width))]
        else:
            layers += [ActivatedConvolution(convolution(down, channels, below, width + 1, "down"))]
        self.layers = nn.Sequential(*layers)
        self.pool = SkeletalPooling(down)
        self.skip = SkeletalConvolution(hierarchy.in_place_links(level - 1, 0), channels, below, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(E, B, T, K) to the coarser level's (E', B, T / 2, K')."""
        skip = self.skip(self.pool(x))
        # The sum of two is kept as large as either.
        return torch.addcmul(self.layers(x) * math.sqrt(0.5), skip, self.skip.scale * math.sqrt(0.5))


class MotionTrunk(nn.Module):
    """Motion to features of its coarsest level: the synthesis network in reverse (Fig. 14), for what reads motions.

    Args:
        hierarchy: the skeleton at all levels.
        options: the sizes.
        extra: channels that come in beside the features before the last convolution.
    """

    def __init__(self, hierarchy: Hierarchy, options: NetworkOptions, extra: int = 0) -> None:
        """Draw the weights."""
        super().__init__()
        _check_levels(hierarchy, options)
        finest, coarsest = options.channels[-1], options.channels[0]
        each_alone = hierarchy.in_place_links(len(hierarchy) - 1, 0)
        self.input = ActivatedConvolution(SkeletalConvolution(each_alone, options.features, finest, 1))
        levels = reversed(range(1, len(hierarchy)))
        self.levels = nn.Sequential(*(_DiscriminatorLevel(hierarchy, level, options) for level in levels))
        near = hierarchy.in_place_links(0, options.neighbour_distance)
        self.last = ActivatedConvolution(SkeletalConvolution(near, coarsest + extra, coarsest, options.kernel_width))
        self.outputs = hierarchy.entities[0] * options.frames_at(0) * coarsest

    def coarsest(self, motions: Tensor) -> Tensor:
        """(B, T, E, K) motions to (E', B, T', K') features, before the last convolution."""
        x: Tensor = self.levels(self.input(motions.permute(2, 0, 1, 3)))
        return x

    def flat(self, x: Tensor) -> Tensor:
        """(E', B, T', K' + extra) to (B, outputs), after the last convolution."""
        y: Tensor = self.last(x)
        return y.transpose(0, 1).flatten(1)


class Discriminator(MotionTrunk):
    """Motion to a score, high for real ones (Fig. 14).

    Args:
        hierarchy: the skeleton at all levels.
        options: the sizes.
    """

    def __init__(self, hierarchy: Hierarchy, options: NetworkOptions) -> None:
        """Draw the weights."""
        super().__init__(hierarchy, options, extra=1 if options.deviation_group > 1 else 0)
        self.group = options.deviation_group
        coarsest = options.channels[0]
        self.judge = nn.Sequential(EqualisedLinear(self.outputs, coarsest, activate=True), EqualisedLinear(coarsest, 1))

    def forward(self, motions: Tensor) -> Tensor:
        """(B, T, E, K) to (B,) scores, as logits."""
        x = self.coarsest(motions)
        if self.group > 1:
            x = with_deviation(x, self.group)
        scores: Tensor = self.judge(self.flat(x)).squeeze(1)
        return scores


def with_deviation(x: Tensor, group: int) -> Tensor:
    """(E, B, T, K) to (E, B, T, K + 1): beside it how much motions differ in each group of `group` that come in a row.

    The new channel holds, for all motions of a group, the mean over entities, frames and channels of the deviation
    among them (Karras et al. 2018). Where B is no multiple of `group`, groups are as large as their common divisor.
    """
    entities, batch, frames, _ = x.shape
    size = math.gcd(batch, group)
    variance = x.unflatten(1, (-1, size)).var(dim=2, unbiased=False)  # (E, B / size, T, K)
    deviation = (variance + EPSILON).sqrt().mean(dim=(0, 2, 3)).repeat_interleave(size)  # (B,)
    return torch.cat([x, deviation.view(1, -1, 1, 1).expand(entities, -1, frames, -1)], dim=-1)


def _check_levels(hierarchy: Hierarchy, options: NetworkOptions) -> None:
    if len(hierarchy) != options.levels:
        raise MotionGenError(f"{options.levels} levels of channels need as many of the skeleton, not {len(hierarchy)}")
