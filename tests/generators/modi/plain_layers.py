"""MoDi's layers as the paper defines them, one line after the other: 3-D convolution with 5-D filters and masks.

Filters are (K', K, E', E, U) and data is (B, K, E, T), as in the paper.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from motiongen.generators.modi.layers import EPSILON, SkeletalConvolution


def filter_of(convolution: SkeletalConvolution) -> Tensor:
    """(K', K, E', E, U) the filter of a layer: its weights where the mask is, zero elsewhere."""
    width, inputs, outputs = convolution.weight.shape[1:]
    links = convolution.links
    whole = convolution.weight.new_zeros(*links.shape, outputs, inputs, width)
    blocks = convolution.weight.permute(0, 3, 2, 1)[list(links.blocks)]  # (P, K', K, U)
    whole = whole.index_put((torch.tensor(links.targets), torch.tensor(links.sources)), blocks)
    whole = whole.permute(2, 3, 0, 1, 4)
    assert not whole[:, :, ~torch.tensor(links.mask)].any()
    return whole


def convolve(x: Tensor, whole: Tensor, stride: int) -> Tensor:
    """Fig. 3: data becomes a plane of a block padded with zeros, along which the filter slides.

    Args:
        x: (B, K, E, T).
        whole: (K', K, E', E, U).
        stride: in time.

    Returns:
        (B, K', E', T / stride).
    """
    targets, width = whole.shape[2], whole.shape[4]
    block = functional.pad(x[:, :, None], (0, 0, 0, 0, targets - 1, targets - 1))  # (B, K, 2 E' - 1, E, T)
    # The filter meets the plane with its last slice first.
    padding = (0, 0, (width - stride) // 2)
    y = functional.conv3d(block, whole.flip(2), stride=(1, 1, stride), padding=padding)
    return y[:, :, :, 0]  # the height is that of the filter: one place along y


def convolve_transposed(x: Tensor, whole: Tensor) -> Tensor:
    """The transpose of a scaler down: each coarse entity spreads over the plane of fine entities in the middle.

    Args:
        x: (B, K, E, T).
        whole: (K', K, E', E, U).

    Returns:
        (B, K', E', 2 T).
    """
    sources, width = whole.shape[3], whole.shape[4]
    line = x[:, :, :, None]  # (B, K, E, 1, T)
    spread = whole.permute(1, 0, 3, 2, 4).flip(2)  # (K, K', E, E', U)
    y = functional.conv_transpose3d(line, spread, stride=(1, 1, 2), padding=(0, 0, (width - 2) // 2))
    return y[:, :, sources - 1]


def applied(convolution: SkeletalConvolution, x: Tensor, whole: Tensor) -> Tensor:
    """(E, B, T, K) to (E', B, T', K') with the filter `whole`, which way the layer goes."""
    x = x.permute(1, 3, 0, 2)
    if convolution.direction == "up":
        y = convolve_transposed(x, whole)
    else:
        y = convolve(x, whole, 2 if convolution.direction == "down" else 1)
    return y.permute(2, 0, 3, 1)


def modulated(whole: Tensor, style: Tensor) -> Tensor:
    """(K', K, E', E, U): Eq. 10 for one motion, whose style is (K,)."""
    return style[None, :, None, None, None] * whole


def demodulated(whole: Tensor, transposed: bool) -> Tensor:
    """(K', K, E', E, U): Eq. 11; an output (j, e') has the filter (K, E, U), of which i and k run over all.

    Of a transposed filter an output frame meets the even or the odd weights; the mean of both stands for either.
    """
    sums = whole.square().sum(dim=(1, 3, 4), keepdim=True) / (2 if transposed else 1)
    return whole / (sums + EPSILON).sqrt()
