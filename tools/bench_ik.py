"""Foot clean-up before and after: `python -m tools.bench_ik FOLDER [--seeds 4]`.

FOLDER holds real clips (`characters/`, and `bandai-namco/dataset-1.tar.xz`); those that are not there are left out, and
the bundled clip is always in. Each is cleaned itself, and GenMM makes motions of it, twice as long, from seeds 0 on,
with its option `standing_feet` on free (the synthesis as it comes), still and example. Markdown tables are printed:
means over the seeds for what is a mean, and the worst of all seeds for what is a largest.
"""

from __future__ import annotations

import argparse
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import motiongen as mg
from motiongen import rotations as rot
from motiongen.assets import EXAMPLE_CLIP
from motiongen.contact import contact_labels, foot_joints
from motiongen.ik import clean_feet
from motiongen.ik.legs import find_legs
from motiongen.quality import foot_skate, jitter, penetration
from motiongen.report import markdown_table

Array = NDArray[np.float64]
Labels = NDArray[np.bool_]

CHARACTERS = ("Walk-In-Circle", "xia-normal-walk", "Salsa-Dancing-6", "Baseball-Milling-Idle", "elephant-idle1")
WALKS = tuple(f"dataset-1_{content}_001" for content in ("walk_normal", "walk_active", "walk_old", "walk-left_normal"))


def clips_in(folder: Path) -> Iterator[mg.Motion]:
    """The clips of the tables."""
    for name in CHARACTERS:
        if (path := folder / "characters" / f"{name}.bvh").is_file():
            yield mg.load(path)
    yield mg.load(EXAMPLE_CLIP)
    archive = folder / "bandai-namco" / "dataset-1.tar.xz"
    if not archive.is_file():
        return
    with tempfile.TemporaryDirectory() as place, tarfile.open(archive) as files:
        for member in files:
            if (path := Path(place, Path(member.name).name)).stem in WALKS:
                content = files.extractfile(member)
                assert content is not None
                path.write_bytes(content.read())
        for name in WALKS:
            yield mg.load(Path(place, f"{name}.bvh"))


@dataclass(frozen=True)
class Figures:
    """Of one motion; lengths in skeleton heights. The legs are the joints that the clean-up may turn."""

    skate: float  # quality.foot_skate
    slip: float  # mean speed over the ground while a foot joint is labelled as standing, per second
    turn: float  # largest turn of a leg joint in its parent's frame, degrees a frame
    step: float  # largest way of a leg joint through the world, a frame
    shake: float  # mean third derivative of the leg joints' positions, per second cubed
    jitter: float  # the same of all joints, quality.jitter
    depth: float  # quality.penetration


def measure(motion: mg.Motion, feet: Sequence[int], labels: Labels) -> Figures:
    """The figures of a motion whose feet stand where `labels` says."""
    legs, size = leg_joints(motion, feet), motion.skeleton.height
    ground = motion.positions[:, list(feet)][..., [0, 2]]
    speed = np.linalg.norm(np.diff(ground, axis=0), axis=-1) * motion.frame_rate / size
    third = np.diff(motion.positions[:, legs], n=3, axis=0) * motion.frame_rate**3 / size
    return Figures(
        skate=foot_skate(motion, feet) or 0.0,
        slip=float(speed[labels[1:] & labels[:-1]].mean()),
        turn=float(np.degrees(rot.angle_between(motion.rotations[1:, legs], motion.rotations[:-1, legs]).max())),
        step=float(np.linalg.norm(np.diff(motion.positions[:, legs], axis=0), axis=-1).max() / size),
        shake=float(np.linalg.norm(third, axis=-1).mean()),
        jitter=jitter(motion) or 0.0,
        depth=penetration(motion),
    )


def leg_joints(motion: mg.Motion, feet: Sequence[int]) -> list[int]:
    legs = find_legs(motion, feet)
    return sorted({int(joint) for joints in (legs.hips, legs.knees, legs.feet) for joint in joints})


def seconds_of(work: Callable[[], object], repeats: int = 9) -> float:
    """The least processor time of several runs; on an idle machine that is the time that passes."""
    times = []
    for _ in range(repeats):
        begun = time.process_time()
        work()
        times.append(time.process_time() - begun)
    return min(times)


