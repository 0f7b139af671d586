"""Walks along paths, walks of their own, and endless ones: `python -m tools.genmm_locomotion FOLDER [--output DOCS]`.

FOLDER holds real clips (`characters/`, `bandai-namco/dataset-*.tar.xz`). Writes `locomotion.md` and `locomotion.png`
into the output folder. Needs matplotlib (extra `plots`).
"""

from __future__ import annotations

import argparse
import io
import re
import tarfile
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import motiongen as mg
from motiongen import rotations as rot
from motiongen.assets import EXAMPLE_CLIP
from motiongen.contact import contact_labels, foot_joints
from motiongen.files import atomic_write
from motiongen.generators.base import Generator
from motiongen.generators.genmm.locomotion import straight_examples
from motiongen.metrics import one_clip_metrics
from motiongen.quality import foot_skate, measure_quality
from motiongen.report import markdown_table
from motiongen.trajectory import follow, frames_to_follow, path_through, straightened, track_of, travel_speed
from tools import bench_stream

Array = NDArray[np.float64]

SECONDS = 9.0
SEEDS = 4

# In heights. The figure of eight ends where it begins, and so is closed; the corner's middle point is given twice.
PATHS = {
    "straight line": [[0, 0], [0, 6]],
    "S": [[0, 0], [1.5, 1.5], [-1.5, 4], [0, 5.5]],
    "figure of eight": [[0, 0], [0.7, 0.7], [1.4, 0], [0.7, -0.7], [0, 0], [-0.7, 0.7], [-1.4, 0], [-0.7, -0.7], [0, 0]
    ],
    "right angle": [[0, 0], [0, 3], [0, 3], [3, 3]],
}  # fmt: skip

TURNS = ("dataset-2_walk-turn-left_normal_002", "dataset-2_walk-turn-right_normal_002")
ARCHIVED = ("dataset-1_walk_normal_001", "dataset-1_walk-left_normal_001", "dataset-2_run_normal_003")


def archived_clips(folder: Path, names: Sequence[str]) -> dict[str, mg.Motion]:
    """Clips of the archives in `folder/bandai-namco`, each archive read once."""
    clips = {}
    with tempfile.TemporaryDirectory() as place:
        for archive in sorted({name.split("_")[0] for name in names}):
            with tarfile.open(folder / "bandai-namco" / f"{archive}.tar.xz") as files:
                for member in files:
                    if (name := Path(member.name).stem) in names and (content := files.extractfile(member)):
                        path = Path(place, f"{name}.bvh")
                        path.write_bytes(content.read())
                        clips[name] = mg.load(path)
    return {name: clips[name] for name in names}


def clips_in(folder: Path) -> Iterator[mg.Motion]:
    """The clips of the tables."""
    for name in ("Walk-In-Circle", "xia-normal-walk"):
        yield mg.load(folder / "characters" / f"{name}.bvh")
    yield from archived_clips(folder, ARCHIVED).values()


# -- along paths


def slip(motion: mg.Motion, feet: Sequence[int], stands: NDArray[np.bool_]) -> float:
    """Mean speed over the ground of foot joints while they stand, in heights per second."""
    ground = motion.positions[:, list(feet)][..., [0, 2]] / motion.skeleton.height
    speed = np.linalg.norm(np.diff(ground, axis=0), axis=-1) * motion.frame_rate
    return float(speed[stands[1:] & stands[:-1]].mean())


