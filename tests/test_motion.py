"""Motions: what is refused, that nothing changes in place, and the laws of every change."""

from __future__ import annotations

import dataclasses
import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from motiongen import Motion, MotionGenError, Skeleton, kinematics
from motiongen import rotations as rot
from motiongen.motion import METRES_PER_UNIT
from tests.strategies import generators, motions, random_motion, random_quaternions, skeletons

CHAIN = Skeleton(("Root", "Middle", "Tip"), (-1, 0, 1), np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 0]]))


def tolerance(motion: Motion) -> float:
    return 1e-10 * (motion.skeleton.height + float(np.abs(motion.positions).max()))


def chain_motion(frames: int = 10, **changes: Any) -> Motion:
    fields = {"translations": np.zeros((frames, 1, 3)), "translating": (0,), "frame_rate": 30.0}
    return Motion(CHAIN, np.tile(rot.IDENTITY, (frames, 3, 1)), **(fields | changes))


# -- what is refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rotations": np.zeros((0, 3, 4))}, "a motion needs at least one frame; none came"),
        ({"rotations": np.ones((10, 2, 4))}, r"rotations must have shape \(any, 3, 4\), not \(10, 2, 4\)"),
        ({"rotations": np.ones((3, 4))}, r"rotations must have shape \(any, 3, 4\), not \(3, 4\)"),
        ({"rotations": np.zeros((10, 3, 4))}, "the rotation of joint 'Root' at frame 0 is zero"),
        ({"rotations": np.full((10, 3, 4), np.inf)}, r"rotations must be finite numbers; entry \(0, 0, 0\) is inf"),
        ({"translations": np.zeros((10, 2, 3))}, r"translations must have shape \(10, 1, 3\), not \(10, 2, 3\)"),
        ({"translations": np.zeros((9, 1, 3))}, r"translations must have shape \(10, 1, 3\), not \(9, 1, 3\)"),
        ({"translations": np.full((10, 1, 3), np.nan)}, "translations must be finite numbers"),
        ({"translating": ()}, r"translations must have shape \(10, 0, 3\), not \(10, 1, 3\)"),
        ({"translating": (3,)}, r"translating must be ascending joint indices below 3, not \(3,\)"),
        ({"translating": (-1,)}, r"translating must be ascending joint indices below 3, not \(-1,\)"),
        ({"translating": (1, 0)}, "translating must be ascending joint indices"),
        ({"translating": (1, 1)}, "translating must be ascending joint indices"),
        ({"frame_rate": 0.0}, "frame_rate must be a positive number of Hz, not 0.0"),
        ({"frame_rate": -30.0}, "frame_rate must be a positive number of Hz, not -30.0"),
        ({"frame_rate": math.nan}, "frame_rate must be a positive number of Hz, not nan"),
        ({"frame_rate": math.inf}, "frame_rate must be a positive number of Hz, not inf"),
        ({"unit": "parsec"}, "unit must be one of m, cm, mm, in, ft or None, not 'parsec'"),
        ({"up": "x"}, "up must be 'y' or 'z', not 'x'"),
    ],
)
def test_what_is_no_motion_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(MotionGenError, match=message) as caught:
        chain_motion().replace(**changes)
    assert "\n" not in str(caught.value)


def test_the_frame_and_joint_of_a_zero_rotation_are_named() -> None:
    rotations = np.tile(rot.IDENTITY, (10, 3, 1))
    rotations[4, 2] = 0.0
    with pytest.raises(MotionGenError, match="the rotation of joint 'Tip' at frame 4 is zero"):
        chain_motion().replace(rotations=rotations)


# -- immutability and equality


@given(motions())
def test_it_cannot_be_changed(motion: Motion) -> None:
    for field in dataclasses.fields(motion):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(motion, field.name, None)
    arrays = [motion.rotations, motion.translations, motion.positions, motion.world_rotations]
    arrays += [motion.local_translations, motion.root_positions]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


def test_the_callers_arrays_stay_the_callers() -> None:
    rotations, translations = np.tile(rot.IDENTITY, (10, 3, 1)), np.zeros((10, 1, 3))
    motion = Motion(CHAIN, rotations, translations, (0,), 30.0)
    rotations[:], translations[:] = 0.5, 7.0
    assert motion == chain_motion()


