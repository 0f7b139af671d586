"""How long GenMM takes, and how much faster than its plain twin: `python -m tools.bench_genmm [CLIP]`.

Both make the same frames from the same noise in the same run; only the ratio means anything on another machine. The
matrix products alone, in all features, are timed as the floor of an exact method that does not reduce them. Processor
seconds are what the process used on all threads together; they suffer less from other work on the machine.

On a GPU: `python -m tools.bench_genmm CLIP --device cuda`. The twin still runs on the processor there, and 64 syntheses
at once are timed as well.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import torch

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.generators.base import sample_seed
from motiongen.generators.genmm.matching import augment_examples, augment_guess
from motiongen.generators.genmm.pyramid import stage_length
from motiongen.generators.genmm.synthesis import first_guess, synthesise
from motiongen.report import markdown_table
from tools import plain_genmm

BATCH = 64
"""Syntheses made at once on a GPU."""


def least_seconds(work: Callable[[], object], repeats: int, device: str = "cpu") -> tuple[float, float]:
    """The least of several timings, the one that the rest of the machine disturbed least: wall clock and processor."""
    times = []
    for _ in range(repeats):
        begun, begun_processor = time.perf_counter(), time.process_time()
        work()
        if device != "cpu":
            torch.cuda.synchronize()
        times.append((time.perf_counter() - begun, time.process_time() - begun_processor))
    return min(wall for wall, _ in times), min(processor for _, processor in times)


def machine(device: str = "cpu") -> str:
    """What it runs on and how busy that is, in a line."""
    names = [line for line in _lines("/proc/cpuinfo") if line.startswith("model name")]
    processor = names[0].split(":")[1].strip() if names else platform.processor()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    gpu = "" if device == "cpu" else f", {torch.cuda.get_device_name()}"
    return (
        f"{processor}, {os.cpu_count()} cores, {torch.get_num_threads()} threads{gpu}, torch {torch.__version__}, "
        f"load {load:.1f} when it began"
    )


def _lines(path: str) -> list[str]:
    return Path(path).read_text().splitlines() if Path(path).exists() else []


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_genmm", description=__doc__)
    parser.add_argument("clip", nargs="?", default=str(EXAMPLE_CLIP))
    parser.add_argument("--frames", type=int, default=1000, help="frames to make, at the working rate")
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    print(machine(options.device), end="\n\n")

    generator = mg.create("genmm", device=options.device)
    generator.fit([mg.load(options.clip).resample(30.0)])
    pyramid, settings = generator._pyramid(None, reduced=True), generator.options
    size = settings.patch_size
    lengths = [stage_length(options.frames, stage.scale, size) for stage in pyramid.stages]
    coordinates = first_guess(pyramid, lengths[0], [sample_seed(0, 0)], settings.noise)[0]
    axes, mean = pyramid.basis.axes.float(), pyramid.basis.mean.float()
    noise = coordinates @ axes.T + mean
    stages = [[stage.parts[0].frames @ axes.T + mean] for stage in pyramid.stages]  # the twin knows nothing of axes
    guesses = [augment_guess(torch.zeros(length, len(mean), device=options.device)) for length in lengths]
    columns = [augment_examples(example) for (example,) in stages]

    def floor() -> None:
        """The products of frames with frames that the distances of Eq. 1 need, in all features."""
        for guess, example in zip(guesses, columns):
            for _ in range(settings.iterations):
                guess @ example

    def features_only(batch: int) -> Callable[[], object]:
        return lambda: synthesise(pyramid, options.frames, [sample_seed(0, i) for i in range(batch)], settings)

    kept = [[example.cpu() for example in stage] for stage in stages]
    work: dict[str, tuple[Callable[[], object], int, str]] = {
        "plain twin": (
            lambda: plain_genmm.synthesise(kept, lengths, noise.cpu(), size, settings.alpha, settings.iterations),
            max(3, options.repeats // 3),
            "cpu",
        ),
        "motiongen, features only": (features_only(1), options.repeats, options.device),
        "motiongen, motion to motion": (lambda: generator.sample(options.frames), options.repeats, options.device),
        "matrix products alone": (floor, options.repeats, options.device),
    }
    if options.device != "cpu":
        work[f"motiongen, features only, {BATCH} at once"] = (features_only(BATCH), options.repeats, options.device)
    times = {name: least_seconds(*how) for name, how in work.items()}
    twin = times["plain twin"]
    rows = [["what", "seconds", "times faster than the twin", "processor seconds", "times fewer than the twin"]]
    rows += [
        [name, f"{wall:.4f}", f"{twin[0] / wall:.1f}", f"{processor:.4f}", f"{twin[1] / processor:.1f}"]
        for name, (wall, processor) in times.items()
    ]
    print(
        f"{options.frames} frames from an example of {len(kept[-1][0])} frames x {pyramid.features[0]} features "
        f"({axes.shape[1]} principal axes), {len(stages)} stages\n"
    )
    print("\n".join(markdown_table(rows)))


if __name__ == "__main__":
    main()
