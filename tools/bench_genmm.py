"""How long GenMM takes, and how much faster than its plain twin: `python -m tools.bench_genmm [CLIP]`.

Both make the same frames from the same noise in the same run; only the ratio means anything on another machine. The
matrix products alone are timed as the floor that no exact method can go under.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import torch

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.generators.base import sample_seed
from motiongen.generators.genmm.matching import augment_examples, frame_distances
from motiongen.generators.genmm.pyramid import stage_length
from motiongen.generators.genmm.synthesis import first_guess, synthesise
from tools import plain_genmm


def best_seconds(work: Callable[[], object], repeats: int) -> float:
    """The least of several timings: the one that the rest of the machine disturbed least."""
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_genmm", description=__doc__)
    parser.add_argument("clip", nargs="?", default=str(EXAMPLE_CLIP))
    parser.add_argument("--frames", type=int, default=1000, help="frames to make, at the working rate")
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()

    generator = mg.create("genmm")
    generator.fit([mg.load(options.clip).resample(30.0)])
    pyramid, settings = generator._pyramid(None, reduced=True), generator.options
    size = settings.patch_size
    lengths = [stage_length(options.frames, stage.scale, size) for stage in pyramid.stages]
    coordinates = first_guess(pyramid, lengths[0], [sample_seed(0, 0)], settings.noise)[0]
    axes, mean = pyramid.basis.axes.float(), pyramid.basis.mean.float()
    noise = coordinates @ axes.T + mean
    stages = [[stage.parts[0].frames @ axes.T + mean] for stage in pyramid.stages]  # the twin knows nothing of axes

    def floor() -> None:
        """The products of frames with frames that the distances of Eq. 1 need, in all features."""
        for (example,), length in zip(stages, lengths):
            columns = augment_examples(example)
            for _ in range(settings.iterations):
                frame_distances(torch.zeros(1, length, example.shape[1]), columns)

    timings = {
        "plain twin": best_seconds(
            lambda: plain_genmm.synthesise(stages, lengths, noise, size, settings.alpha, settings.iterations), 3
        ),
        "motiongen, features only": best_seconds(
            lambda: synthesise(pyramid, options.frames, [sample_seed(0, 0)], settings), options.repeats
        ),
        "motiongen, motion to motion": best_seconds(lambda: generator.sample(options.frames), options.repeats),
        "matrix products alone": best_seconds(floor, options.repeats),
    }
    print(
        f"{options.frames} frames from an example of {len(stages[-1][0])} frames x {pyramid.features[0]} features "
        f"({axes.shape[1]} principal axes), {len(stages)} stages, {torch.get_num_threads()} threads\n"
    )
    print("| what | seconds | times faster than the plain twin |\n| --- | ---: | ---: |")
    for name, seconds in timings.items():
        print(f"| {name} | {seconds:.4f} | {timings['plain twin'] / seconds:.1f} |")


if __name__ == "__main__":
    main()
