"""Windows of a dataset: which there are, what is in them, and that what is on disk is what was written."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.datasets import Dataset, ImportSettings, import_clips, to_entities
from motiongen.datasets.entities import heading_radians
from motiongen.datasets.labels import HELD_BACK, SPLITS, TRAINING
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.stance import facing
from tests.datasets.clips import save_clips, stride

LENGTH = 8
CLIPS = {f"clip_{i}": stride(i, frames=LENGTH + 3 * i) for i in range(8)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("dataset")
    source = save_clips(place / "clips", {f"{name}.npz": motion for name, motion in CLIPS.items()})
    import_clips(source, place / "out", ImportSettings(frames=LENGTH, stride=5, held_back=0.3))
    return place / "out"


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Dataset:
    return Dataset.open(folder)


def slow_window(dataset: Dataset, motion: Motion, start: int) -> NDArray[np.float64]:
    """One window, not standardised, by way of the motion's own methods."""
    ahead = rot.inverse(facing(motion)[start])
    window = to_entities(motion.transform(ahead), dataset.layout)[start : start + dataset.window_frames]
    for joint, reference in enumerate(dataset.index.reference):
        if window[0, joint] @ reference < 0:
            window[:, joint] *= -1
    return window


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("step", [None, 1, 3, 100])
def test_windows_are_all_there_are(dataset: Dataset, split: str, step: int | None) -> None:
    expected = [
        (clip, start)
        for clip, name in enumerate(dataset.names)
        for start in range(len(CLIPS[name]))
        if dataset.index.splits[clip] == split and start % (step or 5) == 0 and start + LENGTH <= len(CLIPS[name])
    ]
    assert [tuple(window) for window in dataset.windows(split, step).tolist()] == expected
    assert expected


@pytest.mark.parametrize("split", SPLITS)
def test_batches_are_what_the_slow_way_gives(dataset: Dataset, split: str) -> None:
    windows = dataset.windows(split, 1)
    batch = dataset.batch(windows, standardised=False)
    assert batch.dtype == np.float32
    assert batch.shape == (len(windows), LENGTH, dataset.layout.count, 4)
    for (clip, start), window in zip(windows.tolist(), batch):
        np.testing.assert_allclose(window, slow_window(dataset, CLIPS[dataset.names[clip]], start), atol=1e-5)


def test_windows_begin_ahead_over_the_origin_with_signs_that_agree(dataset: Dataset) -> None:
    batch = dataset.batch(dataset.windows(TRAINING, 1), standardised=False)
    root = batch[:, 0, 0].astype(np.float64)
    body = rot.multiply(rot.inverse(rot.heading(root)), root)  # which way the root looks is not the body's heading
    assert rot.angle_between(root, body).max() < 0.5
    first = batch[:, 0, dataset.layout.joints]
    assert (np.einsum("bjc,jc->bj", first, dataset.index.reference) >= 0).all()


def test_the_training_part_is_standardised_and_the_rest_by_the_same_numbers(dataset: Dataset) -> None:
    raw = np.concatenate(list(dataset.batches(TRAINING, size=3, standardised=False))).astype(np.float64)
    np.testing.assert_allclose(dataset.mean, raw.mean(axis=(0, 1)), atol=1e-6)
    varies = raw.std(axis=(0, 1)) > 1e-4
    np.testing.assert_allclose(dataset.deviation[varies], raw.std(axis=(0, 1))[varies], rtol=1e-4)
    np.testing.assert_array_equal(dataset.deviation[~varies], 1.0)
    for split in SPLITS:
        windows = dataset.windows(split)
        expected = (dataset.batch(windows, standardised=False) - dataset.mean) / dataset.deviation
        np.testing.assert_allclose(dataset.batch(windows), expected, atol=1e-6)
    padding = dataset.batch(dataset.windows(HELD_BACK))
    np.testing.assert_array_equal(padding[:, :, dataset.layout.root, 3], 0.0)
    np.testing.assert_array_equal(padding[:, :, dataset.layout.contacts, 1:], 0.0)


