"""A dataset on disk: a folder of two plain arrays, end to end over all clips, and an index in JSON.

    index.json   format and version, settings, skeleton, clips, statistics, the arrays' digests, and the fingerprint
    frames.npy   (N, E, 4) float32 entities of every frame of every clip, in the world of its clip
    facing.npy   (N,) float32 heading of the body in each frame, in radians about the up axis; 0 faces +z

Windows are cut from these when they are asked for. The fingerprint is the SHA-256 of the index without it, and so of
the settings and, by the digests, of all frames. Nothing in a dataset can run code.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import tokenize
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.datasets.entities import CHANNELS, EntityLayout
from motiongen.datasets.labels import SPLITS
from motiongen.datasets.settings import ImportSettings
from motiongen.errors import MotionGenError
from motiongen.files import open_to_read

FORMAT, VERSION = "motiongen dataset", 1
INDEX, FRAMES, FACING = "index.json", "frames.npy", "facing.npy"

# What reading a damaged index, array or archive raises; RuntimeError on nesting without end and encrypted archives,
# MemoryError on arrays that claim to be larger than anything, the last two on headers that NumPy takes for old ones.
_DAMAGE = (
    *(KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError),
    *(EOFError, OSError, RuntimeError, MemoryError, zipfile.BadZipFile, SyntaxError, tokenize.TokenError),
)


@dataclass(frozen=True, eq=False)
class Index:
    """Everything about a dataset but its frames.

    Attributes:
        settings: what the import was asked for.
        layout: the skeleton and the entities.
        unit: length unit of the skeleton, or None where it is not known.
        names: (n,) the clips.
        lengths: (n,) their numbers of frames.
        splits: (n,) the part each belongs to, one of `SPLITS`.
        labels: for each field of the label pattern, (n,) what the clips' names say; "" where one does not fit.
        reference: (J, 4) rotations near which windows begin (see `entities.choose_signs`).
        mean: (E, 4) over the training windows.
        deviation: (E, 4) likewise; 1 where a channel does not vary.
        packed_from: fingerprint of the dataset that this one was packed from and unpacked again, or None.
    """

    settings: ImportSettings
    layout: EntityLayout
    unit: str | None
    names: tuple[str, ...]
    lengths: NDArray[np.int64]
    splits: tuple[str, ...]
    labels: dict[str, tuple[str, ...]]
    reference: NDArray[np.float32]
    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    packed_from: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """The index as plain data that JSON can hold."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "settings": dataclasses.asdict(self.settings) | {"joints": list(self.settings.joints)},
            "layout": self.layout.to_dict(),
            "unit": self.unit,
            "clips": {
                "names": list(self.names),
                "lengths": self.lengths.tolist(),
                "splits": list(self.splits),
                "labels": {field: list(values) for field, values in self.labels.items()},
            },
            "reference": self.reference.tolist(),
            "mean": self.mean.tolist(),
            "deviation": self.deviation.tolist(),
            "packed_from": self.packed_from,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Index:
        """The index of plain data as `to_dict` gives it.

        Raises:
            KeyError, TypeError, ValueError: if the data is not like that.
        """
        if data["format"] != FORMAT:
            raise ValueError(f"it says that it is '{data['format']}'")
        if data["version"] != VERSION:
            raise ValueError(f"it has version {data['version']} of the format where this motiongen reads {VERSION}")
        layout, clips = EntityLayout.from_dict(data["layout"]), data["clips"]
        entities = (layout.count, CHANNELS)
        index = cls(
            ImportSettings(**data["settings"]),
            layout,
            data["unit"],
            tuple(str(name) for name in clips["names"]),
            np.array(clips["lengths"], dtype=np.int64),
            tuple(clips["splits"]),
            {str(field): tuple(map(str, values)) for field, values in clips["labels"].items()},
            np.array(data["reference"], dtype=np.float32).reshape(len(layout.skeleton), CHANNELS),
            np.array(data["mean"], dtype=np.float32).reshape(entities),
            np.array(data["deviation"], dtype=np.float32).reshape(entities),
            data["packed_from"],
        )
        counts = {len(column) for column in (index.names, index.splits, *index.labels.values())}
        if counts != {len(index.lengths)} or not set(index.splits) <= set(SPLITS):
            raise ValueError("its lists of clips do not agree")
        if (index.lengths < 1).any():
            raise ValueError("a clip has no frames")
        return index


