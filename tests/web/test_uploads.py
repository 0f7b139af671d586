"""What a visitor sends: every format, every kind of mistake, and names that mean no harm or do."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError
from motiongen.io.glb.container import read_container
from motiongen.motion import Motion
from motiongen.web.limits import Limits
from motiongen.web.uploads import SUFFIXES, check_size, file_bytes, file_name, read_upload, shown_name
from tests.io.test_glb import foreign

CLIP = mg.load(EXAMPLE_CLIP)[:20]
LIMITS = Limits()

NAMES = [
    "../../etc/passwd",
    "..\\..\\windows\\system32\\clip",
    "/etc/cron.d/clip",
    "C:\\clip",
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "a\x00b\nc\x1b[31m",
    "\u202ereversed",
    "'; rm -rf ~; '",
    "$(touch x)",
    "con",
    "..",
    " ",
    "x" * 5000,
    "Gehen – 走る",
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where temporary files go; nothing may be left there."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield tmp_path
    assert not list(tmp_path.iterdir()), "nothing is left in the temporary folder"


@pytest.fixture
def touched(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of all files that are read and written."""
    names: list[str] = []

    def noting(there):
        def noted(path, *arguments, **settings):
            names.append(str(path))
            return there(path, *arguments, **settings)

        return noted

    monkeypatch.setattr(Path, "write_bytes", noting(Path.write_bytes))
    monkeypatch.setattr(mg.io, "load", noting(mg.io.load))
    return names


def read_or_message(name: str, content: bytes) -> Motion | str:
    try:
        return read_upload(name, content, LIMITS)
    except MotionGenError as error:
        return str(error)


