"""Motions from files and back. The suffix chooses the format; one small registry says which there are."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from motiongen.errors import MotionGenError
from motiongen.motion import METRES_PER_UNIT, UP_AXES, Motion


@dataclass(frozen=True)
class Format:
    """A file format: its suffix, what it is, and where its functions are ("module:function"), imported when needed.

    Attributes:
        suffix: in lower case, with its dot.
        description: one line for people.
        reader: a function `(path, up, unit) -> Motion`.
        writer: a function `(motion, path) -> None`.
    """

    suffix: str
    description: str
    reader: str
    writer: str


FORMATS = (
    Format(".bvh", "Biovision hierarchy: text, any rig", "motiongen.io.bvh:read_bvh", "motiongen.io.bvh:write_bvh"),
    Format(
        ".glb", "binary glTF: game engines, web, with a mesh", "motiongen.io.glb:read_glb", "motiongen.io.glb:write_glb"
    ),
    Format(
        ".fbx", "FBX, through Blender where it is installed", "motiongen.io.fbx:read_fbx", "motiongen.io.fbx:write_fbx"
    ),
    Format(".npz", "NumPy archive: fast, bit for bit", "motiongen.io.npz:read_npz", "motiongen.io.npz:write_npz"),
)


def formats() -> tuple[str, ...]:
    """The suffixes of the files that motions are read from and written to."""
    return tuple(known.suffix for known in FORMATS)


def load(path: str | Path, *, up: str | None = None, unit: str | None = None) -> Motion:
    """Read a motion from a file.

    Args:
        path: the file; its suffix chooses the format.
        up: which axis of the file is up, "y" or "z", where the format does not say; detected from the poses by default.
        unit: what its lengths are in, one of `METRES_PER_UNIT`; guessed from the stature by default. Nothing is scaled.

    Returns:
        The motion, y-up; `notes` says in words what is odd about the file.

    Raises:
        MotionGenError: if the file cannot be read, is damaged, or its format is not known.
    """
    if up is not None and up not in UP_AXES:
        raise MotionGenError(f"up must be 'y' or 'z', or left out to detect it, not '{up}'")
    if unit is not None and unit not in METRES_PER_UNIT:
        raise MotionGenError(f"unit must be one of {', '.join(METRES_PER_UNIT)}, or left out to guess it, not '{unit}'")
    path = Path(path)
    motion: Motion = _function(_format(path).reader)(path, up, unit)
    return motion


def save(motion: Motion, path: str | Path) -> None:
    """Write a motion to a file, which appears complete or not at all; the suffix chooses the format.

    Raises:
        MotionGenError: if the format is not known, cannot hold the motion, or the file cannot be written.
    """
    path = Path(path)
    _function(_format(path).writer)(motion, path)


def _format(path: Path) -> Format:
    suffixes = {known.suffix: known for known in FORMATS}
    if path.suffix.lower() not in suffixes:
        came = f"the suffix '{path.suffix}'" if path.suffix else "no suffix"
        raise MotionGenError(f"{path}: {came} is no format of motions; use one of {', '.join(suffixes)}")
    return suffixes[path.suffix.lower()]


def _function(where: str) -> Any:
    module, function = where.split(":")
    return getattr(import_module(module), function)
