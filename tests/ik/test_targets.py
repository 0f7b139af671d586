"""Where feet should be, and how near to that legs let them come."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from motiongen.contact import foot_joints
from motiongen.ik.footprints import displacements, fill_gaps
from motiongen.ik.legs import find_legs
from motiongen.ik.targets import lowering, within_reach
from tests.ik.rigs import biped
from tests.strategies import generators


@given(generators(), st.integers(0, 8))
def test_gaps_are_filled_as_by_hand(rng: np.random.Generator, frames: int) -> None:
    labels = rng.uniform(size=(40, 3)) < 0.4
    expected = labels.copy()
    for c in range(3):
        standing = np.flatnonzero(labels[:, c])
        for one, other in itertools.pairwise(standing):
            if other - one <= frames:
                expected[one:other, c] = True
    np.testing.assert_array_equal(fill_gaps(labels, frames), expected)


@given(generators(), st.floats(1, 12))
def test_single_feet_ease_as_a_spline_by_hand_does(rng: np.random.Generator, blend: float) -> None:
    """A slow twin: stance by stance and gap by gap, with SciPy's Hermite splines."""
    from scipy.interpolate import CubicHermiteSpline

    motion = biped(toes=False, frames=60)
    legs = find_legs(motion, foot_joints(motion))
    places = np.cumsum(0.01 * rng.normal(size=(60, 2, 3)), axis=0)
    contact = np.repeat(rng.uniform(size=(12, 2)) < 0.5, 5, axis=0)
    contact[0, :] = True
    moves, hold = displacements(places, np.zeros((60, 2)), contact, legs, blend)
    for k in range(2):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], contact[:, k], [0]]).astype(int)))
        runs = list(zip(ends[::2], ends[1::2]))  # first frame, and the one after the last
        prints = [places[a:b, k].mean(axis=0) for a, b in runs]
        expected = np.zeros((60, 3))
        for i, (a, b) in enumerate(runs):
            expected[a:b] = prints[i] - places[a:b, k]
        for t in np.flatnonzero(~contact[:, k]):
            for i, (a, b) in enumerate(runs):
                following = runs[i + 1][0] if i + 1 < len(runs) else 10**6
                preceding = runs[i - 1][1] - 1 if i else -(10**6)
                if b <= t < following:
                    at, beyond, gap = b - 1, b, following - (b - 1)
                elif preceding < t < a:
                    at, beyond, gap = a, a - 1, a - preceding
                else:
                    continue
                span = max(1.0, min(blend, gap))
                if abs(t - at) < span:
                    start = prints[i] - places[at, k]
                    slope = prints[i] - places[beyond, k] - start
                    expected[t] += CubicHermiteSpline([0, span], [start, 0 * start], [slope, 0 * slope])(abs(t - at))
        expected[:, 1] = 0.0
        np.testing.assert_allclose(moves[:, k], expected, atol=1e-12)
        np.testing.assert_array_equal(hold[contact[:, k], k], 1.0)
        assert hold.min() >= 0
        assert hold.max() <= 1


def test_a_stance_that_floats_or_sinks_is_brought_to_the_ground_as_a_whole() -> None:
    motion = biped(toes=False, frames=60)
    legs = find_legs(motion, foot_joints(motion))
    contact = np.zeros((60, 2), dtype=bool)
    contact[10:20, 0] = contact[30:40, 0] = contact[50:60, 0] = True
    heights = np.zeros((60, 2))
    heights[10:20, 0] = 0.02 + 0.005 * np.sin(np.arange(10))
    heights[30:40, 0] = -0.015
    heights[50:60, 0] = 0.2  # on a step
    moves, _ = displacements(np.zeros((60, 2, 3)), heights, contact, legs, 5.0)
    lowest = heights[10:20, 0].min()
    np.testing.assert_allclose(moves[10:20, 0, 1], 0.005 - lowest)
    np.testing.assert_allclose(moves[30:40, 0, 1], 0.01)
    np.testing.assert_array_equal(moves[50:60, 0, 1], 0.0)
    np.testing.assert_array_equal(moves[:, 1], 0.0)


def test_the_places_of_heel_and_toe_come_from_when_both_stand() -> None:
    """While a foot rolls over its toe the heel comes nearer to it; that is no part of the footprint."""
    motion = biped(frames=60)
    legs = find_legs(motion, foot_joints(motion))
    contact = np.zeros((60, 4), dtype=bool)
    contact[10:30, 0] = contact[10:50, 2] = True
    places = np.zeros((60, 4, 3))
    places[:, 2, 2] = 0.1
    places[30:, 0] = np.linspace([0.0, 0.0, 0.0], [0.0, 0.05, 0.05], 30)
    moves, _ = displacements(places, np.zeros((60, 4)), contact, legs, 6.0)
    assert np.abs(moves[contact]).max() < 1e-6


def test_what_is_out_of_reach_slips_over_the_ground() -> None:
    way = np.array([[[0.8, -0.8, 0.0]], [[0.3, -0.9, 0.0]]])
    was = np.array([[[0.2, -0.8, 0.0]], [[0.3, -0.9, 0.0]]])
    shorter = within_reach(way, was, np.ones((2, 1)))
    np.testing.assert_array_equal(shorter[..., 1], way[..., 1])
    assert np.linalg.norm(shorter, axis=-1).max() <= 1
    np.testing.assert_array_equal(shorter[1], way[1])
    assert 0.5 < shorter[0, 0, 0] <= 0.6


@given(generators())
def test_the_root_is_lowered_as_far_as_is_needed(rng: np.random.Generator) -> None:
    hips = np.tile([0.0, 1.0, 0.0], (50, 2, 1))
    ankles = np.stack([0.3 * rng.uniform(size=(50, 2)), np.zeros((50, 2)), np.zeros((50, 2))], axis=-1)
    reach = np.full((50, 2), 1.005)
    drop = lowering(hips, ankles, reach, np.ones((50, 2)), 0.2, 5)
    lower = hips - drop[:, None, None] * [0.0, 1.0, 0.0]
    assert (np.linalg.norm(ankles - lower, axis=-1) <= reach + 1e-9).all()
    assert not lowering(hips, ankles, reach, np.zeros((50, 2)), 0.2, 5).any()
