"""A dataset as one plain file of 16-bit numbers, for carrying to another machine.

An .npz archive, nothing in it compressed or pickled. A rotation takes 48 bits: the three smallest parts of its
quaternion in 15 bits each, and 2 that say which part is left out, to be had from the norm. That is half precision by
size, but evenly spaced: eleven times as fine as 16-bit floats above a half. Of the root's path, rounded to a grid, the
steps are kept, so that rounding does not add up. What is lost is measured when the file is written.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.datasets.dataset import Dataset
from motiongen.datasets.entities import CHANNELS, EntityLayout, from_entities
from motiongen.datasets.store import Index, Writer, damage_told
from motiongen.files import atomic_write, new_folder, open_to_read

FORMAT, VERSION = "motiongen packed dataset", 1

MEMBERS = {"index": "|u1", "rotations": "<u2", "steps": "<i2", "facing": "<i2", "contacts": "|u1"}
"""The members of the archive and their types."""

# The parts that are kept are at most 1/sqrt(2), and take 15 bits with their sign.
_LARGEST_PART = np.sqrt(0.5)
_LEVELS = (1 << 15) - 1
_LARGEST_STEP = (1 << 15) - 2
_HALF_TURN = (1 << 15) - 1


@dataclass(frozen=True)
class Loss:
    """What packing loses at most, over all frames of all clips.

    Attributes:
        rotation_degrees: angle between a joint's rotation before and after.
        position_heights: distance between where a joint is before and after, each clip set off in one place, in
            skeleton heights.
        heading_degrees: angle by which a window is turned otherwise.
    """

    rotation_degrees: float
    position_heights: float
    heading_degrees: float


def pack(dataset: Dataset, path: str | Path) -> Loss:
    """Write a dataset as one file, which appears complete or not at all.

    Raises:
        MotionGenError: if the file cannot be written.
    """
    layout = dataset.layout
    steps = dataset.frames[:, layout.root, :3]
    grid = max(float(np.abs(steps).max()) / (_LARGEST_STEP - 1), 1e-12)
    total = len(dataset.frames)
    arrays: dict[str, NDArray[Any]] = {
        "rotations": np.empty((total, len(layout.skeleton), 3), np.uint16),
        "steps": np.empty((total, 3), np.int16),
        "facing": np.rint(dataset.facing * (_HALF_TURN / np.pi)).astype(np.int16),
        "contacts": np.packbits(dataset.frames[:, layout.contacts, 0] > 0.5, axis=1),
    }
    for now in _slices(dataset.index.lengths):
        arrays["rotations"][now] = pack_rotations(dataset.frames[now, layout.joints])
        arrays["steps"][now] = _pack_steps(steps[now], grid)
    about = {"format": FORMAT, "version": VERSION, "grid": grid, "from": dataset.fingerprint}
    text = json.dumps(about | {"index": dataset.index.to_dict()})
    arrays["index"] = np.frombuffer(text.encode(), np.uint8)
    loss = _loss(dataset, arrays, grid)
    members: dict[str, Any] = {name: np.ascontiguousarray(arrays[name], dtype) for name, dtype in MEMBERS.items()}
    with atomic_write(path) as file:
        np.savez(file, **members)
    return loss


def unpack(path: str | Path, out: str | Path) -> Dataset:
    """Make the dataset's folder of a packed file.

    Its frames are not quite those that were packed, so its fingerprint, made by the same rule, is its own;
    `index.packed_from` tells the other. Mean, deviation and the clips' parts are kept as they were.

    Raises:
        MotionGenError: if it is no packed dataset, or damaged, or `out` exists.
    """
    path = Path(path)
    arrays, index, grid = _read(path)
    with new_folder(out) as folder:
        writer = Writer(folder, index.layout)
        try:
            for now in _slices(index.lengths):
                packed = {name: array[now] for name, array in arrays.items() if name != "index"}
                writer.append(_unpack_clip(packed, index.layout, grid), _unpack_facing(packed["facing"]))
        finally:
            writer.close()
        writer.finish(index)
    return Dataset.open(out)


def pack_rotations(quaternions: NDArray[Any]) -> NDArray[np.uint16]:
    """Unit quaternions (..., 4) as 16-bit numbers (..., 3): the three smallest parts, and which one is missing."""
    q = np.asarray(quaternions, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    largest = np.abs(q).argmax(axis=-1)[..., None]
    q = q * np.where(np.take_along_axis(q, largest, axis=-1) < 0, -1.0, 1.0)
    kept = np.take_along_axis(q, _others(largest), axis=-1)  # (..., 3) within +- _LARGEST_PART
    levels = np.rint((kept / _LARGEST_PART + 1) * (_LEVELS / 2)).astype(np.uint16)
    levels[..., 0] |= (largest[..., 0] & 1).astype(np.uint16) << 15
    levels[..., 1] |= (largest[..., 0] >> 1).astype(np.uint16) << 15
    return levels


def unpack_rotations(packed: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Unit quaternions (..., 4) of three 16-bit numbers (..., 3), either sign of each."""
    largest = ((packed[..., 0] >> 15) | ((packed[..., 1] >> 15) << 1)).astype(np.int64)[..., None]
    kept = ((packed & _LEVELS) * (2 / _LEVELS) - 1) * _LARGEST_PART
    quaternions = np.empty((*packed.shape[:-1], 4))
    np.put_along_axis(quaternions, _others(largest), kept, axis=-1)
    missing = np.sqrt(np.maximum(1 - np.sum(kept**2, axis=-1, keepdims=True), 0.0))
    np.put_along_axis(quaternions, largest, missing, axis=-1)
    return quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)


