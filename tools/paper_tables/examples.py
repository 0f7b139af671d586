"""The examples that the tables are measured on: real clips, cut to what the paper's settings ask for."""

from __future__ import annotations

import itertools
import tarfile
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import motiongen as mg
from motiongen.errors import MotionGenError
from tools.paper_tables.cells import content_of, digest

FRAME_RATE = 30.0

HUMANS = ("Salsa-Dancing-6", "Baseball-Milling-Idle", "Walk-In-Circle")
"""Three sequences of a character of 65 joints, as in section 4.1."""

CLIPS = (*HUMANS, "elephant-idle1")

LONG_EXAMPLE = ("Salsa-Dancing-6", 522)
"""The clip and the number of its frames that Figure 9 is measured on."""

_DANCE = "dataset-1_dance-short_normal_001"
# Where the pieces of the dance begin and how long they are: section 4.2 has dances of 120 to 220 frames.
_DANCE_PIECES = ((100, 170), (450, 120), (800, 220), (1150, 145), (1500, 195))
_WALKS = tuple(f"dataset-1_walk_{style}_001" for style in ("active", "chimpira", "giant", "masculinity", "normal"))

SETS = {
    "dance": "five pieces of 120 to 220 frames of one dance of 22 joints (bandai-namco, dance-short)",
    "walks": "five walks of 146 to 195 frames, each in another style, of 22 joints (bandai-namco)",
    "salsa": "Salsa-Dancing-6 of 65 joints, cut into five pieces of 129 or 130 frames",
}
"""Sets of five examples of one skeleton for Table 2, and what they are."""


@dataclass(frozen=True)
class ExampleSet:
    """One or several examples of one skeleton.

    Attributes:
        name: what they are called.
        frames: of all of them together.
        joints: of their skeleton.
        content: a name for what they hold.
        load: gives them; may take a while.
    """

    name: str
    frames: int
    joints: int
    content: str
    load: Callable[[], list[mg.Motion]]


@dataclass
class Examples:
    """Loads clips when first asked for, and keeps them.

    Attributes:
        folder: holds `characters/NAME.bvh` and `bandai-namco/dataset-1.tar.xz`.
    """

    folder: Path
    _clips: dict[str, mg.Motion] = field(default_factory=dict)

    def clip(self, name: str) -> mg.Motion:
        """One of `CLIPS` at 30 frames per second."""
        if name not in self._clips:
            self._clips[name] = mg.load(self.folder / "characters" / f"{name}.bvh").resample(FRAME_RATE)
        return self._clips[name]

    def single(self, name: str) -> ExampleSet:
        """One of `CLIPS`."""
        return _of(name, [self.clip(name)])

    def several(self, name: str, count: int) -> ExampleSet:
        """The first `count` examples of one of `SETS`."""
        if name == "salsa":
            whole = self.clip("Salsa-Dancing-6")
            borders = [round(len(whole) * piece / 5) for piece in range(6)]
            pieces = [whole[start:stop] for start, stop in itertools.pairwise(borders)]
        elif name == "dance":
            whole = self._archived(_DANCE)
            pieces = [whole[start : start + frames] for start, frames in _DANCE_PIECES]
        else:
            pieces = [self._archived(walk) for walk in _WALKS]
        return _of(f"{name} 1 to {count}", pieces[:count])

    def with_joints(self, name: str, joints: int) -> ExampleSet:
        """One of `CLIPS` on a character with so many joints: `tools.make_creature` adds some or leaves some out."""
        from tools import make_creature

        clip = self.clip(name)
        if joints == len(clip.skeleton):
            return self.single(name)
        program = Path(make_creature.__file__).read_bytes()
        content = digest(content_of(clip).encode(), str(joints).encode(), program)[:12]
        return ExampleSet(name, len(clip), joints, content, lambda: [make_creature.creature(clip, joints)])

    def _archived(self, name: str) -> mg.Motion:
        if name not in self._clips:
            self._clips |= _from_archive(self.folder / "bandai-namco" / "dataset-1.tar.xz", (_DANCE, *_WALKS))
        return self._clips[name]


def _of(name: str, clips: list[mg.Motion]) -> ExampleSet:
    frames, joints = sum(len(clip) for clip in clips), len(clips[0].skeleton)
    content = digest(*(content_of(clip).encode() for clip in clips))[:12]
    return ExampleSet(name, frames, joints, content, lambda: clips)


def _from_archive(archive: Path, names: Sequence[str]) -> dict[str, mg.Motion]:
    """Clips of a packed folder by name, at 30 frames per second; everything else in it is passed over."""
    found = {}
    try:
        with tarfile.open(archive) as packed, tempfile.TemporaryDirectory() as folder:
            for member in packed:
                name = Path(member.name).stem
                content = packed.extractfile(member) if name in names else None
                if content is not None:
                    path = Path(folder) / f"{name}.bvh"
                    path.write_bytes(content.read())
                    found[name] = mg.load(path).resample(FRAME_RATE)
    except (OSError, tarfile.TarError) as error:
        raise MotionGenError(
            f"{archive}: cannot be unpacked ({error}); name the folder of clips with --data"
        ) from error
    if missing := set(names) - set(found):
        raise MotionGenError(f"{archive}: holds no clip {', '.join(sorted(missing))}; give the whole archive")
    return found
