"""Layers on a skeleton: in-place convolution and convolutional scaler (section 3.2), modulation (appendix B.3).

A filter of the paper is K' x K x E' x E x U numbers, of which the skeleton leaves those E' x E slices that a link
joins. Only these are stored, (links, U, K, K'), and only these are multiplied: what the links read is gathered,
multiplied by their weights in one batched product, and added up where they write. Tensors are (E, B, T, K): entities
outermost, so that what belongs to one link lies together.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from motiongen.generators.modi.hierarchy import Links

Direction = Literal["in place", "up", "down"]

SLOPE = 0.2
"""Of the leaky rectifier below zero."""

ACTIVATION_GAIN = math.sqrt(2.0)
"""What keeps the size of activations through the rectifier."""

EPSILON = 1e-8


class EqualisedLinear(nn.Module):
    """A linear layer with an equalised learning rate (Karras et al. 2020).

    Weights are stored at unit deviation and scaled when used, so that Adam moves all layers at the same relative rate.

    Args:
        inputs: numbers in.
        outputs: numbers out.
        bias: what the bias starts from.
        rate: learning rate of this layer beside the others'.
        activate: whether a leaky rectifier follows.
    """

    def __init__(self, inputs: int, outputs: int, bias: float = 0.0, rate: float = 1.0, activate: bool = False) -> None:
        """Draw the weights."""
        super().__init__()
        self.weight = nn.Parameter(torch.randn(inputs, outputs) / rate)
        self.bias = nn.Parameter(torch.full((outputs,), bias / rate))
        self.gain = rate * (ACTIVATION_GAIN if activate else 1.0)
        self.scale = self.gain / math.sqrt(inputs)
        self.activate = activate

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs) to (B, outputs)."""
        # The gain of the activation may come before it, since the rectifier is linear on either side of zero.
        y = torch.addmm(self.bias * self.gain, x, self.weight, alpha=self.scale)
        return functional.leaky_relu(y, SLOPE) if self.activate else y


