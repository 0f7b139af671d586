"""Make the bundled clip from its original: `python -m tools.make_example 01_01.bvh`.

The original is CMU subject 1, trial 1, in Bruce Hahne's BVH conversion (see NOTICE). Its first frame is a T-pose that
is no part of the motion and is dropped; 120 Hz become 30 Hz by keeping every fourth frame.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP


def main() -> None:
    """Read, cut, write."""
    parser = argparse.ArgumentParser(prog="python -m tools.make_example", description=__doc__)
    parser.add_argument("original", help="the CMU file 01_01.bvh")
    parser.add_argument("--out", type=Path, default=EXAMPLE_CLIP)
    options = parser.parse_args()
    clip = mg.load(options.original)[1:].resample(30.0)
    options.out.parent.mkdir(exist_ok=True)
    clip.save(options.out)
    print(f"{options.out}: {len(clip)} frames at {clip.frame_rate:g} Hz, {options.out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
