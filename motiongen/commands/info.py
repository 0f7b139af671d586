"""`motiongen info CLIP`: what is in a file, and what is odd about it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from motiongen import io
from motiongen.commands.arguments import Parser, add_reading_arguments
from motiongen.contact import contact_labels, foot_joints
from motiongen.motion import Motion
from motiongen.quality import measure_quality


def run(arguments: Sequence[str]) -> None:
    """Print a table, or JSON with `--json`."""
    parser = Parser(prog="motiongen info", description="What is in a clip, and what is odd about it.")
    parser.add_argument("clip", nargs="+", help="a clip; its suffix tells the format: " + ", ".join(io.formats()))
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument(
        "--levels", action="store_true", help="draw the skeleton at all levels of MoDi's networks, coarsest first"
    )
    add_reading_arguments(parser)
    options = parser.parse_args(arguments)
    if options.levels:
        clips = [(path, io.load(path, up=options.up, unit=options.unit)) for path in options.clip]
        print("\n\n".join("\n".join([path, *levels(clip)]) for path, clip in clips))
        return
    facts = [describe(io.load(path, up=options.up, unit=options.unit), path) for path in options.clip]
    if options.json:
        print(json.dumps(facts[0] if len(facts) == 1 else facts, indent=2))
        return
    print("\n\n".join(_table(each) for each in facts))


def levels(motion: Motion) -> list[str]:
    """The skeleton at all levels that MoDi's networks have by default, as lines of text."""
    from motiongen.generators.modi.hierarchy import build_hierarchy
    from motiongen.generators.modi.hierarchy import describe as drawn
    from motiongen.generators.modi.options import NetworkOptions

    return drawn(build_hierarchy(motion.skeleton, foot_joints(motion), NetworkOptions()))


def describe(motion: Motion, path: str) -> dict[str, Any]:
    """What there is to say of a clip, as plain data."""
    skeleton = motion.skeleton
    names = skeleton.names
    feet = foot_joints(motion)
    labels = contact_labels(motion, feet)  # (T, C)
    return {
        "file": path,
        "frames": len(motion),
        "frame_rate_hz": motion.frame_rate,
        "duration_seconds": motion.duration,
        "joints": len(skeleton),
        "end_sites": len(skeleton.end_sites),
        "root": names[motion.root],
        "up": motion.up,
        "unit": motion.unit,
        "height": skeleton.height,
        "moving_translations": [names[j] for j in motion.translating],
        "contacts": {names[j]: float(labels[:, c].mean()) for c, j in enumerate(feet)},
        "quality": measure_quality(motion, feet).to_dict(),
        "notes": list(motion.notes),
        "joint_names": list(names),
    }


def _table(facts: dict[str, Any]) -> str:
    quality = facts["quality"]
    skate_unit = "cm/s" if quality["foot_skate_cm_per_second"] is not None else "heights/s"
    skate = quality["foot_skate_cm_per_second"] or quality["foot_skate_heights_per_second"]
    turn, joint = quality["largest_step_degrees"], quality["largest_step_degrees_joint"]
    rows = [
        ("frames", f"{facts['frames']} at {facts['frame_rate_hz']:g} Hz, {facts['duration_seconds']:.2f} s"),
        ("joints", f"{facts['joints']}, {facts['end_sites']} end sites"),
        ("root joint", facts["root"]),
        ("up axis", facts["up"]),
        ("unit", facts["unit"] or "unknown"),
        ("height", f"{facts['height']:.4g} {facts['unit'] or 'units'} (longest side of the rest pose)"),
        ("moving translations", ", ".join(facts["moving_translations"]) or "none"),
        ("contacts", ", ".join(f"{n} {share:.0%}" for n, share in facts["contacts"].items()) or "no feet found"),
        ("foot skate", "-" if skate is None else f"{skate:.2f} {skate_unit}"),
        ("jitter", _number(quality["jitter_heights_per_second_cubed"], "heights/s³")),
        (
            "largest turn",
            "-" if turn is None else f"{turn:.1f}° in a frame, {joint}, at {quality['largest_step_degrees_frame']}",
        ),
        ("penetration", _number(quality["penetration_heights"], "heights")),
    ]
    width = max(len(name) for name, _ in rows)
    lines = [facts["file"], *(f"  {name:<{width}}  {text}" for name, text in rows)]
    lines += [f"  {'odd' if i == 0 else '':<{width}}  {note}" for i, note in enumerate(facts["notes"])]
    return "\n".join(lines)


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.3g} {unit}"