class SkeletalConvolution(nn.Module):
    """The filter K' x K x E' x E x U, in time and entities at once, with weights where links are and nowhere else.

    In place and down (strided, half as many frames) it is a convolution; up (twice as many frames) a transposed one.
    Frames beyond the ends are zero, or as the ends are. It has neither bias nor scale: those come with what follows it.

    Args:
        links: which entities it joins.
        inputs: K.
        outputs: K'.
        width: U: odd in place; even up and down, so that every frame is covered by as many weights.
        direction: what happens in time.
        held_ends: whether the frames beyond the ends are those at the ends, in place of zeros.

    Attributes:
        weight: (blocks, U, K, K').
        scale: (E', 1, 1, 1) what makes outputs as large as inputs while weights have unit deviation.
    """

    targets: Tensor | None
    sources: Tensor | None
    blocks: Tensor | None
    scale: Tensor

    def __init__(
        self,
        links: Links,
        inputs: int,
        outputs: int,
        width: int,
        direction: Direction = "in place",
        held_ends: bool = False,
    ) -> None:
        """Draw the weights."""
        super().__init__()
        self.links, self.direction, self.width, self.held_ends = links, direction, width, held_ends
        self.stride = 1 if direction == "in place" else 2
        self.weight = nn.Parameter(torch.randn(max(links.blocks) + 1, width, inputs, outputs))
        for name, size in (("targets", links.shape[0]), ("sources", links.shape[1]), ("blocks", len(self.weight))):
            self.register_buffer(name, _index(getattr(links, name), size), persistent=False)
        # Going up, each output frame meets the weights of every other input frame only.
        self.seen_share = 0.5 if direction == "up" else 1.0
        fan_in = self.seen_share * width * inputs * torch.bincount(torch.tensor(links.targets))
        self.register_buffer("scale", fan_in.rsqrt().view(-1, 1, 1, 1), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """(E, B, T, K) to (E', B, T', K'): T' = T in place, 2 T up, T / 2 down."""
        reach = (self.width - self.stride) // 2
        if not (self.held_ends and reach):
            return self._convolved(x)
        margin = reach if self.direction == "in place" else -(-reach // 2) * (2 if self.direction == "down" else 1)
        before, after = (end.expand(-1, -1, margin, -1) for end in (x[:, :, :1], x[:, :, -1:]))
        y = self._convolved(torch.cat([before, x, after], dim=2))
        cut = {"in place": margin, "up": 2 * margin, "down": margin // 2}[self.direction]
        return y[:, :, cut:-cut]

    def _convolved(self, x: Tensor) -> Tensor:
        """Likewise, with zeros beyond the ends."""
        weight = _gathered(self.weight, self.blocks)  # (P, U, K, K')
        entities_out, entities_in = self.links.shape
        if self.direction == "up":
            read = _gathered(x, self.sources)  # (P, B, T, K)
            taps = torch.bmm(read.flatten(1, 2), weight.transpose(1, 2).flatten(2)).unflatten(1, x.shape[1:3])
            spread: Tensor = _Spread.apply(taps, self.targets, entities_out, self.width, self.stride)
            return spread
        read = _Windows.apply(x, self.sources, entities_in, self.width, self.stride)  # (P, B, T', U K)
        y = torch.bmm(read.flatten(1, 2), weight.flatten(1, 2)).unflatten(1, read.shape[1:3])
        return _scattered(y, self.targets, entities_out)

    def energy(self, style: Tensor) -> Tensor:
        """(E', B, K') sum of the squares of what each output's weights become when modulated (Eq. 10, 11).

        An output entity has a filter of its own (Fig. 12), so that k in the equation runs over its source entities and
        the frames that it sees.

        Args:
            style: (B, K) factors of the input channels.
        """
        squares = _gathered(self.weight.square().sum(dim=1), self.blocks)  # (P, K, K')
        energy = torch.matmul(style.square(), squares)  # (P, B, K')
        return _scattered(energy, self.targets, self.links.shape[0]) * self.seen_share


def _index(places: tuple[int, ...], size: int) -> Tensor | None:
    """Indices as a tensor; None where they are all of `size` in order, so that nothing need be moved."""
    return None if places == tuple(range(size)) else torch.tensor(places)


def _gathered(x: Tensor, index: Tensor | None) -> Tensor:
    """(E, ...) to (P, ...): what each link reads."""
    return x if index is None else x.index_select(0, index)


def _scattered(y: Tensor, index: Tensor | None, entities: int) -> Tensor:
    """(P, ...) to (E', ...): the sum of what links write."""
    return y if index is None else y.new_zeros(entities, *y.shape[1:]).index_add(0, index, y)


class _Windows(torch.autograd.Function):
    """(E, B, T, K) to (P, B, T / stride, U K): what each link reads, with the frames that each output frame sees.

    Frames beyond the ends are zero. This is a linear map, whose derivative is its transpose, `_Spread`, and that one's
    is this, so that they can be derived again and again. Derivatives of overlapping views would copy far more.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, index: Tensor | None, entities: int, width: int, stride: int) -> Tensor:
        ctx.save_for_backward(index)
        ctx.sizes = entities, width, stride
        _, batch, frames, channels = x.shape
        padded = functional.pad(x, (0, 0, (width - stride) // 2, (width - stride) // 2)).contiguous()
        size = (entities, batch, frames // stride, width * channels)
        overlapping = padded.as_strided(size, (*padded.stride()[:2], stride * channels, 1))
        return _gathered(overlapping, index).contiguous()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        return _Spread.apply(gradient, *ctx.saved_tensors, *ctx.sizes), None, None, None, None


class _Spread(torch.autograd.Function):
    """(P, B, T, U K) to (E, B, T stride, K): the sum of what links write to the U frames around each of theirs."""

    @staticmethod
    def forward(ctx: Any, taps: Tensor, index: Tensor | None, entities: int, width: int, stride: int) -> Tensor:
        ctx.save_for_backward(index)
        ctx.sizes = entities, width, stride
        _, batch, frames, size = taps.shape
        whole = taps.new_zeros(entities, batch, stride * frames + width - stride, size // width)
        for u, tap in enumerate(_scattered(taps, index, entities).chunk(width, dim=3)):
            whole[:, :, u : u + stride * frames : stride] += tap
        return whole.narrow(2, (width - stride) // 2, stride * frames)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        return _Windows.apply(gradient, *ctx.saved_tensors, *ctx.sizes), None, None, None, None


class ModulatedConvolution(nn.Module):
    """A convolution whose input channels a style scales (Eq. 10), with demodulation (Eq. 11), bias and rectifier.

    Scaling input channels, convolving with the weights that all motions share and dividing the outputs is the same as
    modulating and demodulating the weights for each motion, and needs no weights for each motion.

    Args:
        convolution: the filter.
        latent_size: numbers in a latent code.
        output: whether this is an output layer, which has neither demodulation nor rectifier.
        smoothing: whether neighbouring frames of what the filter gives are averaged, see `smoothed`.
    """

    def __init__(
        self, convolution: SkeletalConvolution, latent_size: int, output: bool = False, smoothing: bool = False
    ) -> None:
        """Add the affine map from code to style, and the bias."""
        super().__init__()
        self.convolution = convolution
        self.style = EqualisedLinear(latent_size, convolution.weight.shape[2], bias=1.0)
        self.bias = _bias(convolution)
        self.output, self.smoothing = output, smoothing

    def forward(self, x: Tensor, code: Tensor) -> Tensor:
        """(E, B, T, K) and (B, latent_size) to (E', B, T', K')."""
        style = self.style(code)  # (B, K)
        y = self.convolution(x * style[:, None, :])
        if self.smoothing:
            y = smoothed(y)
        if self.output:
            return torch.addcmul(self.bias, y, self.convolution.scale)
        demodulation = (self.convolution.energy(style) + EPSILON).rsqrt()  # (E', B, K')
        return _activated(y, demodulation.unsqueeze(2), self.bias)


class ActivatedConvolution(nn.Module):
    """A convolution with an equalised learning rate, bias and rectifier.

    Args:
        convolution: the filter.
    """

    def __init__(self, convolution: SkeletalConvolution) -> None:
        """Add the bias."""
        super().__init__()
        self.convolution = convolution
        self.bias = _bias(convolution)

    def forward(self, x: Tensor) -> Tensor:
        """(E, B, T, K) to (E', B, T', K')."""
        return _activated(self.convolution(x), self.convolution.scale, self.bias)


def _bias(convolution: SkeletalConvolution) -> nn.Parameter:
    """(E', 1, 1, K') zeros; one for all entities where they share weights."""
    entities = 1 if convolution.links.shared else convolution.links.shape[0]
    return nn.Parameter(torch.zeros(entities, 1, 1, convolution.weight.shape[3]))


def _activated(y: Tensor, scale: Tensor, bias: Tensor) -> Tensor:
    # The gain may come before the rectifier, which is linear on either side of zero; there it costs next to nothing.
    return functional.leaky_relu(torch.addcmul(bias * ACTIVATION_GAIN, y, scale * ACTIVATION_GAIN), SLOPE)


def smoothed(x: Tensor) -> Tensor:
    """(E, B, T, K): each frame averaged with the two beside it, 1 : 2 : 1; those beyond the ends repeat the last.

    A transposed convolution makes even and odd frames from different weights, so that they need not agree, and motions
    shake with every frame. This removes what alternates from frame to frame and leaves slow changes, as the low-pass
    filter after such layers of StyleGAN2 does (Karras et al. 2020), on which the networks are built.
    """
    before, after = _beside(x)
    return torch.lerp(x, (before + after) / 2, 0.5)


def _beside(x: Tensor) -> tuple[Tensor, Tensor]:
    """(E, B, T, K), the frame before each, and the one after."""
    return torch.cat([x[:, :, :1], x[:, :, :-1]], dim=2), torch.cat([x[:, :, 1:], x[:, :, -1:]], dim=2)


class SkeletalUnpooling(nn.Module):
    """Copies each entity to those that it is split into, and doubles the frames by linear interpolation (Fig. 11).

    Args:
        links: from coarse to fine.
    """

    sources: Tensor

    def __init__(self, links: Links) -> None:
        """Keep where each entity comes from."""
        super().__init__()
        self.register_buffer("sources", torch.tensor(links.sources), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """(E, B, T, K) to (E', B, 2 T, K)."""
        before, after = _beside(x)
        doubled = torch.stack([torch.lerp(x, before, 0.25), torch.lerp(x, after, 0.25)], dim=3).flatten(2, 3)
        return doubled.index_select(0, self.sources)


class SkeletalPooling(nn.Module):
    """The mean of the entities that merge, and of each two frames (Fig. 11).

    Args:
        links: from fine to coarse.
    """

    targets: Tensor
    shares: Tensor

    def __init__(self, links: Links) -> None:
        """Count what merges."""
        super().__init__()
        targets = torch.tensor(links.targets)
        merging = torch.bincount(targets, minlength=links.shape[0])
        self.register_buffer("targets", targets, persistent=False)
        self.register_buffer("shares", (1.0 / merging).view(-1, 1, 1, 1), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """(E, B, T, K) to (E', B, T / 2, K)."""
        halved = x.unflatten(2, (-1, 2)).mean(dim=3)
        return halved.new_zeros(len(self.shares), *halved.shape[1:]).index_add(0, self.targets, halved) * self.shares
