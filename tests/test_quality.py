"""Quality figures: slow twins, faults put in on purpose and found again, and real clips."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.contact import contact_labels, foot_heights, foot_joints
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.quality import SKATE_HEIGHT, foot_skate, jitter, measure_quality, penetration
from motiongen.skeleton import Skeleton
from tests.puppets import load_clip, puppet, still, walker
from tests.strategies import generators, motions, random_motion, random_skeleton

Array = NDArray[np.float64]

UP = np.array([0.0, 1.0, 0.0])
RATES = (24.0, 30.0, 60.0, 120.0)


def sliding(speed: float, frame_rate: float, seconds: float = 2.0) -> Motion:
    """One foot stands, the other slides over the ground at `speed` heights per second."""
    frames = round(seconds * frame_rate)
    path = still(0, 0, 0, frames=frames)
    path[:, 2] = speed * np.arange(frames) / frame_rate
    return puppet({"LeftFoot": still(0, 0, 0, frames=frames), "RightFoot": path}, frame_rate)


# -- slow twins


@given(motions(max_frames=12, smooth=True))
def test_figures_equal_their_slow_twins(motion: Motion) -> None:
    feet = list(range(len(motion.skeleton)))
    quality = measure_quality(motion, feet)
    for figure, twin in (
        (quality.foot_skate_heights_per_second, slow_skate(motion, feet)),
        (quality.jitter_heights_per_second_cubed, slow_jitter(motion)),
        (quality.penetration_heights, slow_penetration(motion)),
        (quality.contact_ratio, contact_labels(motion, feet).mean()),
        *zip(slow_steps(motion), (quality.largest_step_degrees, quality.largest_step_heights)),
    ):
        assert (figure is None) == (twin is None)
        if twin is not None:
            assert figure == pytest.approx(twin, rel=1e-6, abs=1e-6)


def slow_skate(motion: Motion, feet: list[int]) -> float | None:
    span = min(max(1, round(motion.frame_rate / 30)), len(motion) - 1)
    heights = foot_heights(motion, feet)
    total = weights = 0.0
    for t in range(len(motion) - span if span else 0):
        for column, joint in enumerate(feet):
            way = motion.positions[t + span, joint] - motion.positions[t, joint]
            speed = np.hypot(way[0], way[2]) / motion.skeleton.height * motion.frame_rate / span
            higher = max(heights[t, column], heights[t + span, column])
            weight = min(1.0, max(0.0, 2 - 2 ** min(higher / SKATE_HEIGHT, 100.0)))
            total += weight * speed
            weights += weight
    return total / weights if weights > 0 else None


def slow_jitter(motion: Motion) -> float | None:
    p, rate, sizes = motion.positions, motion.frame_rate, []
    for t in range(len(motion) - 3):
        for joint in range(len(motion.skeleton)):
            third = p[t + 3, joint] - 3 * p[t + 2, joint] + 3 * p[t + 1, joint] - p[t, joint]
            sizes.append(np.linalg.norm(third * rate**3) / motion.skeleton.height)
    return float(np.mean(sizes)) if sizes else None


def slow_penetration(motion: Motion) -> float:
    lowest = []
    for t in range(len(motion)):
        heights = [p[1] for p in motion.positions[t]]
        for joint, offset in zip(motion.skeleton.end_sites, motion.skeleton.end_site_offsets):
            heights.append((motion.positions[t, joint] + rot.rotate(motion.world_rotations[t, joint], offset))[1])
        lowest.append(min(heights))
    return max(0.0, float(np.percentile(lowest, 2) - min(lowest))) / motion.skeleton.height


def slow_steps(motion: Motion) -> tuple[float | None, float | None]:
    turns, ways = [], []
    for t in range(len(motion) - 1):
        for joint in range(len(motion.skeleton)):
            turns.append(
                float(np.degrees(rot.angle_between(motion.rotations[t, joint], motion.rotations[t + 1, joint])))
            )
            ways.append(np.linalg.norm(motion.positions[t + 1, joint] - motion.positions[t, joint]))
    return max(turns, default=None), max(ways) / motion.skeleton.height if ways else None


# -- skate


@pytest.mark.parametrize("frame_rate", RATES)
@pytest.mark.parametrize("speed", [0.05, 0.5, 5.0])
def test_a_slide_is_measured_whatever_its_speed_and_rate(speed: float, frame_rate: float) -> None:
    """Half of the feet slide: the mean speed is half of theirs. No slide is too fast to be seen."""
    clip = sliding(speed, frame_rate)
    assert foot_skate(clip, foot_joints(clip)) == pytest.approx(speed / 2)


def test_feet_that_stand_or_hang_do_not_skate() -> None:
    standing = puppet({"LeftFoot": still(0, 0, 0), "RightFoot": still(1, 0, 0)})
    assert foot_skate(standing, (2, 3)) == 0.0
    hanging = puppet({"Seat": still(0, 0, 0), "LeftFoot": sliding(1.0, 30.0).positions[:, 3] + 0.5 * UP})
    assert foot_skate(hanging, (3,)) is None


def test_a_walk_without_slides_has_little_skate_and_a_slide_adds_to_it() -> None:
    clip = walker(60.0)
    feet = foot_joints(clip)
    translations = clip.translations.copy()
    translations[:, 0, 0] += 0.3 * np.arange(len(clip)) / 60.0  # the hips, and all below them
    slid = clip.replace(translations=translations)
    plain, worse = foot_skate(clip, feet), foot_skate(slid, feet)
    assert plain is not None
    assert worse is not None
    assert plain < 0.05
    assert worse == pytest.approx(plain + 0.3, rel=0.1)


def test_skate_is_the_same_at_every_rate() -> None:
    """Feet that pass low over the ground at speed: what they add is the same at every rate."""
    figures = [foot_skate(walker(rate, lift=0.02), (2, 3)) for rate in (30.0, 60.0, 120.0)]
    assert figures[0] is not None
    assert figures[0] > 0.05
    np.testing.assert_allclose(figures, figures[-1], rtol=0.1)


def test_centimetres_need_a_unit() -> None:
    clip = sliding(0.5, 30.0)
    assert measure_quality(clip).foot_skate_cm_per_second is None
    for unit, one in (("m", 1.0), ("cm", 100.0), ("in", 1 / 0.0254)):
        figure = measure_quality(clip.scale(1.8 * one, unit)).foot_skate_cm_per_second
        assert figure == pytest.approx(0.25 * 180)


# -- jitter, steps, depth


def test_jitter_of_a_cubic_path_is_its_third_derivative() -> None:
    for frame_rate in RATES:
        seconds = np.arange(40) / frame_rate
        path = np.outer(seconds**3, [0.3, 0.0, 0.4]) + np.outer(seconds**2, [0.0, 1.0, 2.0])
        skeleton = Skeleton(("a", "b"), (-1, 0), np.array([[0.0, 0, 0], [0.0, 2.0, 0]]))
        clip = Motion(skeleton, np.tile(rot.IDENTITY, (40, 2, 1)), path[:, None], (0,), frame_rate)
        assert jitter(clip) == pytest.approx(6 * 0.5 / 2.0, rel=1e-4)


@given(generators(), st.integers(1, 19), st.floats(0.7, 3.0))
def test_a_jerk_is_named(rng: np.random.Generator, frame: int, angle: float) -> None:
    """One joint turns at once at one frame: the step's size, frame and joint are reported."""
    motion = random_motion(rng, random_skeleton(rng, joints=5, names="j{}"), frames=20, smooth=True, frame_rate=120.0)
    joint = int(rng.integers(1, 5))
    still_rotations = np.tile(motion.rotations[:1], (20, 1, 1))
    still_rotations[frame:, joint] = rot.multiply(still_rotations[frame:, joint], rot.from_axis_angle(UP, angle))
    quality = measure_quality(motion.replace(rotations=still_rotations))
    assert quality.largest_step_degrees == pytest.approx(np.degrees(angle))
    assert (quality.largest_step_degrees_frame, quality.largest_step_degrees_joint) == (frame, f"j{joint}")


