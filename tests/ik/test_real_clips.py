"""The clean-up of captured clips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from motiongen import rotations as rot
from motiongen.contact import contact_labels, foot_joints
from motiongen.ik import clean_feet
from motiongen.ik.legs import find_legs
from motiongen.motion import Motion
from motiongen.quality import foot_skate, jitter, penetration
from tests.ik.rigs import drifting, ground_steps
from tests.puppets import load_clip


def leg_turns(motion: Motion, feet: Sequence[int]) -> float:
    legs = find_legs(motion, feet)
    joints = sorted({*legs.hips, *legs.knees, *legs.feet})
    return float(rot.angle_between(motion.rotations[1:, joints], motion.rotations[:-1, joints]).max())


@pytest.mark.parametrize("path", ["characters/Walk-In-Circle.bvh", "characters/elephant-idle1.bvh", "cmu/01_01.bvh"])
def test_captured_clips_slide_less_and_hardly_change(path: str, shared_data: Path) -> None:
    motion = load_clip(shared_data / path)
    motion = motion[-1800:] if len(motion) > 1800 else motion  # the T-pose before it is no motion
    feet = foot_joints(motion)
    cleaned = clean_feet(motion, feet)
    before, after = foot_skate(motion, feet), foot_skate(cleaned, feet)
    assert before is not None
    assert after is not None
    assert after < 0.97 * before
    stands = contact_labels(motion, feet)
    both = stands[1:] & stands[:-1]
    assert ground_steps(cleaned, feet)[both].mean() < 0.4 * ground_steps(motion, feet)[both].mean()
    assert (
        np.abs((cleaned.positions - motion.positions)[:, list(feet), 1][stands].mean()) < 2e-3 * motion.skeleton.height
    )
    assert leg_turns(cleaned, feet) <= 1.05 * leg_turns(motion, feet)
    assert jitter(cleaned) <= 1.05 * jitter(motion)
    assert penetration(cleaned) <= penetration(motion) + 1e-3
    assert np.degrees(rot.angle_between(cleaned.rotations, motion.rotations).mean()) < 1


def test_a_slide_put_into_a_captured_walk_is_taken_out(shared_data: Path) -> None:
    motion = load_clip(shared_data / "characters/Walk-In-Circle.bvh")
    feet = foot_joints(motion)
    labels = contact_labels(motion, feet)
    seconds = np.arange(len(motion)) / motion.frame_rate
    slide = 0.05 * motion.skeleton.height * np.stack([np.sin(2 * seconds), 0 * seconds, np.cos(2 * seconds)], axis=-1)
    sliding = drifting(motion, slide)
    cleaned = clean_feet(sliding, feet, labels)
    stands = labels[1:] & labels[:-1]
    steps = [ground_steps(each, feet)[stands].mean() for each in (motion, sliding, cleaned)]
    assert steps[1] > 2 * steps[0]
    assert steps[2] < 0.5 * steps[0]
    assert leg_turns(cleaned, feet) <= 1.1 * leg_turns(sliding, feet)
