"""Reading and writing BVH files, held to a slow reader that follows the definition to the letter."""

from __future__ import annotations

import io as standard_io
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.io import load, save
from motiongen.io.bvh.layout import CHANNELS, BvhLayout
from motiongen.kinematics import end_site_positions
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.io.bvh_texts import Joint, bvh_files, bvh_text, walker, write_text
from tests.io.slow_bvh import read_slowly
from tests.strategies import generators, motions, random_motion, random_skeleton

Array = NDArray[np.float64]

TOLERANCE = 1e-4  # in heights, as is demanded of the reader
WRITTEN = 1e-6  # in heights, what writing may add


def worst_error(motion: Motion, path: Path) -> float:
    """How far any joint or end site is from where the slow reader puts it, in heights."""
    joints, tips = read_slowly(path).positions()
    expected = np.concatenate([joints, tips], axis=1)
    if motion.up == "z":
        expected = np.stack([expected[..., 0], expected[..., 2], -expected[..., 1]], axis=-1)
    found = np.concatenate([motion.positions, end_site_positions(motion)], axis=1)
    return float(np.linalg.norm(found - expected, axis=-1).max()) / motion.skeleton.height


def same_bytes(a: Path, b: Path) -> bool:
    """A plain answer: pytest would take minutes to show how megabytes differ."""
    return a.read_bytes() == b.read_bytes()


def check_round_trip(path: Path, folder: Path, up: str | None = None) -> Motion:
    """The laws for any file: right positions when read and when written and read; from then on, the same bytes."""
    motion = load(path, up=up)
    assert worst_error(motion, path) < TOLERANCE
    once, twice = folder / "once.bvh", folder / "twice.bvh"
    save(motion, once)
    again = load(once, up=up)
    assert worst_error(again, once) < TOLERANCE
    assert np.linalg.norm(again.positions - motion.positions, axis=-1).max() < WRITTEN * motion.skeleton.height
    assert (again.frame_rate, again.up, again.translating) == (motion.frame_rate, motion.up, motion.translating)
    assert again.file_layout == motion.file_layout
    save(again, twice)
    assert same_bytes(once, twice)
    return motion


def real_clips(folder: Path) -> Iterator[Path]:
    yield from sorted(folder.glob("characters/*.bvh"))
    yield from sorted(folder.glob("cmu/*.bvh"))


def test_all_real_clips_come_back(shared_data: Path, tmp_path: Path) -> None:
    clips = list(real_clips(shared_data))
    assert len(clips) == 7
    for path in clips:
        motion = check_round_trip(path, tmp_path)
        assert motion.up == "y", path.name
        assert motion.name == path.stem


@pytest.mark.parametrize("archive", ["dataset-1", "dataset-2"])
def test_a_sample_of_archived_clips_comes_back(shared_data: Path, tmp_path: Path, archive: str) -> None:
    # The archives are streams: a sample from the beginning spares unpacking all of it.
    with tarfile.open(shared_data / "bandai-namco" / f"{archive}.tar.xz") as archived:
        clips = (member for member in archived if member.name.endswith(".bvh"))
        for _, member in zip(range(25), clips):
            file = archived.extractfile(member)
            assert file is not None
            path = tmp_path / Path(member.name).name
            path.write_bytes(file.read())
            motion = check_round_trip(path, tmp_path)
            assert motion.up == "y", member.name
            assert motion.skeleton.names[motion.root] == "Hips"
            assert motion.translating == (1,)
            assert any("'joint_Root' stands still" in note for note in motion.notes)


