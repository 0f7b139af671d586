"""Walks along a path, and walks that go where they like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import Motion, MotionGenError
from motiongen import rotations as rot
from motiongen.contact import foot_joints
from motiongen.quality import foot_skate
from motiongen.trajectory import path_through, track_of
from tests.test_trajectory import walk

CURVE = np.array([[0.0, 0.0], [1.0, 2.0], [-1.0, 4.0], [0.0, 6.0]])
RING = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.0], [-1.0, 1.0], [0.0, 0.0]])


@pytest.fixture(scope="module")
def circler() -> Motion:
    """Goes round a circle in some twelve seconds."""
    return walk(frames=360, turn=0.5)


def off_path(motion: Motion, points: np.ndarray) -> float:
    roots = motion.root_positions[:, [0, 2]]
    return float(path_through(points).distance_to(roots).max() / motion.skeleton.height)


def test_a_walk_in_a_circle_serves_for_any_path(circler: Motion) -> None:
    points = CURVE * circler.skeleton.height
    generator = mg.create("genmm").fit([circler])
    motions = generator.sample(280, count=3, seed=1, constraints=[mg.RootPath(points)])
    assert [(len(motion), motion.name) for motion in motions] == [(280, f"sample_000{k}") for k in range(3)]
    for motion in motions:
        assert off_path(motion, points) < 0.1
        assert any("heights of the path" in note for note in motion.notes)
        turns = rot.angle_between(motion.rotations[1:], motion.rotations[:-1]).max()
        assert turns < 2 * rot.angle_between(circler.rotations[1:], circler.rotations[:-1]).max()
    assert motions[0] != motions[1]
    alone = generator.sample(280, seed=1, constraints=[mg.RootPath(points)])[0]
    assert alone == motions[0]
    free = generator.sample(280, seed=1)[0]  # what was fitted for the path leaves the rest as it was
    assert free == mg.create("genmm").fit([circler]).sample(280, seed=1)[0]


def test_parts_follow_a_path_too(circler: Motion) -> None:
    points = CURVE * circler.skeleton.height
    motion = mg.create("genmm").fit([circler]).sample(280, constraints=[mg.Parts(), mg.RootPath(points)])[0]
    assert off_path(motion, points) < 0.1


def test_another_output_rate_goes_the_same_way(circler: Motion) -> None:
    points = CURVE * circler.skeleton.height
    motion = mg.create("genmm", output_rate=60.0).fit([circler]).sample(560, constraints=[mg.RootPath(points)])[0]
    assert (len(motion), motion.frame_rate) == (560, 60.0)
    assert off_path(motion, points) < 0.1


def test_a_patrol_goes_round_and_round(circler: Motion) -> None:
    points = RING * 1.2 * circler.skeleton.height  # some 7.4 heights round
    motion = mg.create("genmm").fit([circler]).sample(320, constraints=[mg.RootPath(points), mg.Loop()])[0]
    assert off_path(motion, points) < 0.12
    around = np.concatenate([motion.positions, motion.positions[:2]])
    steps = np.linalg.norm(np.diff(around, axis=0), axis=-1).max(axis=1)
    assert steps[319:].max() <= 1.1 * steps[:319].max()
    assert any("round the path 1.00 times" in note for note in motion.notes)


def test_what_does_not_go_with_a_path_is_refused(circler: Motion) -> None:
    generator = mg.create("genmm").fit([circler])
    path, ring = mg.RootPath(CURVE), mg.RootPath(RING * circler.skeleton.height)
    for others, message in (
        ([mg.Keyframes({0: circler[3]})], "RootPath and Keyframes do not go together, only Parts and Loop do"),
        ([mg.Continuation(circler)], "RootPath and Continuation do not go together"),
        ([path], "there can be only one RootPath; put the points together in one"),
        ([mg.Loop()], "a loop along a path with two ends cannot follow it; end the path at its first point"),
    ):
        with pytest.raises(MotionGenError, match=message):
            generator.sample(60, constraints=[path, *others])
    with pytest.raises(MotionGenError, match="a loop in place cannot follow it"):
        generator.sample(300, constraints=[ring, mg.Loop(in_place=True)])
    with pytest.raises(MotionGenError, match=r"a loop of 30 frames cannot go round .* ask for about \d+ frames"):
        generator.sample(30, constraints=[ring, mg.Loop()])
    with pytest.raises(MotionGenError, match=r"two different points; all 2 are \[1.0, 2.0\]"):
        mg.RootPath(np.array([[1.0, 2.0], [1.0, 2.0]]))


def test_who_stays_in_one_place_cannot_follow_a_path() -> None:
    dance = walk(speed=0.0, sway=0.1).replace(name="dance")
    with pytest.raises(MotionGenError, match=r"only examples that travel can follow a path; 'dance' gets on by 0\.\d+"):
        mg.create("genmm").fit([dance]).sample(60, constraints=[mg.RootPath(CURVE)])


@pytest.mark.parametrize("name", ["Walk-In-Circle", "xia-normal-walk"])
def test_real_walks_follow_a_path_on_honest_feet(shared_data: Path, name: str) -> None:
    """On a curve the feet slide less than those of the same syntheses that no path bends and no clean-up touches."""
    clip = mg.load(shared_data / "characters" / f"{name}.bvh").resample(30)
    points, feet = CURVE * clip.skeleton.height, foot_joints(clip)
    generator = mg.create("genmm").fit([clip])
    motions = generator.sample(270, count=2, constraints=[mg.RootPath(points)])
    free = mg.create("genmm", standing_feet="free").fit([clip]).sample(270, count=2)
    skate, without = (np.mean([foot_skate(motion, feet) for motion in made]) for made in (motions, free))
    assert skate < without
    assert max(off_path(motion, points) for motion in motions) < 0.1


def test_random_walks_go_ways_of_their_own(shared_data: Path) -> None:
    """No path given: from a walk in a circle come walks elsewhere, and each seed goes another way."""
    clip = mg.load(shared_data / "characters" / "Walk-In-Circle.bvh").resample(30)
    motions = mg.create("genmm").fit([clip]).sample(2 * len(clip), count=3)
    ways = []
    for motion in (clip, *motions):
        track = track_of(motion)
        places = track.places - track.places[0]
        turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), -track.heading[0])
        ways.append(rot.rotate(turn, np.insert(places, 1, 0.0, axis=1))[: len(clip)] / clip.skeleton.height)
    for one, way in enumerate(ways):
        for other in ways[one + 1 :]:
            assert np.linalg.norm(way - other, axis=-1).mean() > 0.25
