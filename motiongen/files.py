"""Opening files for reading, and writing them whole or not at all, with mistakes said in one line."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from motiongen.errors import MotionGenError, nearest_of


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
        temporary = target.with_name(f".motiongen-{secrets.token_hex(8)}{target.suffix}")
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
