"""Tracks over the ground, paths, and leading a motion along one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import Motion, MotionGenError
from motiongen import rotations as rot
from motiongen.stance import facing
from motiongen.trajectory import (
    PACE,
    GroundPath,
    follow,
    follow_in_a_loop,
    frames_to_follow,
    path_through,
    shifted,
    straightened,
    track_of,
    travel_speed,
)
from motiongen.trajectory.path import route_along
from motiongen.trajectory.track import UP, at_times, laid, smooth
from tests.strategies import generators, random_motion, random_skeleton, symmetric_motion

Array = NDArray[np.float64]

RATE = 30.0


def walk(frames: int = 300, speed: float = 0.7, turn: float = 0.0, sway: float = 0.02, above: int = 0) -> Motion:
    """A figure that goes `speed` heights a second along +z, turning by `turn` radians a second, and sways at 1 Hz.

    Its joints swing, too, with the same period. `above` joints that stand still, turned somehow, carry its root.
    """
    rng = np.random.default_rng(5)
    body = symmetric_motion(rng, frames=1).skeleton
    seconds = np.arange(frames) / RATE
    heading = turn * seconds
    ways = np.stack([np.sin(heading), np.zeros(frames), np.cos(heading)], axis=-1) * speed / RATE
    line = np.cumsum(ways, axis=0) - ways
    across = np.stack([np.cos(heading), np.zeros(frames), -np.sin(heading)], axis=-1)
    places = (line + sway * np.sin(2 * np.pi * seconds)[:, None] * across) * body.height
    swing = rng.normal(size=(len(body), 3)) * 0.3
    rotations = rot.from_rotation_vector(swing * np.sin(2 * np.pi * seconds)[:, None, None])
    rotations[:, 0] = rot.multiply(rot.from_axis_angle(UP, heading), rot.from_rotation_vector(swing[0] * 0.1))
    places[:, 1] = body.offsets[0, 1]
    motion = Motion(body, rotations, places[:, None], (0,), RATE, name="walk")
    return motion if not above else carried(motion)


def carried(motion: Motion) -> Motion:
    """The same with a joint above the root that stands still and is turned."""
    body = motion.skeleton
    turned, shift = rot.from_rotation_vector(np.array([0.3, 1.0, -0.4])), np.array([1.0, 2.0, 3.0])
    skeleton = type(body)(
        ("Stand", *body.names), (-1, *(p + 1 for p in body.parents)), np.concatenate([[shift], body.offsets])
    )
    rotations = np.concatenate([np.tile(turned, (len(motion), 1, 1)), motion.rotations], axis=1)
    back = rot.inverse(turned)
    rotations[:, 1] = rot.multiply(back, motion.rotations[:, 0])
    translations = rot.rotate(back, motion.translations[:, 0] - shift)
    return Motion(skeleton, rotations, translations[:, None], (1,), RATE, name="walk")


def turned_by(motion: Motion, angle: float, shift: tuple[float, float] = (0.0, 0.0)) -> Motion:
    return motion.transform(rot.from_axis_angle(UP, angle), (shift[0], 0.0, shift[1]))


def direction(angles: Array | float) -> Array:
    return np.stack([np.sin(angles), np.cos(angles)], axis=-1)


# -- smoothing and tracks


@given(generators(), st.integers(2, 40), st.sampled_from([0.5, 1.0, 3.0, 20.0]))
def test_smoothing_fits_a_weighted_line_around_each_place(rng: np.random.Generator, count: int, width: float) -> None:
    values = rng.normal(size=(count, 2))
    smoothed, slope = smooth(values, width)
    time = np.arange(count, dtype=float)
    for place in range(count):
        near = np.abs(time - place) <= np.ceil(4 * width)
        weights = np.exp(-0.25 * ((time[near] - place) / width) ** 2)  # polyfit squares them
        fit = np.polyfit(time[near] - place, values[near], 1, w=weights)
        np.testing.assert_allclose(smoothed[place], fit[1], atol=1e-9)
        np.testing.assert_allclose(slope[place], fit[0], atol=1e-9)


@pytest.mark.parametrize("above", [0, 1])
def test_the_track_leaves_out_the_sway_and_keeps_the_way(above: int) -> None:
    motion = walk(turn=0.3, above=above)
    track, plain = track_of(motion), track_of(walk(turn=0.3, sway=0.0))
    height = motion.skeleton.height
    inner = slice(30, -30)  # at the ends half of what says which way it goes is missing
    assert np.abs(track.places - plain.places)[inner].max() < 0.003 * height
    assert np.abs(track.heading - 0.3 * np.arange(len(motion)) / RATE)[inner].max() < np.radians(2)
    assert np.abs(track.heading - 0.3 * np.arange(len(motion)) / RATE).max() < np.radians(12)
    assert track.distance[-1] == pytest.approx(0.7 * height * motion.duration, rel=0.02)


@given(st.floats(-np.pi, np.pi), st.floats(-50, 50), st.floats(-50, 50))
def test_a_track_moves_with_its_motion_and_a_straight_one_forgets(angle: float, x: float, z: float) -> None:
    motion = walk(frames=120, turn=0.4)
    moved = turned_by(motion, angle, (x, z))
    track, theirs = track_of(motion), track_of(moved)
    expected = rot.rotate(
        rot.from_axis_angle(UP, angle), np.insert(track.places, 1, 0.0, axis=1)
    ) + np.array([x, 0.0, z])  # fmt: skip
    np.testing.assert_allclose(theirs.places, expected[:, [0, 2]], atol=1e-8)
    np.testing.assert_allclose(theirs.distance, track.distance, atol=1e-8)
    np.testing.assert_allclose(direction(theirs.heading), direction(track.heading + angle), atol=1e-8)
    assert straightened(moved).allclose(straightened(motion), 1e-8)


@pytest.mark.parametrize("above", [0, 1])
def test_a_straightened_walk_goes_along_z_and_does_what_it_did(above: int) -> None:
    motion = walk(turn=0.5, above=above)
    straight = straightened(motion)
    places = track_of(straight).places / motion.skeleton.height
    assert np.abs(places[:, 0]).max() < 0.03
    assert np.ptp(places[30:-30, 0]) < 0.01
    assert (np.diff(places[:, 1]) > 0).all()
    np.testing.assert_allclose(straight.positions[..., 1], motion.positions[..., 1], atol=1e-9)
    others = [j for j in range(len(motion.skeleton)) if j != motion.root]
    np.testing.assert_array_equal(straight.rotations[:, others], motion.rotations[:, others])
    # The body does what it does in the same walk without turns, but for the ends.
    plain = straightened(walk(above=above))
    body = [m.positions[:, list(m.skeleton.subtree(m.root))] - m.root_positions[:, None] for m in (straight, plain)]
    assert np.linalg.norm(body[0] - body[1], axis=-1)[30:-30].max() < 0.03 * motion.skeleton.height


def test_where_it_stands_it_turns_evenly_from_one_way_to_the_next() -> None:
    """Ahead, then a stand, then across: in between the heading goes from the one to the other without a jump."""
    motion = walk(frames=240, sway=0.0)
    time = np.arange(240) / RATE
    places = np.stack([np.clip(time - 5, 0, None), 0 * time, np.clip(time, 0, 3)], axis=-1) * motion.skeleton.height
    track = track_of(motion.replace(translations=places[:, None]))
    assert np.degrees(track.heading[[0, -1]]) == pytest.approx([0.0, 90.0], abs=1.0)
    assert (np.diff(track.heading) > -1e-9).all()
    assert np.degrees(np.diff(track.heading)).max() < 10


def test_what_does_not_go_has_a_track_too() -> None:
    motion = walk(frames=60, speed=0.0, sway=0.0)
    track = track_of(motion)
    np.testing.assert_allclose(track.distance, 0.0, atol=1e-9)
    np.testing.assert_array_equal(track.heading, 0.0)
    assert np.isfinite(straightened(motion[:1]).positions).all()


def test_only_getting_on_is_travel() -> None:
    assert travel_speed(walk()) == pytest.approx(0.7, abs=0.01)
    assert travel_speed(walk(turn=0.6)) == pytest.approx(0.7, abs=0.06)  # a circle
    assert travel_speed(walk(speed=0.0, sway=0.3)) < 0.05  # to and fro
    assert travel_speed(walk()[:1]) == 0.0


# -- moving and playing


@given(generators())
def test_laying_a_motion_where_it_is_leaves_it_there(rng: np.random.Generator) -> None:
    motion = random_motion(rng, frames=6)
    track = track_of(motion)
    still = laid(motion, track, track.places, np.zeros(6))
    np.testing.assert_allclose(still.positions, motion.positions, atol=1e-9 * max(1.0, motion.skeleton.height))
    shift = rng.normal(size=(6, 2))
    moved = shifted(motion, shift).positions[:, list(motion.skeleton.subtree(motion.root))]
    there = motion.positions[:, list(motion.skeleton.subtree(motion.root))]
    there = there + np.insert(shift, 1, 0.0, axis=1)[:, None]
    np.testing.assert_allclose(moved, there, atol=1e-9 * max(1.0, motion.skeleton.height))


@given(generators(), st.floats(0.5, 2.0))
def test_another_pace_keeps_whole_frames_and_steady_changes(rng: np.random.Generator, pace: float) -> None:
    motion = random_motion(rng, random_skeleton(rng, 4), frames=20, translating=(0,))
    assert at_times(motion, np.arange(20.0)) == motion
    time = np.arange(20.0)
    parabola = np.stack([time, time**2, 3 - time], axis=-1)
    spin = rot.from_axis_angle(UP, 0.1 * time)
    steady = motion.replace(translations=parabola[:, None], rotations=np.tile(spin[:, None], (1, 4, 1)))
    times = np.arange(2, 17, pace)  # the ends have neighbours on one side only
    played = at_times(steady, times)
    np.testing.assert_allclose(played.translations[:, 0, 1], times**2, atol=1e-9)
    assert rot.angle_between(played.rotations[:, 0], rot.from_axis_angle(UP, 0.1 * times)).max() < 1e-4


# -- paths


def slow_catmull_rom(points: Array, part: float) -> Array:
    """The centripetal spline between the middle two of four points, by Barry and Goldman's recursion."""
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=-1) ** 0.5)])
    time = knots[1] + part * (knots[2] - knots[1])
    level = list(points)
    for order in (1, 2, 3):
        spans = [(0, 1), (1, 2), (2, 3)] if order == 1 else [(0, 2), (1, 3)] if order == 2 else [(1, 2)]
        level = [
            ((knots[b] - time) * level[i] + (time - knots[a]) * level[i + 1]) / (knots[b] - knots[a])
            for i, (a, b) in enumerate(spans)
        ]
    return level[0]


