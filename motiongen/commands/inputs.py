"""The setting `input`: clips of one character, or parts of several that make a new one."""

from __future__ import annotations

import glob
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from motiongen import io
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError, nearest_of
from motiongen.generators.constraints import Constraint
from motiongen.motion import Motion
from motiongen.reassembly import PartSource, assemble

PART_SETTINGS = tuple(field.name for field in fields(PartSource) if field.name != "motions")


@dataclass(frozen=True)
class PartInput:
    """A part of another character: its clips, and where it goes (the other settings of a `PartSource`)."""

    clips: tuple[Path, ...]
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Inputs:
    """What `input` names.

    Attributes:
        clips: of the character, or of the body of a creature; none only for a generator that needs no examples.
        parts: of other characters.
    """

    clips: tuple[Path, ...]
    parts: tuple[PartInput, ...] = ()


@dataclass(frozen=True)
class Examples:
    """Clips that have been read.

    Attributes:
        clips: for `Generator.fit`.
        body: those of them that know the whole character, or its body.
        constraints: that each part of a creature moves as its own clips do.
    """

    clips: tuple[Motion, ...]
    body: tuple[Motion, ...]
    constraints: tuple[Constraint, ...] = ()


def read_input(given: Any, needed: bool) -> Inputs:
    """Check the setting.

    Args:
        given: a path, or a list of paths and of mappings with `clips` and settings of a `PartSource`.
        needed: whether the generator works from examples; null then stands for the bundled clip.

    Raises:
        MotionGenError: if a folder holds no clip, or there is no such setting.
    """
    if given is None:
        return Inputs((EXAMPLE_CLIP,) if needed else ())
    entries = given if isinstance(given, list) else [given]
    paths = _paths([entry for entry in entries if not isinstance(entry, Mapping)])
    if not paths:
        raise MotionGenError("input names no clip of the body; name at least one, or leave it out for the bundled one")
    return Inputs(paths, tuple(_part(entry) for entry in entries if isinstance(entry, Mapping)))


def load_examples(inputs: Inputs, up: str | None, unit: str | None) -> Examples:
    """Read the clips, and put the creature together where there are parts.

    Raises:
        MotionGenError: if a clip cannot be read or the parts do not fit.
    """

    def load(paths: Sequence[Path]) -> tuple[Motion, ...]:
        return tuple(io.load(path, up=up, unit=unit) for path in paths)

    body = load(inputs.clips)
    if not inputs.parts:
        return Examples(body, body)
    creature = assemble([PartSource(body), *(PartSource(load(part.clips), **part.settings) for part in inputs.parts)])
    return Examples(creature.clips, creature.examples[0], (creature.constraint,))


def _part(entry: Mapping[str, Any]) -> PartInput:
    settings = dict(entry)
    clips = settings.pop("clips", None)
    if clips is None:
        raise MotionGenError(f"a part in input needs clips=..., but {dict(entry)} came")
    for name in settings:
        if name not in PART_SETTINGS:
            raise MotionGenError(
                f"a part in input has no setting '{name}'{nearest_of(name, PART_SETTINGS) or ';'} its settings are "
                f"clips, {', '.join(PART_SETTINGS)}"
            )
    return PartInput(_paths(clips if isinstance(clips, list) else [clips]), settings)


def _paths(entries: Sequence[Any]) -> tuple[Path, ...]:
    """The paths of clips: files as they are, folders as the clips in them."""
    paths: list[Path] = []
    for entry in entries:
        if is_pattern(entry):
            raise MotionGenError(
                f"input={entry} is a pattern: add -m for a run for each of its clips, "
                "or name their folder for one run with all of them as examples"
            )
        path = Path(str(entry)).expanduser()
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if p.suffix.lower() in io.formats())
            if not inside:
                raise MotionGenError(f"folder '{path}' holds no clip; the formats are {', '.join(io.formats())}")
            paths += inside
        else:
            paths.append(path)
    return tuple(paths)


def is_pattern(value: Any) -> bool:
    """Whether `value` has wildcards and is not simply the odd name of something that exists."""
    return isinstance(value, str) and glob.has_magic(value) and not os.path.lexists(os.path.expanduser(value))
