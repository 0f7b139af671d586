"""Features and back: the exact inverse, whatever the skeleton, the unit, and the joint that carries the motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from motiongen import Motion, MotionGenError, Skeleton
from motiongen import rotations as rot
from motiongen.features import from_features, layout_of, to_features
from tests.strategies import motions, random_motion, random_skeleton, skeletons


@given(motions(min_frames=2))
def test_features_and_back_is_the_same_motion(motion: Motion) -> None:
    layout = layout_of([motion])
    features = to_features(motion, layout)
    assert features.shape == (len(motion), layout.size)
    assert from_features(features, layout, motion).allclose(motion, tolerance=1e-7)


@given(motions(of=skeletons(min_joints=2), min_frames=2))
def test_features_do_not_depend_on_the_unit_or_on_the_place(motion: Motion) -> None:
    features = to_features(motion, layout_of([motion]))
    scaled = motion.scale(37.0)
    np.testing.assert_allclose(to_features(scaled, layout_of([scaled])), features, atol=1e-8)
    moved = motion.transform(shift=[3.0, 0.0, -5.0])
    np.testing.assert_allclose(to_features(moved, layout_of([moved])), features, atol=1e-8)


def test_slices_are_apart_and_cover_every_feature() -> None:
    rng = np.random.default_rng(0)
    motion = random_motion(rng, random_skeleton(rng, 9), frames=5, translating=(0, 3, 7))
    layout = layout_of([motion])
    slices = ("rotations", "root_steps", "root_height", "translations", "contacts", "foot_steps")
    parts = [getattr(layout, name) for name in slices]
    covered = [i for part in parts for i in range(part.start, part.stop)]
    assert covered == list(range(layout.size))
    assert sorted(layout.joint_features(range(9))) == list(range(layout.size))
    assert set(layout.joint_features([3])).isdisjoint(layout.joint_features([0, 1, 2, 4, 5, 6, 7, 8]))


def test_a_still_root_above_moving_hips_takes_no_steps() -> None:
    """The hips carry the motion; joint 0 keeps its place, turned frame and all."""
    rng = np.random.default_rng(1)
    names = ("world", "hips", "spine", "leg")
    skeleton = Skeleton(names, (-1, 0, 1, 1), rng.normal(size=(4, 3)))
    motion = random_motion(rng, skeleton, frames=20, translating=(1,))
    layout = layout_of([motion])
    assert layout.root == 1
    features = to_features(motion, layout)
    back = from_features(features, layout, motion)
    assert back.translating == (1,)
    np.testing.assert_allclose(back.positions, motion.positions, atol=1e-9)
    steps = np.diff(motion.positions[:, 1][:, [0, 2]], axis=0) / skeleton.height
    np.testing.assert_allclose(features[1:, layout.root_steps], steps, atol=1e-12)


def test_one_layout_holds_clips_with_different_moving_joints() -> None:
    rng = np.random.default_rng(2)
    skeleton = random_skeleton(rng, 6)
    a = random_motion(rng, skeleton, frames=8, translating=(0,))
    b = random_motion(rng, skeleton, frames=9, translating=(0, 4))
    layout = layout_of([a, b])
    for clip in (a, b):
        assert from_features(to_features(clip, layout), layout, clip).allclose(clip, tolerance=1e-7)


def test_contact_labels_are_appended(shared_data: object) -> None:
    from motiongen import load
    from motiongen.contact import contact_labels

    motion = load(f"{shared_data}/characters/xia-normal-walk.bvh").resample(30)
    layout = layout_of([motion], contacts=True)
    labels = to_features(motion, layout)[:, layout.contacts]
    assert len(layout.feet) >= 2
    np.testing.assert_array_equal(labels, contact_labels(motion, layout.feet))
    steps = np.diff(motion.positions[:, list(layout.feet)][..., [0, 2]], axis=0) / motion.skeleton.height
    np.testing.assert_allclose(
        to_features(motion, layout)[1:, layout.foot_steps], steps.reshape(len(steps), -1), atol=1e-12
    )


def test_clips_of_two_skeletons_are_refused_by_name() -> None:
    rng = np.random.default_rng(3)
    a = random_motion(rng, random_skeleton(rng, 5), frames=4)
    b = random_motion(rng, random_skeleton(rng, 6), frames=4).replace(name="other")
    with pytest.raises(MotionGenError, match=r"'other' has another skeleton .* extra joint"):
        layout_of([a, b])
    with pytest.raises(MotionGenError, match="none came"):
        layout_of([])


def test_the_start_is_where_it_is_asked_to_be() -> None:
    rng = np.random.default_rng(4)
    motion = random_motion(rng, frames=6, translating=(0,))
    layout = layout_of([motion])
    back = from_features(to_features(motion, layout), layout, motion, start=np.array([2.0, 9.0]))
    np.testing.assert_allclose(back.root_positions[0, [0, 2]], [2.0, 9.0])
    np.testing.assert_allclose(np.diff(back.positions, axis=0), np.diff(motion.positions, axis=0), atol=1e-9)
    assert np.abs(rot.angle_between(back.rotations, motion.rotations)).max() < 1e-7