@given(st.integers(1, 59), st.floats(0.3, 2.0))
def test_a_leap_is_named(frame: int, way: float) -> None:
    foot = still(0, 0, 0)
    foot[frame:, 2] += way
    quality = measure_quality(puppet({"LeftFoot": still(0, 0, 0), "RightFoot": foot}))
    assert quality.largest_step_heights == pytest.approx(way)
    assert (quality.largest_step_heights_frame, quality.largest_step_heights_joint) == (frame, "RightFoot")
    assert quality.largest_step_degrees == 0.0


def test_a_foot_below_the_ground_is_found() -> None:
    foot = still(0, 0, 0, frames=100)
    foot[40, 1] = -0.07
    assert penetration(puppet({"LeftFoot": foot})) == pytest.approx(0.07)
    assert penetration(puppet({"LeftFoot": still(0, 0, 0)})) == 0.0


# -- seams


def turning_walk(frames: int, steps: float = 1.0, root: str | None = None) -> Motion:
    """A body that swings its limbs `steps` times while it goes round a circle, a quarter turn each time.

    The hips may hang below a `root` that stands still somewhere, or one in the middle of the circle that does the
    turning, as a turntable does.
    """
    names, parents = ("Hips", "Leg", "Foot", "Arm"), (-1, 0, 1, 0)
    offsets = np.array([[0.0, 0.9, 0.0], [0.1, -0.4, 0.0], [0.0, -0.5, 0.0], [-0.2, 0.5, 0.0]])
    phase = 2 * np.pi * steps * np.arange(frames) / (frames - 1)
    turn = rot.from_axis_angle(UP, phase / 4)  # (T, 4)
    hips, *limbs = (
        rot.from_axis_angle(np.eye(3)[0], angle * np.sin(phase + later))
        for angle, later in ((0.1, 0.3), (0.5, 0.0), (0.3, 1.0), (0.4, 2.0))
    )
    local = np.array([2.0, 0.0, 0.0]) + np.outer(0.9 + 0.05 * np.sin(phase), UP)
    turned, way = rot.multiply(turn, hips), rot.rotate(turn, local)
    if root is None:
        rotations = np.stack([turned, *limbs], axis=1)
        return Motion(Skeleton(names, parents, offsets), rotations, way[:, None], (0,), 30.0)
    skeleton = Skeleton(
        ("Root", *names), (-1, *(parent + 1 for parent in parents)), np.concatenate([[[0.3, 0.0, 0.2]], offsets])
    )
    above = {"still": np.tile(rot.IDENTITY, (frames, 1)), "turntable": turn}[root]
    hips, local = {"still": (turned, way + np.array([1.0, 0.0, 0.5])), "turntable": (hips, local)}[root]
    return Motion(skeleton, np.stack([above, hips, *limbs], axis=1), local[:, None], (1,), 30.0)


