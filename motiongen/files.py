"""Opening files for reading, and writing files and folders whole or not at all, with mistakes said in one line."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from motiongen.errors import MotionGenError, nearest_of

TEMPORARY = ".motiongen-"
"""What names begin with until a file or folder is complete; what a killed process has left under one may be removed."""


def open_to_read(path: str | Path) -> BinaryIO:
    """Open a regular file for reading bytes.

    Raises:
        MotionGenError: if there is no such file, it is a directory or a device, or it may not be read.
    """
    path = Path(path)
    try:
        kind = path.stat().st_mode  # before opening: opening a pipe would wait for its other end
        if stat.S_ISREG(kind):
            return path.open("rb")
    except FileNotFoundError:
        raise MotionGenError(f"{path}: there is no such file{_nearest_file(path)}; check the path") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        raise MotionGenError(f"{path}: cannot be read ({_reason(error)}); check the path and its permissions") from None
    what = "a directory" if stat.S_ISDIR(kind) else "a device or a pipe"
    raise MotionGenError(f"{path}: this is {what}, not a file; name a regular file")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`, of the same suffix, that takes its place when the block ends without an error.

    For writers that want a path; `atomic_write` serves those that want an open file. If the block raises, the temporary
    file is removed and whatever stood at `path` stays as it was. A symbolic link is followed, not replaced.

    Raises:
        MotionGenError: if the folder does not exist or is not writable, `path` is no regular file, or the block raises
            an `OSError`, such as on a full disk.
    """
    try:
        target = _target(path)
        temporary = _beside(target, target.suffix)
        try:
            yield temporary
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise MotionGenError(f"{path}: cannot be written ({_reason(error)}); choose another place") from error


@contextmanager
def atomic_write(path: str | Path) -> Iterator[BinaryIO]:
    """A binary file that appears at `path`, complete, when the block ends without an error (see `atomic_path`)."""
    with atomic_path(path) as temporary, temporary.open("xb") as file:
        yield file


@contextmanager
def new_folder(path: str | Path, *, parents: bool = False, replacing: bool = False) -> Iterator[Path]:
    """A temporary folder beside `path` that becomes `path` when the block ends without an error, else disappears.

    Args:
        path: where; nothing, or an empty folder.
        parents: whether the folders above are made as well.
        replacing: whether another folder may stand there; it stays until the new one takes its place.

    Raises:
        MotionGenError: if something is there that must not be, the folder above does not exist, or the block raises an
            `OSError`, such as on a full disk.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.exists() and not (target.is_dir() and (replacing or not any(target.iterdir()))):
            raise MotionGenError(f"{path}: this exists and cannot be written over; remove it, or choose another place")
        if parents:
            target.parent.mkdir(parents=True, exist_ok=True)
        if not target.parent.is_dir():
            raise MotionGenError(f"{path}: the folder '{target.parent}' does not exist; make it first")
        temporary = _beside(target)
        temporary.mkdir()
        try:
            yield temporary
            _move_folder(temporary, target, replacing)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise MotionGenError(f"{path}: cannot be written ({_reason(error)}); choose another place") from error


def _move_folder(folder: Path, target: Path, replacing: bool) -> None:
    """Rename a folder to `target`; what may be replaced there is put aside meanwhile."""
    if not (replacing and target.exists()):
        with suppress(FileNotFoundError):
            target.rmdir()  # an empty one: not all systems rename over it
        folder.rename(target)
        return
    aside = _beside(target)
    target.rename(aside)
    try:
        folder.rename(target)
    except OSError:
        aside.rename(target)
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _beside(target: Path, suffix: str = "") -> Path:
    """A name that nothing has, in the same folder."""
    return target.with_name(f"{TEMPORARY}{secrets.token_hex(8)}{suffix}")


def _target(path: str | Path) -> Path:
    """Where `path` leads in the end, checked to be a place for a regular file."""
    try:
        target = Path(os.path.realpath(path))
        kind = target.stat().st_mode
    except FileNotFoundError:
        if target.parent.is_dir():
            return target
        raise MotionGenError(f"{path}: the folder '{target.parent}' does not exist; make it first") from None
    except ValueError as error:  # a NUL character
        raise MotionGenError(f"{str(path)!r}: cannot be written ({error}); choose another name") from None
    if stat.S_ISREG(kind):
        return target
    what = "a directory" if stat.S_ISDIR(kind) else "a device or a pipe"
    raise MotionGenError(f"{path}: this is {what}; name a regular file")


def _nearest_file(path: Path) -> str:
    try:
        return nearest_of(path.name, (entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ""


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