@given(bvh_files(), st.sampled_from(["y", "z"]))
def test_any_file_comes_back(file: tuple[str, str], up: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write_text(Path(folder) / "any.bvh", *file)
        motion = check_round_trip(path, Path(folder), up)
        slow = read_slowly(path)
        assert list(motion.skeleton.names) == [joint.name for joint in slow.joints]
        assert motion.skeleton.parents == tuple(joint.parent for joint in slow.joints)
        assert len(motion) == len(slow.numbers)
        layout = motion.file_layout
        assert [list(map(str.lower, c)) for c in layout.channels.values()] == [
            list(map(str.lower, joint.channels)) for joint in slow.joints
        ]


@given(bvh_files())
def test_a_file_read_as_z_up_is_the_motion_turned(file: tuple[str, str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write_text(Path(folder) / "any.bvh", *file)
        as_z, as_y = load(path, up="z", unit="m"), load(path, up="y", unit="m")
        assert as_z == as_y.turn_up("z")


@given(bvh_files())
def test_rotations_do_not_change_sign_from_frame_to_frame(file: tuple[str, str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        motion = load(write_text(Path(folder) / "any.bvh", *file))
    assert (np.sum(motion.rotations[1:] * motion.rotations[:-1], axis=-1) >= -1e-12).all()


@given(motions())
def test_any_motion_comes_back(motion: Motion) -> None:
    """A motion that came from no file: joints may come in any order, and any of them translate."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.bvh"
        save(motion, path)
        again = load(path, up=motion.up)
        assert worst_error(again, path) < TOLERANCE
    assert again.frame_rate == pytest.approx(motion.frame_rate, rel=1e-12)
    order = [again.skeleton.index(name) for name in motion.skeleton.names]
    apart = np.linalg.norm(again.positions[:, order] - motion.positions, axis=-1)
    assert apart.max() < 1e-5 * motion.skeleton.height  # translations are far off a random skeleton, up to ten heights
    assert rot.angle_between(again.rotations[:, order], motion.rotations).max() < 1e-6
    tips = end_site_positions(motion)
    assert (
        np.linalg.norm(np.sort(end_site_positions(again), axis=1) - np.sort(tips, axis=1), axis=-1).max(initial=0)
        < 1e-5 * motion.skeleton.height
    )


@given(generators(), st.data())
def test_channels_are_widened_rather_than_data_lost(rng: np.random.Generator, data: st.DataObject) -> None:
    """A motion with any layout, also one that lists too few channels for it or speaks of other joints."""
    skeleton = random_skeleton(rng, depth_first=True)
    motion = random_motion(rng, skeleton, up=data.draw(st.sampled_from("yz")))
    few = {name: tuple(rng.permutation(CHANNELS)[: int(rng.integers(0, 7))].tolist()) for name in skeleton.names}
    few.pop(skeleton.names[-1])
    layout = BvhLayout(few, (), "0.033333", 30.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.bvh"
        save(motion.replace(file_layout=layout), path)
        again = load(path, up=motion.up)
    assert again.positions.shape == motion.positions.shape
    assert np.linalg.norm(again.positions - motion.positions, axis=-1).max() < 1e-5 * skeleton.height
    assert rot.angle_between(again.rotations, motion.rotations).max() < 1e-6
    for name, channels in few.items():  # in the same order, and more only where they are needed
        kept = [channel for channel in again.file_layout.channels[name] if channel in channels]
        assert tuple(kept) == channels


def test_a_layout_without_any_channel_gets_the_usual_ones_of_a_root(tmp_path: Path) -> None:
    skeleton = Skeleton(("a", "b"), (-1, 0), np.array([[0.0, 1, 0], [0, 1, 0]]))
    motion = Motion(skeleton, np.tile(rot.IDENTITY, (2, 2, 1)), np.zeros((2, 0, 3)), (), 30.0)
    save(motion.replace(file_layout=BvhLayout({"a": (), "b": ()}, (), "0.033333", 30.0)), tmp_path / "still.bvh")
    assert load(tmp_path / "still.bvh", up="y").allclose(motion, tolerance=1e-6)


def test_enough_channels_are_not_widened(tmp_path: Path) -> None:
    """One and two rotation channels say turns about one and two axes, at poles and beyond them too."""
    joints = [
        Joint("hinge", -1, channels=["Yposition", "Zrotation"]),
        Joint("universal", 0, channels=["Yrotation", "Xrotation"]),
        Joint("rigid", 1, channels=[]),
    ]
    angles = np.array([-180.0, -135, -90, -45, 0, 30, 90, 91, 179, 180, 270])
    grid = np.stack(np.meshgrid(angles, angles, angles), axis=-1).reshape(-1, 3)
    numbers = np.concatenate([grid[:, :1] / 100, grid], axis=1)
    motion = check_round_trip(write_text(tmp_path / "few.bvh", bvh_text(joints, numbers)), tmp_path)
    assert list(motion.file_layout.channels.values()) == [tuple(joint.channels) for joint in joints]


@given(generators(), st.permutations(CHANNELS[3:]), st.integers(2, 400))
def test_angles_are_written_without_jumps(rng: np.random.Generator, order: list[str], frames: int) -> None:
    """A joint that spins smoothly, many times and over the poles, gets curves without steps of half or whole turns."""
    steps = np.cumsum(rng.uniform(-6, 6, size=(frames, 3)) + rng.uniform(-6, 6, size=3), axis=0)
    joints = [Joint("spinner", -1, channels=order), Joint("tip", 0, (1.0, 2.0, 3.0))]
    text = bvh_text(joints, np.concatenate([steps, np.zeros((frames, 3))], axis=1))
    with tempfile.TemporaryDirectory() as folder:
        path = write_text(Path(folder) / "spin.bvh", text)
        save(load(path), path)
        written = np.array(read_slowly(path).numbers)
    assert np.abs(np.diff(written, axis=0)).max() < 12.1


def test_chunks_join_without_a_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However few lines are read or written at once, the same motion and the same text come of it."""
    rng = np.random.default_rng(5)
    motion = random_motion(rng, random_skeleton(rng, 5, depth_first=True), frames=300, translating=(0, 2))
    whole, pieces = tmp_path / "whole.bvh", tmp_path / "pieces.bvh"
    save(motion, whole)
    read_whole = load(whole)
    monkeypatch.setattr("motiongen.io.bvh.writer.NUMBERS_AT_ONCE", 90)
    monkeypatch.setattr("motiongen.io.bvh.source.BLOCK", 333)
    save(motion, pieces)
    assert same_bytes(pieces, whole)
    assert load(whole) == read_whole
    for newline in ("\r\n", "\r"):
        assert load(write_text(pieces, whole.read_text(), newline)) == read_whole


def test_written_numbers_are_plain(tmp_path: Path) -> None:
    """No exponents and no minus zero, whatever the size of the skeleton."""
    rng = np.random.default_rng(0)
    for scale in (1e-4, 1.0, 1e6):
        motion = random_motion(rng, random_skeleton(rng, 6, scale=scale), frames=20, translating=(0,))
        still = motion.replace(rotations=-np.abs(rot.IDENTITY) + np.zeros(motion.rotations.shape))
        for each in (motion, still):
            save(each, tmp_path / "plain.bvh")
            text = (tmp_path / "plain.bvh").read_text()
            words = text.split("MOTION")[1].split()
            assert not any("e" in word.lower() for word in words[6:])
            assert not any(float(word) == 0 and word.startswith("-") for word in words[6:])
            again = load(tmp_path / "plain.bvh", up="y")
            assert worst_error(again, tmp_path / "plain.bvh") < TOLERANCE


def test_what_a_file_chose_is_written_again(tmp_path: Path) -> None:
    """Names, order, end sites with their names and places, channels and frame time."""
    tips = [(0, "left tip", (0.0, 0.0, 0.0)), (1, "", (0.0, 0.0, 1.0)), (1, "middle", (1.0, 0.0, 0.0))]
    joints = [
        Joint("Hips of it: all", -1, (0.0, 1.0, 0.0), ["Zrotation", "Yposition", "Xrotation", "Yrotation"], tips),
        Joint("latin\udce9", 0, (0.0, 1.0, 0.0), ["Xrotation"]),
        Joint("Kopf ü", 0, (0.0, 2.0, 0.0), []),
    ]
    text = bvh_text(joints, np.zeros((2, 5)), frame_time="00.01666670")
    source, target = write_text(tmp_path / "in.bvh", text), tmp_path / "out.bvh"
    save(load(source), target)

    def words(path: Path) -> list[bytes]:
        return [word for word in path.read_bytes().split() if not word.replace(b".", b"").lstrip(b"-").isdigit()]

    assert words(target) == words(source)
    assert b"Frame Time: 00.01666670" in target.read_bytes()
    save(load(source).resample(30.0), target)
    assert b"Frame Time: 0.033333\n" in target.read_bytes()


def test_big_files_are_read_in_little_memory(tmp_path: Path) -> None:
    """The text is never in memory as a whole, nor are its numbers: less than three times the resulting arrays."""
    import tracemalloc

    frames, joints = 20_000, 12
    names = [Joint("Hips", -1, channels=CHANNELS)] + [Joint(f"j{j}", j, (0.0, 1.0, 0.0)) for j in range(joints - 1)]
    head, line = (
        bvh_text(names, np.ones((1, 3 * joints + 3))).replace("Frames: 1", f"Frames: {frames}").rsplit("\n", 2)[:2]
    )
    path = tmp_path / "big.bvh"
    with path.open("w") as file:
        file.write(head + "\n")
        file.writelines(f"{line}\n" for _ in range(frames))
    load(write_text(tmp_path / "warm.bvh", walker()))
    tracemalloc.start()
    motion = load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * (motion.rotations.nbytes + motion.translations.nbytes)


def test_standard_io_is_not_shadowed() -> None:
    """`motiongen.io` has the name of a module of the standard library; both must be there."""
    assert standard_io.BytesIO(b"x").read() == b"x"
