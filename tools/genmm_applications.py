"""GenMM's applications measured: `python -m tools.genmm_applications FOLDER [--seeds 12]`.

FOLDER holds clips. For each clip and seed a loop, keys, a completed motion, a redone segment, a continuation and an
in-between are made, and the steps at their seams are set beside the example's own. Steps are per frame at the clip's
own rate: the largest turn of any joint in degrees, and the largest way of any joint in skeleton heights.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import motiongen as mg
from motiongen import rotations as rot
from motiongen.generators.base import Generator
from motiongen.report import markdown_table

Array = NDArray[np.float64]

CLIPS = ("Salsa-Dancing-6", "Baseball-Milling-Idle", "Walk-In-Circle", "xia-normal-walk", "elephant-idle1")


@dataclass(frozen=True)
class Steps:
    """(T - 1,) the largest turn in degrees and way in heights of each step of a motion."""

    turns: Array
    ways: Array

    @classmethod
    def of(cls, motion: mg.Motion) -> Steps:
        """The steps of a motion."""
        turns = rot.angle_between(motion.rotations[1:], motion.rotations[:-1]).max(axis=1)
        ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1).max(axis=1)
        return cls(np.degrees(turns), ways / motion.skeleton.height)

    def at(self, frames: Array) -> tuple[float, float]:
        """The largest turn and way of the steps into and out of `frames`."""
        steps = np.unique(np.concatenate([frames - 1, frames]).clip(0, len(self.turns) - 1))
        return float(self.turns[steps].max()), float(self.ways[steps].max())


def loop_seam(generator: Generator, clip: mg.Motion, seed: int) -> tuple[float, float]:
    """A loop played twice, each round where the one before it ended: the step over the seam."""
    loop = generator.sample(frames=len(clip) // 2, seed=seed, constraints=[mg.Loop()])[0]
    root, ground = loop.root_positions, np.array([1.0, 0.0, 1.0])
    travel = (root[-1] - root[0]) * ground
    # The step from the last frame to the first is the loop's mean of the steps beside it, as everywhere in it.
    step = 0.5 * ((root[-1] - root[-2]) + (root[1] - root[0])) * ground
    return Steps.of(mg.concatenate([loop, loop.transform(shift=travel + step)], align=False)).at(np.array([len(loop)]))


def keys(generator: Generator, clip: mg.Motion, seed: int) -> tuple[float, float]:
    """Four random poses of the clip at random times, two seconds apart or more: the steps at the keys."""
    rng = np.random.default_rng(seed)
    rate = round(clip.frame_rate)
    frames = [2 * rate * k + int(rng.integers(0, rate // 2)) for k in range(1, 5)]
    poses = {frame: clip[int(rng.integers(0, len(clip)))] for frame in frames}
    made = generator.sample(frames=11 * rate, seed=seed, constraints=[mg.Keyframes(poses)])[0]
    for frame, pose in poses.items():
        if not np.array_equal(made.rotations[frame], pose.rotations[0]):
            raise AssertionError("a key does not hold")
    return Steps.of(made).at(np.array(frames))


def segment(generator: Generator, clip: mg.Motion, seed: int) -> tuple[float, float]:
    """The middle third redone: the steps over its two seams."""
    start, stop = len(clip) // 3, 2 * len(clip) // 3
    made = generator.sample(frames=len(clip), seed=seed, constraints=[mg.Segment(clip, start, stop)])[0]
    kept = np.r_[0:start, stop : len(clip)]
    if not np.array_equal(made.rotations[kept], clip.rotations[kept]):
        raise AssertionError("a kept frame has changed")
    return Steps.of(made).at(np.array([start, stop]))


def continuation(generator: Generator, clip: mg.Motion, seed: int) -> tuple[float, float]:
    """The clip gone on from: the step over the seam."""
    made = generator.sample(frames=round(4 * clip.frame_rate), seed=seed, constraints=[mg.Continuation(clip)])[0]
    return Steps.of(mg.concatenate([clip, made], align=False)).at(np.array([len(clip)]))


def in_between(generator: Generator, clip: mg.Motion, seed: int) -> tuple[float, float]:
    """From the first third of the clip to the last, in as many frames as lie between: the steps over both seams."""
    first, last = clip[: len(clip) // 3], clip[2 * len(clip) // 3 :]
    gap = len(clip) - len(first) - len(last)
    made = generator.sample(frames=gap, seed=seed, constraints=[mg.InBetween(first, last)])[0]
    joined = mg.concatenate([first, made, last], align=False)
    return Steps.of(joined).at(np.array([len(first), len(first) + gap]))


def completion(generator: Generator, clip: mg.Motion, seed: int) -> tuple[float, float]:
    """The lower body given, mirrored in time so that the example does not have it: the largest steps of the whole."""
    below = [clip.skeleton.names[j] for j in _lower_body(clip)]
    given = clip[::-1]
    made = generator.sample(
        frames=len(given), seed=seed, constraints=[mg.FixedJoints(given, tuple(below)), mg.Parts()]
    )[0]
    joints = [clip.skeleton.index(name) for name in below]
    error = rot.angle_between(made.rotations[:, joints], given.rotations[:, joints]).max()
    if error > 1e-4:
        raise AssertionError(f"the given joints are off by {error} radians")
    steps = Steps.of(made)
    return float(steps.turns.max()), float(steps.ways.max())


def _lower_body(clip: mg.Motion) -> list[int]:
    from motiongen.contact import foot_joints

    chains = {above for foot in foot_joints(clip) for above in (*clip.skeleton.ancestors(foot), foot)}
    return sorted(chains)


APPLICATIONS = {
    "loop, seam": loop_seam,
    "keys": keys,
    "segment, seams": segment,
    "continuation, seam": continuation,
    "in-between, seams": in_between,
    "completion, anywhere": completion,
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.genmm_applications", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=12)
    options = parser.parse_args()
    rows = [["clip", "what", "turn, median", "turn, largest", "way, median", "way, largest"]]
    for name in CLIPS:
        clip = mg.load(options.folder / f"{name}.bvh")
        own, generator = Steps.of(clip), mg.create("genmm").fit([clip])
        for what, percentile in (("the example itself", 50), ("the example, 99th percentile", 99)):
            turn, way = np.percentile(own.turns, percentile), np.percentile(own.ways, percentile)
            largest = [f"{own.turns.max():.1f}°", f"{own.ways.max():.4f}"] if percentile == 50 else ["", ""]
            rows.append([name, what, f"{turn:.1f}°", largest[0], f"{way:.4f}", largest[1]])
        for what, make in APPLICATIONS.items():
            turns, ways = zip(*(make(generator, clip, seed) for seed in range(options.seeds)))
            rows.append(
                [
                    name,
                    what,
                    f"{np.median(turns):.1f}°",
                    f"{max(turns):.1f}°",
                    f"{np.median(ways):.4f}",
                    f"{max(ways):.4f}",
                ]
            )
    print("\n".join(markdown_table(rows)))
    print(f"\n{options.seeds} seeds. Keys hold, kept frames stay and given joints move to the last bit in all of them.")


if __name__ == "__main__":
    main()