def test_the_reference_is_the_rotation_nearest_to_all_of_the_training_part(dataset: Dataset) -> None:
    rotations = [
        rot.multiply(rot.inverse(facing(m))[:, None], m.world_rotations)[:, 0]
        for m in (CLIPS[dataset.names[clip]] for clip in dataset.clips(TRAINING))
    ]
    seen = np.concatenate(rotations)  # (T, 4) of the root, as it faces ahead
    rng = np.random.default_rng(0)
    mine = dataset.index.reference[0].astype(np.float64)
    near = mine + 0.05 * rng.normal(size=(50, 4))
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    scores = ((seen @ near.T) ** 2).sum(axis=0)
    assert ((seen @ mine) ** 2).sum() >= scores.max()


def test_draws_are_as_likely_everywhere_and_repeat(dataset: Dataset) -> None:
    places = {tuple(window) for window in dataset.windows(TRAINING, 1).tolist()}
    drawn = dataset.draw(TRAINING, 200 * len(places), np.random.default_rng(1))
    found, counts = np.unique(drawn, axis=0, return_counts=True)
    assert {tuple(window) for window in found.tolist()} == places
    assert counts.min() > 120  # five standard deviations below 200
    assert counts.max() < 290
    np.testing.assert_array_equal(drawn, dataset.draw(TRAINING, len(drawn), np.random.default_rng(1)))
    assert (drawn[:50] != dataset.draw(TRAINING, 50, np.random.default_rng(2))).any()


def test_a_batch_does_not_depend_on_what_else_is_in_it(dataset: Dataset) -> None:
    windows = dataset.windows(TRAINING, 1)
    batch = dataset.batch(windows)
    for i in range(0, len(windows), 7):
        np.testing.assert_array_equal(dataset.batch(windows[i]), batch[i : i + 1])
    batch[:] = 0.0
    assert np.abs(dataset.batch(windows)).max() > 0


@pytest.mark.parametrize("standardised", [True, False])
def test_motions_come_back_from_windows(dataset: Dataset, standardised: bool) -> None:
    window = dataset.windows(TRAINING)[-1]
    motion = dataset.to_motion(dataset.batch(window, standardised)[0], standardised, name="made")
    assert (motion.name, motion.frame_rate, len(motion)) == ("made", 30.0, LENGTH)
    assert motion.skeleton == dataset.skeleton
    layout = dataset.layout
    again = to_entities(motion, layout)
    expected = dataset.batch(window, standardised=False)[0]
    np.testing.assert_allclose(np.abs(again[:, layout.joints]), np.abs(expected[:, layout.joints]), atol=1e-6)
    np.testing.assert_allclose(again[1:, layout.root], expected[1:, layout.root], atol=1e-6)


def test_whole_clips_come_back(dataset: Dataset) -> None:
    for clip, name in enumerate(dataset.names):
        motion, before = dataset.clip(clip), CLIPS[name]
        apart = motion.positions - before.positions
        assert np.abs(apart - apart[0, 0]).max() < 1e-5
        np.testing.assert_allclose(
            np.cos(heading_radians(facing(before)) - dataset.facing[dataset.first[clip] :][: len(before)]),
            1.0,
            atol=1e-6,
        )


@pytest.mark.parametrize("window", [(-1, 0), (8, 0), (0, -1), (0, 1), (3, 10), (99, 99)])
def test_windows_that_do_not_exist_are_refused(dataset: Dataset, window: tuple[int, int]) -> None:
    with pytest.raises(MotionGenError, match=f"at frame {window[1]} of clip {window[0]}"):
        dataset.batch([(1, 0), window])


def test_questions_that_make_no_sense_are_refused(dataset: Dataset) -> None:
    with pytest.raises(MotionGenError, match=r"no part 'trainign'.*did you mean 'training'"):
        dataset.windows("trainign")
    with pytest.raises(MotionGenError, match="stride must be"):
        dataset.windows(TRAINING, 0)
    with pytest.raises(MotionGenError, match="no clip 8"):
        dataset.clip(8)
    with pytest.raises(MotionGenError, match=r"shape \(frames, 10, 4\), not \(8, 9, 4\)"):
        dataset.to_motion(np.zeros((8, 9, 4)))


