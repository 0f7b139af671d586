"""A film strip: poses of each clip, evenly in time, side by side in one picture."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.render import draw, schedule
from motiongen.render.camera import NEAR
from motiongen.render.figure import MARKED
from motiongen.render.ground import Ground
from motiongen.render.palette import FAINT_INK, INK, SIDES
from motiongen.render.stage import Actor, Panel, View, cast, closeups

_MOST_POSES = 64

_HEIGHT, _LOWEST, _HIGHEST = 220, 64, 2048
"""Of a row in pixels: the usual height, the least and the most."""

_LABEL = 12
"""The widest that labels may be, in times their height."""


def film_strip(
    motions: Sequence[Motion],
    labels: Sequence[str] | None = None,
    poses: int = 10,
    *,
    moments: Sequence[Sequence[int]] | None = None,
    marked: Sequence[NDArray[np.bool_] | None] | None = None,
    size: tuple[int, int] | None = None,
    seconds: float | None = None,
    supersample: int = 3,
    progress: Callable[[float], None] | None = None,
) -> Image.Image:
    """Poses of each clip, evenly in time from its first frame to its last, one clip a row.

    Each pose stands in a cell of its own, seen from the same side, distance and height as all others, with the time
    below it and, on the ground, the stretch of the root's way that leads up to it. Poses are frames of the clip as they
    are.

    Args:
        motions: the clips, one row each.
        labels: what to write beside each row; by default the clips' names.
        poses: how many poses a row shows; a clip with fewer frames shows each once.
        moments: the frames that each clip shows, ascending, in place of `poses` evenly in time.
        marked: for each clip which frames (T,), or joints at which frames (T, J), are drawn in a colour of their own;
            None marks nothing.
        size: width and height in pixels that the picture is made to fit into; by default rows are 220 pixels high and
            as wide as the figures need.
        seconds: how much of each clip to show; by default all of it.
        supersample: samples a pixel, in each direction, where edges are drawn.
        progress: called after every pose with the share done, 0 to 1.

    Raises:
        MotionGenError: if an argument is out of range.
    """
    labels = checked_labels(motions, labels)
    checked_supersample(supersample)
    if poses not in range(1, _MOST_POSES + 1):
        raise MotionGenError(f"poses must be a whole number from 1 to {_MOST_POSES}, not {poses}")
    shown = [schedule.trimmed(motion, seconds) for motion in motions]
    at = _evenly(shown, poses) if moments is None else _checked_moments(shown, moments)
    marks = _checked_marks(shown, marked)
    actors = cast(shown, labels, [np.arange(len(motion)) for motion in shown])
    rows = _fitting_rows(actors, at, marks, size, supersample)
    picture = draw.blank((max(row.width for row in rows), sum(row.height for row in rows)))
    done, total = 0, sum(len(row.moments) for row in rows)
    for number, row in enumerate(rows):
        image = row.blank(picture.width)
        for pose in range(len(row.moments)):
            row.paint(image, pose)
            done += 1
            if progress is not None:
                progress(done / total)
        picture.paste(image, (0, number * row.height))
    return picture


@dataclass(frozen=True, eq=False)
class Row:
    """One clip of a film strip.

    Attributes:
        actor: who is shown, at every frame of the clip.
        moments: (P,) the frames that are shown as poses.
        marks: (T, J) the joints that are marked.
        view: how poses are seen, in a cell whose left edge is at pixel 0.
        cell: width of a cell in pixels.
        margin: width left of the first cell, for the label.
        height: of the row in pixels.
        text_size: height of the words, in pixels.
        supersample: samples a pixel, in each direction.
    """

    actor: Actor
    moments: NDArray[np.int64]
    marks: NDArray[np.bool_]
    view: View
    cell: int
    margin: int
    height: int
    text_size: float
    supersample: int

    @property
    def width(self) -> int:
        """The width that the label, the poses and the last one's shadow take, in pixels."""
        return self.margin + self.cell * len(self.moments) + round(self.text_size)

    def blank(self, width: int) -> Image.Image:
        """The row with its label and the ground, the same from left to right, so that the cells show no seam."""
        middle = round(self.view.camera.centre[0])
        ground = Ground(self.view.camera, (middle + 1, self.height), self.view.radius, lines=False)
        picture = Image.fromarray(np.repeat(ground.paint(np.zeros(3))[:, middle:], width, axis=1))
        size = self.text_size
        label = draw.fitting(self.actor.label, size, self.margin - 1.4 * size)
        draw.write(picture, (size, self.height / 2), label, size=size, colour=INK, anchor="lm")
        return picture

    def paint(self, picture: Image.Image, pose: int) -> None:
        """Draw one pose (0 to P - 1) into its cell, its shadow falling where it will."""
        moment, left, size = self.moments[pose], self.margin + pose * self.cell, self.text_size
        camera = self.view.camera
        camera = dataclasses.replace(camera, centre=(camera.centre[0] + left, camera.centre[1]))
        stretch = self.actor.way[self.moments[max(pose - 1, 0)] : moment + 1] - self.actor.way[moment]
        pixels, depths = camera.project(stretch)
        inside = (depths > NEAR) & (np.abs(pixels[:, 0] - left - self.cell / 2) < self.cell / 2)
        draw.paint_path(picture, pixels, inside, now=len(pixels) - 1, factor=self.supersample)
        view = dataclasses.replace(self.view, camera=camera, track=self.view.track[pose : pose + 1])
        actor = self.actor.at(self.moments[pose : pose + 1])
        if self.marks[moment].any():
            actor = dataclasses.replace(actor, figure=actor.figure.marking(self.marks[moment]))
        Panel(actor, view, picture.size, size, self.supersample).paint_figure(picture, 0)
        at = (left + self.cell / 2, self.height - 0.7 * size)
        time = f"{self.actor.seconds[moment]:.2f} s"
        colour = SIDES[MARKED] if self.marks[moment].all() else FAINT_INK
        draw.write(picture, at, time, size=0.85 * size, colour=colour, anchor="ms")


