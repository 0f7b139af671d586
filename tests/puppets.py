"""Figures whose joints go where a test says, and real clips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]


def puppet(paths: dict[str, Array], frame_rate: float = 30.0, **settings: Any) -> Motion:
    """A figure of height 1 over the ground y = 0, with joints below its hips that move along the given world paths."""
    frames = len(next(iter(paths.values())))
    hips = np.tile([0.0, 0.5, 0.0], (frames, 1))
    hips[:, 0] = np.mean([path[:, 0] for path in paths.values()], axis=0)
    names = ("Hips", "Head", *paths)
    skeleton = Skeleton(
        names,
        (-1, *[0] * (len(names) - 1)),
        np.array([[0.0, 0.5, 0.0], [0.0, 0.5, 0.0], *([[0.0, -0.5, 0.0]] * len(paths))]),
    )
    translations = np.stack([hips, *(path - hips for path in paths.values())], axis=1)
    rotations = np.tile(rot.IDENTITY, (frames, len(names), 1))
    return Motion(skeleton, rotations, translations, (0, *range(2, len(names))), frame_rate, **settings)


def still(*point: float, frames: int = 60) -> Array:
    """(T, 3) a path that stays where it is."""
    return np.tile(np.array(point, dtype=float), (frames, 1))


def step_path(seconds: Array, phase: float, lift: float = 0.12, stride: float = 0.7) -> tuple[Array, NDArray[np.bool_]]:
    """A foot that stands for 0.6 s and swings for 0.4 s, and when it stands: (T, 3) and (T,)."""
    cycle, within = np.divmod(seconds + phase, 1.0)
    swing = np.clip((within - 0.6) / 0.4, 0.0, 1.0)
    path = np.zeros((len(seconds), 3))
    path[:, 0] = stride * (cycle + (1 - np.cos(np.pi * swing)) / 2)
    path[:, 1] = lift * np.sin(np.pi * swing)
    return path, within < 0.6


def walker(frame_rate: float, ankle: float = 0.0, lift: float = 0.12) -> Motion:
    """Four seconds of two feet that take turns; with `ankle` they are that high, and toes go below the left one."""
    seconds = np.arange(round(4 * frame_rate)) / frame_rate
    raised = np.array([0.0, ankle, 0.0])
    paths = {
        name: step_path(seconds, phase, lift)[0] + raised for name, phase in (("LeftFoot", 0.0), ("RightFoot", 0.5))
    }
    if ankle:
        paths["Toes"] = np.minimum(step_path(seconds, 0.0)[0], [np.inf, 0.02, np.inf])
    return puppet(paths, frame_rate)


def load_clip(path: Path) -> Motion:
    """The clip in a file; the test is skipped where there is none."""
    from motiongen import io

    if not path.is_file():
        pytest.skip(f"real clips are not part of the project; there is no {path.name}")
    return io.load(path)
