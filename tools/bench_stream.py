"""Endless motion, measured: `python -m tools.bench_stream CLIP... [--chunks 50] [--seconds 5 10 20]`.

Of each clip a stream is taken, chunk by chunk. Printed as Markdown: how long the first chunk takes (with `fit`), how
many frames a second come after it, how steep the borders between chunks are beside the chunks themselves and the
example, how much of the example appears, how far the root gets, and what is held in memory after 10 chunks and at the
end. A border is the first second of a chunk. The bundled clip is always in.
"""

from __future__ import annotations

import argparse
import gc
import time
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.metrics import one_clip_metrics
from motiongen.report import markdown_table
from tools.genmm_applications import Steps

HEADING = ["clip, chunk", "first chunk", "frames/s, best and median chunk", "times real time", "times 60 Hz",
           "largest turn: borders / inside / example (°)", "largest way: borders / inside / example (heights)",
           "coverage", "local distance", "room: stream / example (heights)"]  # fmt: skip


def row(clip: mg.Motion, seconds: float, chunks: int) -> list[str]:
    """The cells of one stream."""
    frames = round(seconds * clip.frame_rate)
    begun = time.perf_counter()
    running = mg.create("genmm").fit([clip]).stream(frames)
    taken, times = [next(running)], []
    first = time.perf_counter() - begun
    for _ in range(chunks - 1):
        begun = time.perf_counter()
        taken.append(next(running))
        times.append(time.perf_counter() - begun)
    joined = mg.concatenate(taken, align=False)
    steps, own = Steps.of(joined), Steps.of(clip)
    border = (np.arange(chunks)[:, None] * frames + np.arange(round(clip.frame_rate)) - 1)[1:].ravel()
    border = border[border < len(steps.turns)]
    inside = np.setdiff1d(np.arange(len(steps.turns)), border)
    metrics = one_clip_metrics([clip], [joined])
    best, median = frames / min(times), frames / float(np.median(times))

    def triple(values: np.ndarray, example: np.ndarray, form: str) -> str:
        figures = values[border].max(), values[inside].max(), example.max()
        return " / ".join(format(float(figure), form) for figure in figures)

    def room(motion: mg.Motion) -> str:
        return " x ".join(f"{side:.1f}" for side in np.ptp(motion.root_positions[:, [0, 2]], axis=0) / clip_height)

    clip_height = clip.skeleton.height
    return [
        f"{clip.name} ({len(clip.skeleton)} joints, {clip.frame_rate:g} Hz), {seconds:g} s",
        f"{first:.2f} s",
        f"{best:.0f}, {median:.0f}",
        f"{median / clip.frame_rate:.0f}",
        f"{median / 60:.0f}",
        triple(steps.turns, own.turns, ".1f"),
        triple(steps.ways, own.ways, ".4f"),
        f"{metrics.coverage:.4f}",
        f"{metrics.local_patch_distance:.3f}",
        f"{room(joined)} / {room(clip)}",
    ]


def table(clips: Sequence[mg.Motion], lengths: Sequence[float], chunks: int) -> list[str]:
    """The lines of the table."""
    rows = [row(clip, seconds, chunks) for clip in clips for seconds in lengths]
    return markdown_table([HEADING, *rows])


def memory_held(clip: mg.Motion, chunks: int) -> tuple[float, float]:
    """Megabytes held by Python and NumPy after 10 chunks of ten seconds, and after `chunks`."""
    running = mg.create("genmm").fit([clip]).stream()
    held = []
    tracemalloc.start()
    try:
        for number in range(1, chunks + 1):
            next(running)
            if number in (10, chunks):
                gc.collect()
                held.append(tracemalloc.get_traced_memory()[0] / 2**20)
    finally:
        tracemalloc.stop()
    return held[0], held[-1]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_stream", description=__doc__)
    parser.add_argument("clips", nargs="*", type=Path)
    parser.add_argument("--chunks", type=int, default=50)
    parser.add_argument("--seconds", type=float, nargs="+", default=[5.0, 10.0, 20.0], help="lengths of chunks")
    options = parser.parse_args()
    clips = [mg.load(path) for path in (EXAMPLE_CLIP, *options.clips)]
    print("\n".join(table(clips, options.seconds, options.chunks)))
    begun, ended = memory_held(clips[0], options.chunks)
    print(f"\nHeld after 10 chunks of {clips[0].name}: {begun:.2f} MB; after {options.chunks}: {ended:.2f} MB.")


if __name__ == "__main__":
    main()
