"""Feet and contacts: names of many rigs, a slow twin, a walker whose steps are known, and real clips."""

from __future__ import annotations

import dataclasses
import itertools
import tarfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.contact import NEAR_GROUND, contact_labels, foot_heights, foot_joints
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.puppets import load_clip, puppet, step_path, still, walker
from tests.strategies import generators, motions, random_motion, random_skeleton

Array = NDArray[np.float64]


def named_skeleton(names: list[str]) -> Skeleton:
    return Skeleton(tuple(names), (-1, *range(len(names) - 1)), np.ones((len(names), 3)))


def one_frame(skeleton: Skeleton) -> Motion:
    return Motion(skeleton, np.tile(rot.IDENTITY, (1, len(skeleton), 1)), np.zeros((1, 0, 3)), (), 30.0)


def without_names(motion: Motion) -> Motion:
    names = tuple(f"b{joint}" for joint in range(len(motion.skeleton)))
    return motion.replace(skeleton=dataclasses.replace(motion.skeleton, names=names))


# -- names


@pytest.mark.parametrize(
    "name",
    [
        "LeftFoot", "LeftToeBase", "LeftToe_End", "mixamorig7:RightToe_End", "RightAnkle", "rToes", "LHeel",
        "Foot_L", "Toes_R", "foot_l", "l_foot", "left_ankle", "L_Toe", "toe.R", "Bip01 L Foot", "Bip01 R Toe0",
        "Bip01_L_Toe01Nub", "lfoot", "footl", "lefttoebase", "LEFTFOOT", "LToe", "hoof_FR", "front_left_paw",
        "HindPawL", "RearHoof.L", "bigToe1", "Armature|LeftFoot", "forefoot",
    ],
)  # fmt: skip
def test_names_of_feet_are_recognised(name: str) -> None:
    assert foot_joints(one_frame(named_skeleton(["Hips", "Leg", name]))) == (2,)


@pytest.mark.parametrize(
    "name",
    [
        "LFingers", "RightFinger1", "Footwear", "FootWear_L", "football", "eyeball_L", "basket_ball", "Ball", "Spawn",
        "pawn_arm", "mistletoe", "tiptoeing", "ik_foot_l", "LeftFoot_IK", "FootPole.R", "RightLeg", "LeftShin",
        "Foothold",
    ],
)  # fmt: skip
def test_names_that_only_look_like_feet_are_not(name: str) -> None:
    skeleton = named_skeleton(["Hips", "Foot_R", "Arm", name])
    # Beside the arm, not below the foot.
    skeleton = dataclasses.replace(skeleton, parents=(-1, 0, 0, 2))
    assert foot_joints(one_frame(skeleton)) == (1,)


def test_a_ball_counts_below_a_foot_only() -> None:
    skeleton = dataclasses.replace(named_skeleton(["pelvis", "foot_l", "ball_l", "ball"]), parents=(-1, 0, 1, 0))
    assert foot_joints(one_frame(skeleton)) == (1, 2)


def test_a_character_called_foot_is_not_all_feet() -> None:
    skeleton = named_skeleton(["Foot_Hips", "Foot_Leg", "Foot_LeftAnkle"])
    assert foot_joints(one_frame(skeleton)) == (2,)


@pytest.mark.parametrize(("share", "found"), [(1.0, True), (0.7, True), (0.3, False), (0.0, False)])
def test_a_hand_is_a_foot_where_it_stands_most_of_the_time(share: float, found: bool) -> None:
    hand = still(0.3, 0.04, 0.0, frames=100)
    hand[round(100 * share) :, 1] = 0.4
    clip = puppet({"LeftFoot": still(0, 0, 0, frames=100), "LeftHand": hand, "LeftHandIndex1": hand})
    assert foot_joints(clip) == ((2, 3) if found else (2,))


def test_several_clips_are_looked_at_together() -> None:
    """A short clip on hands and feet among longer ones on feet: the hands of this skeleton are no feet."""
    crawl, stand = ({"LeftFoot": still(0, 0, 0), "LeftHand": still(0.3, height, 0)} for height in (0.04, 0.4))
    assert foot_joints(puppet(crawl)) == (2, 3)
    assert foot_joints([puppet(crawl)[:20], puppet(stand)]) == (2,)
    assert foot_joints([puppet(crawl), puppet(stand)[:20]]) == (2, 3)


# -- motion


@pytest.mark.parametrize("frame_rate", [24.0, 30.0, 60.0, 120.0])
@pytest.mark.parametrize("ankle", [0.0, 0.08])
def test_labels_of_a_known_walk(frame_rate: float, ankle: float) -> None:
    clip = walker(frame_rate, ankle)
    labels = contact_labels(clip)
    seconds = np.arange(len(clip)) / frame_rate
    for column, phase in enumerate((0.0, 0.5)):
        stands = step_path(seconds, phase)[1]
        # Near the change from the one to the other both answers are fine: speeds are taken over a span of time.
        changes = np.flatnonzero(np.diff(stands.astype(int))) + 0.5
        clear = np.abs(np.arange(len(clip))[:, None] - changes).min(axis=1) > 0.09 * frame_rate
        assert clear.mean() > 0.5
        np.testing.assert_array_equal(labels[clear, column], stands[clear])