def _evenly(motions: Sequence[Motion], poses: int) -> list[NDArray[np.int64]]:
    """The frames (P,) of each clip that are shown, evenly from its first to its last."""
    spread = [np.linspace(0, len(motion) - 1, min(poses, len(motion))) for motion in motions]
    return [np.unique(times.round().astype(np.int64)) for times in spread]


def _checked_moments(motions: Sequence[Motion], moments: Sequence[Sequence[int]]) -> list[NDArray[np.int64]]:
    if len(moments) != len(motions):
        raise MotionGenError(f"{len(motions)} clips need as many lists of moments; {len(moments)} came")
    for motion, frames in zip(motions, moments):
        inside = all(0 <= frame < len(motion) for frame in frames)
        if not (1 <= len(frames) <= _MOST_POSES and inside and list(frames) == sorted(set(frames))):
            raise MotionGenError(
                f"the moments of '{motion.name}' must be 1 to {_MOST_POSES} ascending frames from 0 to "
                f"{len(motion) - 1}, not {list(frames)}"
            )
    return [np.array(frames, dtype=np.int64) for frames in moments]


def _checked_marks(
    motions: Sequence[Motion], marked: Sequence[NDArray[np.bool_] | None] | None
) -> list[NDArray[np.bool_]]:
    """(T, J) for each clip the joints that are marked."""
    marked = [None] * len(motions) if marked is None else marked
    if len(marked) != len(motions):
        raise MotionGenError(f"{len(motions)} clips need as many entries in marked; {len(marked)} came")
    marks = []
    for motion, given in zip(motions, marked):
        shape = (len(motion), len(motion.skeleton))
        mask = np.zeros(len(motion), dtype=bool) if given is None else np.asarray(given, dtype=bool)
        if mask.shape not in (shape, shape[:1]):
            raise MotionGenError(
                f"what is marked of '{motion.name}' must have the shape {shape[:1]} or {shape}, not {mask.shape}"
            )
        marks.append(np.broadcast_to(mask.reshape(*mask.shape, *[1] * (2 - mask.ndim)), shape))
    return marks


def _fitting_rows(
    actors: Sequence[Actor],
    moments: Sequence[NDArray[np.int64]],
    marks: Sequence[NDArray[np.bool_]],
    size: tuple[int, int] | None,
    supersample: int,
) -> list[Row]:
    """The rows of a strip: of the usual height, or as high as fits into `size`."""
    if size is None:
        return _rows(actors, moments, marks, _HEIGHT, supersample)
    height = min(int(size[1]) // len(actors), _HIGHEST)
    while height >= _LOWEST:
        rows = _rows(actors, moments, marks, height, supersample)
        widest = max(row.width for row in rows)
        if widest <= size[0]:
            return rows
        height = min(height - 1, int(height * max(size[0] / widest, 0.5)))
    raise MotionGenError(
        f"size {size[0]} x {size[1]} is too small for {len(actors)} rows of {max(len(m) for m in moments)} poses, "
        f"which are at least {_LOWEST} pixels high; make it larger or leave it out"
    )


def _rows(
    actors: Sequence[Actor],
    moments: Sequence[NDArray[np.int64]],
    marks: Sequence[NDArray[np.bool_]],
    height: int,
    supersample: int,
) -> list[Row]:
    size = min(max(0.065 * height, 10.0), 16.0)
    cell, views = closeups(actors, moments, height, top=0.04 * height, bottom=2.4 * size)
    longest = max(draw.font(size).getlength(actor.label) for actor in actors)
    margin = round(min(longest, _LABEL * size) + 2 * size)
    return [
        Row(actor, moment, mark, view, cell, margin, height, size, supersample)
        for actor, moment, mark, view in zip(actors, moments, marks, views)
    ]


def checked_labels(motions: Sequence[Motion], labels: Sequence[str] | None) -> list[str]:
    """A label for every clip: those given, else the clips' names.

    Raises:
        MotionGenError: if there is no clip, or their number is not that of the labels.
    """
    if not motions:
        raise MotionGenError("there is nothing to show: give at least one clip")
    if labels is None:
        return [motion.name for motion in motions]
    if len(labels) != len(motions):
        raise MotionGenError(f"{len(motions)} clips need as many labels; {len(labels)} came")
    return [str(label) for label in labels]


def checked_supersample(supersample: int) -> int:
    """`supersample`, if it is a whole number from 1 to 8.

    Raises:
        MotionGenError: if it is not.
    """
    if supersample not in range(1, 9):
        raise MotionGenError(f"supersample must be a whole number from 1 to 8, not {supersample}")
    return supersample
