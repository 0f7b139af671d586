"""Several clips side by side as an animation, or as a film strip."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from motiongen import files
from motiongen.errors import MotionGenError, nearest_of
from motiongen.motion import Motion
from motiongen.render import draw, schedule, video
from motiongen.render.camera import Frame, focal_length
from motiongen.render.palette import SEAM
from motiongen.render.player import write_player
from motiongen.render.stage import Panel, cast, views
from motiongen.render.strip import checked_labels, checked_supersample, film_strip

Progress = Callable[[float], None]

SUFFIXES = (".mp4", ".gif", ".png", ".html")
"""What `render_clips` can write."""

_SMALLEST, _LARGEST = 48, 8192


def render_clips(
    motions: Sequence[Motion],
    path: str | Path,
    *,
    labels: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    frame_rate: float | None = None,
    seconds: float | None = None,
    supersample: int = 3,
    progress: Progress | None = None,
) -> Path:
    """Show clips side by side, as stick figures on a ground, and write them to a file.

    Clips play in real time. At every moment each clip shows its nearest frame, as it is: nothing is blended, smoothed
    or filtered, and only the camera's own track is calmed where it follows. A clip that is over stays on its last pose,
    in grey. All clips share one kind of camera: fixed where that leaves the figures large enough, else following. Clips
    of skeletons of about one height share one scale; where units differ, each is scaled by its skeleton's height.

    Args:
        motions: the clips, in order, one panel each.
        path: where to write; the suffix chooses `.mp4` (needs the extra `video`), `.gif`, `.png` (a film strip) or
            `.html` (a page that plays them, see `player.write_player`).
        labels: what to write above each clip; by default the clips' names.
        size: width and height of the whole picture in pixels, all panels together; by default as many pixels as the
            panels need. An MP4 has even sides: odd ones grow by a pixel. A film strip is made to fit inside.
        frame_rate: pictures a second; by default the fastest clip's, divided by a whole number to at most 30 for MP4
            and 15 for GIF. Not for `.png` and `.html`.
        seconds: how much of each clip to show; by default all of it.
        supersample: samples a pixel, in each direction, where edges are drawn.
        progress: called after every picture with the share done, 0 to 1.

    Returns:
        The path written to. The file appears there complete, or not at all.

    Raises:
        MotionGenError: if an argument is out of range, the suffix is none of these, the extra `video` is missing for an
            MP4, or the file cannot be written. Arguments are checked before anything is drawn.
    """
    path = Path(path)
    suffix = _checked_suffix(path, frame_rate, size)
    if suffix == ".html":
        return write_player(motions, path, labels, seconds)
    with files.atomic_path(path) as temporary:
        if (kind := video.KINDS.get(suffix)) is None:
            strip = film_strip(motions, labels, size=size, seconds=seconds, supersample=supersample, progress=progress)
            strip.save(temporary)
            return path
        movie = build_movie(
            motions,
            labels,
            size=size,
            frame_rate=frame_rate,
            highest_rate=kind.usual_rate,
            seconds=seconds,
            supersample=supersample,
            even_sides=kind.even_sides,
        )
        kind.write(temporary, movie.pictures(progress), movie.size, movie.frame_rate)
    return path


def _checked_suffix(path: Path, frame_rate: float | None, size: tuple[int, int] | None) -> str:
    """The suffix of `path`, if it is one that can be written, at `frame_rate` and of `size` where they are given."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        came = f"'{path.suffix}'" if path.suffix else "no suffix"
        raise MotionGenError(
            f"{path}: a picture's suffix must be one of {', '.join(SUFFIXES)}, not {came}{nearest_of(suffix, SUFFIXES)}"
        )
    if suffix == ".html" and size is not None:
        raise MotionGenError("size is for pictures; an .html page fills its window: leave it out")
    if frame_rate is None:
        return suffix
    if suffix in (".png", ".html"):
        raise MotionGenError(f"frame_rate is for .mp4 and .gif; a {suffix} file has no rate of its own: leave it out")
    highest = video.KINDS[suffix].highest_rate
    if not (math.isfinite(frame_rate) and 0 < frame_rate <= highest):
        raise MotionGenError(f"frame_rate must be above 0 and at most {highest:g} Hz for {suffix}, not {frame_rate}")
    return suffix


