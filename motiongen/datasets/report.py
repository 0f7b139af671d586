"""What an import kept, what it dropped, and why."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from motiongen.datasets.store import Index

OTHER_FILE = "no motion"
UNREADABLE = "unreadable"
SLOW = "frame rate too low"
OTHER_RIG = "another skeleton"
SHORT = "too short"
DUPLICATE = "same content twice"

NOTABLE = 1e-3
"""Differences below this, in skeleton heights, are roundings of a file and not worth a line."""

_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass(frozen=True)
class Dropped:
    """A file that is left out: its name, what kind of reason there is, and the reason in words."""

    name: str
    kind: str
    reason: str


@dataclass(frozen=True)
class Kept:
    """A clip that is in the dataset, and what was changed about it.

    Attributes:
        name: its name.
        digest: SHA-256 of the file it came from.
        frames: how many, at the dataset's rate.
        bones: how far its bones differed from the rig's at most, in heights of each.
        scale: its height over the rig's.
        held: how far a joint below the root moved in its parent's frame that is now held still, at most, in heights.
        notes: what the reader found odd about the file.
    """

    name: str
    digest: str
    frames: int
    bones: float
    scale: float
    held: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ImportReport:
    """The outcome of an import; `report.json` in the dataset holds the same.

    Attributes:
        fingerprint: of the dataset.
        joints: names of the joints that were kept.
        feet: names of the foot joints with contact labels.
        clips, frames, windows: how many there are of each in each part.
        labels: for each label, its values and how many clips have each; "" counts names that the pattern does not fit.
        dropped: what was left out.
        other_bones: clips with other bones than the first one's, by how much in heights, and their height over its own.
        held_still: clips where joints below the root moved in their parents' frames, and how far in heights.
        notes: what the reader found odd, with # for numbers, and in how many clips.
        seconds: how long the import took.
    """

    fingerprint: str
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    clips: dict[str, int]
    frames: dict[str, int]
    windows: dict[str, int]
    labels: dict[str, dict[str, int]]
    dropped: tuple[Dropped, ...]
    other_bones: dict[str, tuple[float, float]]
    held_still: dict[str, float]
    notes: dict[str, int]
    seconds: float

    @classmethod
    def of(
        cls,
        index: Index,
        fingerprint: str,
        kept: Sequence[Kept],
        dropped: Sequence[Dropped],
        windows: dict[str, int],
        seconds: float,
    ) -> ImportReport:
        """The report on a finished dataset."""
        skeleton = index.layout.skeleton
        other = {clip.name: (clip.bones, clip.scale) for clip in kept if _other_bones(clip)}
        notes = Counter(_NUMBER.sub("#", note) for clip in kept for note in clip.notes)
        return cls(
            fingerprint,
            skeleton.names,
            tuple(skeleton.names[joint] for joint in index.layout.feet),
            {split: index.splits.count(split) for split in windows},
            {split: sum(c.frames for c, s in zip(kept, index.splits) if s == split) for split in windows},
            windows,
            {field: dict(sorted(Counter(values).items())) for field, values in index.labels.items()},
            tuple(dropped),
            other,
            {clip.name: clip.held for clip in kept if clip.held > NOTABLE},
            dict(notes.most_common()),
            round(seconds, 2),
        )

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data that JSON can hold."""
        return dataclasses.asdict(self)

    def dropped_by_kind(self) -> dict[str, list[Dropped]]:
        """What was left out, by the kind of reason, the most frequent first."""
        kinds = Counter(each.kind for each in self.dropped)
        return {kind: [each for each in self.dropped if each.kind == kind] for kind, _ in kinds.most_common()}


def _other_bones(clip: Kept) -> bool:
    return clip.bones > NOTABLE or abs(clip.scale - 1) > NOTABLE
