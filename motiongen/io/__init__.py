"""Motions from files and back. The suffix chooses the format; one small registry says which there are."""

from __future__ import annotations

from pathlib import Path

from motiongen.motion import Motion


def save(motion: Motion, path: str | Path) -> None:
    """Write `motion` to `path`."""
    raise NotImplementedError
