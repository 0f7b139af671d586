"""Writing pictures one after the other: MP4 through ffmpeg, GIF by Pillow's coder. Neither holds all frames."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from motiongen.errors import MotionGenError
from motiongen.render.palette import gif_colours

_UNCHANGED = 255  # the palette index that lets the picture before show through


def require_ffmpeg() -> Any:
    """The module `imageio_ffmpeg`.

    Raises:
        MotionGenError: if it is not installed.
    """
    try:
        import imageio_ffmpeg
    except ImportError:
        raise MotionGenError(
            "writing .mp4 needs the extra 'video', which is not installed: "
            "pip install 'motiongen[video]'; .gif and .png work without"
        ) from None
    return imageio_ffmpeg


def write_mp4(path: Path, pictures: Iterable[Image.Image], size: tuple[int, int], frame_rate: float) -> None:
    """Stream `pictures` of an even `size` into an H.264 file at `path`, at exactly `frame_rate`.

    Raises:
        MotionGenError: if ffmpeg is missing or fails.
    """
    ffmpeg = require_ffmpeg()
    encoder = ffmpeg.write_frames(
        str(path),
        size,
        fps=frame_rate,
        codec="libx264",
        macro_block_size=2,
        quality=None,
        ffmpeg_log_level="error",
        output_params=["-crf", "20", "-preset", "veryfast", "-movflags", "+faststart"],
    )
    try:
        with closing(encoder):
            encoder.send(None)
            for picture in pictures:
                encoder.send(picture.tobytes())
    except OSError as error:
        raise MotionGenError(f"ffmpeg could not write the video: {' '.join(str(error).split())[-300:]}") from error


def write_gif(path: Path, pictures: Iterable[Image.Image], size: tuple[int, int], frame_rate: float) -> None:
    """Write an endlessly repeating GIF, each picture as the box and the pixels in which it differs from the one before.

    Delays are whole hundredths of a second. They are rounded so that the sum over the frames so far is right: at 15 Hz
    they go 7, 6, 7, and no frame is more than half a hundredth off, however long the clip.
    """
    colours = gif_colours()
    palette = Image.new("P", (1, 1))
    palette.putpalette([channel for colour in colours for channel in colour])
    table = bytes(channel for colour in colours for channel in colour).ljust(768, b"\0")
    before: NDArray[np.uint8] | None = None
    with path.open("xb") as file:
        file.write(b"GIF89a" + struct.pack("<HHBBB", *size, 0xF7, 0, 0) + table)
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")  # for ever
        for number, picture in enumerate(pictures):
            delay = round(100 * (number + 1) / frame_rate) - round(100 * number / frame_rate)
            now = np.asarray(picture.quantize(palette=palette, dither=Image.Dither.NONE))
            file.write(_gif_frame(now, before, delay))
            before = now
        file.write(b"\x3b")


def _gif_frame(now: NDArray[np.uint8], before: NDArray[np.uint8] | None, delay: int) -> bytes:
    """One frame of a GIF, of palette indices (H, W)."""
    left, top, patch = 0, 0, now
    if before is not None:
        changed = now != before
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        bounds = (rows[0], rows[-1] + 1, columns[0], columns[-1] + 1) if len(rows) else (0, 1, 0, 1)
        top, bottom, left, right = (int(bound) for bound in bounds)
        patch = np.where(changed, now, _UNCHANGED)[top:bottom, left:right].astype(np.uint8)
    height, width = patch.shape
    control = struct.pack("<BBBBHBB", 0x21, 0xF9, 4, 0b101, delay, _UNCHANGED, 0)  # keep what is there, transparency on
    place = struct.pack("<BHHHHB", 0x2C, left, top, width, height, 0)
    return control + place + _lzw(patch)


def _lzw(indices: NDArray[np.uint8]) -> bytes:
    """The compressed pixels: what Pillow writes into a GIF of this one picture, without all around it."""
    buffer = io.BytesIO()
    Image.fromarray(indices).save(buffer, "GIF", optimize=False, interlace=0)
    whole = buffer.getvalue()
    header = 13 + 3 * 2 ** ((whole[10] & 7) + 1)  # screen, then its colour table
    if whole[10] & 0x80 == 0 or whole[header] != 0x2C:
        raise RuntimeError("Pillow lays out a GIF of one grey picture in another way than expected")
    return whole[header + 10 : -1]


@dataclass(frozen=True)
class Kind:
    """How one kind of animation is written.

    Attributes:
        write: from pictures of a size at a rate to a file.
        usual_rate: pictures a second that are plenty.
        highest_rate: pictures a second that players still show as they are.
        even_sides: whether width and height must be even.
    """

    write: Callable[[Path, Iterable[Image.Image], tuple[int, int], float], None]
    usual_rate: float
    highest_rate: float
    even_sides: bool


KINDS = {
    ".mp4": Kind(write_mp4, 30.0, 240.0, even_sides=True),
    ".gif": Kind(write_gif, 15.0, 50.0, even_sides=False),  # browsers slow down delays below 2/100 s
}
"""The kinds of animation, by suffix."""
