"""Checks of single settings, and of what a run leaves behind, that the Hydra commands share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from motiongen import io
from motiongen.errors import MotionGenError
from motiongen.generators.registry import GeneratorSpec, spec_of
from motiongen.io.glb.layout import GlbLayout
from motiongen.motion import METRES_PER_UNIT, UP_AXES, Motion


@contextmanager
def leaving_no_empty(folder: Path) -> Iterator[None]:
    """Remove the folder, which Hydra has made, if the block fails before anything is in it."""
    try:
        yield
    except BaseException:
        with suppress(OSError):  # it holds something, or another process was first
            folder.rmdir()
        raise


def whole(name: str, value: Any, least: int) -> int:
    """The setting as a whole number of at least `least`; anything else is refused."""
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise MotionGenError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return value


def positive(name: str, value: Any) -> float:
    """The setting as a positive number; anything else is refused."""
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 < value < float("inf"):
        raise MotionGenError(f"{name} must be a positive number, not {value!r}")
    return float(value)


def choice(name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """The setting, if it is one of those allowed; anything else is refused."""
    if value not in allowed:
        words = ", ".join("null" if word is None else str(word) for word in allowed)
        raise MotionGenError(f"{name} must be one of {words}, not {value!r}")
    return value


def clip_format(values: Mapping[str, Any]) -> str:
    """The suffix, without its dot, of the clips to write: the setting `format`."""
    return str(choice("format", values["format"], [suffix.lstrip(".") for suffix in io.formats()]))


def own_format(values: Mapping[str, Any]) -> str | None:
    """Likewise, where null stands for what the motions come from (see `suffix_of`)."""
    return None if values["format"] is None else clip_format(values)


def suffix_of(motion: Motion, asked: str | None) -> str:
    """The suffix that was asked for, else glb for a motion that belongs into a GLB file, and bvh for any other."""
    return asked or ("glb" if isinstance(motion.file_layout, GlbLayout) else "bvh")


def up_and_unit(values: Mapping[str, Any]) -> tuple[str | None, str | None]:
    """How clips are read: the settings `up` and `unit`, null for what the files say."""
    up, unit = choice("up", values["up"], (None, *UP_AXES)), choice("unit", values["unit"], (None, *METRES_PER_UNIT))
    return up, unit


def chosen_generator(group: Mapping[str, Any]) -> tuple[GeneratorSpec, dict[str, Any]]:
    """The generator that the group `generator` names, and what it says of the options, which is not checked yet."""
    options = dict(group)
    return spec_of(str(options.pop("name"))), options