@given(motions(), st.floats(0.01, 100))
def test_rotations_are_made_unit_and_unit_ones_are_kept_bit_for_bit(motion: Motion, factor: float) -> None:
    assert_allclose(np.linalg.norm(motion.rotations, axis=-1), 1.0, atol=1e-9)
    assert np.array_equal(motion.replace().rotations, motion.rotations)
    assert_allclose(motion.replace(rotations=factor * motion.rotations).rotations, motion.rotations, atol=1e-12)


@given(motions(min_frames=2))
def test_equality_is_of_what_moves(motion: Motion) -> None:
    twin = motion.replace(name="other", notes=("odd",))
    assert motion == twin
    assert hash(motion) == hash(twin)
    assert pickle.loads(pickle.dumps(motion)) == motion
    assert motion.allclose(twin)
    assert motion != "a motion"
    changed = [
        motion.replace(frame_rate=motion.frame_rate + 1),
        motion.replace(up="z" if motion.up == "y" else "y"),
        motion.replace(unit="mm"),
        motion.replace(rotations=-motion.rotations),
        motion[1:],
        motion.transform(shift=(0, 1, 0)),
    ]
    assert all(other != motion for other in changed)
    assert changed[3].allclose(motion)  # the same rotations
    assert not changed[4].allclose(motion)
    assert not changed[5].allclose(motion)
    assert not changed[0].allclose(motion)


def test_allclose_counts_heights_and_radians() -> None:
    motion = chain_motion()
    assert motion.skeleton.height == 2.0
    near = motion.transform(shift=(1e-3, 0, 0))
    assert near.allclose(motion, tolerance=0.51e-3)
    assert not near.allclose(motion, tolerance=0.49e-3)
    turned = motion.rotations.copy()
    turned[3, 2] = rot.from_axis_angle(np.array([1.0, 0, 0]), 1e-3)  # the tip has nothing below it to move
    assert motion.replace(rotations=turned).allclose(motion, tolerance=1.01e-3)
    assert not motion.replace(rotations=turned).allclose(motion, tolerance=0.99e-3)


# -- frames


@given(motions(max_frames=12), st.integers(-14, 14), st.integers(-14, 14), st.integers(-4, 4).filter(bool))
def test_slices_are_the_slices_of_the_arrays(motion: Motion, start: int, stop: int, step: int) -> None:
    if len(motion.rotations[start:stop:step]) == 0:
        with pytest.raises(MotionGenError, match=rf"of a clip with frames 0 to {len(motion) - 1}"):
            motion[start:stop:step]
        return
    part = motion[start:stop:step]
    assert np.array_equal(part.rotations, motion.rotations[start:stop:step])
    assert np.array_equal(part.translations, motion.translations[start:stop:step])
    assert_allclose(part.positions, motion.positions[start:stop:step], atol=tolerance(motion))
    assert part.frame_rate == motion.frame_rate / abs(step)
    assert part.skeleton is motion.skeleton


@given(motions())
def test_one_frame_is_a_motion(motion: Motion) -> None:
    for frame in range(-len(motion), len(motion)):
        one = motion[frame]
        assert len(one) == 1
        assert one.duration == 0.0
        assert np.array_equal(one.rotations[0], motion.rotations[frame])
    for outside in (len(motion), -len(motion) - 1):
        with pytest.raises(MotionGenError, match=f"there is no frame {outside} in a clip with frames 0 to"):
            motion[outside]
    assert list(motion) == [motion[frame] for frame in range(len(motion))]


@given(motions())
def test_backwards_twice_is_forwards(motion: Motion) -> None:
    assert motion[::-1][::-1] == motion
    assert motion[:] == motion


@given(motions(min_frames=2))
def test_duration_is_from_the_first_to_the_last_frame(motion: Motion) -> None:
    assert motion.duration == pytest.approx((len(motion) - 1) / motion.frame_rate)
    cut = len(motion) // 2
    gap = 1 / motion.frame_rate
    assert motion[:cut].duration + gap + motion[cut:].duration == pytest.approx(motion.duration)


# -- another rate


@given(motions(max_frames=30), st.integers(1, 7))
def test_lowering_by_an_integer_is_slicing(motion: Motion, factor: int) -> None:
    assert motion.resample(motion.frame_rate / factor) == motion[::factor]