@given(generators(), st.integers(4, 9))
def test_the_path_is_a_centripetal_spline(rng: np.random.Generator, count: int) -> None:
    points = rng.normal(size=(count, 2))
    places = path_through(points).places
    assert np.linalg.norm(places[:, None] - points, axis=-1).min(axis=0).max() < 1e-12
    samples = (len(places) - 1) // (count - 1)
    for segment in range(1, count - 2):
        for step in (1, samples // 2):
            expected = slow_catmull_rom(points[segment - 1 : segment + 3], step / samples)
            np.testing.assert_allclose(places[segment * samples + step], expected, atol=1e-9)


def test_points_on_a_line_make_a_line_and_points_given_twice_make_corners() -> None:
    line = path_through(np.array([[0.0, 0.0], [1.0, 2.0], [1.5, 3.0], [5.0, 10.0]]))
    assert np.abs(line.places @ [2.0, -1.0]).max() < 1e-12
    assert line.length == pytest.approx(np.hypot(5, 10))
    corner = path_through(np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 3.0], [4.0, 3.0]]))
    assert corner.length == pytest.approx(7.0)
    assert not corner.closed


@given(generators(), st.integers(3, 7), st.integers(0, 6))
def test_a_closed_path_has_no_beginning(rng: np.random.Generator, count: int, start: int) -> None:
    points = rng.normal(size=(count, 2))
    ring = path_through(np.concatenate([points, points[:1]]))
    rolled = np.roll(points, -(start % count), axis=0)
    other = path_through(np.concatenate([rolled, rolled[:1]]))
    assert ring.closed
    assert ring.length == pytest.approx(other.length)
    assert ring.distance_to(other.places).max() < 1e-9