def along(clip: mg.Motion) -> Iterator[list[str]]:
    """The rows of a clip: itself, syntheses of it, and each path, from several seeds."""
    feet, frames = foot_joints(clip), round(SECONDS * clip.frame_rate)
    generator = mg.create("genmm").fit([clip])
    straight = mg.create("genmm").fit(straight_examples([clip]))
    for name, motions in (
        (f"**{clip.name}** ({clip.frame_rate:g} Hz)", [clip]),
        ("no path", generator.sample(frames, SEEDS)),
    ):
        yield [
            name,
            "",
            "",
            "",
            mean(foot_skate(motion, feet) for motion in motions),
            mean(slip(motion, feet, contact_labels(motion, feet)) for motion in motions),
            *steadiness(motions),
            "",
        ]
    for name, points in PATHS.items():
        ground = np.array(points, dtype=float) * clip.skeleton.height
        path = path_through(ground)
        results = generator.sample(frames, SEEDS, constraints=[mg.RootPath(ground)])
        raw = [follow(m, path, frames) for m in straight.sample(frames_to_follow(frames, clip.frame_rate), SEEDS)]
        off = [[float(number) for number in re.findall(r"\d+\.\d+", motion.notes[0])] for motion in results]
        roots = [
            path.distance_to(m.root_positions[on_path(m), :][:, [0, 2]]).max() / clip.skeleton.height for m in results
        ]
        metrics = one_clip_metrics([straightened(clip)], [straightened(motion) for motion in results])
        stands = [contact_labels(motion, feet) for motion in raw]
        skates = [mean(foot_skate(motion, feet) for motion in motions) for motions in (raw, results)]
        slips = [mean(slip(m, feet, s) for m, s in zip(motions, stands)) for motions in (raw, results)]
        yield [
            name,
            f"{np.mean([mean for _, mean in off]):.3f} / {max(largest for largest, _ in off):.3f}",
            f"{max(roots):.3f}",
            pace(results),
            " / ".join(skates),
            " / ".join(slips),
            *steadiness(results),
            f"{metrics.coverage:.3f}",
        ]


def on_path(motion: mg.Motion) -> slice:
    """The frames that are not beyond the end of the path."""
    ends = [int(found[1]) for note in motion.notes if (found := re.search(r"reached at frame (\d+)", note))]
    return slice(None, ends[0] if ends else None)


def pace(motions: Sequence[mg.Motion]) -> str:
    """How fast they are played, on average, where they are played to arrive."""
    paces = [float(found[1]) for m in motions for note in m.notes if (found := re.search(r"at ([\d.]+) times", note))]
    return f"{np.mean(paces):.2f}" if paces else "own"


def mean(values: Iterable[float | None], form: str = ".3f") -> str:
    """The mean as a cell of a table."""
    return format(float(np.mean([value or 0.0 for value in values])), form)


def steadiness(motions: Sequence[mg.Motion]) -> tuple[str, str, str]:
    """Mean jitter, the largest turn in degrees and the largest way in heights of any of them."""
    figures = [measure_quality(motion) for motion in motions]
    return (
        mean((q.jitter_heights_per_second_cubed for q in figures), ".0f"),
        f"{max(q.largest_step_degrees or 0.0 for q in figures):.1f}",
        f"{max(q.largest_step_heights or 0.0 for q in figures):.4f}",
    )


def patrols(clip: mg.Motion, generator: Generator) -> list[str]:
    """A closed walk, over and over: the steps at its seam beside those inside."""
    speed = straightened(clip).root_positions[:, 2]
    length = float(np.ptp(speed)) / clip.duration * 12.0  # twelve seconds round
    ring = np.array(PATHS["figure of eight"], dtype=float)
    ground = ring * (length / path_through(ring).length)
    frames, seams, inside, notes = round(12 * clip.frame_rate), [], [], ""
    for seed in range(SEEDS):
        loop = generator.sample(frames, seed=seed, constraints=[mg.RootPath(ground), mg.Loop()])[0]
        around = np.concatenate([loop.positions, loop.positions[:2]]) / clip.skeleton.height
        ways = np.linalg.norm(np.diff(around, axis=0), axis=-1).max(axis=1)
        seams.append(ways[frames - 1 :].max())
        inside.append(ways[: frames - 1].max())
        notes = "; ".join(loop.notes)
    return [clip.name, f"{max(seams):.4f}", f"{max(inside):.4f}", notes]


# -- ways of their own


def way(motion: mg.Motion, frames: int) -> Array:
    """(frames, 2) the track, set out from the origin along +z, in heights."""
    track = track_of(motion)
    turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), -track.heading[0])
    places = rot.rotate(turn, np.insert(track.places - track.places[0], 1, 0.0, axis=1))
    return places[:frames, [0, 2]] / motion.skeleton.height


