"""Endless motion in chunks: seamless, repeatable, and no larger the longer it runs."""

from __future__ import annotations

import gc
import itertools
import tracemalloc
import weakref
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import Motion, MotionGenError
from motiongen import rotations as rot
from motiongen.metrics import one_clip_metrics
from motiongen.motion import concatenate
from tests.strategies import random_motion, random_skeleton

CHUNK = 60


def swinging(frames: int = 120, speed: float = 0.0) -> Motion:
    """A figure that swings its joints, on its spot or as it gets on at `speed` heights a second."""
    skeleton = random_skeleton(np.random.default_rng(7), 5)
    clip = random_motion(
        np.random.default_rng(3), skeleton, frames=frames, translating=(0,), smooth=True, frame_rate=30.0
    )
    ahead = np.arange(frames)[:, None, None] / 30 * speed * skeleton.height * [0.0, 0.0, 1.0]
    return clip.replace(translations=clip.translations + ahead)


def stream(clip: Motion, count: int, seed: int = 0, **options: object) -> list[Motion]:
    return list(itertools.islice(mg.create("genmm", **options).fit([clip]).stream(CHUNK, seed), count))


def largest_steps(motion: Motion, frames: list[int] | None = None) -> tuple[float, float]:
    """Largest turn of a joint, and largest way of one, to the given frames from the ones before; to all by default."""
    turns = rot.angle_between(motion.rotations[1:], motion.rotations[:-1]).max(axis=1)
    ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1).max(axis=1)
    chosen = slice(None) if frames is None else [frame - 1 for frame in frames]
    return float(turns[chosen].max()), float(ways[chosen].max())


def test_fifty_borders_are_no_steeper_than_the_example() -> None:
    clip = swinging()
    chunks = stream(clip, 51, iterations=3)
    assert [len(chunk) for chunk in chunks] == [CHUNK] * 51
    joined = concatenate(chunks, align=False)
    borders = [k * CHUNK + after for k in range(1, 51) for after in range(3)]
    for at_borders, own in zip(largest_steps(joined, borders), largest_steps(clip)):
        assert at_borders <= 1.001 * own


def test_a_long_stream_shows_all_of_the_example() -> None:
    clip = swinging()
    metrics = one_clip_metrics([clip], [concatenate(stream(clip, 20), align=False)])
    assert metrics.coverage == 1.0
    assert metrics.local_patch_distance < 0.5


def test_the_seed_decides_and_how_much_is_taken_does_not() -> None:
    clip = swinging()
    long, short = stream(clip, 4), stream(clip, 2)
    assert long[:2] == short
    assert [chunk.name for chunk in long] == ["chunk_000000", "chunk_000001", "chunk_000002", "chunk_000003"]
    assert stream(clip, 1, seed=1)[0] != long[0]
    assert all(a != b for a, b in itertools.combinations(long, 2))


def test_two_streams_of_one_generator_do_not_meet() -> None:
    generator = mg.create("genmm").fit([swinging()])
    one, other = generator.stream(CHUNK, 0), generator.stream(CHUNK, 1)
    taken = [(next(one), next(other)) for _ in range(3)]
    assert [a for a, _ in taken] == list(itertools.islice(generator.stream(CHUNK, 0), 3))
    assert [b for _, b in taken] == list(itertools.islice(generator.stream(CHUNK, 1), 3))


def test_nothing_grows() -> None:
    """What was handed out is let go of, and what is kept after 24 chunks is what was kept after 8."""
    running = mg.create("genmm", iterations=1).fit([swinging(60)]).stream(CHUNK)
    first = weakref.ref(next(running))
    tracemalloc.start()
    try:
        held = []
        for number in range(1, 25):
            next(running)
            if number % 8 == 0:
                gc.collect()
                held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert first() is None
    assert max(held[1:]) - held[0] < 50_000  # a chunk with its positions has some 30 kB


def test_who_stays_in_one_place_does_not_wander_off() -> None:
    """Steps to and fro that do not even out lead a little further with each chunk; it is led back."""
    clip = swinging()
    generator = mg.create("genmm").fit([clip])
    running = generator.stream(CHUNK)
    ends = np.array([chunk.root_positions[-1, [0, 2]] for chunk in itertools.islice(running, 60)])
    room = np.linalg.norm(np.ptp(clip.root_positions[:, [0, 2]], axis=0))
    away = np.linalg.norm(ends - ends[0], axis=1)
    assert away.max() < 3 * room
    assert away[30:].mean() < 2 * room


def test_who_travels_is_let_go() -> None:
    clip = swinging(speed=1.0)
    last = stream(clip, 20)[-1]
    seconds = 20 * CHUNK / 30
    assert last.root_positions[-1, 2] > 0.7 * seconds * clip.skeleton.height


def test_parts_and_other_rates() -> None:
    clip = swinging().resample(60.0)
    generator = mg.create("genmm").fit([clip])
    chunks = list(itertools.islice(generator.stream(100, constraints=[mg.Parts()]), 3))
    assert [(len(chunk), chunk.frame_rate) for chunk in chunks] == [(100, 60.0)] * 3
    by_default = next(generator.stream())
    assert len(by_default) == 600
    tiny = list(itertools.islice(generator.stream(1), 5))
    assert largest_steps(concatenate(tiny, align=False))[0] <= 1.5 * largest_steps(clip)[0]


def test_what_does_not_fit_is_refused_when_asked_for() -> None:
    clip = swinging()
    generator = mg.create("genmm").fit([clip])
    for frames in (0, -3, 2.5, True):
        with pytest.raises(MotionGenError, match="chunk_frames must be a whole number of at least 1, not"):
            generator.stream(frames)
    with pytest.raises(MotionGenError, match="a stream takes no Loop, only Parts; leave it out"):
        generator.stream(CHUNK, constraints=[mg.Loop()])
    with pytest.raises(MotionGenError, match="in none"):
        generator.stream(CHUNK, constraints=[mg.Parts({"one": ["joint0"]})])
    with pytest.raises(MotionGenError, match="seed must not be negative"):
        generator.stream(CHUNK, seed=-1)
    with pytest.raises(MotionGenError, match="own frame rate; leave output_rate out"):
        mg.create("genmm", output_rate=24.0).fit([clip]).stream(CHUNK)
    with pytest.raises(MotionGenError, match="call fit"):
        mg.create("genmm").stream(CHUNK)


@pytest.mark.parametrize("name", ["Walk-In-Circle", "Salsa-Dancing-6"])
def test_on_real_clips_borders_do_not_show(shared_data: Path, name: str) -> None:
    clip = mg.load(shared_data / "characters" / f"{name}.bvh").resample(30)
    chunks = list(itertools.islice(mg.create("genmm").fit([clip]).stream(300), 6))
    joined = concatenate(chunks, align=False)
    borders = [k * 300 + after for k in range(1, 6) for after in range(5)]
    for at_borders, own in zip(largest_steps(joined, borders), largest_steps(clip)):
        assert at_borders <= 1.1 * own
    assert one_clip_metrics([clip], [joined]).coverage > 0.99