# -- formats


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_sent_is_what_the_library_reads(suffix: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("sent") / f"Walk{suffix}"
    CLIP.save(path)
    sent = read_upload(f"Walk{suffix.upper()}", path.read_bytes(), LIMITS)
    assert sent == mg.load(path)
    assert sent.name == "Walk"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_downloaded_can_be_sent_back(suffix: str) -> None:
    back = read_upload(f"a{suffix}", file_bytes(CLIP, suffix), LIMITS)
    assert back.allclose(CLIP, 1e-5)


def test_a_character_comes_back_with_its_mesh(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("sent") / "theirs.glb"
    theirs = foreign(np.random.default_rng(0))
    theirs.save(path)
    motion = read_upload("theirs.glb", path.read_bytes(), LIMITS)
    back = tmp_path_factory.mktemp("back") / "back.glb"
    back.write_bytes(file_bytes(motion[::-1].replace(name="new"), ".glb"))
    written = read_container(back)
    for kept in ("meshes", "materials", "skins", "nodes"):
        assert written.document[kept] == theirs.document[kept]
    np.testing.assert_allclose(mg.load(back).positions, motion.positions[::-1], atol=1e-5)


@pytest.mark.parametrize("name", ["clip.fbx", "clip.txt", "clip", "bvh", ".bvh", "", "clip.bvh.exe", "clip.bvh/"])
def test_other_formats_are_refused_before_anything_is_written(name: str, touched: list[str]) -> None:
    with pytest.raises(MotionGenError, match=r"no clip that can be read; send one of \.bvh, \.glb, \.npz"):
        read_upload(name, file_bytes(CLIP, ".bvh"), LIMITS)
    assert [path for path in touched if "upload" in path] == []


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("content", [b"", b"HIERARCHY\nROOT", b"PK\x03\x04broken", b"glTF" + bytes(16), bytes(1000)])
def test_damage_is_said_in_one_line_by_the_visitors_name_for_it(suffix: str, content: bytes, folder: Path) -> None:
    with pytest.raises(MotionGenError) as caught:
        read_upload(f"My Clip{suffix}", content, LIMITS)
    said = str(caught.value)
    assert f"'My Clip{suffix}'" in said
    assert "\n" not in said
    assert str(folder) not in said, "where files lie here is nobody's business"
    assert "upload" not in said


@given(st.integers(0, 2**31), st.sampled_from(SUFFIXES))
def test_damage_anywhere_gives_a_motion_or_one_line(seed: int, suffix: str) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray(file_bytes(CLIP[:4], suffix))
    for place in rng.integers(0, len(content), rng.integers(1, 6)):
        content[place] = rng.integers(256)
    read = read_or_message(f"a{suffix}", bytes(content[: rng.integers(len(content) // 2, len(content) + 1)]))
    assert isinstance(read, Motion) or "\n" not in read


# -- sizes


def test_too_large_a_file_is_refused_before_anything_is_written(touched: list[str]) -> None:
    content = file_bytes(CLIP, ".bvh")
    touched.clear()
    with pytest.raises(MotionGenError, match=r"'a.bvh' has 3.0 MiB; at most 1.5 MiB are taken"):
        read_upload("a.bvh", bytes(3 * 2**20), Limits(upload_bytes=3 * 2**19))
    assert not touched
    assert read_upload("a.bvh", content, Limits(upload_bytes=len(content))) is not None


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_too_many_joints_or_frames_are_refused(suffix: str) -> None:
    content, joints, frames = file_bytes(CLIP, suffix), len(CLIP.skeleton), len(CLIP)
    read_upload(f"a{suffix}", content, Limits(joints=joints, frames=frames))
    with pytest.raises(MotionGenError, match=f"'a{suffix}' has {joints} joints; at most {joints - 1} are taken"):
        read_upload(f"a{suffix}", content, Limits(joints=joints - 1))
    with pytest.raises(MotionGenError, match=f"'a{suffix}' has {frames} frames; at most {frames - 1} are taken"):
        read_upload(f"a{suffix}", content, Limits(frames=frames - 1))


def test_a_clip_from_elsewhere_is_measured_alike() -> None:
    check_size(CLIP, LIMITS, "it")
    with pytest.raises(MotionGenError, match="'it' has 20 frames"):
        check_size(CLIP, Limits(frames=19), "it")


# -- names


@pytest.mark.parametrize("name", NAMES)
def test_a_name_never_reaches_the_file_system(name: str, touched: list[str], folder: Path) -> None:
    content = file_bytes(CLIP, ".bvh")
    touched.clear()
    read = read_or_message(f"{name}.bvh", content)
    if isinstance(read, Motion):
        assert {PurePath(path).name for path in touched} == {"upload.bvh"}
        assert read.name.isprintable()
        assert read.name
    else:
        assert "no clip that can be read" in read, "of `..` no format can be told"
    for path in map(PurePath, touched):
        assert path.parent.parent == folder
        assert path.parent.name.startswith("motiongen-")


@given(st.text(max_size=200), st.sampled_from(["", *SUFFIXES]))
def test_a_shown_name_is_one_short_printable_part_with_its_suffix(name: str, suffix: str) -> None:
    shown = shown_name(name + suffix)
    assert len(shown) <= 60
    assert shown.isprintable()
    assert not set(shown) & set("/\\")
    if suffix:
        assert shown.endswith(suffix)
    assert shown_name(shown) == shown


@given(st.text(max_size=200), st.sampled_from(SUFFIXES))
def test_a_file_at_the_visitors_is_named_by_letters_and_digits(name: str, suffix: str) -> None:
    named = file_name(CLIP.replace(name=name), suffix)
    stem = named.removesuffix(suffix)
    assert named == stem + suffix
    assert stem
    assert not stem.startswith(".")
    assert all(letter.isalnum() or letter in "-_." for letter in stem)


def test_motions_in_memory_leave_no_file_under_their_name(touched: list[str]) -> None:
    for name in NAMES:
        assert file_bytes(CLIP.replace(name=name), ".npz")
    assert {PurePath(path).name for path in touched} <= {"motion.npz"}
