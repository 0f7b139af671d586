"""How long pictures take, step by step: `python -m tools.bench_render [CLIP]`.

Two figures side by side, 300 pictures of 640 x 480 in all; without a clip, made-up bodies of 65 joints. Once they dance
on the spot before a fixed camera and once they walk before one that follows. Times are the fastest of several runs.
"""

from __future__ import annotations

import argparse
import functools
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import motiongen as mg
from motiongen import rotations as rot
from motiongen.render import draw, render_clips
from motiongen.render.clips import Movie, build_movie

PICTURES, SIZE = 300, (640, 480)


def best_seconds(work: Callable[[], object], repeats: int) -> float:
    """The least of several timings: the one that the rest of the machine disturbed least."""
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)


def made_up_body(joints: int = 65, frames: int = 2 * PICTURES, frame_rate: float = 60.0) -> mg.Motion:
    """A trunk with four limbs of equal bones that swing like a body's."""
    rng = np.random.default_rng(0)
    parents, offsets = [-1], [np.array([0.0, 1.0, 0.0])]
    limbs = np.array([[0.0, 0.08, 0.0], [0.06, -0.06, 0.0], [-0.06, -0.06, 0.0], [0.08, 0.0, 0.0], [-0.08, 0.0, 0.0]])
    for joint in range(1, joints):
        parents.append(max(0, joint - len(limbs)))
        offsets.append(limbs[(joint - 1) % len(limbs)])
    skeleton = mg.Skeleton(tuple(f"joint{j}" for j in range(joints)), tuple(parents), np.array(offsets))
    seconds = np.arange(frames)[:, None, None] / frame_rate
    swings = 0.1 * np.sin(2 * np.pi * rng.uniform(0.3, 1.5, (joints, 3)) * seconds + rng.uniform(0, 6, (joints, 3)))
    size = np.linalg.norm(swings, axis=-1)
    rotations = rot.from_axis_angle(swings / np.maximum(size, 1e-9)[..., None], size)
    translations = np.tile([0.0, 1.0, 0.0], (frames, 1, 1)) + 0.2 * np.sin(seconds)
    return mg.Motion(skeleton, rotations, translations, (0,), frame_rate, name="made up")


def walking(motion: mg.Motion) -> mg.Motion:
    """The same, carried along at one height a second."""
    moving = motion.with_translating([motion.root])
    gone = np.arange(len(motion)) * motion.skeleton.height / motion.frame_rate
    translations = moving.translations.copy()
    translations[:, moving.translating.index(motion.root), 2] += gone
    return moving.replace(translations=translations)


def steps(movie: Movie) -> dict[str, Callable[[int], object]]:
    """What is done for the picture of one moment, each step alone."""
    canvas, panels = draw.blank(movie.panels[0].size), movie.panels
    return {
        "ground": lambda moment: [panel._ground(moment) for panel in panels],
        "path": lambda moment: [panel.paint_path(canvas, moment) for panel in panels],
        "figure and shadow": lambda moment: [panel.paint_figure(canvas, moment) for panel in panels],
        "words": lambda moment: [panel.paint_words(canvas, moment) for panel in panels],
        "whole picture": movie.picture,
    }


def for_each(moments: int, step: Callable[[int], object]) -> None:
    """Do one step for all moments, keeping nothing."""
    for moment in range(moments):
        step(moment)


def report(title: str, motion: mg.Motion, supersample: int, repeats: int) -> None:
    """Time one kind of movie, and print its part of the table."""
    pair, seconds = [motion, motion], PICTURES / 30

    def build() -> Movie:
        return build_movie(pair, size=SIZE, seconds=seconds, supersample=supersample)

    movie = build()
    print(f"{title}: 2 x {len(motion.skeleton)} joints, {movie.length} pictures of {SIZE[0]} x {SIZE[1]}")
    print(f"  {'cameras and figures':<20} {1e3 * best_seconds(build, repeats):8.1f} ms in all")
    for name, step in steps(movie).items():
        taken = best_seconds(functools.partial(for_each, movie.length, step), repeats)
        print(f"  {name:<20} {1e3 * taken / movie.length:8.2f} ms a picture")
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".mp4", ".gif", ".png"):
            path, size = Path(folder) / f"bench{suffix}", None if suffix == ".png" else SIZE

            def whole(path: Path = path, size: tuple[int, int] | None = size) -> None:
                render_clips(pair, path, size=size, seconds=seconds, supersample=supersample)

            taken = best_seconds(whole, repeats)
            print(f"  {suffix + ', all of it':<20} {taken:8.2f} s, {path.stat().st_size / 1e6:.2f} MB")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_render", description=__doc__)
    parser.add_argument("clip", nargs="?", help="a clip to show in place of the made-up body")
    parser.add_argument("--supersample", type=int, default=3)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    clip = mg.load(options.clip) if options.clip else made_up_body()
    report("fixed camera", clip, options.supersample, options.repeats)
    report("following camera", walking(clip), options.supersample, options.repeats)


if __name__ == "__main__":
    main()