class Writer:
    """Writes the clips of a dataset one after the other into a folder, however many there will be."""

    def __init__(self, folder: Path, layout: EntityLayout) -> None:
        """Begin the arrays of a dataset in an empty folder."""
        self.folder = folder
        self._arrays = {
            FRAMES: _Growing(folder / FRAMES, (layout.count, CHANNELS)),
            FACING: _Growing(folder / FACING, ()),
        }

    def append(self, frames: NDArray[np.float32], facing: NDArray[np.float32]) -> None:
        """Add a clip: its entities (T, E, 4) and headings (T,)."""
        self._arrays[FRAMES].append(frames)
        self._arrays[FACING].append(facing)

    def close(self) -> None:
        """End the arrays; `frames.npy` and `facing.npy` are complete."""
        for array in self._arrays.values():
            array.close()

    def finish(self, index: Index) -> str:
        """Write the index of what was appended; returns the fingerprint."""
        self.close()
        data = index.to_dict() | {"digests": {name: array.digest for name, array in self._arrays.items()}}
        data["fingerprint"] = _fingerprint(data)
        (self.folder / INDEX).write_text(json.dumps(data), encoding="utf-8")
        return str(data["fingerprint"])


class _Growing:
    """An .npy file of float32 whose first axis grows."""

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self.shape, self.length = shape, 0
        self.hash = hashlib.sha256()
        self.file = path.open("xb")
        self.begin = self._write_header()

    def append(self, values: NDArray[np.float32]) -> None:
        block = np.ascontiguousarray(values, dtype="<f4")
        self.hash.update(block.data if block.size else b"")
        self.file.write(block.data if block.size else b"")
        self.length += len(block)

    def close(self) -> None:
        if self.file.closed:
            return
        self.file.seek(0)
        if self._write_header() != self.begin:  # NumPy leaves room for a first axis of any length
            raise AssertionError("the header of the array has grown")
        self.file.close()

    @property
    def digest(self) -> str:
        return self.hash.hexdigest()

    def _write_header(self) -> int:
        header = {"descr": "<f4", "fortran_order": False, "shape": (self.length, *self.shape)}
        np.lib.format.write_array_header_1_0(self.file, header)
        return self.file.tell()


def read_index(folder: Path) -> tuple[Index, str]:
    """The index of a dataset's folder and its fingerprint.

    Raises:
        MotionGenError: if there is none, or it is damaged or of a later version.
    """
    with open_to_read(folder / INDEX) as file, damage_told(folder):
        data = json.loads(file.read())
        if data["format"] == FORMAT and data["version"] == VERSION and data["fingerprint"] != _fingerprint(data):
            raise ValueError("its index does not have the fingerprint that it says")
        return Index.from_dict(data), str(data["fingerprint"])


def map_arrays(folder: Path, index: Index) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The frames (N, E, 4) and headings (N,) of a dataset, memory-mapped.

    Raises:
        MotionGenError: if a file is missing or damaged.
    """
    total = int(index.lengths.sum())
    shapes = {FRAMES: (total, index.layout.count, CHANNELS), FACING: (total,)}
    arrays = []
    for name, shape in shapes.items():
        open_to_read(folder / name).close()  # its message says what is wrong with the path
        with damage_told(folder):
            array = np.load(folder / name, mmap_mode="r", allow_pickle=False)
            if array.shape != shape or array.dtype != np.dtype("<f4"):
                raise ValueError(f"{name} holds {array.dtype} of shape {array.shape}, not float32 of {shape}")
            arrays.append(np.asarray(array))
    return arrays[0], arrays[1]


def check_arrays(folder: Path, frames: NDArray[np.float32], facing: NDArray[np.float32]) -> None:
    """Compare every byte of the arrays with the digests in the index.

    Raises:
        MotionGenError: if they differ.
    """
    with open_to_read(folder / INDEX) as file, damage_told(folder):
        digests = json.loads(file.read())["digests"]
        for name, array in ((FRAMES, frames), (FACING, facing)):
            if hashlib.sha256(np.ascontiguousarray(array).data).hexdigest() != digests[name]:
                raise ValueError(f"{name} has changed since it was written")


def _fingerprint(data: dict[str, Any]) -> str:
    rest = {key: value for key, value in data.items() if key != "fingerprint"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Whatever a damaged dataset makes the block raise, as a `MotionGenError` that says so."""
    try:
        yield
    except _DAMAGE as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise MotionGenError(
            f"{path}: this is no dataset that motiongen can read, or it is damaged ({text[:300]}); import it anew"
        ) from None