def _others(largest: NDArray[np.int64]) -> NDArray[np.int64]:
    """(..., 3) the parts that are not `largest` (..., 1), ascending."""
    three = np.arange(3)
    return three + (three >= largest)


def _pack_steps(steps: NDArray[np.float32], grid: float) -> NDArray[np.int16]:
    """Steps (T, 3) of a path whose every place is rounded to the grid; the first one stands for itself."""
    path = np.rint(np.cumsum(steps[1:].astype(np.float64), axis=0) / grid)
    return np.concatenate([np.rint(steps[:1] / grid), np.diff(path, axis=0, prepend=0.0)]).astype(np.int16)


def _unpack_facing(facing: NDArray[np.int16]) -> NDArray[np.float32]:
    return (facing * (np.pi / _HALF_TURN)).astype(np.float32)


def _unpack_clip(packed: dict[str, NDArray[Any]], layout: EntityLayout, grid: float) -> NDArray[np.float32]:
    """(T, E, 4) entities of one clip."""
    frames = np.zeros((len(packed["steps"]), layout.count, CHANNELS), np.float32)
    frames[:, layout.joints] = rot.continuous(unpack_rotations(packed["rotations"]))
    frames[:, layout.root, :3] = packed["steps"] * grid
    frames[:, layout.contacts, 0] = np.unpackbits(packed["contacts"], axis=1, count=len(layout.feet))
    return frames


def _slices(lengths: NDArray[np.int64]) -> list[slice]:
    ends = np.cumsum(lengths).tolist()
    return [slice(begin, end) for begin, end in zip([0, *ends], ends)]


def _loss(dataset: Dataset, arrays: dict[str, NDArray[Any]], grid: float) -> Loss:
    """What the packed arrays lose, found by unpacking them again."""
    layout, rate = dataset.layout, dataset.frame_rate
    turned = moved = 0.0
    for clip, now in enumerate(_slices(dataset.index.lengths)):
        packed = {name: array[now] for name, array in arrays.items() if name != "index"}
        after = from_entities(_unpack_clip(packed, layout, grid), layout, rate)
        before = dataset.clip(clip)
        turned = max(turned, float(rot.angle_between(before.rotations, after.rotations).max()))
        apart = before.positions - after.positions
        apart = apart - apart[0, 0]
        moved = max(moved, float(np.linalg.norm(apart, axis=-1).max()) / layout.skeleton.height)
    heading = float(np.abs(_unpack_facing(arrays["facing"]) - dataset.facing).max())
    return Loss(np.degrees(turned), moved, np.degrees(heading))


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], Index, float]:
    """The arrays of a packed file, each checked before it is used."""
    with open_to_read(path) as file, damage_told(path):
        with zipfile.ZipFile(file) as archive:
            _check_members(archive, path.stat().st_size)
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in MEMBERS}
        about = json.loads(arrays["index"].tobytes())
        if about["format"] != FORMAT or about["version"] != VERSION:
            raise ValueError(f"it is '{about['format']}' of version {about['version']}, not {FORMAT} of {VERSION}")
        index = replace(Index.from_dict(about["index"]), packed_from=str(about["from"]))
        total, layout = int(index.lengths.sum()), index.layout
        shapes = {
            "rotations": (total, len(layout.skeleton), 3),
            "steps": (total, 3),
            "facing": (total,),
            "contacts": (total, (len(layout.feet) + 7) // 8),
        }
        for name, shape in shapes.items():
            if arrays[name].shape != shape or arrays[name].dtype != np.dtype(MEMBERS[name]):
                raise ValueError(f"'{name}' holds {arrays[name].dtype} of shape {arrays[name].shape}")
        return arrays, index, float(about["grid"])


def _check_members(archive: zipfile.ZipFile, size: int) -> None:
    """Refuse what could unpack to more than the file holds."""
    if set(archive.namelist()) != {f"{name}.npy" for name in MEMBERS}:
        raise ValueError(f"its members are {sorted(archive.namelist())[:9]}")
    for info in archive.infolist():
        if info.compress_type != zipfile.ZIP_STORED or info.file_size > size:
            raise ValueError(f"'{info.filename}' is compressed or larger than the file")