@given(motions(max_frames=12), st.integers(1, 7))
def test_raising_by_an_integer_keeps_every_frame_and_comes_back(motion: Motion, factor: int) -> None:
    up = motion.resample(motion.frame_rate * factor)
    assert len(up) == (len(motion) - 1) * factor + 1
    assert up[::factor].replace(frame_rate=motion.frame_rate) == motion
    assert up.resample(motion.frame_rate) == motion


@given(motions(max_frames=12), st.floats(0.5, 300))
def test_resampling_never_extrapolates_and_keeps_the_time(motion: Motion, frame_rate: float) -> None:
    other = motion.resample(frame_rate)
    assert other.frame_rate == frame_rate
    assert np.array_equal(other.rotations[0], motion.rotations[0])
    assert np.array_equal(other.translations[0], motion.translations[0])
    assert other.duration <= motion.duration * (1 + 1e-9) + 2e-6 / motion.frame_rate
    assert other.duration > motion.duration - (1 + 1e-5) / frame_rate
    low, high = motion.translations.min(axis=0), motion.translations.max(axis=0)
    room = 1e-12 * (1 + np.abs(motion.translations).max(initial=0.0))
    assert (other.translations >= low - room).all()
    assert (other.translations <= high + room).all()


@given(motions(min_frames=2, max_frames=8), st.floats(1.1, 9.7))
def test_resampling_equals_a_slow_twin(motion: Motion, factor: float) -> None:
    other = motion.resample(motion.frame_rate * factor)
    for frame in range(len(other)):
        time = frame / factor  # in frames of the motion
        before = min(int(time + 1e-6), len(motion) - 2)
        weight = time - before
        for joint in range(len(motion.skeleton)):
            a, b = motion.rotations[before, joint], motion.rotations[before + 1, joint]
            got = other.rotations[frame, joint]
            whole = rot.angle_between(a, b)  # at constant speed, and so on the great arc
            assert_allclose(rot.angle_between(a, got), weight * whole, atol=1e-5)
            assert_allclose(rot.angle_between(got, b), (1 - weight) * whole, atol=1e-5)
        straight = (1 - weight) * motion.translations[before] + weight * motion.translations[before + 1]
        assert_allclose(other.translations[frame], straight, atol=1e-5 * (1 + np.abs(straight).max(initial=0.0)))


@given(motions(), st.sampled_from([math.nan, math.inf, 0.0, -1.0]))
def test_impossible_rates_are_refused(motion: Motion, frame_rate: float) -> None:
    with pytest.raises(MotionGenError, match="frame_rate must be a positive number of Hz, not"):
        motion.resample(frame_rate)


def test_a_uniform_turn_stays_uniform_at_any_rate() -> None:
    """At 29.97, 24 and 144 Hz, a joint that turns at two radians a second does so between any two frames."""
    angles = 2.0 * np.arange(60) / 30.0
    turning = rot.from_axis_angle(np.array([0.0, 0.6, 0.8]), angles)
    motion = chain_motion(60).replace(rotations=np.repeat(turning[:, None], 3, axis=1))
    for frame_rate in (29.97, 24.0, 144.0, 30.0, 7.0):
        other = motion.resample(frame_rate)
        steps = rot.angle_between(other.rotations[:-1], other.rotations[1:])
        assert_allclose(steps, 2.0 / frame_rate, atol=1e-9)


# -- placing, scaling, up


@given(motions(), generators())
def test_transform_moves_the_whole_world_and_composes(motion: Motion, rng: np.random.Generator) -> None:
    first, second = random_quaternions(rng, 2)
    shift, other = rng.normal(size=(2, 3)) * motion.skeleton.height
    moved = motion.transform(first, shift)
    room = tolerance(motion) * 20
    assert_allclose(moved.positions, rot.rotate(first, motion.positions) + shift, rtol=0, atol=room)
    world = rot.multiply(first, motion.world_rotations)
    assert rot.angle_between(moved.world_rotations, world).max() < 1e-9
    twice = moved.transform(second, other)
    once = motion.transform(rot.multiply(second, first), rot.rotate(second, shift) + other)
    assert_allclose(twice.positions, once.positions, rtol=0, atol=room)
    back = moved.transform(shift=-shift).transform(rot.inverse(first))
    assert_allclose(back.positions, motion.positions, rtol=0, atol=room)
    assert motion.transform() == motion


