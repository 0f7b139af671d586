"""One file made into what a dataset holds of it; pure work on one clip, for any process."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen import io
from motiongen.datasets.entities import heading_radians, to_entities
from motiongen.datasets.report import OTHER_FILE, OTHER_RIG, SHORT, SLOW, UNREADABLE, Dropped, Kept
from motiongen.datasets.rig import Rig, fit
from motiongen.datasets.settings import ImportSettings
from motiongen.datasets.sources import Item
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.stance import facing

SLOWEST = 0.5
"""A clip's own frame rate over the dataset's, at least: below, most frames would be made up between its poses."""


@dataclass(frozen=True)
class Prepared:
    """A clip to keep: what there is to say of it, its (T, E, 4) float32 entities and (T,) headings in radians."""

    clip: Kept
    frames: NDArray[np.float32]
    facing: NDArray[np.float32]


def load_item(item: Item, settings: ImportSettings) -> Motion:
    """Read a clip.

    Raises:
        MotionGenError: if it cannot be read; the message speaks of the item, wherever its bytes lie.
    """
    if item.problem is not None:
        raise MotionGenError(item.problem)
    if isinstance(item.content, Path):
        return io.load(item.content, up=settings.up, unit=settings.unit)
    with tempfile.TemporaryDirectory(prefix="motiongen-") as folder:
        path = Path(folder) / f"clip{item.suffix}"  # a name of our own, whatever the member is called
        path.write_bytes(item.content or b"")
        try:
            return io.load(path, up=settings.up, unit=settings.unit)
        except MotionGenError as error:
            raise MotionGenError(str(error).replace(str(path), f"{item.name}{item.suffix}")) from None


def prepare(item: Item, rig: Rig, settings: ImportSettings) -> Prepared | Dropped:
    """What the dataset holds of a file, or why it is left out."""
    name = item.name
    if not item.is_motion:
        return Dropped(name, OTHER_FILE, f"'{item.suffix}' is no format of motions")
    try:
        motion = load_item(item, settings)
    except MotionGenError as error:
        return Dropped(name, UNREADABLE, str(error))
    if motion.frame_rate < SLOWEST * settings.frame_rate:
        least = SLOWEST * settings.frame_rate
        return Dropped(name, SLOW, f"it runs at {motion.frame_rate:g} Hz, where {least:g} are needed")
    try:
        fitted = fit(motion.resample(settings.frame_rate), rig)
    except MotionGenError as error:
        return Dropped(name, OTHER_RIG, str(error))
    frames = len(fitted.motion)
    if frames < settings.frames:
        return Dropped(name, SHORT, f"it has {frames} frames, where a window has {settings.frames}")
    return Prepared(
        Kept(name, _digest(item), frames, fitted.bones, fitted.scale, fitted.held, motion.notes),
        to_entities(fitted.motion, rig.layout).astype(np.float32),
        heading_radians(facing(fitted.motion)).astype(np.float32),
    )


def _digest(item: Item) -> str:
    content = item.content.read_bytes() if isinstance(item.content, Path) else item.content
    return hashlib.sha256(content or b"").hexdigest()
