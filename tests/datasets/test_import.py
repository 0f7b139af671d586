"""From clips to a dataset: nothing is lost, nothing leaks, and what is left out is said."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from motiongen.contact import contact_labels
from motiongen.datasets import Dataset, ImportSettings, import_clips
from motiongen.datasets.labels import HELD_BACK, SPLITS, TRAINING
from motiongen.datasets.report import DUPLICATE, OTHER_FILE, OTHER_RIG, SHORT, SLOW, UNREADABLE
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.conftest import ROOT
from tests.datasets.clips import FIGURE, in_other_order, save_clips, seen_ahead, stride, under_still_root
from tests.strategies import generators, random_motion, skeletons

SMALL = ImportSettings(frames=8, stride=4, held_back=0.0)


def imported(source: Path, out: Path, asked: ImportSettings = SMALL) -> Dataset:
    import_clips(source, out, asked)
    return Dataset.verify(out)


def hold_to(dataset: Dataset, motions: dict[str, Motion], tolerance: float) -> None:
    """Every window gives back what its clip does then, but for heading and place."""
    length = dataset.window_frames
    windows = dataset.windows(TRAINING, stride=1)
    assert len(windows) > 0
    for window, (clip, start) in zip(dataset.batch(windows, standardised=False), windows):
        motion = motions[dataset.names[clip]].resample(dataset.frame_rate)
        positions = dataset.to_motion(window, standardised=False).positions / dataset.skeleton.height
        np.testing.assert_allclose(positions - positions[0, 0], seen_ahead(motion, start, length), atol=tolerance)
        labels = contact_labels(motion, dataset.layout.feet)[start : start + length]
        np.testing.assert_array_equal(window[:, dataset.layout.contacts, 0], labels)
        following = np.einsum("tjc,tjc->tj", window[1:, dataset.layout.joints], window[:-1, dataset.layout.joints])
        assert (following > -1e-6).all()


@pytest.mark.parametrize(("suffix", "tolerance"), [(".npz", 1e-5), (".bvh", 1e-4)])
@pytest.mark.parametrize("rate", [30.0, 60.0, 47.0])
def test_windows_give_their_clips_back(suffix: str, tolerance: float, rate: float, tmp_path: Path) -> None:
    motions = {f"{i}": stride(i, frames=20, frame_rate=rate) for i in range(3)}
    source = save_clips(tmp_path / "clips", {f"{name}{suffix}": motion for name, motion in motions.items()})
    hold_to(imported(source, tmp_path / "out"), motions, tolerance)


@settings(max_examples=10)
@given(generators(), skeletons(min_joints=2))
def test_windows_of_any_tree_give_their_clips_back(rng: np.random.Generator, skeleton: Skeleton) -> None:
    motion = random_motion(rng, skeleton, frames=12, translating=(0,), smooth=True)
    with tempfile.TemporaryDirectory() as folder:
        source = save_clips(Path(folder) / "clips", {"a.npz": motion})
        hold_to(imported(source, Path(folder) / "out"), {"a": motion}, 2e-5)


def test_a_joint_above_the_root_and_the_order_of_joints_change_nothing(tmp_path: Path) -> None:
    motion = stride(5)
    same = {
        "a.npz": motion,
        "b.npz": under_still_root(motion, np.random.default_rng(0)),
        "c.npz": in_other_order(motion, [0, 5, 3, 4, 1, 6, 2]),
        "d.npz": motion.scale(100.0),
    }
    dataset = imported(save_clips(tmp_path / "clips", same), tmp_path / "out")
    batch = dataset.batch([(clip, 3) for clip in range(4)])
    np.testing.assert_allclose(batch, np.broadcast_to(batch[:1], batch.shape), atol=2e-3)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert list(report["other_bones"]) == ["d"]
    assert report["other_bones"]["d"][1] == pytest.approx(100.0)


def test_other_bones_are_brought_to_the_first_ones_and_told(tmp_path: Path) -> None:
    offsets = FIGURE.offsets.copy()
    offsets[[4, 6]] *= 1.3
    tall = stride(1, skeleton=dataclasses.replace(FIGURE, offsets=offsets))
    source = save_clips(tmp_path / "clips", {"a.npz": stride(0), "b.npz": tall})
    report = import_clips(source, tmp_path / "out", SMALL)
    dataset = Dataset.open(tmp_path / "out")
    scale = tall.skeleton.height / FIGURE.height
    assert report.other_bones["b"][1] == pytest.approx(scale)
    brought = dataset.clip(1)
    np.testing.assert_allclose(brought.skeleton.offsets[1:], FIGURE.offsets[1:])
    steps, theirs = np.diff(brought.root_positions, axis=0), np.diff(tall.root_positions, axis=0)
    np.testing.assert_allclose(steps * scale, theirs, atol=1e-6)
    np.testing.assert_allclose(np.abs((brought.rotations * tall.rotations).sum(-1)), 1.0, atol=1e-6)


def test_what_is_left_out_is_said_with_the_reason(tmp_path: Path) -> None:
    source = save_clips(
        tmp_path / "clips",
        {
            "a.npz": stride(0),
            "again/a.npz": stride(0),
            "short.npz": stride(1, frames=7),
            "keys.npz": stride(2, frame_rate=1.0),
            "tree.npz": stride(3, skeleton=dataclasses.replace(FIGURE, parents=(-1, 0, 0, 0, 3, 0, 5))),
            "z.npz": stride(4),
        },
    )
    (source / "broken.bvh").write_text("HIERARCHY\nROOT x\n{\n")
    (source / "README.md").write_text("read me")
    report = import_clips(source, tmp_path / "out", SMALL)
    assert {each.name: each.kind for each in report.dropped} == {
        "again/a": DUPLICATE,
        "short": SHORT,
        "keys": SLOW,
        "tree": OTHER_RIG,
        "broken": UNREADABLE,
        "README": OTHER_FILE,
    }
    assert all(each.reason and "\n" not in each.reason for each in report.dropped)
    assert (report.clips, report.frames, report.windows) == (
        {TRAINING: 2, HELD_BACK: 0},
        {TRAINING: 48, HELD_BACK: 0},
        {TRAINING: 10, HELD_BACK: 0},
    )
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == json.loads(json.dumps(report.to_dict()))
    assert Dataset.open(tmp_path / "out").names == ("a", "z")


def test_a_broken_member_is_named_as_in_its_archive(tmp_path: Path) -> None:
    save_clips(tmp_path, {"a.npz": stride(0)})
    (tmp_path / "b.bvh").write_text("HIERARCHY\nROOT x\n{\n")
    archive = tmp_path / "clips.tar.gz"
    with tarfile.open(archive, "w:gz") as tar:
        tar.add(tmp_path / "a.npz", "in/a.npz")
        tar.add(tmp_path / "b.bvh", "../../in/b.bvh")
    (dropped,) = import_clips(archive, tmp_path / "out", SMALL).dropped
    assert dropped.reason.startswith("../../in/b.bvh:3:")
    assert tempfile.gettempdir() not in dropped.reason


def test_an_archive_gives_the_dataset_that_its_folder_gives(tmp_path: Path) -> None:
    source = save_clips(tmp_path / "clips", {f"{i}.npz": stride(i) for i in range(4)})
    archive = tmp_path / "clips.tar.xz"
    with tarfile.open(archive, "w:xz") as tar:
        for path in sorted(source.iterdir()):
            tar.add(path, path.name)
    first, second = imported(source, tmp_path / "a"), imported(archive, tmp_path / "b")
    assert first.fingerprint == second.fingerprint
    both = import_clips([source, archive], tmp_path / "c", SMALL)
    assert [each.kind for each in both.dropped] == [DUPLICATE] * 4
    assert both.fingerprint == first.fingerprint


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty clips."""
    clips = {f"walk_{'old' if i % 3 else 'new'}_{i:02}.npz": stride(i, frames=12) for i in range(30)}
    return save_clips(tmp_path_factory.mktemp("thirty"), clips)


