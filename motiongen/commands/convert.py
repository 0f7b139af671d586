"""`motiongen convert IN OUT`: another format, rate, unit or up axis; root motion taken out or set apart."""

from __future__ import annotations

from collections.abc import Sequence

from motiongen import io
from motiongen.commands.arguments import Parser, add_reading_arguments
from motiongen.io.glb.layout import GlbLayout
from motiongen.motion import METRES_PER_UNIT, UP_AXES, Motion
from motiongen.root_motion import in_place, split_root


def run(arguments: Sequence[str]) -> None:
    """Read a clip, change what is asked for, write it."""
    parser = Parser(prog="motiongen convert", description="Write a clip in another format, rate, unit or up axis.")
    parser.add_argument("clip", help="the clip to read")
    parser.add_argument("out", help=f"the file to write; its suffix chooses the format: {', '.join(io.formats())}")
    add_reading_arguments(parser)
    parser.add_argument("--rate", type=float, help="frame rate in Hz to resample to")
    parser.add_argument("--to-unit", choices=tuple(METRES_PER_UNIT), help="length unit to write")
    parser.add_argument("--to-up", choices=UP_AXES, help="up axis to write")
    parser.add_argument("--mirror", action="store_true", help="exchange left and right")
    parser.add_argument(
        "--root-motion",
        choices=("keep", "in-place", "split"),
        default="keep",
        help="in-place: the character stays on the spot; split: a new joint 'root' holds its way and heading",
    )
    options = parser.parse_args(arguments)
    motion = io.load(options.clip, up=options.up, unit=options.unit)
    came = motion.file_layout
    if options.rate is not None:
        motion = motion.resample(options.rate)
    if options.mirror:
        motion = motion.mirror()
    if options.root_motion == "in-place":
        motion = in_place(motion)
    elif options.root_motion == "split":
        motion = split_root(motion)
    if options.to_unit is not None:
        motion = motion.convert_unit(options.to_unit)
    if options.to_up is not None:
        motion = motion.change_up(options.to_up)
    motion.save(options.out)
    for note in _notes(motion, options.out, came):
        print(f"note: {note}")
    print(f"{options.out}: {len(motion)} frames at {motion.frame_rate:g} Hz, {len(motion.skeleton)} joints")


def _notes(motion: Motion, out: str, came: object) -> list[str]:
    """What a user may not expect of the file that was written."""
    notes: list[str] = []
    if not out.lower().endswith(".glb"):
        return notes
    if isinstance(came, GlbLayout) and motion.file_layout is None:
        notes.append("meshes and materials were not kept: they hang on the skeleton as it was")
    if motion.unit is None:
        notes.append("the unit is not known, and lengths were written as they are; GLB is in metres, so say --unit")
    return notes
