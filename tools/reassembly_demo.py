"""A creature of two characters: `python -m tools.reassembly_demo CHARACTERS [--output creature]`.

CHARACTERS holds `Walk-In-Circle.bvh` and `elephant-idle1.bvh`. The person of the one gets the head, trunk and ears and
the tail of the other (GenMM, sections 3.4 and 5). Writes BVH files and a film strip, and prints how far each part's
poses are from those of its own source and from those of the others on the same skeleton: a part that moved as another
source does would be far from its own.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import motiongen as mg
from motiongen import rotations as rot
from motiongen.reassembly import Assembly, PartSource, assemble
from motiongen.render import film_strip
from motiongen.report import markdown_table

RATE = 30.0


def elephant_man(folder: Path) -> Assembly:
    """The walking person with the elephant's head and tail."""
    walk = mg.load(folder / "Walk-In-Circle.bvh").resample(RATE)
    elephant = mg.load(folder / "elephant-idle1.bvh").resample(RATE)
    return assemble(
        [
            PartSource(walk, name="body"),
            PartSource(elephant, joints="Bip01_Head", replaces="mixamorig7:Head", name="head"),
            PartSource(elephant, joints="BN_Tail_01", attach="mixamorig7:Hips", name="tail"),
        ]
    )


def degrees_to_nearest(motion: mg.Motion, example: mg.Motion, joints: list[int]) -> float:
    """Mean over the frames of the angle, root mean square over `joints`, to the example's nearest pose."""
    ours, theirs = (rot.to_6d(each.rotations[:, joints]) for each in (motion, example))
    nearest = [int(((theirs - pose) ** 2).sum(axis=(1, 2)).argmin()) for pose in ours]
    apart = rot.angle_between(motion.rotations[:, joints], example.rotations[nearest][:, joints])
    return float(np.degrees(np.sqrt((apart**2).mean(axis=1))).mean())


def main() -> None:
    """Make, measure and draw."""
    parser = argparse.ArgumentParser(prog="python -m tools.reassembly_demo", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=Path("creature"))
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--count", type=int, default=4)
    options = parser.parse_args()
    creature = elephant_man(options.folder)
    generator = mg.create("genmm").fit(creature.clips)
    motions = generator.sample(options.frames, options.count, constraints=[creature.constraint])
    options.output.mkdir(parents=True, exist_ok=True)
    for motion in motions:
        motion.save(options.output / f"{motion.name}.bvh")
    rows = [["part", "joints", *(f"degrees from the clip of {part.name}" for part in creature.parts)]]
    for part in creature.parts:
        joints = list(part.joints)
        found = [
            np.mean([degrees_to_nearest(motion, clips[0], joints) for motion in motions]) for clips in creature.examples
        ]
        rows.append([part.name, str(len(joints)), *(f"{degrees:.1f}" for degrees in found)])
    print("\n".join(markdown_table(rows)))
    shown = [creature.parts[0].examples[0][: options.frames], creature.parts[1].examples[0], *motions[:2]]
    names = ["the body's clip", "the clip of head and tail", "new motion", "another"]
    film_strip(shown, names).save(options.output / "creature.png")
    print(f"\n{len(motions)} motions of {options.frames} frames and creature.png in {options.output}")


if __name__ == "__main__":
    main()
