"""Files appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from motiongen.errors import MotionGenError
from motiongen.files import atomic_path, atomic_write, new_folder, open_to_read


def write_bytes(path: Path, fail: bool = False) -> None:
    with atomic_write(path) as file:
        file.write(b"new")
        if fail:
            raise KeyboardInterrupt


def write_by_path(path: Path, fail: bool = False) -> None:
    with atomic_path(path) as temporary:
        assert temporary.suffix == path.suffix
        temporary.write_bytes(b"new")
        if fail:
            raise KeyboardInterrupt


WRITERS = pytest.mark.parametrize("write", [write_bytes, write_by_path])


@WRITERS
def test_a_file_appears_with_usual_permissions_and_nothing_beside_it(
    tmp_path: Path, write: Callable[..., None]
) -> None:
    (tmp_path / "usual").touch()
    write(tmp_path / "file.txt")
    assert (tmp_path / "file.txt").read_bytes() == b"new"
    assert (tmp_path / "file.txt").stat().st_mode == (tmp_path / "usual").stat().st_mode
    assert len(list(tmp_path.iterdir())) == 2


@WRITERS
@pytest.mark.parametrize("before", [None, b"old"])
def test_after_a_failure_all_is_as_before(tmp_path: Path, write: Callable[..., None], before: bytes | None) -> None:
    path = tmp_path / "file.txt"
    if before is not None:
        path.write_bytes(before)
    with pytest.raises(KeyboardInterrupt):
        write(path, fail=True)
    assert [entry.read_bytes() for entry in tmp_path.iterdir()] == ([] if before is None else [before])


def test_until_the_block_ends_the_old_file_is_there(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    path.write_bytes(b"old")
    with atomic_write(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "target").write_bytes(b"old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_bytes(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"


def test_places_that_cannot_be_written_cost_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path, "this is a directory; name a regular file"),
        (tmp_path / "pipe", "this is a device or a pipe; name a regular file"),
        (Path("/dev/null"), "this is a device or a pipe; name a regular file"),
        (tmp_path / "no" / "file", "the folder '.*no' does not exist; make it first"),
        (tmp_path / "file" / "below", "cannot be written .*; choose another place"),
        (tmp_path / ("x" * 300), "cannot be written .*; choose another place"),
        (tmp_path / "nul\0", "cannot be written .*; choose another name"),
    ):
        with pytest.raises(MotionGenError, match=words) as raised:
            write_bytes(path)
        assert "\n" not in str(raised.value)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "pipe"]


def test_a_failure_of_the_disk_costs_one_line(tmp_path: Path) -> None:
    words = r"file: cannot be written \(No space left\); choose another place"
    with pytest.raises(MotionGenError, match=words), atomic_write(tmp_path / "file"):
        raise OSError(28, "No space left")
    assert list(tmp_path.iterdir()) == []


def tree(folder: Path) -> dict[str, bytes | None]:
    return {str(path.relative_to(folder)): None if path.is_dir() else path.read_bytes() for path in folder.rglob("*")}


def fill(path: Path, fail: BaseException | None = None, **how: bool) -> None:
    with new_folder(path, **how) as folder:
        (folder / "new").write_bytes(b"new")
        if fail:
            raise fail


@pytest.mark.parametrize("empty", [False, True])
def test_a_folder_appears_with_usual_permissions_and_nothing_beside_it(tmp_path: Path, empty: bool) -> None:
    (tmp_path / "usual").mkdir()
    if empty:
        (tmp_path / "made").mkdir()
    with new_folder(tmp_path / "made") as folder:
        (folder / "new").write_bytes(b"new")
        assert not (tmp_path / "made" / "new").exists()
    assert tree(tmp_path) == {"usual": None, "made": None, "made/new": b"new"}
    assert (tmp_path / "made").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_folder_takes_the_place_of_another_only_where_it_may(tmp_path: Path) -> None:
    path = tmp_path / "made"
    path.mkdir()
    (path / "old").write_bytes(b"old")
    before = tree(tmp_path)
    with pytest.raises(MotionGenError, match="this exists and cannot be written over"):
        fill(path)
    for fail in (KeyboardInterrupt(), ValueError()):
        with pytest.raises(type(fail)):
            fill(path, fail, replacing=True)
    assert tree(tmp_path) == before
    with pytest.raises(MotionGenError, match="this exists"):
        fill(path / "old", replacing=True)
    fill(path, replacing=True)
    assert tree(tmp_path) == {"made": None, "made/new": b"new"}


def test_a_folder_that_cannot_be_replaced_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "made"
    fill(path)
    rename, calls = Path.rename, []

    def failing_second(this: Path, target: Path) -> Path:
        calls.append(target)
        if len(calls) == 2:
            raise OSError(13, "busy")
        return rename(this, target)

    monkeypatch.setattr(Path, "rename", failing_second)
    with pytest.raises(MotionGenError, match=r"cannot be written \(busy\)"):
        fill(path, replacing=True)
    assert tree(tmp_path) == {"made": None, "made/new": b"new"}


def fill_after_others(path: Path) -> None:
    with new_folder(path):
        path.mkdir()
        (path / "theirs").write_bytes(b"theirs")


def test_what_others_have_put_there_meanwhile_stays(tmp_path: Path) -> None:
    with pytest.raises(MotionGenError, match="cannot be written"):
        fill_after_others(tmp_path / "made")
    assert tree(tmp_path) == {"made": None, "made/theirs": b"theirs"}


def test_folders_above_are_made_if_asked(tmp_path: Path) -> None:
    with pytest.raises(MotionGenError, match="does not exist; make it first"):
        fill(tmp_path / "a" / "b")
    fill(tmp_path / "a" / "b", parents=True)
    assert (tmp_path / "a" / "b" / "new").is_file()
    with pytest.raises(MotionGenError, match="cannot be written"):
        fill(tmp_path / "a" / "b" / "new" / "c", parents=True)


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read and write anything")
def test_permissions_are_named(tmp_path: Path) -> None:
    path = tmp_path / "closed"
    path.touch(mode=0)
    with pytest.raises(MotionGenError, match="Permission denied"):
        open_to_read(path)
    tmp_path.chmod(0o500)
    with pytest.raises(MotionGenError, match="Permission denied"):
        write_bytes(tmp_path / "file")