@given(generators(), st.integers(2, 6))
def test_distances_to_a_path_are_those_to_its_nearest_place(rng: np.random.Generator, count: int) -> None:
    path = GroundPath(rng.normal(size=(count, 2)))
    places = 2 * rng.normal(size=(5, 2))
    fine = np.concatenate([np.linspace(a, b, 2001) for a, b in zip(path.places[:-1], path.places[1:])])
    slow = np.linalg.norm(places[:, None] - fine, axis=-1).min(axis=1)
    np.testing.assert_allclose(path.distance_to(places), slow, atol=2e-3)
    assert (path.distance_to(places) <= slow + 1e-12).all()


def test_one_place_is_no_path() -> None:
    with pytest.raises(MotionGenError, match=r"a path needs two different points; all 3 are \[1.0, 2.0\]"):
        path_through(np.tile([1.0, 2.0], (3, 1)))


def test_a_route_goes_on_beyond_the_end_and_turns_back_without_a_jump() -> None:
    there_and_back = path_through(np.array([[0.0, 0.0], [0.0, 5.0], [0.0, 5.0], [0.0, 1.0]]))
    route = route_along(there_and_back, 12.0, 0.1, 0.2)
    assert np.abs(route.places[:, 0]).max() < 1e-9
    assert np.degrees(np.abs(np.diff(route.heading))).max() < 10  # within 0.1 / 8
    places, heading, _ = route.at(np.array([0.0, 2.0, route.length, route.length + 3]))
    np.testing.assert_allclose(places[:, 1], [0.0, 2.0, 1.0, -2.0], atol=0.02)
    np.testing.assert_allclose(np.cos(heading), [1.0, 1.0, -1.0, -1.0], atol=1e-3)
    ring = path_through(np.array([[0.0, 0.0], [2.0, 2.0], [0.0, 4.0], [-2.0, 2.0], [0.0, 0.0]]))
    route = route_along(ring, 50.0, 0.1, 0.2)
    distance = np.linspace(0, route.length, 20)
    once, again = route.at(distance), route.at(distance + 2 * route.length)
    np.testing.assert_allclose(once[0], again[0], atol=1e-3)
    np.testing.assert_allclose(direction(once[1]), direction(again[1]), atol=1e-2)


