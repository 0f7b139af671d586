"""The native format keeps a motion bit for bit, and refuses what is not its own."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from motiongen.errors import MotionGenError
from motiongen.io import load, save
from motiongen.io.npz import MEMBERS
from motiongen.motion import Motion
from tests.io.bvh_texts import bvh_files, walker, write_text
from tests.strategies import motions


def assert_identical(a: Motion, b: Motion) -> None:
    assert a == b
    assert a.rotations.tobytes() == b.rotations.tobytes()  # zeros of either sign too
    assert a.translations.tobytes() == b.translations.tobytes()
    assert (a.name, a.notes, a.file_layout) == (b.name, b.notes, b.file_layout)


@given(motions())
def test_any_motion_comes_back_bit_for_bit(motion: Motion) -> None:
    motion = motion.replace(name="Tänzer\udce9", notes=("odd", "very odd"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.npz"
        save(motion, path)
        assert_identical(load(path), motion)


@given(bvh_files())
def test_a_bvh_file_comes_back_by_way_of_it(file: tuple[str, str]) -> None:
    """With its layout, so that the same BVH file is written whether or not the motion has been an `.npz` file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        motion = load(write_text(folder / "any.bvh", *file))
        save(motion, folder / "any.npz")
        again = load(folder / "any.npz")
        assert_identical(again, motion)
        save(motion, folder / "a.bvh")
        save(again, folder / "b.bvh")
        assert (folder / "a.bvh").read_bytes() == (folder / "b.bvh").read_bytes()


