"""The one-clip metrics of GenMM beside the released code's: `python -m tools.genmm_quality FOLDER [--seeds 32]`.

FOLDER holds the four clips of the table. Each is made 30 Hz, and sequences of twice its length are made from seeds 0,
1, 2, ...; the mean over the seeds is printed as Markdown, with the standard error of the patch distances. The released
code's figures (E = 5, K = 4) were measured on the same clips by the same definitions.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import motiongen as mg
from motiongen.metrics import one_clip_metrics
from motiongen.report import markdown_table

# Clip -> coverage, global and local patch distance, seconds of the released code.
RELEASED = {
    "Salsa-Dancing-6": (1.000, 0.069, 0.066, 2.05),
    "Baseball-Milling-Idle": (0.997, 0.077, 0.071, 2.31),
    "Walk-In-Circle": (1.000, 0.112, 0.084, 0.73),
    "elephant-idle1": (1.000, 0.060, 0.040, 0.22),
}


def measure(clip: mg.Motion, seeds: int) -> tuple[list[str], float]:
    """The cells of one row, and the coverage."""
    generator = mg.create("genmm", standing_feet="free").fit([clip])  # the metrics ask what matching makes
    syntheses, seconds = [], []
    for seed in range(seeds):
        begun = time.perf_counter()
        syntheses += generator.sample(frames=2 * len(clip), seed=seed)
        seconds.append(time.perf_counter() - begun)
    metrics = one_clip_metrics([clip], syntheses)
    cells = [f"{metrics.coverage:.4f} (least {min(metrics.coverages):.4f})"]
    for values in (metrics.global_patch_distances, metrics.local_patch_distances):
        cells.append(f"{np.mean(values):.4f} ± {np.std(values) / np.sqrt(seeds):.4f}")
    return [*cells, f"{metrics.set_diversity:.3f}", f"{np.median(seconds):.3f} s"], metrics.coverage


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.genmm_quality", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=32)
    options = parser.parse_args()
    rows = [["clip", "coverage", "global distance", "local distance", "set diversity", "time",
             "released: coverage / global / local, time"]]  # fmt: skip
    coverages = []
    for name, (coverage, far, near, seconds) in RELEASED.items():
        clip = mg.load(options.folder / f"{name}.bvh").resample(30.0)
        cells, covered = measure(clip, options.seeds)
        coverages.append(covered)
        released = f"{coverage:.3f} / {far:.3f} / {near:.3f}, {seconds:.2f} s"
        rows.append([f"{name} ({len(clip)} x {6 * len(clip.skeleton)})", *cells, released])
    print("\n".join(markdown_table(rows)))
    print(f"\nMean coverage {np.mean(coverages):.4f}; {options.seeds} seeds, twice the clip's length.")


if __name__ == "__main__":
    main()