def test_a_path_beyond_all_reach_costs_no_more() -> None:
    far = path_through(np.array([[0.0, 0.0], [0.0, 1e9]]))
    route = route_along(far, 10.0, 0.1, 0.2)
    assert route.length == pytest.approx(1e9)
    assert len(route.places) < 10_000


# -- following

S_CURVE = np.array([[3.0, 1.0], [4.5, 3.0], [1.5, 5.0], [3.0, 7.0]])


def off_path(motion: Motion, path: GroundPath) -> Array:
    """(T,) distances in heights of the root, sway and all, from the path."""
    return path.distance_to(motion.root_positions[:, [0, 2]]) / motion.skeleton.height


def heading_of(motion: Motion) -> Array:
    """(T,) which way the body faces, in radians."""
    turns = facing(motion)
    return np.unwrap(2 * np.arctan2(turns[:, 1], turns[:, 3]))


@pytest.mark.parametrize("above", [0, 1])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_walk_follows_a_path_and_arrives_with_the_last_frame(turn: float, above: int) -> None:
    motion = walk(frames=frames_to_follow(300, RATE), turn=turn, above=above)
    height = motion.skeleton.height
    path = path_through(S_CURVE * height * 0.8)  # some 7 heights: 300 frames at its pace
    result = follow(motion, path, 300)
    assert len(result) == 300
    assert off_path(result, path).max() < 0.02 + 0.04  # the sway, and rounded corners
    for frame, end in ((0, 0), (-1, -1)):
        root = result.root_positions[frame, [0, 2]]
        assert np.linalg.norm(root - path.places[end]) < 0.05 * height
    # It turns as the path does.
    ways = np.diff(path.places, axis=0)
    roots = result.root_positions[:, [0, 2]]
    nearest = np.linalg.norm(roots[:, None] - path.places[:-1], axis=-1).argmin(axis=1)
    apart = heading_of(result) - np.arctan2(ways[nearest, 0], ways[nearest, 1]) - heading_of(motion)[0]
    apart = np.degrees(np.abs((apart + np.pi) % (2 * np.pi) - np.pi))
    assert apart.max() < 20
    assert apart.mean() < 6
    np.testing.assert_allclose(np.ptp(result.positions[..., 1]), np.ptp(motion.positions[..., 1]), rtol=0.01)
    assert "heights of the path" in result.notes[0]
    assert len(result.notes) == 1 or "times its own pace" in result.notes[1]


