"""Bringing clips to one rig: nothing moves that need not, and what does not fit is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen import rotations as rot
from motiongen.datasets.rig import MOST_HELD, choose_rig, fit
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from tests.datasets.clips import FIGURE, NAMES, in_other_order, stride, under_still_root
from tests.strategies import generators, random_motion, skeletons

UPPER = ("Hips", "Spine", "Head")


@given(generators(), st.data())
def test_joints_stay_where_they_are_in_the_world(rng: np.random.Generator, data: st.DataObject) -> None:
    """On random trees, with all joints below any chosen top, whatever stands above it."""
    skeleton = data.draw(skeletons(min_joints=2))
    motion = random_motion(rng, skeleton, frames=4, translating=(0,))
    top = data.draw(st.integers(0, len(skeleton) - 1))
    below = skeleton.subtree(top)
    rig = choose_rig([motion], [skeleton.names[joint] for joint in below])
    fitted = fit(motion, rig)
    assert fitted.motion.skeleton.names == tuple(skeleton.names[joint] for joint in below)
    np.testing.assert_allclose(fitted.motion.positions, motion.positions[:, list(below)], atol=1e-9 * skeleton.height)
    assert rot.angle_between(fitted.motion.world_rotations, motion.world_rotations[:, list(below)]).max() < 1e-7
    assert (fitted.bones, fitted.scale, fitted.held) == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert fitted.motion.translating == (0,)


def test_a_still_root_is_merged_into_the_joint_that_moves() -> None:
    motion = stride(1)
    deeper = under_still_root(motion, np.random.default_rng(2))
    rig = choose_rig([deeper])
    assert rig.skeleton.names == NAMES
    np.testing.assert_allclose(fit(deeper, rig).motion.positions, motion.positions, atol=1e-9)
    asked_for = choose_rig([deeper], ["*"])
    assert asked_for.skeleton == rig.skeleton


def test_clips_with_and_without_a_still_root_fit_one_rig() -> None:
    plain, deeper = stride(1), under_still_root(stride(1), np.random.default_rng(2))
    for first, other in ((plain, deeper), (deeper, plain)):
        fitted = fit(other, choose_rig([first]))
        np.testing.assert_allclose(fitted.motion.positions, plain.positions, atol=1e-9)


def test_feet_are_found_and_the_ground_is_no_part_of_the_rig() -> None:
    rig = choose_rig([stride(1), stride(2)])
    assert [rig.skeleton.names[joint] for joint in rig.layout.feet] == ["LeftFoot", "RightFoot"]
    assert rig.skeleton.height == pytest.approx(FIGURE.height)


def test_the_order_of_joints_does_not_matter() -> None:
    motion = stride(3)
    other = in_other_order(motion, [0, 5, 3, 4, 1, 6, 2])
    fitted = fit(other, choose_rig([motion]))
    assert fitted.motion.skeleton.names == NAMES
    np.testing.assert_array_equal(fitted.motion.positions, motion.positions)


def test_a_joint_whose_child_is_left_out_keeps_the_bone_as_an_end_site() -> None:
    rig = choose_rig([stride(3)], UPPER)
    hips = [site for site, joint in enumerate(rig.skeleton.end_sites) if joint == 0]
    tips = {tuple(rig.skeleton.end_site_offsets[site]) for site in hips}
    assert tips == {tuple(FIGURE.offsets[3]), tuple(FIGURE.offsets[5])}


def test_other_bone_lengths_are_told_and_kept_in_the_motion() -> None:
    longer = FIGURE.offsets.copy()
    longer[4] *= 1.2
    motion = stride(3, skeleton=dataclasses.replace(FIGURE, offsets=longer))
    rig = choose_rig([stride(4)])
    fitted = fit(motion, rig)
    np.testing.assert_allclose(fitted.motion.positions, motion.positions, atol=1e-12)
    theirs, ours = motion.skeleton, rig.skeleton
    assert fitted.scale == pytest.approx(theirs.height / ours.height)
    expected = np.linalg.norm(theirs.offsets[1:] / theirs.height - ours.offsets[1:] / ours.height, axis=-1).max()
    assert fitted.bones == pytest.approx(expected)
    assert fitted.bones > 0.01


def moving_head(amount: float) -> Motion:
    """The figure with a head that moves on its neck, so far in heights to either side."""
    motion = stride(3).with_translating([2])
    translations = motion.translations.copy()
    translations[:, 1, 0] += amount * FIGURE.height * np.where(np.arange(len(motion)) % 2, 1.0, -1.0)
    return motion.replace(translations=translations)


def test_a_joint_that_moves_a_little_is_held_at_its_median_place() -> None:
    amount = 0.5 * MOST_HELD
    fitted = fit(moving_head(amount), choose_rig([stride(3)]))
    assert fitted.held == pytest.approx(amount)
    np.testing.assert_allclose(fitted.motion.skeleton.offsets[2], FIGURE.offsets[2], atol=1e-12)


def without(name: str) -> Motion:
    """The figure without a leaf."""
    joints = [j for j, other in enumerate(NAMES) if other != name]
    motion = stride(3)
    skeleton = dataclasses.replace(
        FIGURE,
        names=tuple(NAMES[j] for j in joints),
        parents=tuple(joints.index(FIGURE.parents[j]) if j else -1 for j in joints),
        offsets=FIGURE.offsets[joints],
        end_sites=(),
        end_site_offsets=np.zeros((0, 3)),
    )
    return motion.replace(skeleton=skeleton, rotations=motion.rotations[:, joints])


def with_offset(joint: int, offset: list[float]) -> Motion:
    offsets = FIGURE.offsets.copy()
    offsets[joint] = offset
    return stride(3, skeleton=dataclasses.replace(FIGURE, offsets=offsets))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (without("Head"), "lacks joint 'Head'"),
        (stride(3, skeleton=dataclasses.replace(FIGURE, names=("Hips", "Chest", *NAMES[2:]))), "lacks joint 'Spine'"),
        (stride(3, skeleton=dataclasses.replace(FIGURE, parents=(-1, 0, 0, 0, 3, 0, 5))), "'Head' hangs from another"),
        (with_offset(1, [0.2, 0.0, 0.0]), "'Spine' rests 90 degrees elsewhere"),
        (moving_head(2 * MOST_HELD), "moves by"),
    ],
)
def test_what_means_something_else_is_refused(motion: Motion, words: str) -> None:
    with pytest.raises(MotionGenError, match=words):
        fit(motion, choose_rig([stride(4)]))


def test_an_extra_joint_is_refused_unless_joints_were_chosen() -> None:
    smaller = without("Head")
    with pytest.raises(MotionGenError, match="extra joint 'Head'"):
        fit(stride(3), choose_rig([smaller]))
    rig = choose_rig([smaller], smaller.skeleton.names)
    np.testing.assert_allclose(
        fit(stride(3), rig).motion.positions, stride(3).positions[:, [0, 1, 3, 4, 5, 6]], atol=1e-12
    )


@pytest.mark.parametrize(
    ("patterns", "words"),
    [
        (["Hips", "Head"], "'Head' is chosen and 'Spine' above it"),
        (["LeftLeg", "RightLeg"], "'RightLeg' is chosen and 'Hips' above it"),
        (["Tail"], "no joint matches 'Tail'"),
    ],
)
def test_joints_that_are_no_tree_are_refused(patterns: list[str], words: str) -> None:
    with pytest.raises(MotionGenError, match=words):
        choose_rig([stride(3)], patterns)
    with pytest.raises(MotionGenError, match="only joints above the root"):
        choose_rig([under_still_root(stride(3), np.random.default_rng(0))], ["Base"])