def captured_row(clip: mg.Motion, feet: Sequence[int]) -> list[str]:
    """What the clean-up does to the clip itself."""
    labels = contact_labels(clip, feet)
    cleaned = clean_feet(clip, feet)
    before, after = measure(clip, feet, labels), measure(cleaned, feet, labels)
    joints, size = leg_joints(clip, feet), clip.skeleton.height
    change = np.degrees(rot.angle_between(clip.rotations[:, joints], cleaned.rotations[:, joints]))
    lifted = (cleaned.positions - clip.positions)[:, list(feet), 1][labels] / size
    lower = (clip.root_positions - cleaned.root_positions)[:, 1].max() / size
    # A copy, so that where the joints are has to be found anew.
    seconds = seconds_of(lambda: clean_feet(clip.replace(), feet))
    return [
        f"{clip.name} ({len(clip)} frames, {len(clip.skeleton)} joints)",
        f"{before.skate:.3f} / {after.skate:.3f}",
        f"{before.slip:.3f} / {after.slip:.3f}",
        f"{change.mean():.1f} / {change.max():.0f}",
        f"{lifted.mean():+.4f}",
        f"{lower:.4f}",
        f"{before.turn:.1f} / {after.turn:.1f}",
        f"{before.shake:.0f} / {after.shake:.0f}",
        f"{before.jitter:.0f} / {after.jitter:.0f}",
        f"{seconds * 1e6 / len(clip):.0f}",
    ]


def synthesis_rows(
    clip: mg.Motion, feet: Sequence[int], syntheses: Sequence[mg.Motion], cleaned: Sequence[mg.Motion]
) -> tuple[list[str], list[str]]:
    """A row of the table of skate, and one of the table of pops."""
    own = measure(clip, feet, contact_labels(clip, feet))
    labels = [contact_labels(each, feet) for each in syntheses]
    before = [measure(each, feet, known) for each, known in zip(syntheses, labels)]
    after = [measure(each, feet, known) for each, known in zip(cleaned, labels)]

    def mean(name: str, of: Sequence[Figures]) -> float:
        return float(np.mean([getattr(each, name) for each in of]))

    def worst(name: str, of: Sequence[Figures]) -> float:
        return float(np.max([getattr(each, name) for each in of]))

    better = sum(each.skate <= own.skate for each in after)
    skate = [
        clip.name,
        f"{own.skate:.3f}",
        f"{mean('skate', before):.3f}",
        f"{mean('skate', after):.3f}",
        f"{better} of {len(after)}",
        f"{own.slip:.3f}",
        f"{mean('slip', before):.3f}",
        f"{mean('slip', after):.3f}",
    ]
    pops = [clip.name]
    for name, figure, decimals in (
        ("turn", worst, 1),
        ("step", worst, 3),
        ("shake", mean, 0),
        ("jitter", mean, 0),
        ("depth", worst, 4),
    ):
        values = (getattr(own, name), figure(name, before), figure(name, after))
        pops.append(" / ".join(f"{value:.{decimals}f}" for value in values))
    return skate, pops


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_ik", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("."))
    parser.add_argument("--seeds", type=int, default=4)
    options = parser.parse_args()

    captured = [["clip", "skate", "slip", "change of leg joints, mean / largest (°)", "feet lifted", "root lowered",
                 "largest turn (°)", "jitter of legs", "of all joints", "ms for 1,000 frames"]]  # fmt: skip
    skate_head = ["syntheses of", "skate: example", "synthesis", "cleaned", "no worse than the example",
                  "slip: example", "synthesis", "cleaned"]  # fmt: skip
    pops_head = ["example / synthesis / cleaned", "largest turn of a leg joint (°)", "largest step", "jitter of legs",
                 "of all joints", "penetration"]  # fmt: skip
    tables = {how: ([skate_head], [pops_head]) for how in ("still", "example")}
    for clip in clips_in(options.folder):
        feet = foot_joints(clip)
        captured.append(captured_row(clip, feet))
        made = {
            how: mg.create("genmm", standing_feet=how).fit([clip]).sample(2 * len(clip), options.seeds)
            for how in ("free", *tables)
        }
        for how, (skate, pops) in tables.items():
            for table, row in zip((skate, pops), synthesis_rows(clip, feet, made["free"], made[how])):
                table.append(row)
    print("## Captured clips, before / after\n")
    print("\n".join(markdown_table(captured)))
    for how, parts in tables.items():
        print(f"\n## Syntheses, standing_feet={how}\n")
        print("\n\n".join("\n".join(markdown_table(table)) for table in parts))


if __name__ == "__main__":
    main()