def test_transform_takes_plain_lists() -> None:
    turned = chain_motion().transform([0.0, 1.0, 0.0, 0.0], [1, 2, 3])
    assert_allclose(turned.root_positions, np.tile([1.0, 2, 3], (10, 1)))


@given(motions(), st.floats(1e-3, 1e3))
def test_scale_scales_every_length(motion: Motion, factor: float) -> None:
    scaled = motion.scale(factor)
    assert_allclose(scaled.positions, factor * motion.positions, rtol=0, atol=factor * tolerance(motion))
    tips = kinematics.end_site_positions(motion)
    assert_allclose(kinematics.end_site_positions(scaled), factor * tips, rtol=0, atol=10 * factor * tolerance(motion))
    if len(motion.skeleton) > 1:  # a point has height 1 at any scale
        assert scaled.skeleton.height == pytest.approx(factor * motion.skeleton.height)
    assert scaled.unit is None
    assert motion.scale(factor, "ft").unit == "ft"


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_impossible_scales_are_refused(factor: float) -> None:
    with pytest.raises(MotionGenError, match="a scale must be a positive number, not"):
        chain_motion().scale(factor)


@pytest.mark.parametrize("there", METRES_PER_UNIT)
@pytest.mark.parametrize("here", METRES_PER_UNIT)
def test_units_convert_and_come_back(here: str, there: str) -> None:
    motion = random_motion(np.random.default_rng(5), unit=here)
    other = motion.convert_unit(there)
    metres = METRES_PER_UNIT[there] * other.positions
    assert_allclose(metres, METRES_PER_UNIT[here] * motion.positions, rtol=1e-12, atol=1e-12)
    assert other.unit == there
    assert other.convert_unit(here).allclose(motion)


def test_units_that_are_not_known_are_refused() -> None:
    with pytest.raises(MotionGenError, match="the unit of 'motion' is not known; say what it is when loading it"):
        chain_motion().convert_unit("cm")
    with pytest.raises(MotionGenError, match="unit must be one of m, cm, mm, in, ft, not 'mile'"):
        chain_motion(unit="m").convert_unit("mile")


@given(motions())
def test_a_z_up_motion_is_turned_so_that_y_is_up(motion: Motion) -> None:
    turned = motion.turn_up("z")
    assert turned.up == "z"
    x, y, z = (motion.positions[..., axis] for axis in range(3))
    assert_allclose(turned.positions, np.stack([x, z, -y], axis=-1), rtol=0, atol=tolerance(motion))
    bones = turned.skeleton.offsets[1:]
    assert np.array_equal(bones, motion.skeleton.offsets[1:])  # in their parents' frames, which turn with joint 0
    assert motion.turn_up("y") == motion.replace(up="y")
    with pytest.raises(MotionGenError, match="up must be 'y' or 'z', not 'x'"):
        motion.turn_up("x")


@given(motions())
def test_another_up_axis_for_writing_changes_nothing_inside(motion: Motion) -> None:
    for up in ("y", "z"):
        other = motion.replace(file_layout="layout").change_up(up)
        assert np.array_equal(other.positions, motion.positions)
        assert other.up == up
        assert other.file_layout == "layout"  # names and channel orders are the same on any axes


# -- translating joints


@given(motions(), generators())
def test_storing_more_translations_changes_nothing(motion: Motion, rng: np.random.Generator) -> None:
    more = [j for j in range(len(motion.skeleton)) if rng.uniform() < 0.5]
    wide = motion.with_translating(more)
    assert wide.translating == tuple(sorted({*more, *motion.translating}))
    assert np.array_equal(wide.positions, motion.positions)
    assert np.array_equal(wide.local_translations, motion.local_translations)


@given(skeletons(), generators())
def test_the_root_carries_half_of_the_joints_or_is_joint_0(skeleton: Skeleton, rng: np.random.Generator) -> None:
    for joint in range(len(skeleton)):
        motion = random_motion(rng, skeleton, frames=2, translating=[joint])
        carries = 2 * len(skeleton.subtree(joint)) >= len(skeleton)
        assert motion.root == (joint if carries else 0)
        assert random_motion(rng, skeleton, frames=1, translating=sorted({0, joint})).root == 0
    assert random_motion(rng, skeleton, frames=1, translating=()).root == 0
    assert motion.root_positions.shape == (2, 3)
