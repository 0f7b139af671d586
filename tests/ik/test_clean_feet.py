"""Feet that stand stay where they stand, on any skeleton, and nothing else changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given

from motiongen import rotations as rot
from motiongen.contact import contact_labels, foot_joints
from motiongen.errors import MotionGenError
from motiongen.ik import BLEND_SECONDS, GAP_SECONDS, KNEE_SECONDS, LARGEST_DROP, clean_feet
from motiongen.ik.legs import find_legs
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.ik.rigs import biped, drifting, ground_steps, spider, sway
from tests.strategies import generators, motions


@pytest.mark.parametrize("make", [lambda: biped(toes=False), biped, spider])
def test_feet_that_stand_do_not_move_over_the_ground(make: Any) -> None:
    still_one = make()
    sliding = drifting(still_one, sway(60))
    feet = foot_joints(sliding)
    cleaned = clean_feet(sliding, feet, np.ones((60, len(feet)), dtype=bool))
    assert ground_steps(sliding, feet).max() > 1e-3
    assert ground_steps(cleaned, feet).max() < 1e-6
    # Near where they were on average, and at the height that they had.
    gap = (cleaned.positions - sliding.positions)[:, list(feet)].mean(axis=0)
    assert np.abs(gap).max() < 1e-6
    np.testing.assert_allclose(cleaned.positions[:, list(feet), 1], sliding.positions[:, list(feet), 1], atol=1e-7)


def test_they_do_not_on_a_body_that_turns_either() -> None:
    motion = spider()
    seconds = np.arange(60) / 30
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.from_rotation_vector(
        np.stack([0.03 * np.sin(2 * seconds), 0.05 * np.sin(3 * seconds), 0.03 * np.cos(seconds) - 0.03], axis=-1)
    )
    motion = motion.replace(rotations=rotations)
    feet = foot_joints(motion)
    cleaned = clean_feet(motion, feet, np.ones((60, len(feet)), dtype=bool))
    assert ground_steps(motion, feet).max() > 1e-3
    assert ground_steps(cleaned, feet).max() < 1e-6


@given(generators())
def test_only_legs_and_root_height_change_and_only_near_stances(rng: np.random.Generator) -> None:
    motion = drifting(biped(frames=120, extra=3), 0.03 * np.cumsum(rng.normal(size=(120, 3)), axis=0) * [1, 0, 1] / 10)
    feet = foot_joints(motion)
    labels = np.zeros((120, 4), dtype=bool)
    start = int(rng.integers(40, 60))
    labels[start : start + 20, 0] = True  # the left ankle
    cleaned = clean_feet(motion, feet, labels)
    names = motion.skeleton.names
    moving = {"Left0", "Left1", "LeftFoot", "LeftToe"}
    if cleaned.positions[:, 0, 1].tolist() != motion.positions[:, 0, 1].tolist():
        moving |= {"Right0", "Right1", "RightFoot", "RightToe"}  # a lower root takes both legs along
    kept = [j for j, name in enumerate(names) if name not in moving]
    np.testing.assert_array_equal(cleaned.rotations[:, kept], motion.rotations[:, kept])
    np.testing.assert_array_equal(cleaned.translations[..., [0, 2]], motion.translations[..., [0, 2]])
    assert (cleaned.translations[..., 1] <= motion.translations[..., 1]).all()
    reach = int(np.ceil((2 * BLEND_SECONDS + KNEE_SECONDS) * 30)) + 2
    far = np.abs(np.arange(120) - (start + 9.5)) > 10 + 2 * reach
    assert far.any()
    np.testing.assert_array_equal(cleaned.rotations[far], motion.rotations[far])
    np.testing.assert_array_equal(cleaned.translations[far], motion.translations[far])
    assert cleaned.skeleton == motion.skeleton
    assert (cleaned.rotations[start : start + 20] != motion.rotations[start : start + 20]).any()


@given(motions(min_frames=1, max_frames=20), generators())
def test_any_skeleton_will_do(motion: Motion, rng: np.random.Generator) -> None:
    feet = rng.permutation(len(motion.skeleton))[: int(rng.integers(0, 5))].tolist()
    labels = rng.uniform(size=(len(motion), len(feet))) < 0.5
    cleaned = clean_feet(motion, feet, labels)
    legs = find_legs(motion, feet)
    kept = sorted(set(range(len(motion.skeleton))) - {*legs.hips, *legs.knees, *legs.feet})
    np.testing.assert_array_equal(cleaned.rotations[:, kept], motion.rotations[:, kept])
    others = [j for j in range(len(motion.skeleton)) if j != motion.root]
    np.testing.assert_array_equal(cleaned.local_translations[:, others], motion.local_translations[:, others])
    lower = (motion.root_positions - cleaned.root_positions) / motion.skeleton.height
    np.testing.assert_allclose(lower[:, [0, 2]], 0, atol=1e-9)
    assert lower[:, 1].min() > -1e-9
    assert lower[:, 1].max() < LARGEST_DROP + 1e-9


def test_the_foot_keeps_its_orientation() -> None:
    motion = drifting(biped(toes=False), sway(60))
    feet = list(foot_joints(motion))
    cleaned = clean_feet(motion, feet, np.ones((60, 2), dtype=bool))
    assert rot.angle_between(cleaned.world_rotations[:, feet], motion.world_rotations[:, feet]).max() < 1e-6
    shins = [j for j, name in enumerate(motion.skeleton.names) if name in ("Left1", "Right1")]
    assert rot.angle_between(cleaned.world_rotations[:, shins], motion.world_rotations[:, shins]).max() > 0.01


def test_a_foot_turns_for_its_toes() -> None:
    """The heel stands, the toe is pushed aside: both stay where they are on average."""
    motion = biped()
    rotations = motion.rotations.copy()
    foot = motion.skeleton.index("LeftFoot")
    aside = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), 0.06 * np.sin(np.arange(60) / 7))
    rotations[:, foot] = rot.multiply(rotations[:, foot], aside)
    motion = motion.replace(rotations=rotations)
    feet = foot_joints(motion)
    cleaned = clean_feet(motion, feet, np.ones((60, 4), dtype=bool))
    assert ground_steps(motion, feet).max() > 5e-4
    assert ground_steps(cleaned, feet).max() < 2e-5
    # A pivot of a right angle is none of its business.
    far = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.linspace(-0.8, 0.8, 60))
    rotations[:, foot] = rot.multiply(motion.rotations[0, foot], far)
    motion = motion.replace(rotations=rotations)
    turned = clean_feet(motion, feet, np.ones((60, 4), dtype=bool)).world_rotations[:, foot]
    assert np.degrees(rot.angle_between(turned, motion.world_rotations[:, foot])).max() < 10 + 1e-6
    assert np.degrees(rot.angle_between(turned[0], turned[-1])) > 70


def test_heel_and_toe_come_and_go_apart() -> None:
    """A sliding foot whose heel lands first and leaves first: each stands while it is labelled, none stretches."""
    motion = drifting(biped(frames=90), np.linspace(0, 0.06, 90)[:, None] * [0.0, 0.0, 1.0])
    feet = foot_joints(motion)
    labels = np.zeros((90, 4), dtype=bool)
    labels[20:50, 0] = labels[30:60, 2] = True
    assert motion.skeleton.names[feet[2]] == "LeftToe"
    cleaned = clean_feet(motion, feet, labels)
    steps = ground_steps(cleaned, feet)
    for k in (0, 2):
        both = labels[1:, k] & labels[:-1, k]
        assert steps[both, k].max() < 0.3 * ground_steps(motion, feet).max()
        assert np.median(steps[both, k]) < 1e-6  # but while the other one comes or goes, which tugs at it
    # Nothing jumps: no velocity changes faster than where a cubic eases out of half of the slide.
    change = np.linalg.norm(np.diff(cleaned.positions, n=2, axis=0), axis=-1).max()
    assert change < 6 * 0.03 / (30 * BLEND_SECONDS) ** 2


@given(generators())
def test_nothing_that_flows_is_made_to_jump(rng: np.random.Generator) -> None:
    seconds = np.arange(120) / 60
    motion = biped(frames=120, frame_rate=60.0)
    motion = drifting(motion, 0.05 * seconds[:, None] * [0.0, 0.0, 1.0])
    feet = foot_joints(motion)
    labels = np.zeros((120, 4), dtype=bool)
    for side in range(2):
        begins, ends = np.sort(rng.choice(np.arange(0, 120, 10), size=2, replace=False))
        labels[begins : ends + 10, [side, side + 2]] = True
    cleaned = clean_feet(motion, feet, labels)
    turns = rot.angle_between(cleaned.rotations[1:], cleaned.rotations[:-1])
    assert np.degrees(turns.max()) < 3
    # Easing out of half the slide of two seconds, in cubic steps.
    assert ground_steps(cleaned, feet).max() < 1.5 * 0.05 / (60 * BLEND_SECONDS) + 2 * ground_steps(motion, feet).max()


def test_a_leg_too_short_lowers_the_root_and_no_foot_is_lifted() -> None:
    motion = drifting(biped(bend=0.1, toes=False, frames=90), np.linspace(-0.15, 0.15, 90)[:, None] * [0.0, 0.0, 1.0])
    feet = foot_joints(motion)
    labels = np.zeros((90, 2), dtype=bool)
    labels[25:65] = True
    size = motion.skeleton.height
    lowered = clean_feet(motion, feet, labels)
    drop = (motion.root_positions - lowered.root_positions)[:, 1] / size
    assert 0.003 < drop.max() <= LARGEST_DROP
    assert drop.min() == 0
    assert np.abs(np.diff(drop)).max() < 0.1 * drop.max() + 1e-4
    kept = clean_feet(motion, feet, labels, largest_drop=0.0)
    np.testing.assert_array_equal(kept.translations, motion.translations)
    standing = labels[1:] & labels[:-1]
    slips = [ground_steps(each, feet)[standing].mean() for each in (motion, kept, lowered)]
    assert slips[2] < 0.2 * slips[0]
    assert slips[2] < slips[1] < slips[0]
    for each in (kept, lowered):
        assert np.abs((each.positions - motion.positions)[:, list(feet), 1]).max() / size < 0.003


def test_the_root_is_lowered_under_a_parent_that_is_turned() -> None:
    motion = drifting(biped(bend=0.1, toes=False, frames=90), np.linspace(-0.15, 0.15, 90)[:, None] * [0.0, 0.0, 1.0])
    skeleton = motion.skeleton
    turn = rot.from_rotation_vector(np.array([0.4, 1.0, -0.7]))
    above = Skeleton(
        ("World", *skeleton.names),
        (-1, *(parent + 1 for parent in skeleton.parents)),
        np.concatenate([np.zeros((1, 3)), skeleton.offsets]),
    )
    rotations = np.concatenate([np.broadcast_to(turn, (90, 1, 4)), motion.rotations], axis=1)
    rotations[:, 1] = rot.multiply(rot.inverse(turn), motion.rotations[:, 0])
    translations = rot.rotate(rot.inverse(turn), motion.translations)
    below = Motion(above, rotations, translations, (1,), 30.0)
    labels = np.zeros((90, 2), dtype=bool)
    labels[25:65] = True
    a, b = clean_feet(motion, foot_joints(motion), labels), clean_feet(below, foot_joints(below), labels)
    assert below.root == 1
    assert (a.root_positions[:, 1] < motion.root_positions[:, 1]).any()
    np.testing.assert_allclose(b.positions[:, 1:], a.positions, atol=1e-6)


@given(generators())
def test_it_does_not_matter_where_the_character_is_or_whither_it_looks_or_in_which_unit(
    rng: np.random.Generator,
) -> None:
    motion = drifting(biped(frames=40), sway(40, 0.05))
    feet = foot_joints(motion)
    labels = np.repeat(rng.uniform(size=(8, 4)) < 0.6, 5, axis=0)
    cleaned = clean_feet(motion, feet, labels)
    turn, shift = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), rng.uniform(-3, 3)), rng.normal(size=3)
    there = clean_feet(motion.transform(turn, shift), feet, labels)
    np.testing.assert_allclose(there.positions, cleaned.transform(turn, shift).positions, atol=1e-6)
    scaled = clean_feet(motion.scale(100.0), feet, labels)
    np.testing.assert_allclose(scaled.positions, 100 * cleaned.positions, atol=1e-4)


@given(generators())
def test_backwards_it_is_the_same(rng: np.random.Generator) -> None:
    motion = drifting(biped(frames=40), sway(40, 0.05))
    feet = foot_joints(motion)
    labels = np.repeat(rng.uniform(size=(8, 4)) < 0.6, 5, axis=0)
    backwards = clean_feet(motion[::-1], feet, labels[::-1])[::-1]
    np.testing.assert_allclose(backwards.positions, clean_feet(motion, feet, labels).positions, atol=1e-6)


def test_without_contact_it_is_the_very_same_motion() -> None:
    motion = drifting(biped(), sway(60))
    feet = foot_joints(motion)
    assert clean_feet(motion, feet, np.zeros((60, 4), dtype=bool)) is motion
    assert clean_feet(motion, ()) is motion


@pytest.mark.parametrize("bend", [0.5, 0.0])
def test_feet_that_stand_still_already_stay_as_they_are(bend: float) -> None:
    motion = biped(bend)
    cleaned = clean_feet(motion, labels=np.ones((60, 4), dtype=bool))
    assert cleaned.allclose(motion, 1e-9 if bend else 1e-6)


def test_no_foot_is_dragged_far() -> None:
    motion = drifting(biped(toes=False), np.linspace(-0.4, 0.4, 60)[:, None] * [0.0, 0.0, 1.0])
    feet = list(foot_joints(motion))
    cleaned = clean_feet(motion, feet, np.ones((60, 2), dtype=bool))
    moved = np.linalg.norm((cleaned.positions - motion.positions)[:, feet], axis=-1) / motion.skeleton.height
    assert 0.05 < moved.max() <= 0.1


def test_quaternions_keep_their_signs() -> None:
    motion = drifting(biped(), sway(60))
    flipped = motion.replace(rotations=-motion.rotations)
    labels = np.ones((60, 4), dtype=bool)
    assert np.sum(clean_feet(flipped, labels=labels).rotations * flipped.rotations, axis=-1).min() > 0.9


def test_a_single_frame_stays_as_it_is() -> None:
    motion = biped()[7]
    assert clean_feet(motion, labels=np.ones((1, 4), dtype=bool)).allclose(motion, 1e-9)


def test_contact_at_both_ends_of_the_clip() -> None:
    motion = drifting(biped(toes=False, frames=60), sway(60, 0.03))
    feet = foot_joints(motion)
    labels = np.zeros((60, 2), dtype=bool)
    labels[:10] = labels[-10:] = True
    steps = ground_steps(clean_feet(motion, feet, labels), feet)
    assert max(steps[:9].max(), steps[-9:].max()) < 1e-6
    assert steps.max() < 0.02


def test_a_foot_chosen_by_its_index_is_cleaned_alone() -> None:
    motion = drifting(biped(toes=False), sway(60))
    left, right = foot_joints(motion)
    cleaned = clean_feet(motion, [left], np.ones((60, 1), dtype=bool))
    assert ground_steps(cleaned, [left]).max() < 1e-6
    np.testing.assert_array_equal(cleaned.positions[:, right], motion.positions[:, right])


def test_a_foot_that_slides_as_it_should_is_left_alone() -> None:
    """Only what is not of its own steps is taken out."""
    own = drifting(biped(), sway(60))
    feet = foot_joints(own)
    labels = np.ones((60, len(feet)), dtype=bool)
    ground = own.positions[:, list(feet)][..., [0, 2]] / own.skeleton.height
    steps = np.diff(ground, axis=0, prepend=ground[:1])
    assert clean_feet(own, feet, labels, steps).allclose(own, tolerance=1e-7)
    disturbed = drifting(own, sway(60, size=0.013)[::-1])
    cleaned = clean_feet(disturbed, feet, labels, steps)
    slides = np.diff(cleaned.positions[:, list(feet)][..., [0, 2]], axis=0) / own.skeleton.height
    np.testing.assert_allclose(slides, steps[1:], atol=1e-6)


def test_labels_are_found_where_none_are_given() -> None:
    motion = drifting(biped(), sway(60))
    feet = foot_joints(motion)
    labels = contact_labels(motion, feet)
    assert labels.any()
    assert clean_feet(motion) == clean_feet(motion, feet, labels)
    assert clean_feet(motion) == clean_feet(motion, labels=labels.astype(int).tolist())


def test_a_label_that_drops_out_for_a_moment_does_not_release_the_foot() -> None:
    motion = drifting(biped(toes=False), sway(60))
    feet = foot_joints(motion)
    labels = np.ones((60, 2), dtype=bool)
    labels[30 : 30 + int(GAP_SECONDS * 30) - 1] = False
    assert ground_steps(clean_feet(motion, feet, labels), feet).max() < 1e-6


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"labels": np.ones((60, 3), dtype=bool)}, r"labels must have shape \(60, 4\).*not \(60, 3\)"),
        ({"labels": np.ones(60, dtype=bool)}, r"labels must have shape \(60, 4\).*not \(60,\)"),
        ({"labels": np.full((60, 4), 0.4)}, "true or false"),
        ({"feet": [99]}, "there is no joint 99"),
        ({"feet": [3, 4, 3]}, "joint 3 came twice"),
        ({"blend_seconds": -0.1}, "blend_seconds must be zero or a positive number, not -0.1"),
        ({"blend_seconds": float("nan")}, "blend_seconds must be"),
        ({"largest_drop": float("inf")}, "largest_drop must be"),
    ],
)
def test_mistakes_are_refused_in_one_line(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(MotionGenError, match=words) as raised:
        clean_feet(biped(), **arguments)
    assert "\n" not in str(raised.value)
