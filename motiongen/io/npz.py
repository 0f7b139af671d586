"""The native format: a NumPy archive that keeps everything of a motion, bit for bit, and reads at once.

It holds seven arrays and, as UTF-8 bytes of JSON, what is no array. Nothing in it is compressed, so that no member can
be larger than the file, and nothing is ever unpickled.
"""

from __future__ import annotations

import json
import math
import os
import tokenize
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.files import atomic_write, open_to_read
from motiongen.io.bvh.layout import BvhLayout
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

FORMAT, VERSION = "motiongen motion", 1

MEMBERS = {
    "metadata": "|u1",
    "parents": "<i8",
    "offsets": "<f8",
    "end_sites": "<i8",
    "end_site_offsets": "<f8",
    "rotations": "<f8",
    "translations": "<f8",
    "translating": "<i8",
}
"""The members of the archive and their types."""

# What Python's and NumPy's readers raise on damaged archives, headers and JSON. RuntimeError covers encrypted members,
# JSON nested without end and, as NotImplementedError, the compressions of other zip programs; the header of an array is
# read as Python text, hence TokenError and SyntaxError.
_DAMAGE = (zipfile.BadZipFile, ValueError, KeyError, TypeError, EOFError, RuntimeError, OverflowError, OSError,
           tokenize.TokenError, SyntaxError)  # fmt: skip


def write_npz(motion: Motion, path: Path) -> None:
    """Write a NumPy archive (see `motiongen.io.save`)."""
    skeleton, layout = motion.skeleton, motion.file_layout
    metadata = {
        "format": FORMAT,
        "version": VERSION,
        "names": skeleton.names,
        "frame_rate": motion.frame_rate,
        "unit": motion.unit,
        "up": motion.up,
        "name": motion.name,
        "notes": motion.notes,
        "file_layout": {"bvh": layout.to_dict()} if isinstance(layout, BvhLayout) else None,
    }
    values = {
        "metadata": np.frombuffer(json.dumps(metadata).encode(), np.uint8),
        "parents": skeleton.parents,
        "offsets": skeleton.offsets,
        "end_sites": skeleton.end_sites,
        "end_site_offsets": skeleton.end_site_offsets,
        "rotations": motion.rotations,
        "translations": motion.translations,
        "translating": motion.translating,
    }
    arrays: dict[str, Any] = {name: np.ascontiguousarray(values[name], dtype) for name, dtype in MEMBERS.items()}
    with atomic_write(path) as file:
        np.savez(file, **arrays)


def read_npz(path: Path, up: str | None = None, unit: str | None = None) -> Motion:
    """Read a NumPy archive that `write_npz` wrote (see `motiongen.io.load`).

    Raises:
        MotionGenError: if it is another kind of archive, damaged, or written by a later version.
    """
    if up not in (None, "y"):
        raise MotionGenError(f"{path}: a motion in an .npz file is y-up always; leave out what is up")
    with open_to_read(path) as file:
        try:
            arrays = _arrays(file)
            motion = _motion(arrays)
        except _DAMAGE as error:
            raise MotionGenError(
                f"{path}: this is no motion that motiongen wrote, or it is damaged ({_one_line(error)}); write it anew"
            ) from None
    return motion if unit is None else motion.replace(unit=unit)


def _arrays(file: BinaryIO) -> dict[str, NDArray[Any]]:
    """The members of the archive, each checked to be as large as it says before memory is taken for it."""
    size = os.fstat(file.fileno()).st_size
    arrays: dict[str, NDArray[Any]] = {}
    with zipfile.ZipFile(file) as archive:
        found, wanted = set(archive.namelist()), {f"{name}.npy" for name in MEMBERS}
        if found != wanted:
            raise ValueError(f"its members are {sorted(found)[:9]}, not {sorted(wanted)}")
        for name, dtype in MEMBERS.items():
            info = archive.getinfo(f"{name}.npy")
            if info.compress_type != zipfile.ZIP_STORED or info.file_size > size:
                raise ValueError(f"'{name}' is compressed or larger than the file")
            with archive.open(info) as member:
                version = np.lib.format.read_magic(member)
                if version != (1, 0):
                    raise ValueError(f"'{name}' has array format {version}, not (1, 0)")
                shape, by_columns, kind = np.lib.format.read_array_header_1_0(member)
                if kind != np.dtype(dtype) or by_columns:
                    raise ValueError(f"'{name}' is an array of {kind}, not of {dtype} by rows")
                if math.prod(shape) * kind.itemsize != info.file_size - member.tell():
                    raise ValueError(f"'{name}' has not as many numbers as its shape {shape} says")
                arrays[name] = np.frombuffer(member.read(), kind).reshape(shape)
    return arrays


def _motion(arrays: dict[str, NDArray[Any]]) -> Motion:
    metadata = json.loads(arrays["metadata"].tobytes())
    if metadata["format"] != FORMAT:
        raise ValueError(f"it says that it is '{metadata['format']}'")
    if metadata["version"] != VERSION:
        raise ValueError(
            f"it has version {metadata['version']} of the format where this motiongen reads {VERSION}; update it"
        )
    for name in ("parents", "end_sites", "translating"):
        if arrays[name].ndim != 1:
            raise ValueError(f"'{name}' has shape {arrays[name].shape}")
    skeleton = Skeleton(
        tuple(str(name) for name in metadata["names"]),
        tuple(arrays["parents"].tolist()),
        arrays["offsets"],
        tuple(arrays["end_sites"].tolist()),
        arrays["end_site_offsets"],
    )
    layout = metadata["file_layout"]
    return Motion(
        skeleton,
        arrays["rotations"],
        arrays["translations"],
        tuple(arrays["translating"].tolist()),
        float(metadata["frame_rate"]),
        metadata["unit"],
        metadata["up"],
        str(metadata["name"]),
        tuple(str(note) for note in metadata["notes"]),
        layout and BvhLayout.from_dict(layout["bvh"]),
    )


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 300 else text[:297] + "..."