def test_the_fingerprint_tells_content_and_settings_and_nothing_else(source: Path, tmp_path: Path) -> None:
    def fingerprint(out: str, **changes: object) -> str:
        return import_clips(source, tmp_path / out, dataclasses.replace(SMALL, **changes)).fingerprint

    first = fingerprint("a")
    assert fingerprint("b") == first
    other = [
        fingerprint("c", stride=5),
        fingerprint("d", held_back=0.3),
        fingerprint("e", labels="{what}_{age}_{number}"),
        fingerprint("f", frame_rate=15.0, frames=4),
        fingerprint("g", joints=("Hips", "Spine")),
    ]
    assert len({first, *other}) == 6
    save_clips(tmp_path / "more", {"walk_old_99.npz": stride(99)})
    assert import_clips([source, tmp_path / "more"], tmp_path / "h", SMALL).fingerprint not in {first, *other}


def test_processes_do_not_change_what_comes_out(source: Path, tmp_path: Path) -> None:
    one = import_clips(source, tmp_path / "one", SMALL)
    two = import_clips(source, tmp_path / "two", SMALL, workers=2)
    assert dataclasses.replace(one, seconds=0.0) == dataclasses.replace(two, seconds=0.0)


def test_no_clip_is_in_two_parts_and_new_clips_move_none(source: Path, tmp_path: Path) -> None:
    asked = dataclasses.replace(SMALL, held_back=0.3)
    dataset = imported(source, tmp_path / "out", asked)
    parts = {split: set(dataset.clips(split).tolist()) for split in SPLITS}
    assert parts[TRAINING] | parts[HELD_BACK] == set(range(30))
    assert not parts[TRAINING] & parts[HELD_BACK]
    assert all(len(part) > 2 for part in parts.values())
    for split in SPLITS:
        rng = np.random.default_rng(0)
        for windows in (dataset.windows(split), dataset.draw(split, 500, rng)):
            assert set(windows[:, 0].tolist()) == parts[split]
    save_clips(tmp_path / "more", {f"run_old_{i}.npz": stride(100 + i) for i in range(5)})
    import_clips([tmp_path / "more", source], tmp_path / "larger", asked)
    larger = Dataset.open(tmp_path / "larger")
    before = dict(zip(dataset.names, dataset.index.splits))
    assert {name: split for name, split in zip(larger.names, larger.index.splits) if name in before} == before


