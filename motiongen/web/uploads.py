"""What a visitor sends: the bytes of a file become a motion, or are refused in one line."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path, PurePath

from motiongen import io
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.web.limits import Limits

SUFFIXES = (".bvh", ".glb", ".npz")
"""Of the files that are taken. FBX is not: it would start another program on what a stranger sent."""

_LONGEST_NAME = 60


def read_upload(name: str, content: bytes, limits: Limits) -> Motion:
    """The motion in a file that a visitor sent.

    The name only says which format it is and what to call the motion: on the disk the file has another one.

    Raises:
        MotionGenError: if it is too large, of no such format, or damaged.
    """
    shown = shown_name(name)
    suffix = PurePath(shown).suffix.lower()
    if suffix not in SUFFIXES:
        raise MotionGenError(f"'{shown}' is no clip that can be read; send one of {', '.join(SUFFIXES)}")
    if len(content) > limits.upload_bytes:
        raise MotionGenError(
            f"'{shown}' has {len(content) / 2**20:.1f} MiB; at most {limits.upload_bytes / 2**20:g} MiB are taken"
        )
    with tempfile.TemporaryDirectory(prefix="motiongen-") as folder:
        path = Path(folder, f"upload{suffix}")
        path.write_bytes(content)
        try:
            motion = io.load(path)
        except MotionGenError as error:  # the visitor knows the file by its own name
            raise MotionGenError(str(error).replace(str(path), f"'{shown}'")) from None
    check_size(motion, limits, shown)
    return motion.replace(name=PurePath(shown).stem or "clip")


def check_size(motion: Motion, limits: Limits, name: str) -> None:
    """Raise MotionGenError if a clip has more joints or frames than are taken."""
    for what, has, most in (("joints", len(motion.skeleton), limits.joints), ("frames", len(motion), limits.frames)):
        if has > most:
            raise MotionGenError(f"'{name}' has {has} {what}; at most {most} are taken")


def shown_name(name: str) -> str:
    """A name that a visitor gave, fit to be shown: its last part, printable, and not too long."""
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    printable = "".join(letter for letter in last if letter.isprintable()).strip()
    suffix = PurePath(printable).suffix[:8]
    return printable if len(printable) <= _LONGEST_NAME else printable[: _LONGEST_NAME - len(suffix)] + suffix


def file_bytes(motion: Motion, suffix: str) -> bytes:
    """A motion as a file of the format of `suffix`, such as ".bvh"."""
    return written(suffix, motion.save)


def written(suffix: str, write: Callable[[Path], object]) -> bytes:
    """What a function writes to a file whose name ends in `suffix`."""
    with tempfile.TemporaryDirectory(prefix="motiongen-") as folder:
        path = Path(folder, f"motion{suffix}")
        write(path)
        return path.read_bytes()


def file_name(motion: Motion, suffix: str) -> str:
    """What to call a motion's file at the visitor's: letters, digits, and what needs no quoting."""
    stem = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in motion.name).strip("._")
    return f"{stem or 'motion'}{suffix}"