@given(generators())
def test_a_loop_that_leads_round_a_bend_closes(rng: np.random.Generator) -> None:
    clip = turning_walk(61).transform(rot.from_axis_angle(UP, rng.uniform(0, 6)), [*rng.normal(size=2), 0.0])
    quality = measure_quality(clip)
    assert quality.seam_degrees == pytest.approx(0.0, abs=1e-5)
    assert quality.seam_heights == pytest.approx(0.0, abs=1e-6)
    # The step before the seam and the one after it lie two frames apart: at finer steps they are more alike.
    finer = measure_quality(turning_walk(601)).seam_heights_per_second
    assert quality.seam_heights_per_second is not None
    assert finer is not None
    assert finer < quality.seam_heights_per_second / 50


def test_an_open_loop_is_seen() -> None:
    clip = turning_walk(61)
    bent = clip.rotations.copy()
    bent[-1, 3] = rot.multiply(bent[-1, 3], rot.from_axis_angle(np.eye(3)[0], np.radians(25.0)))
    assert measure_quality(clip.replace(rotations=bent)).seam_degrees == pytest.approx(25.0)
    raised = clip.translations.copy()
    raised[-1, 0, 1] += 0.2
    assert measure_quality(clip.replace(translations=raised)).seam_heights == pytest.approx(0.2 / clip.skeleton.height)
    tilted = clip.rotations.copy()
    tilted[-1, 0] = rot.multiply(rot.from_axis_angle(np.eye(3)[2], np.radians(40.0)), tilted[-1, 0])
    seam = measure_quality(clip.replace(rotations=tilted)).seam_degrees
    assert seam == pytest.approx(40.0, abs=2.0)
    half = measure_quality(turning_walk(61, steps=0.5))
    assert half.seam_heights_per_second > 5 * measure_quality(clip).seam_heights_per_second


