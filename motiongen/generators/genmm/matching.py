"""Generative matching (section 3.3): patch distances (Eq. 1), normalised both ways (Eq. 2), and the nearest patch.

Patches overlap, so the distance of two patches is the sum of p entries down a diagonal of the *frame* distance matrix.
That matrix costs one product of frames instead of patches, p times fewer operations; what is left is memory traffic.
It is gone through in tiles that stay in the processor's cache, and is never whole: memory bounds neither the length of
the examples nor that of the synthesis.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor

Grid = list[tuple[slice, list[slice]]]
"""Which tiles are searched: places of the guess, and with each span of them spans of example patches."""

TINY = 1e-12

DEFAULT_MEMORY = 2**30
"""Bytes that a search may take where nothing is said."""

CACHED_ENTRIES = 2**20
"""Entries of a tile on the CPU: small enough for the cache, large enough that calls cost nothing beside the work."""

NEIGHBOURHOOD = 256
"""Places, and example patches, of a tile where only some tiles are searched."""

TILES_AT_ONCE = 4
"""Tiles in use together: frame distances, their sums, the tile before, and what an operation takes for itself."""


def normaliser_floor(alpha: float | None, patch_size: int, features: int) -> float | None:
    """Alpha of Eq. 2 is meant for the mean squared difference of one feature; patch distances are sums of p x D."""
    return None if alpha is None else alpha * patch_size * features


def augment_examples(frames: Tensor) -> Tensor:
    """(T, D) example frames y -> (D + 2, T) columns [-2 y, |y|^2, 1], see `augment_guess`."""
    squares = (frames * frames).sum(dim=-1, keepdim=True)
    return torch.cat([frames * -2, squares, torch.ones_like(squares)], dim=-1).T.contiguous()


def augment_guess(frames: Tensor) -> Tensor:
    """(..., F, D) frames x -> (..., F, D + 2) rows [x, 1, |x|^2].

    [x, 1, |x|^2] . [-2 y, |y|^2, 1] = |x - y|^2: the norms ride along in the product and cost no pass of their own.
    """
    squares = (frames * frames).sum(dim=-1, keepdim=True)
    return torch.cat([frames, torch.ones_like(squares), squares], dim=-1)


def diagonal_sums(distances: Tensor, width: int) -> Tensor:
    """Sums of `width` entries down each diagonal: (B, F, T) -> (B, F - width + 1, T - width + 1).

    A diagonal is an axis with the stride of a row and an entry together, so one sum over a view, and one pass, does it.
    """
    batch, rows, columns = distances.shape
    block, row, entry = distances.stride()
    diagonals = distances.as_strided(
        (batch, rows - width + 1, columns - width + 1, width), (block, row, entry, row + entry)
    )
    return diagonals.sum(dim=-1)


def nearest_patches(
    frames: Tensor,
    augmented: Tensor,
    starts: Tensor,
    patch_size: int,
    floor: float | None,
    memory: int = DEFAULT_MEMORY,
    likely: Tensor | None = None,
) -> Tensor:
    """For every patch of the guess the start of its best example patch: (B, F, D) -> (B, F - p + 1) int64.

    Eq. 2 needs the least distance of each example patch before any place can choose, so there are two passes; tiles
    that fit into `memory` are kept for the second one, the others are computed again.

    Args:
        frames: (B, F, D) the guess.
        augmented: (D + 2, T) the examples.
        starts: (T,) where example patches may start.
        patch_size: p.
        floor: the alpha of Eq. 2 as a patch distance, see `normaliser_floor`; None: plain nearest neighbours.
        memory: bytes that the search may take beside its arguments; the less, the slower, and no other difference.
        likely: (B, F - p + 1) starts near which to look, and nowhere else; None: look everywhere.
    """
    if likely is not None and len(frames) > 1:  # each where it is likely to be found, whatever the others do
        every = zip(frames.split(1), likely.split(1))
        return torch.cat([nearest_patches(f, augmented, starts, patch_size, floor, memory, n) for f, n in every])
    guess = augment_guess(frames)
    batch, count, patches = len(frames), frames.shape[1] - patch_size + 1, augmented.shape[1] - patch_size + 1
    size = guess.element_size()
    if likely is None:
        height, width = tile_shape(batch, count, patches, patch_size, memory // size, guess.is_cuda)
        grid = [(places, _spans(patches, width)) for places in _spans(count, height)]
    else:
        height = width = NEIGHBOURHOOD
        grid = neighbourhoods(likely[0], patches, patch_size)
    at_once = TILES_AT_ONCE * batch * (height + patch_size) * (width + patch_size) * size
    tiles = _Tiles(guess, augmented, patch_size, spare=memory - at_once)
    weights = {} if floor is None else _weights(tiles, grid, floor)
    barred = torch.where(starts[:patches], 0.0, torch.inf).to(guess)  # added where no patch starts
    return torch.cat([_nearest(tiles, places, spans, weights, barred) for places, spans in grid], dim=1)


class _Tiles:
    """Tiles of patch distances (Eq. 1), of which as many as there is room for are kept for a second use."""

    def __init__(self, guess: Tensor, augmented: Tensor, patch_size: int, spare: int) -> None:
        self.guess, self.augmented, self.patch_size, self.spare = guess, augmented, patch_size, spare
        self.kept: dict[tuple[int, int], Tensor] = {}

    def first(self, places: slice, examples: slice) -> Tensor:
        """(B, places, examples) distances that will be needed once more."""
        tile = self._computed(places, examples)
        if tile.nbytes <= self.spare:
            self.kept[places.start, examples.start] = tile
            self.spare -= tile.nbytes
        return tile

    def last(self, places: slice, examples: slice) -> Tensor:
        """(B, places, examples) distances for the last time; they may be overwritten."""
        here = places.start, examples.start
        return self.kept.pop(here) if here in self.kept else self._computed(places, examples)

    def _computed(self, places: slice, examples: slice) -> Tensor:
        rows = self.guess[:, _covered(places, self.patch_size)]
        product = rows.flatten(0, 1) @ self.augmented[:, _covered(examples, self.patch_size)]
        return diagonal_sums(product.unflatten(0, (len(rows), -1)), self.patch_size)


def _weights(tiles: _Tiles, grid: Grid, floor: float) -> dict[int, Tensor]:
    """(B, 1, examples) what distances are multiplied with (Eq. 2), by the start of each span of example patches."""
    least: dict[int, Tensor] = {}  # how well the guess shows each example patch
    for places, spans in grid:
        for examples in spans:
            lowest = tiles.first(places, examples).amin(dim=1, keepdim=True)
            known = least.get(examples.start)
            least[examples.start] = lowest if known is None else torch.minimum(known, lowest)
    return {start: 1 / (lowest + floor).clamp_min(TINY) for start, lowest in least.items()}


def _nearest(tiles: _Tiles, places: slice, spans: list[slice], weights: dict[int, Tensor], barred: Tensor) -> Tensor:
    """(B, places) the best of all example patches in `spans`; without weights the nearest one."""
    best: tuple[Tensor, Tensor] | None = None  # (B, places) least normalised distance, and where
    for examples in spans:
        tile, weight = tiles.last(places, examples), weights.get(examples.start, barred.new_ones(()))
        lowest, where = torch.addcmul(barred[examples], tile, weight, out=tile).min(dim=-1)
        where += examples.start
        if best is not None:  # of equals the first wins, as within a tile
            where = torch.where(lowest < best[0], where, best[1])
            lowest = torch.minimum(lowest, best[0])
        best = lowest, where
    assert best is not None
    return best[1]


def distances_bytes(frames: int, examples: int) -> int:
    """About what a search in single precision takes where memory is no matter: all distances, and tiles in use."""
    return 4 * (frames * examples + TILES_AT_ONCE * min(frames * examples, CACHED_ENTRIES))


def tile_shape(batch: int, count: int, patches: int, patch_size: int, entries: int, cuda: bool) -> tuple[int, int]:
    """Rows and columns of a tile of patch distances: whole rows where that leaves it squarish, and all of even size.

    Args:
        batch: B.
        count: n, places of the guess.
        patches: m, example patches.
        patch_size: p.
        entries: how many numbers may be held at once; a tile has at least one, whatever is said here.
        cuda: whether a GPU works on it, which wants tiles as large as they may be.
    """
    most = max(1, (entries // TILES_AT_ONCE if cuda else min(CACHED_ENTRIES, entries // TILES_AT_ONCE)) // batch)
    side, halo = math.isqrt(most), patch_size - 1  # a tile needs p - 1 frames more than it has patches

    def room(frames: int) -> int:
        """Patches one way, if there are `frames` the other way."""
        return max(1, most // frames - halo)

    whole = patches + halo
    fits = whole <= 4 * side and whole * patch_size <= most
    width = patches if fits else min(patches, room(min(side, count + halo)))
    return _even(count, room(width + halo)), _even(patches, width)


def neighbourhoods(likely: Tensor, patches: int, patch_size: int) -> Grid:
    """The tiles within a patch of what is likely, so that runs can go on and shift from one tile to the next.

    Args:
        likely: (n,) start of the likely example patch of each place.
        patches: m, example patches.
        patch_size: p.
    """
    count = len(likely)
    height, width = _even(count, NEIGHBOURHOOD), _even(patches, NEIGHBOURHOOD)
    rows, columns = _spans(count, height), _spans(patches, width)
    time = torch.arange(count, device=likely.device)
    near = torch.zeros(len(rows), len(columns), dtype=torch.bool, device=likely.device)
    for earlier, shift in itertools.product((-patch_size, 0, patch_size), repeat=2):
        place, example = (time + earlier).clamp(0, count - 1), (likely + shift).clamp(0, patches - 1)
        near[place // height, example // width] = True
    return [(places, list(itertools.compress(columns, row))) for places, row in zip(rows, near.tolist())]


def _even(length: int, most: int) -> int:
    """The size of equal pieces of at most `most`."""
    return math.ceil(length / math.ceil(length / most))


def _spans(length: int, size: int) -> list[slice]:
    return [slice(start, min(start + size, length)) for start in range(0, length, size)]


def _covered(patches: slice, patch_size: int) -> slice:
    """The frames that patches cover."""
    return slice(patches.start, patches.stop + patch_size - 1)
