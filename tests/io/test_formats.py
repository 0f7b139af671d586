"""The registry of formats: suffixes, and what is said about paths that lead nowhere."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from motiongen import io
from motiongen.errors import MotionGenError
from motiongen.io import FORMATS, formats, load, save
from tests.io.bvh_texts import walker, write_text

OURS = tuple(suffix for suffix in formats() if suffix != ".fbx")
"""Formats that need no other program; tests/blender has the other."""


def test_every_format_round_trips_and_reads_in_any_case(tmp_path: Path) -> None:
    motion = load(write_text(tmp_path / "walk.bvh", walker()))
    for suffix in OURS:
        path = tmp_path / f"walk{suffix.upper()}"
        save(motion, path)
        assert load(path).allclose(motion, tolerance=1e-6)
        assert load(str(path)).name == "walk"
        motion.save(path)


def test_the_registry_names_functions_that_exist() -> None:
    for known in FORMATS:
        assert known.suffix.startswith(".")
        assert known.suffix == known.suffix.lower()
        for where in (known.reader, known.writer):
            assert callable(io._function(where))


def test_listing_formats_imports_no_format() -> None:
    code = (
        "import sys, motiongen.io as io; io.formats(); print([m for m in sys.modules if m.startswith('motiongen.io.')])"
    )
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert printed.strip() == "[]"


def test_reading_and_writing_import_nothing_heavy(tmp_path: Path) -> None:
    path = write_text(tmp_path / "walk.bvh", walker())
    code = (
        f"import sys, motiongen.io as io; m = io.load({str(path)!r}); io.save(m, {str(tmp_path / 'o.bvh')!r});"
        "print([m for m in ('scipy', 'torch', 'hydra', 'matplotlib') if m in sys.modules])"
    )
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert printed.strip() == "[]"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("clip.abc", "the suffix '.abc' is no format of motions; use one of .bvh, .glb, .fbx, .npz"),
        ("clip.bhv", "the suffix '.bhv' is no format of motions; use one of .bvh, .glb, .fbx, .npz"),
        ("clip", "no suffix is no format of motions; use one of .bvh, .glb, .fbx, .npz"),
    ],
)
def test_an_unknown_suffix_lists_the_known_ones(tmp_path: Path, name: str, words: str) -> None:
    motion = load(write_text(tmp_path / "walk.bvh", walker()))
    with pytest.raises(MotionGenError, match=words):
        load(tmp_path / name)
    with pytest.raises(MotionGenError, match=words):
        save(motion, tmp_path / name)


@pytest.mark.parametrize("suffix", OURS)
def test_a_path_that_leads_nowhere_costs_one_line(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / f"walk{suffix}").touch()
    os.mkfifo(tmp_path / f"pipe{suffix}")
    for name, words in (
        (f"wlak{suffix}", f"there is no such file; did you mean 'walk{suffix}'.*; check the path"),
        (f"nowhere/at/all{suffix}", "there is no such file; check the path"),
        (f"folder{suffix}", "this is a directory, not a file; name a regular file"),
        (f"pipe{suffix}", "this is a device or a pipe, not a file; name a regular file"),
        (f"walk{suffix}/below{suffix}", "cannot be read .*; check the path"),
        (f"nul\0{suffix}", "cannot be read .*; check the path"),
    ):
        with pytest.raises(MotionGenError, match=words) as raised:
            load(tmp_path / name)
        assert "\n" not in str(raised.value)


def test_options_are_checked_before_the_file_is_looked_for() -> None:
    with pytest.raises(MotionGenError, match=r"up must be 'y' or 'z', or left out to detect it, not 'x'"):
        load("nowhere.bvh", up="x")
    with pytest.raises(MotionGenError, match=r"unit must be one of m, cm, .*, or left out to guess it, not 'mile'"):
        load("nowhere.bvh", unit="mile")