@dataclass(frozen=True, eq=False)
class Movie:
    """Panels in rows, and when to show what.

    Attributes:
        panels: one for each clip, row by row, all of one size.
        columns: how many stand in a row.
        size: width and height of the picture in pixels.
        frame_rate: pictures a second.
        length: how many pictures there are.
    """

    panels: list[Panel]
    columns: int
    size: tuple[int, int]
    frame_rate: float
    length: int

    def picture(self, moment: int) -> Image.Image:
        """The picture at one moment (0 to `length` - 1)."""
        picture = draw.blank(self.size)
        for number, panel in enumerate(self.panels):
            row, column = divmod(number, self.columns)
            left, top = column * panel.size[0], row * panel.size[1]
            picture.paste(panel.paint(moment), (left, top))
            if column:
                picture.paste(SEAM, (left - 1, top, left + 1, top + panel.size[1]))
        return picture

    def pictures(self, progress: Progress | None = None) -> Iterator[Image.Image]:
        """The pictures, drawn one at a time as they are asked for."""
        for moment in range(self.length):
            yield self.picture(moment)
            if progress is not None:
                progress((moment + 1) / self.length)


def build_movie(
    motions: Sequence[Motion],
    labels: Sequence[str] | None = None,
    *,
    size: tuple[int, int] | None = None,
    frame_rate: float | None = None,
    highest_rate: float = 30.0,
    seconds: float | None = None,
    supersample: int = 3,
    even_sides: bool = False,
) -> Movie:
    """Everything about a movie but its pictures: see `render_clips`.

    The rate chosen by default is at most `highest_rate`. With `even_sides` odd sides grow by a pixel.

    Raises:
        MotionGenError: if an argument is out of range.
    """
    labels = checked_labels(motions, labels)
    checked_supersample(supersample)
    columns = _columns(len(motions), size)
    rows = math.ceil(len(motions) / columns)
    if size is None:
        side = 480 if len(motions) <= 2 else 400 if len(motions) <= 4 else 320
        size = (640, 480) if len(motions) == 1 else (columns * side, rows * side)
    panel_size = (int(size[0]) // columns, int(size[1]) // rows)
    if min(panel_size) < _SMALLEST or max(size) > _LARGEST:
        raise MotionGenError(
            f"size {size[0]} x {size[1]} gives panels of {panel_size[0]} x {panel_size[1]} pixels; "
            f"panels need at least {_SMALLEST} a side, and a picture has at most {_LARGEST}"
        )
    shown = [schedule.trimmed(motion, seconds) for motion in motions]
    rate = frame_rate or schedule.natural_rate(shown, highest_rate)
    frames = schedule.frames_at(shown, rate)
    actors = cast(shown, labels, frames)
    text_size = min(max(0.045 * panel_size[1], 11.0), 18.0)
    width, height = panel_size
    frame = Frame(0.04 * width, 2.2 * text_size, 0.96 * width, 0.96 * height, focal_length(max(panel_size)))
    panels = [
        Panel(actor, view, panel_size, text_size, supersample)
        for actor, view in zip(actors, views(actors, frame, rate))
    ]
    grown = (int(size[0]) + size[0] % 2, int(size[1]) + size[1] % 2) if even_sides else (int(size[0]), int(size[1]))
    return Movie(panels, columns, grown, rate, len(frames[0]))


def _columns(count: int, size: tuple[int, int] | None) -> int:
    """How many panels to put side by side: up to four, or as many as make the shorter sides of panels largest."""
    if size is None:
        return count if count <= 4 else math.ceil(math.sqrt(count))
    return max(
        range(1, count + 1), key=lambda columns: (min(size[0] // columns, size[1] // -(-count // columns)), -columns)
    )