@pytest.mark.parametrize("frame_rate", [24.0, 30.0, 120.0])
def test_feet_are_found_by_motion_where_no_name_tells(frame_rate: float) -> None:
    clip = walker(frame_rate)
    assert foot_joints(without_names(clip)) == foot_joints(clip) == (2, 3)
    assert foot_joints([without_names(clip), without_names(clip)[:40]]) == (2, 3)


def test_feet_that_dangle_never_stand() -> None:
    """A seat on the ground, and feet above it that do not move: how still they are does not matter."""
    dangling = puppet({"Seat": still(0, 0, 0), "LeftFoot": still(0, NEAR_GROUND + 0.01, 0)})
    standing = puppet({"Seat": still(0, 0, 0), "LeftFoot": still(0, NEAR_GROUND - 0.01, 0)})
    assert not contact_labels(dangling).any()
    assert contact_labels(standing).all()


def test_a_body_that_lies_down_is_all_feet_but_its_root() -> None:
    skeleton = Skeleton(("a", "b", "c"), (-1, 0, 1), np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]]))
    assert foot_joints(one_frame(skeleton)) == (1, 2)


def test_what_never_stands_is_no_foot() -> None:
    running = np.cumsum(still(0.1, 0.0, 0.0), axis=0)  # 3 heights per second, and never a rest
    fast = puppet({"a": running, "b": 2 * running})
    assert foot_joints(fast) == ()
    assert contact_labels(fast).shape == (60, 0)


@given(motions(max_frames=30, smooth=True), st.floats(0.01, 0.5), st.floats(0.1, 5.0))
def test_labels_equal_their_slow_twin(motion: Motion, height: float, speed: float) -> None:
    feet = range(len(motion.skeleton))
    fast = contact_labels(motion, feet, height, speed)
    assert fast.shape == (len(motion), len(feet))
    assert fast.tolist() == slow_labels(motion, list(feet), height, speed)


def slow_labels(motion: Motion, feet: list[int], height: float, speed: float) -> list[list[bool]]:
    """Height over the own standing level, and speed between the frames a thirtieth of a second before and after."""
    tall, count = motion.skeleton.height, len(motion)
    lowest = []
    for t in range(count):
        heights = [float(y) for y in motion.positions[t, :, 1]]
        for joint, offset in zip(motion.skeleton.end_sites, motion.skeleton.end_site_offsets):
            heights.append(
                float((motion.positions[t, joint] + rot.rotate(motion.world_rotations[t, joint], offset))[1])
            )
        lowest.append(min(heights))
    ground = np.percentile(lowest, 2)
    reach = max(1, round(motion.frame_rate / 30))
    labels = [[False] * len(feet) for _ in range(count)]
    for column, joint in enumerate(feet):
        path = motion.positions[:, joint]
        level = np.percentile(path[:, 1], 5)
        if (level - ground) > NEAR_GROUND * tall:
            level = ground
        for t in range(count):
            before, after = max(0, t - reach), min(count - 1, t + reach)
            seconds = max(1, after - before) / motion.frame_rate
            moves = np.linalg.norm(path[after] - path[before]) / tall / seconds
            labels[t][column] = bool((path[t, 1] - level) / tall < height and moves < speed)
    return labels


@given(generators(), st.floats(0, 6.28), st.sampled_from([0.01, 1.0, 39.37]), st.sampled_from([30.0, 60.0]))
def test_labels_do_not_depend_on_place_heading_unit_or_direction_of_time(
    rng: np.random.Generator, turn: float, scale: float, frame_rate: float
) -> None:
    skeleton = random_skeleton(rng, joints=6)  # one without extent has no height to scale
    motion = random_motion(rng, skeleton, frames=20, smooth=True, translating=(0,), frame_rate=frame_rate)
    feet = range(len(motion.skeleton))
    labels = contact_labels(motion, feet)
    about_up = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), turn)
    moved = motion.transform(about_up, motion.skeleton.height * rng.normal(size=3)).scale(scale)
    np.testing.assert_array_equal(contact_labels(moved, feet), labels)
    np.testing.assert_array_equal(contact_labels(motion[::-1], feet), labels[::-1])


@given(generators(), st.tuples(*[st.floats(0.01, 1.0)] * 4))
def test_wider_thresholds_never_lose_a_contact(
    rng: np.random.Generator, thresholds: tuple[float, float, float, float]
) -> None:
    motion = random_motion(rng, frames=20, smooth=True)
    feet = range(len(motion.skeleton))
    height, speed, more_height, more_speed = thresholds
    narrow = contact_labels(motion, feet, height, speed)
    wide = contact_labels(motion, feet, height + more_height, speed + more_speed)
    assert (wide | ~narrow).all()


