"""Packing: small, plain, and as exact as it says."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motiongen import rotations as rot
from motiongen.datasets import Dataset, ImportSettings, import_clips, pack, unpack
from motiongen.datasets.labels import SPLITS
from motiongen.datasets.packing import pack_rotations, unpack_rotations
from motiongen.errors import MotionGenError
from tests.datasets.clips import save_clips, stride
from tests.strategies import generators, random_quaternions

COARSEST = 1.001 * np.degrees(4 * np.sqrt(3) * np.sqrt(0.5) / (2**15 - 1))
"""The largest angle, in degrees, between a rotation and its packed form, where all three parts are rounded by half a
level and the missing one, at its least a half, makes up for that."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("dataset")
    source = save_clips(place / "clips", {f"a_{i}.npz": stride(i, frames=40 + i) for i in range(12)})
    import_clips(source, place / "out", ImportSettings(frames=16, held_back=0.3, labels="{what}_{number}"))
    return place / "out"


@given(generators())
def test_rotations_come_back_nearly(rng: np.random.Generator) -> None:
    quaternions = random_quaternions(rng, 50, 3)
    packed = pack_rotations(quaternions)
    assert (packed.dtype, packed.shape) == (np.dtype(np.uint16), (50, 3, 3))
    back = unpack_rotations(packed)
    np.testing.assert_allclose(np.linalg.norm(back, axis=-1), 1.0, atol=1e-12)
    assert np.degrees(rot.angle_between(quaternions, back)).max() < COARSEST
    np.testing.assert_array_equal(unpack_rotations(pack_rotations(-quaternions)), back)


@given(st.permutations(range(4)), st.floats(0, 1e-4))
def test_rotations_with_equal_parts_come_back(order: list[int], apart: float) -> None:
    """Where it is not clear which part is the largest."""
    quaternion = np.array([1.0, 1.0 + apart, -1.0, -1.0 - apart])[order]
    back = unpack_rotations(pack_rotations(quaternion))
    assert np.degrees(rot.angle_between(quaternion / np.linalg.norm(quaternion), back)) < COARSEST


def test_what_is_unpacked_is_the_dataset_but_for_the_loss_told(folder: Path, tmp_path: Path) -> None:
    before = Dataset.open(folder)
    loss = pack(before, tmp_path / "packed.npz")
    after = unpack(tmp_path / "packed.npz", tmp_path / "out")
    assert loss.rotation_degrees < COARSEST
    assert loss.position_heights < 5e-4
    for split in SPLITS:
        windows = before.windows(split)
        np.testing.assert_array_equal(after.windows(split), windows)
        for one, other in zip(before.batch(windows, standardised=False), after.batch(windows, standardised=False)):
            there, back = before.to_motion(one, standardised=False), after.to_motion(other, standardised=False)
            turned = rot.angle_between(there.world_rotations[:, 0], back.world_rotations[:, 0])
            assert np.degrees(turned).max() <= loss.rotation_degrees + loss.heading_degrees + 1e-4
            assert np.degrees(rot.angle_between(there.rotations, back.rotations)[:, 1:]).max() <= (
                loss.rotation_degrees + 1e-4
            )
            np.testing.assert_array_equal(one[:, before.layout.contacts], other[:, before.layout.contacts])
    moved = [
        np.linalg.norm((a - a[0, 0]) - (b - b[0, 0]), axis=-1).max() / before.skeleton.height
        for a, b in ((before.clip(c).positions, after.clip(c).positions) for c in range(len(before.names)))
    ]
    assert max(moved) == pytest.approx(loss.position_heights, rel=1e-6)


def test_everything_else_is_kept(folder: Path, tmp_path: Path) -> None:
    before = Dataset.open(folder)
    pack(before, tmp_path / "packed.npz")
    after = unpack(tmp_path / "packed.npz", tmp_path / "out")
    assert after.index.packed_from == before.fingerprint
    assert after.fingerprint != before.fingerprint
    Dataset.verify(tmp_path / "out")
    assert after.index.to_dict() | {"packed_from": None} == before.index.to_dict()


def test_a_path_does_not_drift_however_long(tmp_path: Path) -> None:
    long = stride(0, frames=4000)
    import_clips(save_clips(tmp_path / "clips", {"a.npz": long}), tmp_path / "out", ImportSettings(held_back=0.0))
    before = Dataset.open(tmp_path / "out")
    pack(before, tmp_path / "packed.npz")
    after = unpack(tmp_path / "packed.npz", tmp_path / "back")
    grid = np.abs(before.frames[:, before.layout.root]).max() / 2**15
    apart = (before.clip(0).root_positions - after.clip(0).root_positions) / before.skeleton.height
    assert np.abs(apart - apart[0]).max() < 2 * grid


def test_the_file_is_as_small_as_it_says(folder: Path, tmp_path: Path) -> None:
    dataset = Dataset.open(folder)
    pack(dataset, tmp_path / "packed.npz")
    with zipfile.ZipFile(tmp_path / "packed.npz") as archive:
        index = archive.getinfo("index.npy").file_size
    bytes_of_a_frame = 6 * len(dataset.skeleton) + 6 + 2 + 1
    assert (tmp_path / "packed.npz").stat().st_size < bytes_of_a_frame * len(dataset.frames) + index + 2000


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(st.data())
def test_damaged_files_never_raise_anything_but_a_mistake(folder: Path, tmp_path: Path, data: st.DataObject) -> None:
    packed = tmp_path / "packed.npz"
    if not packed.exists():
        pack(Dataset.open(folder), packed)
    content = bytearray(packed.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    (tmp_path / "damaged.npz").write_bytes(content[: data.draw(st.sampled_from([len(content), at]))])
    out = tmp_path / "out"
    try:
        unpack(tmp_path / "damaged.npz", out)
    except MotionGenError:
        assert not out.exists()
    else:  # a byte that says nothing, such as the time of a member
        shutil.rmtree(out)


def test_compressed_members_and_objects_are_refused(folder: Path, tmp_path: Path) -> None:
    pack(Dataset.open(folder), tmp_path / "packed.npz")
    with np.load(tmp_path / "packed.npz") as archive:
        arrays = dict(archive)
    np.savez_compressed(tmp_path / "small.npz", **arrays)
    np.savez(tmp_path / "objects.npz", **(arrays | {"steps": np.array([{}], dtype=object)}))
    np.savez(tmp_path / "less.npz", **{name: arrays[name] for name in arrays if name != "steps"})
    np.savez(tmp_path / "wider.npz", **(arrays | {"steps": arrays["steps"].astype(np.int64)}))
    (tmp_path / "text.npz").write_text("no archive")
    for name in ("small", "objects", "less", "wider", "text"):
        with pytest.raises(MotionGenError, match=f"{name}.npz: this is no dataset"):
            unpack(tmp_path / f"{name}.npz", tmp_path / "out")
    assert not (tmp_path / "out").exists()