def test_a_straight_walk_along_its_own_line_stays_as_it_is() -> None:
    motion = walk(sway=0.0)
    result = follow(motion, path_through(np.array([[0.0, 0.0], [0.0, 1e3]])), 200)
    edge = (frames_to_follow(1, RATE) - 1) // 2
    taken = motion[edge : edge + 200]
    expected = turned_by(taken, 0.0, (0.0, -float(taken.root_positions[0, 2])))
    np.testing.assert_allclose(result.positions, expected.positions, atol=1e-6)


@pytest.mark.parametrize(("stretch", "note"), [(0.9, "times its own pace"), (1.2, "times its own pace")])
def test_pace_makes_up_for_a_path_a_little_longer_or_shorter(stretch: float, note: str) -> None:
    frames = 300
    motion = walk(frames=frames_to_follow(frames, RATE), sway=0.0)
    way = 0.7 * motion.skeleton.height * (frames - 1) / RATE * stretch
    result = follow(motion, path_through(np.array([[0.0, 0.0], [way, 0.0]])), frames)
    assert any(note in words and f"{stretch:.2f}" in words for words in result.notes)
    assert result.root_positions[-1, 0] == pytest.approx(way, rel=1e-3)


def test_too_long_and_too_short_paths_are_gone_at_the_walks_own_pace_and_named() -> None:
    frames = 300
    motion = walk(frames=frames_to_follow(frames, RATE), sway=0.0)
    way = 0.7 * motion.skeleton.height * (frames - 1) / RATE
    for factor, words in ((2.0, "all of it takes about 600 frames"), (0.5, "reached at frame 150 of 300")):
        result = follow(motion, path_through(np.array([[0.0, 0.0], [way * factor, 0.0]])), frames)
        assert any(words in note for note in result.notes), result.notes
        assert result.root_positions[-1, 0] == pytest.approx(way, rel=1e-3)
        assert np.abs(result.root_positions[:, 2]).max() < 1e-6
    assert len(follow(motion, path_through(np.array([[0.0, 0.0], [1.0, 0.0]])), 1)) == 1


def test_a_closed_path_is_gone_round_as_often_as_fits() -> None:
    frames = 600
    motion = walk(frames=frames_to_follow(frames, RATE))
    height = motion.skeleton.height
    ring = path_through(height * 0.75 * np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.0], [-1.0, 1.0], [0.0, 0.0]]))
    result = follow(motion, ring, frames)  # 13.9 heights at its pace, three times round some 4.6
    assert any("round the path 3.00 times" in note for note in result.notes)
    assert np.linalg.norm(result.root_positions[-1] - result.root_positions[0]) < 0.05 * height
    assert off_path(result, ring).max() < 0.02 + 0.03


def test_the_body_faces_where_it_is_told_to() -> None:
    motion = walk(frames=frames_to_follow(300, RATE), turn=0.2)
    points = S_CURVE * motion.skeleton.height * 0.8
    told = np.radians([90.0, 120.0, 170.0, -150.0])  # the shorter way from 170 is over 180
    result = follow(motion, path_through(points, told), 300)
    angles = np.degrees(heading_of(result))
    assert angles[0] % 360 == pytest.approx(90, abs=8)
    assert angles[-1] - angles[0] == pytest.approx(120, abs=12)
    assert (np.diff(angles) > -2).all()


def test_a_loop_round_a_ring_closes() -> None:
    """The step over the seam is like the others, in place, heading and pose."""
    motion = walk(frames=300)  # ten periods of a second
    height = motion.skeleton.height
    ring = path_through(height * 1.1 * np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.0], [-1.0, 1.0], [0.0, 0.0]]))
    result = follow_in_a_loop(motion, ring, 290)
    assert len(result) == 290
    assert off_path(result, ring).max() < 0.02 + 0.03
    around = np.concatenate([result.positions, result.positions[:3]])
    steps = np.linalg.norm(np.diff(around, axis=0), axis=-1)
    changes = np.linalg.norm(np.diff(around, n=2, axis=0), axis=-1)
    assert steps[289:].max() <= 1.02 * steps[:289].max()
    assert changes[288:].max() <= 1.1 * changes[:288].max()
    seam = rot.angle_between(result.rotations[-1], result.rotations[0]).max()
    assert seam <= 1.1 * rot.angle_between(result.rotations[1:], result.rotations[:-1]).max()
    assert PACE[0] < 300 / 290 < PACE[1]