def test_labels_come_from_names(source: Path, tmp_path: Path) -> None:
    dataset = imported(source, tmp_path / "out", dataclasses.replace(SMALL, labels="{what}_{age}_{number}"))
    assert dataset.labels["what"] == ("walk",) * 30
    assert dataset.labels["age"] == tuple(name.split("_")[1] for name in dataset.names)
    save_clips(tmp_path / "odd", {"unlike.npz": stride(77)})
    report = import_clips(
        [source, tmp_path / "odd"], tmp_path / "with", dataclasses.replace(SMALL, labels="{what}_{age}_{number}")
    )
    assert report.labels["age"] == {"": 1, "new": 10, "old": 20}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"frames": 13}, "no clip can be kept.*has 12 frames, where a window has 13"),
        ({"joints": ("Tail",)}, "no joint matches 'Tail'"),
        ({"labels": "{a}-{b}"}, "fits no name, such as 'walk_old_01'|fits no name, such as 'walk_new_00'"),
        ({"held_back": 0.9999}, "all 30 clips are held back"),
    ],
)
def test_an_import_that_leaves_nothing_says_so_and_makes_nothing(
    changes: dict[str, object], words: str, source: Path, tmp_path: Path
) -> None:
    with pytest.raises(MotionGenError, match=words):
        import_clips(source, tmp_path / "out", dataclasses.replace(SMALL, **changes))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "changes",
    [
        {"frame_rate": 0.0},
        {"frame_rate": float("nan")},
        {"frames": 1},
        {"frames": 2.5},
        {"stride": 0},
        {"held_back": 1.0},
        {"held_back": -0.1},
        {"up": "x"},
        {"unit": "mile"},
        {"labels": "none"},
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(MotionGenError, match=f"(?i){next(iter(changes))[:5]}"):
        dataclasses.replace(SMALL, **changes)


def test_what_stands_at_the_target_stays(source: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    import_clips(source, tmp_path / "out", SMALL)  # an empty folder is as good as none
    before = sorted(path.name for path in (tmp_path / "out").iterdir())
    for out, words in ((tmp_path / "out", "this exists"), (tmp_path / "none" / "out", "does not exist")):
        with pytest.raises(MotionGenError, match=words):
            import_clips(source, out, SMALL)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == before


def test_sources_and_workers_are_asked_for(source: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(MotionGenError, match="at least one folder"):
        import_clips([], tmp_path / "out", SMALL)
    with pytest.raises(MotionGenError, match="workers must be"):
        import_clips(source, tmp_path / "out", SMALL, workers=0)
    with pytest.raises(MotionGenError, match="no clip can be read"):
        import_clips(tmp_path / "empty", tmp_path / "out", SMALL)


SLOW_IMPORT = """
import sys, time
from pathlib import Path
from motiongen.datasets import ImportSettings, import_clips

def wait(share):
    if share > 0.5:
        print("half", flush=True)
        time.sleep(60)

if __name__ == "__main__":
    import_clips(Path(sys.argv[1]), sys.argv[2], ImportSettings(frames=8), workers=2, progress=wait)
"""


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_import_leaves_no_dataset_and_no_process(how: signal.Signals, source: Path, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SLOW_IMPORT)
    out = tmp_path / "out"
    command = [sys.executable, str(script), str(source), str(out)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": str(ROOT)}
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"half\n"
        workers = children_of(running.pid)
        assert workers
        running.send_signal(how)
    assert running.returncode != 0
    assert not out.exists()
    if how is signal.SIGINT:
        assert [path.name for path in tmp_path.iterdir()] == ["script.py"]
    waited = time.monotonic() + 30
    while left := [pid for pid in workers if is_running(pid)]:
        assert time.monotonic() < waited, f"processes {left} are still there"
        time.sleep(0.05)
    imported(source, out)


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
