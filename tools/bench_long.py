"""Time and memory of GenMM against frames (Fig. 9 of the paper): `python -m tools.bench_long CLIP FOLDER`.

First ever longer syntheses of CLIP at 30 Hz. Then ever longer examples, the clips of FOLDER one after the other in an
order drawn once, with a synthesis as long as the example, by the exact and by the approximate search. An exact one that
would take longer than `--patience` seconds is not run: one round of matching at full length is timed, and the whole is
taken to be as many times as long as there are pairs of frames in all its rounds; such figures say "about".

Each row is a process of its own. Memory is the most that the process had in use, less what it had before (Linux only),
and thus includes the result. `synthesis` is the search and the blending of features, `motion` all of `sample`,
conversion into a motion included. Where frames are few enough, the quality of the motion is measured, too.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import motiongen as mg
from motiongen.report import markdown_table
from tools.bench_genmm import machine

LENGTHS = (1_000, 3_000, 10_000, 30_000, 100_000)
MEASURED_QUALITY = 10_000
"""Frames up to which the quality is measured: it takes longer than the synthesis."""

Row = dict[str, Any]


def main() -> None:
    """Measure, print Markdown, and draw the plot."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_long", description=__doc__)
    parser.add_argument("clip", type=Path)
    parser.add_argument("folder", type=Path, help="BVH clips of one skeleton at 30 Hz")
    parser.add_argument("--plot", type=Path, default=Path("docs/results/genmm/speed.png"))
    parser.add_argument("--patience", type=float, default=480.0, help="processor seconds that a run may take")
    parser.add_argument("--lengths", type=int, nargs="+", default=LENGTHS)
    options = parser.parse_args()
    print(machine(), end="\n\n")
    with tempfile.TemporaryDirectory() as folder:
        short, long = Path(folder) / "short.npz", Path(folder) / "long.npz"
        mg.save(mg.load(options.clip).resample(30.0), short)
        mg.save(joined(options.folder, max(options.lengths)), long)
        outputs = [in_process(short, None, length, "auto", options.patience) for length in options.lengths]
        print(table(outputs), flush=True)
        examples = [
            in_process(long, length, length, search, options.patience)
            for length in options.lengths
            for search in ("exact", "approximate")
        ]
        print(table(examples), flush=True)
    draw(outputs, examples, options.plot)


def joined(folder: Path, frames: int) -> mg.Motion:
    """Clips of a folder in an order drawn once, one after the other."""
    files = sorted(folder.glob("*.bvh"))
    random.Random(0).shuffle(files)
    clips: list[mg.Motion] = []
    while sum(map(len, clips)) < frames:
        if len(clips) == len(files):
            sys.exit(f"the clips in {folder} have {sum(map(len, clips))} frames, fewer than {frames}")
        clips.append(mg.load(files[len(clips)]))
    return mg.concatenate(clips)[:frames]


# -- one row, in a process of its own


def in_process(clip: Path, examples: int | None, frames: int, search: str, patience: float) -> Row:
    """`measure` in a process of its own, so that memory is that of this row alone."""
    program = (
        "import sys, json; from tools.bench_long import measure; print(json.dumps(measure(*json.loads(sys.argv[1]))))"
    )
    arguments = json.dumps([str(clip), examples, frames, search, patience])
    output = subprocess.run([sys.executable, "-c", program, arguments], capture_output=True, text=True, check=True)
    row: Row = json.loads(output.stdout.splitlines()[-1])
    return row


def measure(clip: str, examples: int | None, frames: int, search: str, patience: float) -> Row:
    """The figures of one row: seconds of wall clock and processor, MB, and the quality."""
    from motiongen.generators.base import sample_seed
    from motiongen.generators.genmm.synthesis import synthesise
    from motiongen.metrics import one_clip_metrics

    motion = mg.load(clip)[:examples]
    generator = mg.create("genmm", search=search).fit([motion])
    pyramid = generator._pyramid(None, reduced=True)
    row: Row = {"examples": len(motion), "joints": len(motion.skeleton), "frames": frames, "search": search}
    row["axes"] = pyramid.basis.axes.shape[1]
    generator.sample(min(frames, 200))  # what the first call alone needs
    if search == "exact" and (guess := foretold(generator, pyramid, frames)) > patience:
        return row | {"synthesis": {"processor": guess, "about": True}}
    row["synthesis"] = used(lambda: synthesise(pyramid, frames, [sample_seed(0, 0)], generator.options))
    if search == "exact" and frames > MEASURED_QUALITY:
        return row
    made: list[mg.Motion] = []
    row["motion"] = used(lambda: made.extend(generator.sample(frames)))
    if examples is not None and frames <= MEASURED_QUALITY:
        metrics = one_clip_metrics([motion], made)
        row["quality"] = [metrics.coverage, metrics.global_patch_distance, metrics.local_patch_distance]
    return row


