"""`motiongen render CLIP... OUT`: clips side by side as a video, an animated GIF, a film strip or a page that plays."""

from __future__ import annotations

from collections.abc import Sequence

from motiongen import io
from motiongen.commands.arguments import Parser, add_reading_arguments
from motiongen.console import progress_bar
from motiongen.render import render_clips


def run(arguments: Sequence[str]) -> None:
    """Read the clips and draw them."""
    parser = Parser(prog="motiongen render", description="Draw clips side by side as stick figures.")
    parser.add_argument("clips", nargs="+", metavar="CLIP", help="the clips to read")
    parser.add_argument("out", help="what to write: .mp4, .gif, .png for a film strip, or .html")
    add_reading_arguments(parser)
    parser.add_argument("--size", help="WIDTHxHEIGHT in pixels of the whole, such as 640x480 (default: as needed)")
    parser.add_argument("--rate", type=float, help="pictures a second (default: chosen by format)")
    parser.add_argument("--seconds", type=float, help="draw only so many seconds")
    options = parser.parse_args(arguments)
    size = None
    if options.size is not None:
        width, by, height = options.size.partition("x")
        if not (by and width.isdigit() and height.isdigit()):
            parser.error(f"--size must be WIDTHxHEIGHT, such as 640x480, not '{options.size}'")
        size = (int(width), int(height))
    motions = [io.load(path, up=options.up, unit=options.unit) for path in options.clips]
    with progress_bar("drawing") as progress:
        render_clips(
            motions,
            options.out,
            size=size,
            frame_rate=options.rate,
            seconds=options.seconds,
            progress=progress,
        )
    print(options.out)
