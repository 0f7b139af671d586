"""A dataset of motion windows, read from disk as they are asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen.datasets.entities import EntityLayout, choose_signs, from_entities, turn_about_up
from motiongen.datasets.labels import SPLITS
from motiongen.datasets.store import Index, check_arrays, map_arrays, read_index
from motiongen.errors import MotionGenError, nearest_of
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Floats = NDArray[np.float32]
Windows = NDArray[np.int64]


class Dataset:
    """Clips of one skeleton at one rate, handed out as windows (frames, E, 4) of entities (see `EntityLayout`).

    A window faces +z and stands over the ground's origin in its first frame; lengths are in skeleton heights; each
    joint's quaternions have one sign, near the joint's usual rotation at first, continuous in time. A window is named
    by the number of its clip and the frame it starts at, so any frame may start one.

    Attributes:
        index: all there is to know but the frames.
        fingerprint: SHA-256 of content and settings.
        frames: (N, E, 4) entities of all clips end to end, each in the world of its clip; read-only.
        facing: (N,) heading of the body in radians.
        first: (n,) where each clip begins in `frames`.
    """

    def __init__(self, index: Index, frames: Floats, facing: Floats, fingerprint: str = "") -> None:
        """Take the parts as they are; `Dataset.open` reads them from disk."""
        self.index = index
        self.frames, self.facing = frames, facing
        self.fingerprint = fingerprint
        self.first = np.concatenate([[0], np.cumsum(index.lengths)[:-1]]).astype(np.int64)

    @classmethod
    def open(cls, folder: str | Path) -> Dataset:
        """The dataset in a folder, memory-mapped: what is not asked for is not read.

        Raises:
            MotionGenError: if there is none, or it is damaged or of a later version.
        """
        folder = Path(folder)
        index, fingerprint = read_index(folder)
        return cls(index, *map_arrays(folder, index), fingerprint)

    @staticmethod
    def verify(folder: str | Path) -> Dataset:
        """`open`, after comparing all frames with the digests that the fingerprint covers.

        Raises:
            MotionGenError: if anything differs.
        """
        dataset = Dataset.open(folder)
        check_arrays(Path(folder), dataset.frames, dataset.facing)
        return dataset

    # -- what it is

    @property
    def layout(self) -> EntityLayout:
        """Which entity is what."""
        return self.index.layout

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton that all clips were brought to."""
        return self.index.layout.skeleton

    @property
    def frame_rate(self) -> float:
        """In Hz."""
        return self.index.settings.frame_rate

    @property
    def window_frames(self) -> int:
        """The length of a window."""
        return self.index.settings.frames

    @property
    def names(self) -> tuple[str, ...]:
        """(n,) the clips."""
        return self.index.names

    @property
    def labels(self) -> dict[str, tuple[str, ...]]:
        """For each label, (n,) its values; "" for a clip whose name does not fit the pattern."""
        return self.index.labels

    @property
    def mean(self) -> Floats:
        """(E, 4) mean over all frames of the training windows."""
        return self.index.mean

    @property
    def deviation(self) -> Floats:
        """(E, 4) standard deviation likewise; 1 where a channel does not vary."""
        return self.index.deviation

    def __repr__(self) -> str:
        """A short form."""
        return f"Dataset({len(self.names)} clips, {len(self.frames)} frames, {self.layout.count} entities)"

    # -- windows

    def clips(self, split: str) -> NDArray[np.int64]:
        """The numbers of the clips of a part, "training" or "held_back".

        Raises:
            MotionGenError: if there is no such part.
        """
        if split not in SPLITS:
            raise MotionGenError(f"there is no part '{split}'; use {' or '.join(SPLITS)}{nearest_of(split, SPLITS)}")
        return np.flatnonzero(np.array(self.index.splits) == split)

    def windows(self, split: str, stride: int | None = None) -> Windows:
        """The (clip, first frame) of every window of a part, (W, 2), in order.

        Args:
            split: "training" or "held_back".
            stride: frames from one window of a clip to the next; by default that of the import.

        Raises:
            MotionGenError: if there is no such part, or the stride is below 1.
        """
        stride = self.index.settings.stride if stride is None else stride
        if stride < 1:
            raise MotionGenError(f"stride must be a whole number of at least 1, not {stride}")
        starts = [
            (clip, start)
            for clip in self.clips(split).tolist()
            for start in range(0, int(self.index.lengths[clip]) - self.window_frames + 1, stride)
        ]
        return np.array(starts, dtype=np.int64).reshape(-1, 2)

    def draw(self, split: str, count: int, generator: np.random.Generator) -> Windows:
        """Windows (count, 2) of a part that start anywhere, each place as likely as any other.

        Raises:
            MotionGenError: if there is no such part, or it is empty.
        """
        clips = self.clips(split)
        ends = np.cumsum(self.index.lengths[clips] - self.window_frames + 1)  # of each clip's places in a row of all
        if not len(clips):
            raise MotionGenError(f"the part '{split}' has no clips; import more, or hold back another share")
        place = generator.integers(0, ends[-1], size=count)
        chosen = np.searchsorted(ends, place, side="right")
        ahead = ends[chosen] - place  # 1 at the last place of a clip
        return np.stack([clips[chosen], self.index.lengths[clips[chosen]] - self.window_frames + 1 - ahead], axis=1)

    def batch(self, windows: ArrayLike, standardised: bool = True) -> Floats:
        """(B, frames, E, 4) windows by their (B, 2) clips and first frames.

        Args:
            windows: rows of `windows` or `draw`.
            standardised: less `mean`, over `deviation`.

        Raises:
            MotionGenError: if a window does not lie within its clip.
        """
        chosen = np.asarray(windows, dtype=np.int64).reshape(-1, 2)
        clips, starts = chosen[:, 0], chosen[:, 1]
        known = (clips >= 0) & (clips < len(self.names))
        last = self.index.lengths[np.where(known, clips, 0)] - self.window_frames
        inside = known & (starts >= 0) & (starts <= last)
        if not inside.all():
            clip, start = chosen[np.argmin(inside)]
            raise MotionGenError(f"no window starts at frame {start} of clip {clip}; take those of `windows` or `draw`")
        rows = self.first[clips] + starts  # (B,)
        batch = self.frames[rows[:, None] + np.arange(self.window_frames)]  # (B, frames, E, 4), a copy
        turn_about_up(batch, self.layout, -self.facing[rows])
        choose_signs(batch, self.layout, self.index.reference)
        if standardised:
            batch -= self.mean
            batch /= self.deviation
        return batch

    def batches(self, split: str, size: int = 256, standardised: bool = True) -> Iterator[Floats]:
        """All windows of a part in order, up to `size` at a time."""
        windows = self.windows(split)
        for start in range(0, len(windows), size):
            yield self.batch(windows[start : start + size], standardised)

    # -- back to motions

    def to_motion(self, window: NDArray[Any], standardised: bool = True, name: str = "motion") -> Motion:
        """The motion of a window (T, E, 4) of any length, made or real: the inverse of `batch`.

        It is exact but for where the window was: it faces +z and its root starts over the origin, with the ground at
        zero, on the dataset's skeleton in its unit. Rotations are normalised.

        Raises:
            MotionGenError: if the shape does not fit, or a number is not finite.
        """
        window = np.asarray(window, dtype=np.float64)
        entities = self.mean.shape
        if window.ndim != 3 or window.shape[1:] != entities or not len(window):
            raise MotionGenError(f"a window must have shape (frames, {entities[0]}, {entities[1]}), not {window.shape}")
        if standardised:
            window = window * self.deviation + self.mean
        return from_entities(window, self.layout, self.frame_rate, self.index.unit, name)

    def clip(self, clip: int) -> Motion:
        """A whole clip by its number, facing as it did, with its root's start over the origin.

        Raises:
            MotionGenError: if there is no such clip.
        """
        if not 0 <= clip < len(self.names):
            raise MotionGenError(f"there is no clip {clip}; there are 0 to {len(self.names) - 1}")
        frames = self.frames[self.first[clip] : self.first[clip] + self.index.lengths[clip]]
        return from_entities(frames, self.layout, self.frame_rate, self.index.unit, self.names[clip])
