"""What skeletal parts are for (GenMM Fig. 7): `python -m tools.parts_demo CLIP... [--picture OUT.png]`.

CLIPs show both arms raised together. Printed is the share of frames in which just one hand is up, in the examples, in
syntheses of the whole body, and in syntheses by parts. A hand is up while it is above its own shoulder.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

import motiongen as mg
from motiongen.mirror import counterparts
from motiongen.render import film_strip
from motiongen.report import markdown_table


def one_hand_up(motion: mg.Motion) -> np.ndarray:
    """(T,) True where exactly one of the two hands is above its shoulder."""
    names = motion.skeleton.names
    pairs = counterparts(motion.skeleton)
    hand = next(j for j, name in enumerate(names) if "hand" in name.lower() and pairs[j] != j)
    up = []
    for joint in (hand, pairs[hand]):
        shoulder = next(j for j in reversed(motion.skeleton.ancestors(joint)) if "shoulder" in names[j].lower())
        up.append(motion.positions[:, joint, 1] > motion.positions[:, shoulder, 1])
    return up[0] ^ up[1]


def share(motions: Sequence[mg.Motion]) -> float:
    """Share of all frames with one hand up."""
    return float(np.concatenate([one_hand_up(motion) for motion in motions]).mean())


def main() -> None:
    """Print the table, and draw the example and one synthesis of each kind."""
    parser = argparse.ArgumentParser(prog="python -m tools.parts_demo", description=__doc__)
    parser.add_argument("clips", nargs="+")
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--picture", help="film strip to write")
    options = parser.parse_args()
    clips = [mg.load(path) for path in options.clips]
    generator = mg.create("genmm").fit(clips)
    frames = 2 * sum(map(len, clips))
    whole = generator.sample(frames, options.seeds, seed=0)
    parts = generator.sample(frames, options.seeds, seed=0, constraints=[mg.Parts()])
    rows = [["what", "frames with just one hand up"]]
    rows += [
        [name, f"{share(motions):.1%}"]
        for name, motions in (("examples", clips), ("whole body", whole), ("parts", parts))
    ]
    print("\n".join(markdown_table(rows)))
    print(f"\n{options.seeds} seeds of {frames} frames from {len(clips)} clips.")
    if options.picture:
        most = max(parts, key=lambda motion: one_hand_up(motion)[:300].mean())
        film_strip([clips[0], whole[0][:300], most[:300]], ["example", "whole body", "parts"]).save(options.picture)


if __name__ == "__main__":
    main()