def test_a_part_without_clips_gives_no_windows(tmp_path: Path) -> None:
    source = save_clips(tmp_path / "clips", {"a.npz": stride(0)})
    import_clips(source, tmp_path / "out", ImportSettings(frames=LENGTH, held_back=0.0))
    dataset = Dataset.open(tmp_path / "out")
    assert dataset.windows(HELD_BACK).shape == (0, 2)
    assert dataset.batch(dataset.windows(HELD_BACK)).shape[0] == 0
    with pytest.raises(MotionGenError, match="'held_back' has no clips"):
        dataset.draw(HELD_BACK, 1, np.random.default_rng(0))


# -- on disk


def test_frames_are_mapped_and_cannot_be_changed(dataset: Dataset) -> None:
    assert isinstance(dataset.frames.base, np.memmap)
    with pytest.raises(ValueError, match="read-only"):
        dataset.frames[0] = 0.0


def test_opening_a_dataset_brings_in_neither_torch_nor_scipy(folder: Path) -> None:
    code = (
        "import sys; from motiongen.datasets import Dataset; d = Dataset.open(sys.argv[1]);"
        "d.batch(d.windows('training')); heavy = {'torch', 'scipy', 'hydra', 'rich'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(st.sampled_from(["index.json", "frames.npy", "facing.npy"]), st.data())
def test_any_changed_byte_is_found(folder: Path, tmp_path: Path, name: str, data: st.DataObject) -> None:
    copy = tmp_path / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy)
    content = bytearray((copy / name).read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    (copy / name).write_bytes(content)
    try:
        changed = Dataset.verify(copy)
    except MotionGenError:
        return
    original = Dataset.open(folder)  # it was a blank of the index, or of an array's header
    assert changed.fingerprint == original.fingerprint
    np.testing.assert_array_equal(changed.frames, original.frames)
    np.testing.assert_array_equal(changed.facing, original.facing)


@pytest.mark.parametrize("key", ["mean", "settings", "clips", "layout"])
def test_an_index_that_was_changed_by_hand_is_refused(folder: Path, tmp_path: Path, key: str) -> None:
    shutil.copytree(folder, tmp_path / "changed")
    index = json.loads((folder / "index.json").read_text())
    index["mean"][0][0] += 1e-6 * (key == "mean")
    index["settings"]["stride"] += key == "settings"
    index["clips"]["names"][0] += "x" * (key == "clips")
    index["layout"]["feet"] = index["layout"]["feet"][:: -1 if key == "layout" else 1]
    (tmp_path / "changed" / "index.json").write_text(json.dumps(index))
    with pytest.raises(MotionGenError, match="does not have the fingerprint"):
        Dataset.open(tmp_path / "changed")


@pytest.mark.parametrize("name", ["index.json", "frames.npy", "facing.npy"])
def test_missing_and_cut_files_are_told(folder: Path, tmp_path: Path, name: str) -> None:
    shutil.copytree(folder, tmp_path / "cut")
    content = (tmp_path / "cut" / name).read_bytes()
    for length in (0, 10, len(content) // 2, len(content) - 4):
        (tmp_path / "cut" / name).write_bytes(content[:length])
        with pytest.raises(MotionGenError, match="damaged"):
            Dataset.open(tmp_path / "cut")
    (tmp_path / "cut" / name).unlink()
    with pytest.raises(MotionGenError, match="no such file"):
        Dataset.open(tmp_path / "cut")


def test_a_later_version_is_told(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "later")
    index = json.loads((folder / "index.json").read_text())
    for key, value, words in (("version", 2, "version 2"), ("format", "other", "it says that it is 'other'")):
        (tmp_path / "later" / "index.json").write_text(json.dumps(index | {key: value}))
        with pytest.raises(MotionGenError, match=words):
            Dataset.open(tmp_path / "later")


def test_arrays_of_objects_are_never_read(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "objects")
    np.save(tmp_path / "objects" / "frames.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(MotionGenError, match="damaged"):
        Dataset.open(tmp_path / "objects")
