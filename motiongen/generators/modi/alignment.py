"""Clips as MoDi's networks see them: on the checkpoint's rig, at its rate, in windows that face +z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.datasets import EntityLayout, from_entities, to_entities
from motiongen.datasets.entities import choose_signs, heading_radians, turn_about_up
from motiongen.datasets.rig import Rig, fit
from motiongen.errors import MotionGenError
from motiongen.generators.modi.checkpoint import Card
from motiongen.motion import Motion
from motiongen.stance import facing

Floats = NDArray[np.float32]

ALIKE = 5e-3
"""Bones that differ by less than this, in skeleton heights, are not worth a word."""


@dataclass(frozen=True, eq=False)
class Track:
    """A whole clip as entities of a checkpoint, in the world of the clip.

    Attributes:
        card: of the checkpoint.
        name: of the clip.
        entities: (T, E, 4) as the dataset has them, not standardised.
        headings: (T,) of the body in radians.
        places: (T, 3) of the root, in the clip's own unit.
        unit: that unit, if known.
        report: what was done to the clip, in words.
    """

    card: Card
    name: str
    entities: Floats
    headings: Floats
    places: NDArray[np.float64]
    unit: str | None
    report: tuple[str, ...]

    def __len__(self) -> int:
        """The number of frames T."""
        return len(self.entities)

    def starts(self, frames: int) -> tuple[int, ...]:
        """First frames of the windows that cover the clip; the last one overlaps the one before where it must.

        Raises:
            MotionGenError: if the clip is shorter than one.
        """
        if len(self) < frames:
            raise MotionGenError(
                f"'{self.name}' has {len(self)} frames at {self.card.frame_rate:g} Hz where a window has {frames}; "
                "give a longer clip (what is missing would be made up, not inverted)"
            )
        last = len(self) - frames
        return tuple(sorted({*range(0, last + 1, frames), last}))

    def window(self, start: int, frames: int) -> Floats:
        """(frames, E, 4) from `start` on, facing +z in its first frame, with signs as in training."""
        return facing_ahead(self.card, self.entities[start : start + frames], float(self.headings[start]))

    def cut(self, most: int | None = None) -> Cut:
        """The windows that cover the clip, or the first `most` of them.

        Raises:
            MotionGenError: if the clip is shorter than one.
        """
        frames = self.card.network.frames
        starts = self.starts(frames)[:most]
        overlap = " (the last two overlap)" if len(starts) > 1 and starts[-1] - starts[-2] < frames else ""
        count = "1 window" if len(starts) == 1 else f"{len(starts)} windows"
        return Cut(
            np.stack([self.window(start, frames) for start in starts]),
            tuple(f"{self.name}_{start:04d}" for start in starts),
            (
                *self.report,
                f"{count} of {frames} frames from the clip's {len(self)}{overlap}",
                *map(self._placement, starts),
            ),
        )

    def _placement(self, start: int) -> str:
        """What was done to the window that begins there, in words."""
        turned, place, unit = -np.degrees(self.headings[start]), self.places[start], self.unit or "units"
        return (
            f"window from frame {start}: turned by {turned:.0f} degrees about the up axis, its root's start moved from "
            f"({place[0]:.3g}, {place[2]:.3g}) {unit} to the origin"
        )


@dataclass(frozen=True, eq=False)
class Cut:
    """Windows of a clip.

    Attributes:
        windows: (N, T, E, 4) of entities.
        names: (N,) of the clip with the first frame.
        report: what was done to the clip and each window, in words.
    """

    windows: Floats
    names: tuple[str, ...]
    report: tuple[str, ...]


def bring(card: Card, motion: Motion) -> Track:
    """A clip on the checkpoint's rig at its rate, as an import into its dataset would make it.

    Joints that the checkpoint does not have are left out; bones of other lengths keep their rotations, and the root its
    way in skeleton heights.

    Raises:
        MotionGenError: if its skeleton is another; the message says in what.
    """
    ours = card.layout.skeleton
    if missing := [name for name in ours.names if name not in motion.skeleton.names]:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise _stranger(motion, f"it lacks joint '{missing[0]}'{more}")
    try:
        fitted = fit(motion.resample(card.frame_rate), Rig(card.layout, ours.names, card.unit))
    except MotionGenError as error:
        raise _stranger(motion, str(error)) from error
    report = []
    if motion.frame_rate != card.frame_rate:
        report.append(f"resampled from {motion.frame_rate:g} to {card.frame_rate:g} Hz")
    if others := [name for name in motion.skeleton.names if name not in ours.names]:
        report.append(f"without the joints that the checkpoint does not have: {', '.join(others)}")
    if fitted.bones > ALIKE:
        report.append(f"on the checkpoint's bones, which differ by up to {fitted.bones:.1%} of the height")
    return Track(
        card,
        motion.name,
        to_entities(fitted.motion, card.layout).astype(np.float32),
        heading_radians(facing(fitted.motion)).astype(np.float32),
        fitted.motion.positions[:, 0],
        motion.unit,
        tuple(report),
    )


def facing_ahead(card: Card, entities: Floats, heading_radians: float) -> Floats:
    """(T, E, 4) entities turned back by a heading, each joint's sign near its mean rotation in the first frame."""
    window = entities[None].copy()
    turn_about_up(window, card.layout, np.array([-heading_radians]))
    choose_signs(window, card.layout, card.mean[card.layout.joints])
    ahead: Floats = window[0]
    return ahead


def standardised(card: Card, entities: NDArray[np.floating]) -> Floats:
    """(..., E, 4) entities as the networks take them."""
    scaled: Floats = ((entities - card.mean) / card.deviation).astype(np.float32)
    return scaled


def motions_of(card: Card, windows: Sequence[Floats], names: Sequence[str]) -> tuple[Motion, ...]:
    """The motions of windows (T, E, 4) of entities, on the checkpoint's skeleton."""
    layout: EntityLayout = card.layout
    return tuple(from_entities(each, layout, card.frame_rate, card.unit, name) for each, name in zip(windows, names))


def _stranger(motion: Motion, reason: str) -> MotionGenError:
    return MotionGenError(
        f"'{motion.name}' has another skeleton than the checkpoint: {reason}; only clips on the skeleton that it was "
        "trained on have codes"
    )