def test_noise_at_a_high_rate_is_no_motion() -> None:
    """Three millimetres of noise on a body of two metres, 120 times a second: the foot stands all the same."""
    noise = 0.0015 * np.random.default_rng(0).normal(size=(240, 3))
    noisy = puppet({"LeftFoot": noise, "RightFoot": still(0, 0, 0, frames=240)}, frame_rate=120.0)
    assert contact_labels(noisy).all()


def test_a_single_frame_is_judged_by_height() -> None:
    clip = puppet({"LeftFoot": still(0, 0, 0, frames=1), "RightFoot": still(0, 0.3, 0, frames=1)})
    np.testing.assert_array_equal(contact_labels(clip), [[True, False]])
    np.testing.assert_allclose(foot_heights(clip, foot_joints(clip)), [[0.0, 0.3]], atol=1e-12)


def test_mistakes_are_refused_in_one_line() -> None:
    clip = walker(30.0)
    with pytest.raises(MotionGenError, match="no joint 9 in 'motion'; its joints are 0 to 3"):
        contact_labels(clip, [9])
    with pytest.raises(MotionGenError, match="must not be negative"):
        contact_labels(clip, height=-1.0)
    with pytest.raises(MotionGenError, match="at least one motion"):
        foot_joints([])
    with pytest.raises(MotionGenError, match="another skeleton"):
        foot_joints([clip, without_names(clip)])


# -- real clips


def bandai_clip(shared_data: Path, folder: Path, name: str) -> Motion:
    archive = shared_data / "bandai-namco" / "dataset-1.tar.xz"
    if not archive.is_file():
        pytest.skip(f"real clips are not part of the project; there is no {archive.name}")
    with tarfile.open(archive) as files:
        member = next(m for m in files if Path(m.name).name == f"{name}.bvh")
        content = files.extractfile(member)
        assert content is not None
        (folder / f"{name}.bvh").write_bytes(content.read())
    return load_clip(folder / f"{name}.bvh")


def side(motion: Motion, labels: NDArray[np.bool_], pattern: str) -> NDArray[np.bool_]:
    """(T,) whether any foot joint of one side stands."""
    names = [motion.skeleton.names[joint] for joint in foot_joints(motion)]
    columns = [i for i, name in enumerate(names) if pattern in name]
    assert columns
    return labels[:, columns].any(axis=1)


def assert_walks(motion: Motion, left: str, right: str) -> None:
    """Each foot stands about half of the time, one of them nearly always, and they take turns."""
    labels = contact_labels(motion)
    on_left, on_right = side(motion, labels, left), side(motion, labels, right)
    for stands in (on_left, on_right):
        assert 0.45 < stands.mean() < 0.68
    assert (on_left | on_right).mean() > 0.95
    assert (on_left & on_right).mean() < 0.3
    touches = [(t, s) for s, stands in enumerate((on_left, on_right)) for t in np.flatnonzero(np.diff(stands * 1) > 0)]
    order = [s for _, s in sorted(touches)]
    assert len(order) >= 2
    assert all(a != b for a, b in itertools.pairwise(order))


@pytest.mark.parametrize("name", ["characters/xia-normal-walk.bvh", "characters/Walk-In-Circle.bvh"])
def test_real_walks_alternate(shared_data: Path, name: str) -> None:
    clip = load_clip(shared_data / name)
    assert_walks(clip, "Left", "Right")
    assert foot_joints(without_names(clip)) == foot_joints(clip)


def test_a_real_walk_below_a_still_root_alternates(shared_data: Path, tmp_path: Path) -> None:
    clip = bandai_clip(shared_data, tmp_path, "dataset-1_walk_normal_001")
    assert_walks(clip, "_L", "_R")
    assert foot_joints(without_names(clip)) == foot_joints(clip)


def test_a_real_elephant_stands_on_four_feet(shared_data: Path) -> None:
    clip = load_clip(shared_data / "characters/elephant-idle1.bvh")
    feet = foot_joints(clip)
    names = {clip.skeleton.names[joint] for joint in feet}
    assert names == {f"Bip01_{s}_{part}" for s in "LR" for part in ("Foot", "Toe0", "Hand")}
    assert contact_labels(clip).mean() > 0.99
    assert foot_joints(without_names(clip)) == feet


def test_real_jumps_leave_the_ground_with_both_feet(shared_data: Path) -> None:
    clip = load_clip(shared_data / "cmu/01_01.bvh")[1:]
    labels = contact_labels(clip)
    stands = side(clip, labels, "Left") | side(clip, labels, "Right")
    assert 0.7 < stands.mean() < 0.9
    assert foot_joints(without_names(clip)) == foot_joints(clip)
    # Whenever the hips are as high as a jump takes them, no foot stands.
    hips = clip.root_positions[:, 1]
    assert not stands[hips > np.percentile(hips, 99)].any()
