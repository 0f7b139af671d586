"""What a BVH file does not say outright: its frame rate, its up axis, its unit, and what is odd about it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.io import load, save
from motiongen.io.bvh.layout import rate_of, spelled
from motiongen.motion import Z_TO_Y_UP, Motion
from tests.io.bvh_texts import CHANNELS, Joint, bvh_text, walker, write_text

# -- frame rates


@pytest.mark.parametrize(
    ("frame_time", "rate"),
    [
        ("0.0333", 30),
        ("0.033333", 30),
        ("0.016667", 60),
        ("0.016666", 60),  # cut, not rounded
        (".0083333", 120),
        ("1.66667e-02", 60),
        ("0.0400000", 25),
        ("0.0417", 24),
        ("1.00000000", 1),
        ("0.033366700", 1 / 0.0333667),
        ("0.0333667", 30 * 1000 / 1001),
        ("0.041708", 24 * 1000 / 1001),
        ("0.0335", 1 / 0.0335),
        ("0.0123456789", 1 / 0.0123456789),
        ("2.5", 0.4),
        ("0.0333333333333333333333333333333333333333", 30),
    ],
)
def test_a_frame_time_is_read_as_the_rate_it_was_rounded_from(frame_time: str, rate: float) -> None:
    assert rate_of(frame_time) == rate


@given(st.integers(1, 240), st.sampled_from([1, 1.001]), st.integers(8, 17))
def test_rates_survive_rounding(whole: int, slower: float, digits: int) -> None:
    rate = whole * 1000 / (1000 * slower)
    assert rate_of(f"{1 / rate:.{digits}f}") == pytest.approx(rate, rel=1e-15)


@given(st.floats(1e-3, 1e5))
def test_any_rate_can_be_spelled(rate: float) -> None:
    text = spelled(rate)
    assert "e" not in text
    assert math.isclose(rate_of(text), rate, rel_tol=1e-12)


@given(st.text("0123456789.eE+-_ nanif", max_size=12))
def test_a_frame_time_is_a_plain_number_within_bounds_or_refused(text: str) -> None:
    plain = re.fullmatch(r"\+?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", text)
    if plain and 1e-6 <= float(text) <= 3600:
        assert math.isclose(rate_of(text), 1 / float(text), rel_tol=1.0)
    else:
        with pytest.raises(MotionGenError, match=r"give seconds, from 0.000001 to 3600"):
            rate_of(text)


# -- the up axis


def laid_down(motion: Motion) -> Motion:
    """The motion with its z axis pointing up in the file: as y-up inside, marked to be written z-up."""
    return motion.replace(up="z")


def test_the_up_axis_of_real_clips_is_found_however_they_are_turned(shared_data: Path, tmp_path: Path) -> None:
    for path in sorted(shared_data.glob("*/*.bvh")):
        motion = load(path)
        assert motion.up == "y", path.name
        save(laid_down(motion), tmp_path / "z.bvh")
        turned = load(tmp_path / "z.bvh")
        assert turned.up == "z", path.name
        assert any("z is up" in note for note in turned.notes)
        assert turned.allclose(motion, tolerance=1e-6)
        assert turned.unit == motion.unit


def test_the_up_axis_can_be_given(tmp_path: Path) -> None:
    path = write_text(tmp_path / "y.bvh", walker())
    as_y, as_z = load(path), load(path, up="z")
    assert (as_y.up, as_z.up) == ("y", "z")
    assert as_z.allclose(as_y.turn_up("z"), tolerance=1e-12)


def test_the_ground_tells_what_is_up_where_no_joint_is_called_a_foot(tmp_path: Path) -> None:
    joints = [Joint("a", -1, (0.0, 0.0, 0.0), CHANNELS), Joint("b", 0, (0.0, 1.7, 0.0))]
    walk = np.zeros((20, 9))
    walk[:, 2] = np.linspace(-2, 9, 20)  # along z
    path = write_text(tmp_path / "anonymous.bvh", bvh_text(joints, walk))
    assert load(path).up == "y"
    save(laid_down(load(path)), path)
    assert load(path).up == "z"


def test_what_cannot_be_told_is_assumed_and_noted(tmp_path: Path) -> None:
    joints = [Joint("a", -1, (0.0, 0.0, 0.0), CHANNELS), Joint("b", 0, (1.0, 0.0, 0.0))]
    motion = load(write_text(tmp_path / "flat.bvh", bvh_text(joints, np.zeros((3, 9)))))
    assert motion.up == "y"
    assert any("do not tell which axis is up; y is assumed" in note for note in motion.notes)


def test_a_body_that_lies_on_the_ground_is_not_stood_up(tmp_path: Path) -> None:
    joints = [Joint("foot", -1, (0.0, 0.0, 0.0), CHANNELS), Joint("head", 0, (0.0, 0.0, 1.7))]
    lying = np.zeros((5, 9))
    lying[:, 1], lying[:, 2] = 0.1, -0.85
    motion = load(write_text(tmp_path / "lying.bvh", bvh_text(joints, lying)))
    assert motion.up == "y"
    assert any("do not tell which axis is up" in note for note in motion.notes)


def test_a_z_up_file_is_turned_and_turned_back(tmp_path: Path) -> None:
    """Inside, y is up; the written file has the numbers it was read with."""
    once, twice = tmp_path / "once.bvh", tmp_path / "twice.bvh"
    save(laid_down(load(write_text(tmp_path / "y.bvh", walker()))), once)
    motion = load(once, up="z")
    save(motion, twice)
    assert once.read_bytes() == twice.read_bytes()
    in_file = load(once, up="y")
    assert np.allclose(motion.positions, rot.rotate(Z_TO_Y_UP, in_file.positions), atol=1e-12)


# -- the unit


@pytest.mark.parametrize(
    ("stature", "unit"),
    [(1.75, "m"), (175.0, "cm"), (69.0, None), (17.5, None), (1.0, None), (0.5, None), (300.0, None)],
)
def test_the_unit_is_guessed_from_the_stature(tmp_path: Path, stature: float, unit: str | None) -> None:
    joints = [Joint("foot", -1, (0.0, 0.0, 0.0), CHANNELS), Joint("head", 0, (0.0, stature, 0.0))]
    path = write_text(tmp_path / "pole.bvh", bvh_text(joints, np.zeros((2, 9))))
    motion = load(path)
    assert motion.unit == unit
    assert any("the unit is a guess" in note for note in motion.notes) == (unit is not None)
    given_unit = load(path, unit="ft")
    assert given_unit.unit == "ft"
    assert not any("guess" in note for note in given_unit.notes)
    assert np.array_equal(given_unit.positions, motion.positions)  # nothing is scaled


# -- translations, and what is odd


def chain(channels: tuple[str, ...] = CHANNELS, offset: float = 1.0) -> list[Joint]:
    """Three joints in a row, each with position and rotation channels."""
    return [Joint(name, j - 1, (0.0, offset, 0.0), channels) for j, name in enumerate(("root", "hips", "head"))]


def chain_numbers(frames: int = 20) -> np.ndarray:
    """Every joint in its place, upright, with the slight unrest of the last digits of a file."""
    numbers = np.zeros((frames, 18))
    numbers[:, [1, 7, 13]] = 1.0
    return numbers + 1e-6 * np.random.default_rng(0).uniform(-1, 1, size=(frames, 18))


def read_chain(folder: Path, numbers: np.ndarray, joints: list[Joint] | None = None, time: str = "0.1") -> Motion:
    return load(
        write_text(
            folder / "chain.bvh",
            bvh_text(
                joints or chain(),
                numbers,
                time,
            ),
        ),
        up="y",
        unit="m",
    )


def test_nothing_odd_is_not_noted(tmp_path: Path) -> None:
    motion = read_chain(tmp_path, chain_numbers())
    assert motion.notes == ()
    assert motion.translating == (0,)  # joint 0 stays, moving or not, where nothing below it moves
    assert np.abs(motion.skeleton.offsets - [0, 1, 0]).max() < 1e-6


def test_a_still_root_above_moving_hips_folds(tmp_path: Path) -> None:
    numbers = chain_numbers()
    numbers[:, 0] += 3.0
    numbers[:, 6] += np.linspace(0, 2, 20)
    motion = read_chain(tmp_path, numbers)
    assert motion.translating == (1,)
    assert motion.skeleton.offsets[0] == pytest.approx([3, 1, 0], abs=1e-6)
    assert motion.notes == ("'root' stands still; 'hips' below it carries the character",)
    numbers[:, 0] += np.linspace(0, 1, 20)  # now it moves as well
    motion = read_chain(tmp_path, numbers)
    assert motion.translating == (0, 1)
    assert motion.notes == ("besides the root, joints move in their parents' frames: 'hips'",)


def test_a_root_stays_where_only_little_of_the_character_moves(tmp_path: Path) -> None:
    numbers = chain_numbers()
    numbers[:, 12] += np.linspace(0, 2, 20)
    motion = read_chain(tmp_path, numbers)
    assert motion.translating == (0, 2)
    assert any("their parents' frames: 'head'" in note for note in motion.notes)


def test_slight_movement_is_kept(tmp_path: Path) -> None:
    """What moves by more than noise stays, also where another joint wanders so far that it seems nothing beside it."""
    numbers = chain_numbers()
    numbers[:, 13] += np.linspace(0, 1e-4, 20)
    motion = read_chain(tmp_path, numbers)
    assert motion.translating == (0, 2)
    assert np.array_equal(motion.translations[:, 1], np.round(numbers[:, 12:15], 6))
    wanderer = Joint("prop", 0, (1.0, 0.0, 0.0), CHANNELS[:3])
    far = np.concatenate([numbers, np.linspace(0, 1000, 20)[:, None] * [1, 0, 1]], axis=1)
    assert read_chain(tmp_path, far, [*chain(), wanderer]).translating == (0, 2, 3)


def test_a_channel_wins_over_its_offset(tmp_path: Path) -> None:
    motion = read_chain(tmp_path, chain_numbers(), chain(offset=1.5))
    assert motion.skeleton.offsets[1:, 1] == pytest.approx([1, 1], abs=1e-6)
    assert motion.skeleton.offsets[0, 1] == 1.5  # a moving joint keeps what the file says
    assert any("elsewhere than their OFFSET: 2 of them, by up to 25" in note for note in motion.notes)


def test_axes_without_a_channel_take_the_offset(tmp_path: Path) -> None:
    joints = [Joint("root", -1, (5.0, 1.0, 7.0), ("Yposition", "Xrotation")), Joint("tip", 0, (0.0, 1.0, 0.0), ())]
    motion = read_chain(tmp_path, np.array([[2.0, 0.0], [3.0, 0.0]]), joints)
    assert np.array_equal(motion.translations[:, 0], [[5, 2, 7], [5, 3, 7]])
    save(motion, tmp_path / "again.bvh")
    assert "CHANNELS 2 Yposition Xrotation" in (tmp_path / "again.bvh").read_text()


def test_one_pose_has_nothing_that_moves(tmp_path: Path) -> None:
    motion = read_chain(tmp_path, chain_numbers(1))
    assert len(motion) == 1
    assert motion.translating == (0,)


def test_a_first_frame_that_is_no_part_of_the_motion_is_noted(tmp_path: Path) -> None:
    numbers = chain_numbers()
    numbers[1:, 3:6] += 60.0
    numbers[1:, 9:12] += 40.0 + np.arange(19)[:, None]
    assert any("the first frame is far from all others" in note for note in read_chain(tmp_path, numbers).notes)
    numbers[0] = numbers[1]
    assert read_chain(tmp_path, numbers).notes == ()


def test_key_poses_are_noted(tmp_path: Path) -> None:
    assert any("lasts 1 s" in note for note in read_chain(tmp_path, chain_numbers(), time="1.0").notes)


def test_end_sites_without_length_are_noted(tmp_path: Path) -> None:
    joints = chain()
    joints[2].tips = [(0, "", (0.0, 0.0, 0.0)), (0, "", (0.0, 0.1, 0.0))]
    assert any(
        "1 of 2 end sites have no length" in note for note in read_chain(tmp_path, chain_numbers(), joints).notes
    )
