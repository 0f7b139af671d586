"""GenMM on motions: rates, lengths, several examples, and what a good synthesis has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import Motion, MotionGenError
from motiongen import rotations as rot
from motiongen.assets import EXAMPLE_CLIP
from motiongen.contact import foot_joints
from motiongen.quality import foot_skate
from tests.strategies import random_motion, random_skeleton


def swinging(frames: int = 90, rate: float = 30.0, joints: int = 5, seed: int = 0) -> Motion:
    rng = np.random.default_rng(seed)
    return random_motion(
        rng, random_skeleton(np.random.default_rng(7), joints), frames=frames, translating=(0,), smooth=True,
        frame_rate=rate, name=f"swing{seed}",
    )  # fmt: skip


@pytest.mark.parametrize("rate", [24.0, 30.0, 60.0, 100.0, 120.0])
def test_the_result_has_the_rate_of_the_example_and_its_detail(rate: float) -> None:
    """Every native frame is a mean of native frames: one patch alone must give them back bit by bit."""
    clip = swinging(frames=int(2 * rate), rate=rate)
    motion = mg.create("genmm").fit([clip]).sample(frames=97, seed=3)[0]
    assert (len(motion), motion.frame_rate) == (97, rate)
    turns = rot.angle_between(motion.rotations[1:], motion.rotations[:-1])
    assert turns.max() < 4 * rot.angle_between(clip.rotations[1:], clip.rotations[:-1]).max()


@pytest.mark.parametrize("frames", [1, 2, 10, 11, 12, 43, 300])
@pytest.mark.parametrize("output_rate", [None, 30.0, 48.0])
def test_exactly_as_many_frames_as_asked_for(frames: int, output_rate: float | None) -> None:
    generator = mg.create("genmm", output_rate=output_rate).fit([swinging(rate=60.0)])
    motion = generator.sample(frames=frames)[0]
    assert len(motion) == frames
    assert motion.frame_rate == pytest.approx(output_rate or 60.0)


def test_an_example_too_short_for_a_patch_is_refused() -> None:
    with pytest.raises(MotionGenError, match=r"'swing0' has 10 frames at 30 Hz, fewer than a patch of 11.*patch_size"):
        mg.create("genmm").fit([swinging(frames=10)])
    assert len(mg.create("genmm", patch_size=4).fit([swinging(frames=10)]).sample(30)[0]) == 30


def test_all_of_several_examples_appear() -> None:
    """Three clips in poses far apart: frames near each of them must be in the result."""
    clips = []
    for k in range(3):
        clip = swinging(frames=60 + 20 * k, seed=k)
        turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), k * 2.0)
        rotations = clip.rotations.copy()
        rotations[:, 1] = rot.multiply(turn, rotations[:, 1])
        clips.append(clip.replace(rotations=rotations))
    result = mg.create("genmm").fit(clips).sample(frames=480, seed=1)[0]
    for clip in clips:
        gaps = rot.angle_between(clip.rotations[:, None, 1], result.rotations[None, :, 1])  # (T, F)
        assert gaps.min(axis=1).mean() < 0.2


def test_examples_at_another_rate_are_brought_to_the_first_ones() -> None:
    result = mg.create("genmm").fit([swinging(rate=30.0), swinging(frames=180, rate=60.0, seed=1)]).sample(60)[0]
    assert result.frame_rate == 30.0


def test_moving_joints_below_the_root_keep_moving() -> None:
    rng = np.random.default_rng(5)
    clip = random_motion(rng, random_skeleton(rng, 6), frames=80, translating=(0, 4), smooth=True)
    result = mg.create("genmm").fit([clip]).sample(100)[0]
    assert result.translating == (0, 4)
    assert np.ptp(result.translations[:, 1], axis=0).max() > 0.1 * np.ptp(clip.translations[:, 1], axis=0).max()


def test_feet_that_stand_stay_where_they_are() -> None:
    """Slip, the speed of feet over the ground while the example says that they stand, nearly goes."""
    clip = mg.load(EXAMPLE_CLIP)[:600].resample(30)
    free, example, still = (
        mg.create("genmm", standing_feet=how).fit([clip]).sample(300)[0] for how in ("free", "example", "still")
    )
    feet = foot_joints(clip)
    assert foot_skate(still, feet) < 0.6 * foot_skate(free, feet)
    assert foot_skate(still, feet) < foot_skate(clip, feet)
    away = [np.abs(motion.rotations - free.rotations).mean() for motion in (example, still)]
    assert 0 < away[0] < away[1]


def test_standing_feet_of_a_loop_close_it() -> None:
    clip = mg.load(EXAMPLE_CLIP)[:600].resample(30)
    loop = mg.create("genmm").fit([clip]).sample(150, constraints=[mg.Loop(in_place=True)])[0]
    turns = rot.angle_between(np.roll(loop.rotations, -1, axis=0), loop.rotations).max(axis=1)
    assert turns[-1] <= turns[:-1].max()


def test_fixed_legs_are_no_concern_of_the_clean_up() -> None:
    clip = mg.load(EXAMPLE_CLIP)[:600].resample(30)
    legs = ("*Leg*", "*Foot*", "*Toe*")
    fixed = mg.FixedJoints(clip, legs)
    motion = mg.create("genmm").fit([clip]).sample(len(clip), constraints=[fixed])[0]
    chosen = list(clip.skeleton.select(legs))
    np.testing.assert_array_equal(motion.rotations[:, chosen], clip.rotations[:, chosen])


def test_contact_labels_can_be_matched_too() -> None:
    clip = mg.load(EXAMPLE_CLIP)[:200]
    plain, matched = (mg.create("genmm", contact_weight=w).fit([clip]).sample(50)[0] for w in (0.0, 5.0))
    assert not plain.allclose(matched)


def test_a_device_that_is_not_there_is_refused_in_a_line() -> None:
    with pytest.raises(MotionGenError, match=r"device 'abacus' cannot be used.*use cpu"):
        mg.create("genmm", device="abacus")


@pytest.mark.parametrize("name", ["Salsa-Dancing-6", "elephant-idle1", "xia-normal-walk"])
def test_on_real_clips_nothing_is_lost_and_nothing_invented(shared_data: Path, name: str) -> None:
    from motiongen.metrics import one_clip_metrics

    clip = mg.load(shared_data / "characters" / f"{name}.bvh").resample(30)
    generator = mg.create("genmm", standing_feet="free").fit([clip])
    syntheses = generator.sample(frames=2 * len(clip), count=2, seed=0)
    metrics = one_clip_metrics([clip], syntheses)
    assert metrics.coverage > 0.99
    assert metrics.local_patch_distance < 0.25
    assert metrics.set_diversity is not None
    assert metrics.set_diversity > 0.2  # two seeds are two motions, not one copied twice