@pytest.mark.parametrize("steps", [1.0, 0.6])
@pytest.mark.parametrize("root", ["still", "turntable"])
def test_what_stands_above_the_hips_is_no_part_of_the_seam(steps: float, root: str) -> None:
    plain, rooted = turning_walk(61, steps), turning_walk(61, steps, root)
    ours, theirs = measure_quality(plain), measure_quality(rooted)
    assert theirs.seam_degrees == pytest.approx(ours.seam_degrees, abs=1e-5)
    taller = rooted.skeleton.height / plain.skeleton.height
    for figure in ("seam_heights", "seam_heights_per_second"):
        assert taller * getattr(theirs, figure) == pytest.approx(getattr(ours, figure), abs=1e-6)


# -- all together


@given(generators(), st.floats(0, 6.28), st.sampled_from([0.01, 39.37]))
def test_figures_do_not_depend_on_place_heading_or_unit(rng: np.random.Generator, turn: float, scale: float) -> None:
    skeleton = random_skeleton(rng, joints=6)
    motion = random_motion(rng, skeleton, frames=20, smooth=True, translating=(0,), frame_rate=60.0)
    moved = motion.transform(rot.from_axis_angle(UP, turn), skeleton.height * rng.normal(size=3)).scale(scale)
    feet = tuple(range(6))
    ours, theirs = measure_quality(motion, feet).to_dict(), measure_quality(moved, feet).to_dict()
    for figure, value in ours.items():
        if isinstance(value, float):
            assert theirs[figure] == pytest.approx(value, rel=1e-5, abs=1e-5), figure
        else:
            assert theirs[figure] == value, figure


NEEDED_FRAMES = {
    "foot_skate_heights_per_second": 2,
    "foot_skate_cm_per_second": 2,
    "jitter_heights_per_second_cubed": 4,
    "largest_step_degrees": 2,
    "largest_step_degrees_frame": 2,
    "largest_step_degrees_joint": 2,
    "largest_step_heights": 2,
    "largest_step_heights_frame": 2,
    "largest_step_heights_joint": 2,
    "penetration_heights": 1,
    "contact_ratio": 1,
    "seam_degrees": 2,
    "seam_heights": 2,
    "seam_heights_per_second": 3,
}


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_short_clips_lack_what_needs_more_frames(frames: int) -> None:
    figures = measure_quality(walker(30.0).scale(1.0, "m")[:frames]).to_dict()
    lacking = {name for name, value in figures.items() if value is None}
    assert lacking == {name for name, needed in NEEDED_FRAMES.items() if frames < needed}


def test_no_feet_no_foot_figures() -> None:
    quality = measure_quality(walker(30.0), feet=())
    assert quality.foot_skate_heights_per_second is None
    assert quality.contact_ratio is None
    with pytest.raises(MotionGenError, match="no joint 7"):
        measure_quality(walker(30.0), feet=[7])


@given(motions(smooth=True))
def test_figures_are_plain_finite_data(motion: Motion) -> None:
    figures = measure_quality(motion).to_dict()
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures


# -- real clips


@pytest.mark.parametrize(
    ("name", "most"),
    [("characters/xia-normal-walk.bvh", 0.06), ("cmu/01_01.bvh", 0.08), ("characters/elephant-idle1.bvh", 0.02)],
)
def test_real_clips_skate_little_at_any_rate(shared_data: Path, name: str, most: float) -> None:
    clip = load_clip(shared_data / name)
    feet = foot_joints(clip)
    figures = [foot_skate(clip.resample(rate), feet) for rate in (120.0, 60.0, 30.0) if rate <= clip.frame_rate]
    assert all(figure is not None and figure < most for figure in figures)
    np.testing.assert_allclose(figures, figures[0], rtol=0.1)


def test_the_real_pose_that_is_no_part_of_the_motion_is_found(shared_data: Path) -> None:
    """The first frame of this clip is a T-pose: the largest step leads from it to the second."""
    quality = measure_quality(load_clip(shared_data / "cmu/01_01.bvh"))
    assert quality.largest_step_degrees_frame == 1
    assert quality.largest_step_heights_frame == 1