def test_the_same_motion_gives_the_same_bytes(tmp_path: Path) -> None:
    motion = load(write_text(tmp_path / "a.bvh", walker()))
    for name in ("a.npz", "b.npz"):
        save(motion, tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_the_unit_can_be_given_and_the_up_axis_not(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save(load(write_text(tmp_path / "a.bvh", walker())), path)
    assert load(path, unit="ft").unit == "ft"
    assert load(path, up="y") == load(path)
    with pytest.raises(MotionGenError, match=r"a\.npz: .* y-up always; leave out"):
        load(path, up="z")


# -- what is not its own


@pytest.fixture
def arrays(tmp_path: Path) -> dict[str, Any]:
    """The members of a correct file."""
    save(load(write_text(tmp_path / "a.bvh", walker())), tmp_path / "a.npz")
    return dict(np.load(tmp_path / "a.npz"))


def metadata(change: Callable[[dict[str, Any]], object]) -> Callable[[dict[str, Any]], object]:
    """Change the metadata of a file."""

    def changed(arrays: dict[str, Any]) -> None:
        data = json.loads(arrays["metadata"].tobytes())
        change(data)
        arrays["metadata"] = np.frombuffer(json.dumps(data).encode(), np.uint8)

    return changed


def put(**values: Any) -> Callable[[dict[str, Any]], object]:
    return lambda arrays: arrays.update(values)


HOSTILE = {
    "foreign": (lambda arrays: (arrays.clear(), arrays.update(poses=np.zeros(3))), r"members are \['poses.npy'\]"),
    "a member less": (lambda arrays: arrays.pop("offsets"), "its members are"),
    "a member more": (put(more=np.zeros(2)), "its members are"),
    "single precision": (lambda a: a.update(offsets=a["offsets"].astype("f4")), "'offsets' is an array of float32"),
    "complex": (lambda a: a.update(rotations=a["rotations"] + 0j), "'rotations' is an array of complex128"),
    "by columns": (lambda a: a.update(rotations=np.asfortranarray(a["rotations"])), "not of <f8 by rows"),
    "objects": (put(parents=np.array([None, {}], dtype=object)), "'parents' is an array of object"),
    "another shape": (put(rotations=np.zeros((2, 4))), "rotations must have shape"),
    "tree in a square": (lambda a: a.update(parents=a["parents"].reshape(2, 2)), r"'parents' has shape \(2, 2\)"),
    "nan": (lambda a: a.update(rotations=a["rotations"] * np.nan), "rotations must be finite"),
    "no tree": (lambda a: a.update(parents=a["parents"][::-1].copy()), "joint 0 must be the root"),
    "joints beyond": (put(translating=np.array([99])), "translating must be"),
    "metadata of another kind": (put(metadata=np.frombuffer(b'{"format": "x"}', np.uint8)), "it says that it is 'x'"),
    "metadata no JSON": (put(metadata=np.frombuffer(b"{" * 100_000, np.uint8)), "damaged"),
    "metadata nested": (put(metadata=np.frombuffer(b"[" * 100_000, np.uint8)), "damaged"),
    "metadata a list": (put(metadata=np.frombuffer(b"[1]", np.uint8)), "damaged"),
    "metadata no text": (put(metadata=np.frombuffer(b"\xff\xfe{}", np.uint8)), "damaged"),
    "a later version": (metadata(lambda data: data.update(version=2)), "version 2 .* reads 1; update it"),
    "no names": (metadata(lambda data: data.pop("names")), "'names'"),
    "names no list": (metadata(lambda data: data.update(names=7)), "damaged"),
    "rate no number": (metadata(lambda data: data.update(frame_rate="fast")), "'fast'"),
    "rate below zero": (metadata(lambda data: data.update(frame_rate=-1)), "frame_rate must be"),
    "unit unknown": (metadata(lambda data: data.update(unit="mile")), "unit must be one of"),
    "unit a list": (metadata(lambda data: data.update(unit=[])), "damaged"),
    "layout unknown": (metadata(lambda data: data.update(file_layout={"fbx": {}})), "'bvh'"),
    "layout damaged": (metadata(lambda data: data["file_layout"]["bvh"].pop("channels")), "must hold channels"),
    "channel unknown": (metadata(lambda d: d["file_layout"]["bvh"]["channels"][0].append("W")), "must be different"),
    "frame time": (metadata(lambda d: d["file_layout"]["bvh"].update(frame_time="x")), "frame time is 'x'"),
}  # fmt: skip


def load_or_message(path: Path) -> Motion | str:
    try:
        return load(path)
    except MotionGenError as error:
        return str(error)


def check_refused(path: Path, words: str = "damaged") -> None:
    with pytest.raises(MotionGenError, match=words) as raised:
        load(path)
    message = str(raised.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert len(message) < 1000


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_not_its_own_costs_one_line(tmp_path: Path, arrays: dict[str, Any], kind: str) -> None:
    spoil, words = HOSTILE[kind]
    spoil(arrays)
    np.savez(tmp_path / "hostile.npz", **arrays)
    check_refused(tmp_path / "hostile.npz", words)


def test_compressed_files_are_refused_whatever_they_would_become(tmp_path: Path, arrays: dict[str, Any]) -> None:
    for rotations in (np.zeros((10_000, 4, 4)), arrays["rotations"]):  # shrinks a thousand times, and hardly at all
        np.savez_compressed(tmp_path / "bomb.npz", **arrays | {"rotations": rotations})
        check_refused(tmp_path / "bomb.npz", "compressed or larger than the file")


def test_sizes_that_a_file_only_claims_are_refused(tmp_path: Path, arrays: dict[str, Any]) -> None:
    """A header may claim terabytes; nothing is allocated on its word."""
    path = tmp_path / "claim.npz"
    for shape in ((10**12, 4, 4), (-3, -4, 4), (3, 4, 5)):
        with zipfile.ZipFile(path, "w") as archive:
            for name in MEMBERS:
                member = io.BytesIO()
                np.lib.format.write_array(member, arrays[name])
                if name == "rotations":
                    member = io.BytesIO()
                    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(member, header)
                    member.write(bytes(8 * 48))
                archive.writestr(f"{name}.npy", member.getvalue())
        check_refused(path, "'rotations' has not as many numbers as its shape" if min(shape) > 0 else "damaged")


def test_damaged_files_are_refused_or_still_a_motion(tmp_path: Path, arrays: dict[str, Any]) -> None:
    """Bytes changed, lost or added anywhere: one line or, where nothing that is read has changed, the motion."""
    good, path = (tmp_path / "a.npz").read_bytes(), tmp_path / "damaged.npz"
    rng = np.random.default_rng(3)
    refused = 0
    for case in range(300):
        start, stop = sorted(rng.integers(0, len(good), size=2))
        near = min(stop, start + int(rng.integers(1, 9)))
        put_in = rng.bytes(int(rng.integers(0, 9)))
        path.write_bytes(good[:start] if case % 5 == 0 else good[:start] + put_in + good[near:])
        came = load_or_message(path)
        refused += isinstance(came, str)
        assert isinstance(came, Motion) or came.startswith(f"{path}: "), case
        assert isinstance(came, Motion) or "\n" not in came, case
    assert refused > 250


@pytest.mark.parametrize(
    "content", [b"", b"PK\x05\x06" + bytes(18), b"PK\x03\x04", b"no archive", b"\x93NUMPY\x01\x00"]
)
def test_what_is_no_archive_costs_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "no.npz").write_bytes(content)
    check_refused(tmp_path / "no.npz")