def frechet(one: Array, other: Array) -> float:
    """The discrete Fréchet distance: the longest leash that two walkers need who never turn back."""
    gaps = np.linalg.norm(one[:, None] - other, axis=-1)
    reach = np.empty_like(gaps)
    for i, row in enumerate(gaps):
        for j, gap in enumerate(row):
            before = [reach[a, b] for a, b in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if a >= 0 and b >= 0]
            reach[i, j] = max(gap, min(before, default=0.0))
    return float(reach[-1, -1])


def own_ways(examples: Sequence[mg.Motion], count: int) -> tuple[list[str], list[Array]]:
    """How far apart the ways of the first example and of syntheses are; the ways of all examples, then of those."""
    first = examples[0]
    motions = mg.create("genmm").fit(examples).sample(2 * sum(map(len, examples)), count)
    ways = [way(motion, len(first))[:: max(1, len(first) // 150)] for motion in (first, *motions)]
    pairs = [(a, b) for a in range(1, count + 1) for b in range(a + 1, count + 1)]

    def figures(pairs: list[tuple[int, int]]) -> str:
        means = [float(np.linalg.norm(ways[a] - ways[b], axis=-1).mean()) for a, b in pairs]
        leashes = [frechet(ways[a], ways[b]) for a, b in pairs]
        return f"{np.mean(means):.2f} (least {min(means):.2f}), {np.mean(leashes):.2f} (least {min(leashes):.2f})"

    size = " x ".join(f"{side:.1f}" for side in np.ptp(ways[0], axis=0))
    names = " and ".join(example.name for example in examples)
    cells = [names, size, figures([(0, k) for k in range(1, count + 1)]), figures(pairs)]
    return cells, [way(motion, len(motion)) for motion in (*examples, *motions)]


# -- the page


def picture(ways: Sequence[Array], clip: mg.Motion) -> bytes:
    """PNG: ways of examples and of six syntheses from above, and of another clip along the paths."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 7, figsize=(17.5, 6.2), gridspec_kw={"height_ratios": [1.3, 1]})
    examples = len(ways) - 6
    for number, places in enumerate(ways):
        axis = axes[0, max(0, number - examples + 1)]
        axis.plot(*places.T, color="#c44e52" if number < examples else "#4c72b0", lw=1.4)
        axis.plot(*places[0], "o", color="black", ms=4)
        axis.set_title("examples" if number < examples else f"synthesis {number - examples}", fontsize=10)
    generator, height = mg.create("genmm").fit([clip]), clip.skeleton.height
    for axis in axes[1]:
        axis.axis("off")
    for axis, (title, points) in zip(axes[1], PATHS.items()):
        ground = np.array(points, dtype=float)
        frames = round(path_through(ground).length / travel_speed(clip) * clip.frame_rate)
        motion = generator.sample(frames, constraints=[mg.RootPath(ground * height)])[0]
        axis.axis("on")
        axis.plot(*path_through(ground).places.T, color="#bbbbbb", lw=5)
        axis.plot(*(motion.root_positions[:, [0, 2]] / height).T, color="#4c72b0", lw=1.2)
        axis.plot(*ground.T, ".", color="#c44e52", ms=5)
        axis.set_title(title, fontsize=10)
    for axis in axes.flat:
        axis.set_aspect("equal", adjustable="datalim")
        axis.invert_xaxis()  # seen from above with +z upwards, +x is to the left
        axis.tick_params(labelsize=7)
    figure.tight_layout()
    file = io.BytesIO()
    figure.savefig(file, dpi=70)
    return file.getvalue()


PAGE = """# Locomotion: along a path, on its own, without end

Made by `python -m tools.genmm_locomotion FOLDER` on {machine}. Real clips at their own frame rates, lengths in skeleton
heights, steps per frame.

## Along a path (`RootPath`)

{seconds:g} seconds, {seeds} seeds. *Off path*: the line that the body sways about, mean and largest distance from the
curve through the points; beside it the root itself, sway and all. Corners are rounded, and the wider, the faster the
body goes. *Pace*: how fast it is played to arrive in time; where the path is too long or too short, its own.
*Skate* is `quality.foot_skate`, *slip* the speed of feet while they stand; both as the motion is laid along the path,
and after its feet are put back where they stood; the example's own and those of syntheses without a path are in the
first two rows. *Coverage* is of the straightened example.

{along}

Played over and over, a closed path with `Loop` (a figure of eight in twelve seconds, as many seeds): largest way of a
joint in a frame.

{patrols}

## Ways of their own (Fig. 11)

No path is given; sequences twice as long as the examples. Ways are set out from one place in one direction and compared
over the length of the first example: mean distance at the same time, and discrete Fréchet distance.

{ways}

![Ways from above](locomotion.png)

*From above, in heights. Upper row: a walk, a turn to either side, and where six syntheses of these three went, from the
black dot. Lower row: the walk's root (blue) along paths (grey) through points (red); its sway is part of the walk. The
clips are from the Bandai-Namco Research Motion Dataset 1 and 2 (CC BY-NC 4.0).*

## Without end (`GenMM.stream`)

{chunks} chunks each. A border is the first second of a chunk.

{stream}

Python and NumPy hold {begun:.2f} MB after 10 chunks of {bundled} and {ended:.2f} MB after {many}.

## What the figures say

- The line that the body sways about keeps to the path: walks to within two hundredths of a height on curves and four at
  a right angle; the run, whose curves are rounded wider, to within a tenth.
- Feet that stand slip less along every path than the example's own do, and less than half as much on nearly all.
  Skate, which also counts feet that are about to land or to leave, is the example's own or below it for three of the
  walks; for xia-normal-walk (0.05 to 0.07 against 0.03) and for the run it is higher.
- Feet that are held and then let go catch up: the largest way of a joint in a frame lies above the example's, in most
  rows by a tenth to a half. The clip at 120 Hz has three to four times its example's jitter.
- Walking about, no two seeds and no seed and example go the same way. Directions other than the examples' come about
  where turns are cut short or strung together.
- Streams step no further at the borders of chunks than inside them, and memory stays as it is. Inside, one stream
  (cmu_01_01, 10 s) has a step of two and a half times the example's largest: once in five minutes the body swings round
  in a frame or two. Patch distances are those of motions with feet that are held, which turn the legs away from the
  example's; `standing_feet=free` has the lower ones.
"""


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m tools.genmm_locomotion", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=Path("docs/results/genmm"))
    parser.add_argument("--chunks", type=int, default=50)
    parser.add_argument("--machine", default="2 cores")
    options = parser.parse_args()
    clips = list(clips_in(options.folder))
    circle = clips[0]
    heading = ["path", "off path: mean / largest", "root, largest", "pace", "skate", "slip"]
    heading += ["jitter", "largest turn (°)", "largest way", "coverage"]
    rows = [heading, *(row for clip in clips for row in along(clip))]
    seams = [["clip", "seam", "inside", "notes of the last one"]]
    seams += [patrols(clip, mg.create("genmm").fit([clip])) for clip in clips[:3]]
    bundled, walk = mg.load(EXAMPLE_CLIP), clips[2]
    turning = [walk, *archived_clips(options.folder, TURNS).values()]
    cells, ways = own_ways(turning, 6)
    ways_heading = ["clips", "first example's room", "from the example: mean, Fréchet", "between seeds: mean, Fréchet"]
    salsa = mg.load(options.folder / "characters" / "Salsa-Dancing-6.bvh")
    many = 4 * options.chunks
    begun, ended = bench_stream.memory_held(bundled, many)
    page = PAGE.format(
        machine=options.machine,
        seconds=SECONDS,
        seeds=SEEDS,
        along="\n".join(markdown_table(rows)),
        patrols="\n".join(markdown_table(seams)),
        ways="\n".join(markdown_table([ways_heading, own_ways([circle], 6)[0], own_ways([bundled], 6)[0], cells])),
        chunks=options.chunks,
        stream="\n".join(bench_stream.table([salsa, bundled, circle, walk], [5.0, 10.0], options.chunks)),
        begun=begun,
        ended=ended,
        bundled=bundled.name,
        many=many,
    )
    image = picture(ways, walk)
    for name, content in (("locomotion.md", page.encode()), ("locomotion.png", image)):
        with atomic_write(options.output / name) as file:
            file.write(content)


if __name__ == "__main__":
    main()
