"""Generative matching (section 3.3): patch distances (Eq. 1), normalised both ways (Eq. 2), and the nearest patch.

Patches overlap, so the distance of two patches is the sum of p entries down a diagonal of the *frame* distance matrix.
That matrix costs one product of frames instead of patches, p times fewer operations; what is left is memory traffic.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

TINY = 1e-12


def normaliser_floor(alpha: float | None, patch_size: int, features: int) -> float | None:
    """Alpha of Eq. 2 is meant for the mean squared difference of one feature; patch distances are sums of p x D."""
    return None if alpha is None else alpha * patch_size * features


def augment_examples(frames: Tensor) -> Tensor:
    """(T, D) example frames y -> (D + 2, T) columns [y, 1, |y|^2], see `frame_distances`."""
    squares = (frames * frames).sum(dim=-1, keepdim=True)
    return torch.cat([frames, torch.ones_like(squares), squares], dim=-1).T.contiguous()


def frame_distances(frames: Tensor, augmented: Tensor) -> Tensor:
    """Squared L2 distances (B, F, T) between frames (B, F, D) and augmented examples (D + 2, T).

    [-2 x, |x|^2, 1] . [y, 1, |y|^2] = |x - y|^2: the norms ride along in the product and cost no pass of their own.
    """
    squares = (frames * frames).sum(dim=-1, keepdim=True)
    return torch.cat([frames * -2, squares, torch.ones_like(squares)], dim=-1) @ augmented


def diagonal_sums(distances: Tensor, width: int) -> Tensor:
    """Sums of `width` entries down each diagonal: (B, F, T) -> (B, F - width + 1, T), last width - 1 columns void.

    Laid out flat, an entry's diagonal successor is T + 1 places on, so a diagonal sum is a sliding sum with that
    stride, and doubling (1, 2, 4, ... entries at a time) takes about log2(width) passes instead of `width`. Sums that
    would start in the last columns run over the edge into the next row; `starts` masks them.
    """
    batch, rows, columns = distances.shape
    flat = distances.reshape(batch, rows * columns)
    stride = columns + 1
    total: Tensor | None = None
    done, power, block = 0, 1, flat  # `block` holds sums of `power` entries
    while True:
        if width & power:
            total = block if total is None else _shifted_sum(total, block, done * stride)
            done += power
        power *= 2
        if power > width:
            break
        block = _shifted_sum(block, block, (power // 2) * stride)
    assert total is not None
    # The last row needs only its first sum; pad the rest of it so that the rows can be viewed as a matrix.
    kept = (rows - width + 1) * columns
    if total.shape[-1] < kept:
        total = functional.pad(total, (0, kept - total.shape[-1]))
    return total[:, :kept].view(batch, rows - width + 1, columns)


def _shifted_sum(a: Tensor, b: Tensor, shift: int) -> Tensor:
    """a[i] + b[i + shift], as far as both reach."""
    length = min(a.shape[-1], b.shape[-1] - shift)
    return a[:, :length] + b[:, shift : shift + length]


def nearest_patches(frames: Tensor, augmented: Tensor, starts: Tensor, patch_size: int, floor: float | None) -> Tensor:
    """For every patch of the guess the start of its best example patch: (B, F, D) -> (B, F - p + 1) int64.

    Args:
        frames: (B, F, D) the guess.
        augmented: (D + 2, T) the examples.
        starts: (T,) where example patches may start.
        patch_size: p.
        floor: the alpha of Eq. 2 as a patch distance, see `normaliser_floor`; None: plain nearest neighbours.
    """
    distances = diagonal_sums(frame_distances(frames, augmented), patch_size)  # (B, n, T)
    if floor is not None:
        least = distances.amin(dim=1, keepdim=True)  # (B, 1, T), how well the guess shows each example patch
        distances *= 1 / (floor + least).clamp_min(TINY)
    distances.masked_fill_(~starts, torch.inf)
    return distances.min(dim=-1).indices
