"""Checks of single settings, and of what a run leaves behind, that the Hydra commands share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from motiongen.errors import MotionGenError


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