def foretold(generator: Any, pyramid: Any, frames: int) -> float:
    """Processor seconds of an exact synthesis: one round of matching at full length, times all pairs of all rounds.

    The round is timed with a slice of the synthesis, and goes over the examples twice as the whole would.
    """
    import torch

    from motiongen.generators.genmm.matching import nearest_patches, normaliser_floor
    from motiongen.generators.genmm.pyramid import stage_length

    options, size = generator.options, generator.options.patch_size
    pairs = [stage_length(frames, s.scale, size) * len(s.parts[0].frames) for s in pyramid.stages]
    part = pyramid.stages[-1].parts[0]
    slice_of = min(frames, 4_000)
    guess = part.frames[torch.linspace(0, len(part.frames) - 1, slice_of).long()][None]
    keeps_none = 4 if pairs[-1] * 4 > options.memory_mb * 2**20 else options.memory_mb
    floor = normaliser_floor(options.alpha, size, pyramid.features[0])
    begun = time.process_time()
    nearest_patches(guess, part.augmented, part.starts, size, floor, keeps_none * 2**20)
    a_pair = (time.process_time() - begun) / (slice_of * len(part.frames))
    return a_pair * sum(pairs) * options.iterations


def used(work: Callable[[], object]) -> Row:
    """Seconds and MB that it takes."""
    before = memory_mb("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    begun, begun_processor = time.perf_counter(), time.process_time()
    work()
    wall, processor = time.perf_counter() - begun, time.process_time() - begun_processor
    return {"wall": wall, "processor": processor, "mb": memory_mb("VmHWM") - before}


def memory_mb(what: str) -> float:
    """A figure of this process, by its name in /proc/self/status, in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(what))


# -- what is shown


def table(rows: Sequence[Row]) -> str:
    """The rows as Markdown."""
    head = ["example frames", "joints", "frames made", "search", "synthesis s", "processor s", "MB", "motion s",
            "processor s", "MB", "coverage / global / local"]  # fmt: skip
    cells = [head]
    for row in rows:
        motion, quality = row.get("motion"), row.get("quality")
        about = row["synthesis"].get("about")
        cells.append(
            [f"{row['examples']:,}", str(row["joints"]), f"{row['frames']:,}", row["search"]]
            + (["", f"about {row['synthesis']['processor']:.0f}", ""] if about else _figures(row["synthesis"]))
            + (_figures(motion) if motion else [""] * 3)
            + ["" if quality is None else " / ".join(f"{value:.3f}" for value in quality)]
        )
    return "\n".join(markdown_table(cells)) + "\n"


def _figures(figures: Row) -> list[str]:
    return [f"{figures['wall']:.2f}", f"{figures['processor']:.2f}", f"{figures['mb']:.0f}"]


def draw(outputs: Sequence[Row], examples: Sequence[Row], path: Path) -> None:
    """Time and memory against frames, both axes logarithmic."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    seconds, memory = figure.subplots(1, 2)
    series = {f"{outputs[0]['examples']} example frames, {outputs[0]['joints']} joints": outputs}
    for search in ("exact", "approximate"):
        some = [row for row in examples if row["search"] == search]
        series[f"as many example frames, {some[0]['joints']} joints, {search}"] = some
    for name, rows in series.items():
        seconds.plot([r["frames"] for r in rows], [r["synthesis"]["processor"] for r in rows], "o-", label=name)
        known = [r for r in rows if "mb" in r["synthesis"]]
        memory.plot([r["frames"] for r in known], [r["synthesis"]["mb"] for r in known], "o-", label=name)
    for axes, what in ((seconds, "processor seconds of a synthesis"), (memory, "MB of a synthesis, result included")):
        axes.set(xscale="log", yscale="log", xlabel="frames made", ylabel=what)
        axes.grid(alpha=0.3)
    memory.set_ylim(bottom=1.0)  # less is the noise of what the process had in use before
    seconds.legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
