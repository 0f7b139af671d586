"""Attributes of motions: what they do not depend on, what they are on motions made for it, and who has none."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motiongen import io
from motiongen import rotations as rot
from motiongen.assets import EXAMPLE_CLIP
from motiongen.attributes import ankles, arm, attribute, attribute_of, attributes, attributes_for, registry, trunk
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.bipeds import X, Y, Z, biped, posed
from tests.rigs import on_other_axes
from tests.strategies import random_motion, random_quaternions

BUILT_IN = tuple(attributes())

FRAMES = 64

HEIGHT = biped().height


def swinging(seed: int, **settings: Any) -> Motion:
    """The biped moves all limbs, turns about up and goes somewhere."""
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, biped(), frames=50, translating=(0,), smooth=True, **settings)
    turn = rot.from_axis_angle(Y, np.linspace(0, rng.uniform(-4, 4), len(motion)))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    return motion.replace(rotations=rotations)


def score(name: str, motion: Motion) -> float:
    return attribute_of(name).score(motion)


def lifting(start: float, end: float) -> Motion:
    """The straight right arm goes from one angle over straight down to another, out to the right."""
    angles = np.linspace(start, end, FRAMES) - math.pi / 2
    return posed({"RightArm": rot.from_axis_angle(-Z, angles)})


# -- what scores do not depend on


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("seed", range(3))
def test_place_heading_and_size_do_not_matter(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = swinging(seed)
    elsewhere = motion.transform(rot.from_axis_angle(Y, rng.uniform(-3, 3)), rng.normal(size=3)).scale(37.0)
    assert score(name, elsewhere) == pytest.approx(score(name, motion), abs=1e-8)


@pytest.mark.parametrize("name", [name for name in BUILT_IN if name != "gral_rotation"])
@pytest.mark.parametrize("seed", range(3))
def test_the_axes_of_a_rig_do_not_matter(name: str, seed: int) -> None:
    motion = swinging(seed)
    frames = random_quaternions(np.random.default_rng(seed), len(motion.skeleton))
    other = on_other_axes(motion, frames)
    # The rest pose is another one, and with it what is called a height.
    scale = other.skeleton.height / motion.skeleton.height if _is_length(name) else 1.0
    assert score(name, other) * scale == pytest.approx(score(name, motion), abs=1e-8)


def _is_length(name: str) -> bool:
    return "heights" in attributes()[name].summary


@pytest.mark.parametrize("name", ["speed", "activity", "turning"])
def test_played_twice_as_fast_a_motion_has_twice_the_speed(name: str) -> None:
    motion = swinging(1)
    assert score(name, motion.replace(frame_rate=60.0)) == pytest.approx(2 * score(name, motion))


@pytest.mark.parametrize("name", [name for name in BUILT_IN if not name.startswith(("gral", "right"))])
def test_a_mirror_changes_nothing_but_the_way_of_turning(name: str) -> None:
    motion = swinging(2)
    sign = -1 if name == "turning" else 1
    assert score(name, motion.mirror()) == pytest.approx(sign * score(name, motion), abs=1e-8)


# -- gradual right arm lift


def plain_share(first: list[float], second: list[float]) -> float:
    """Appendix C.2, written out."""
    points = []
    for angles in (first, second):
        alpha = []
        for i in range(len(angles) // 4):
            window = angles[4 * i : 4 * i + 8]
            alpha.append(sum(window) / len(window))
        points += [1 if alpha[i] > alpha[i - 1] else 0 for i in range(1, len(angles) // 4)]
    return sum(points) / len(points)


def plain_lift(motion: Motion, joint: str, tip: str) -> list[float]:
    """Angle between straight down and a bone, frame by frame."""
    start, end = (motion.skeleton.index(name) for name in (joint, tip))
    angles = []
    for frame in motion.positions:
        bone = frame[end] - frame[start]
        angles.append(math.acos(-bone[1] / math.sqrt(sum(bone**2))))
    return angles


@pytest.mark.parametrize("seed", range(4))
def test_gral_is_the_appendix_written_out(seed: int) -> None:
    motion = swinging(seed)
    upper, fore = plain_lift(motion, "RightArm", "RightForeArm"), plain_lift(motion, "RightForeArm", "RightHand")
    assert score("gral", motion) == pytest.approx(plain_share(upper, fore))
    turns = [
        [2 * math.acos(min(1.0, abs(q[3]))) for q in motion.rotations[:, motion.skeleton.index(name)]]
        for name in ("RightArm", "RightForeArm")
    ]
    assert score("gral_rotation", motion) == pytest.approx(plain_share(*turns))


def test_an_arm_that_rises_has_all_of_it_and_one_that_falls_none() -> None:
    assert score("gral", lifting(0.1, 3.0)) == 1.0
    assert score("gral", lifting(3.0, 0.1)) == 0.0
    assert score("gral", posed({})) == 0.0, "nothing increases"
    there_and_back = np.concatenate([np.linspace(0, 1, 32), np.linspace(1, 0, 32)])
    arm_turn = rot.from_axis_angle(-Z, there_and_back)
    assert score("gral", posed({"RightArm": arm_turn})) == pytest.approx(0.5, abs=0.05)


def test_only_the_right_arm_is_looked_at() -> None:
    left = posed({"LeftArm": rot.from_axis_angle(Z, np.linspace(-1, 1, FRAMES))})
    assert score("gral", left) == 0.0
    assert score("gral", left.mirror()) == 1.0


# -- known values


def test_verticality_of_a_stand_a_rest_and_a_handstand() -> None:
    for angle, expected in ((0.0, 1.0), (math.pi / 2, 0.0), (math.pi, -1.0), (math.pi / 3, 0.5)):
        for axis in (X, Z):
            assert score("verticality", posed({"Hips": rot.from_axis_angle(axis, angle)})) == pytest.approx(expected)


def test_speeds_of_a_glide_and_of_a_turn() -> None:
    seconds = np.arange(FRAMES) / 30
    glide = posed({}, way=seconds[:, None] * [3.0, 5.0, 4.0])
    assert score("speed", glide) == pytest.approx(5 / HEIGHT), "over the ground: what goes up counts nothing"
    assert score("activity", glide) == pytest.approx(0.0, abs=1e-9)
    spin = posed({"Hips": rot.from_axis_angle(Y, 1.5 * seconds)})
    assert score("turning", spin) == pytest.approx(1.5)
    assert score("turning", spin.mirror()) == pytest.approx(-1.5)
    assert score("turning", posed({"Hips": rot.from_axis_angle(X, seconds)})) == pytest.approx(0.0, abs=1e-9)


def test_arms_in_known_poses() -> None:
    tee = posed({})
    assert score("right_elbow_angle", tee) == pytest.approx(math.pi)
    assert score("right_elbow_angle", posed({"RightForeArm": rot.from_axis_angle(Y, 1.0)})) == pytest.approx(
        math.pi - 1.0
    )
    assert score("right_elbow_angle", posed({"LeftForeArm": rot.from_axis_angle(Y, 1.0)})) == pytest.approx(math.pi)
    assert score("hand_spread", tee) == pytest.approx(1.4 / HEIGHT)
    assert score("hand_height", tee) == pytest.approx(1.4 / HEIGHT)
    hanging = {f"{side}Arm": rot.from_axis_angle(Z, sign * math.pi / 2) for side, sign in (("Left", -1), ("Right", 1))}
    assert score("hand_height", posed(hanging)) == pytest.approx((1.4 - 0.55) / HEIGHT)


def test_legs_in_known_poses() -> None:
    assert score("hip_height", posed({})) == pytest.approx(0.9 / HEIGHT)
    assert score("stance_width", posed({})) == pytest.approx(0.2 / HEIGHT)
    assert score("step_length", posed({})) == pytest.approx(0.0, abs=1e-12)
    swing = 0.5 * np.sin(np.linspace(0, 4 * np.pi, 65))
    turns = {
        "LeftUpLeg": rot.from_axis_angle(X, swing),
        "RightUpLeg": rot.from_axis_angle(X, -swing),
    }
    assert score("step_length", posed(turns, frames=65)) == pytest.approx(2 * 0.9 * math.sin(0.5) / HEIGHT, rel=1e-3)
    crossed = {f"{side}UpLeg": rot.from_axis_angle(Z, s * 0.3) for side, s in (("Left", -1), ("Right", 1))}
    assert score("stance_width", posed(crossed)) == pytest.approx((0.2 - 2 * 0.9 * math.sin(0.3)) / HEIGHT)


# -- which joints


@pytest.mark.parametrize(
    "names", ["{side}{part}", "rig:{side}{part}", "{part}_{side[0]}", "Bip01 {side[0]} {part}", "{side[0]}{part}"]
)
def test_arms_and_legs_are_found_whatever_they_are_called(names: str) -> None:
    skeleton = biped(names)
    motion = posed({}).replace(skeleton=skeleton)

    def joint(side: str, part: str) -> int:
        return skeleton.index(names.format(side=side, part=part))

    for side in ("Left", "Right"):
        found = arm(skeleton, side.lower())
        assert [found.shoulder, found.elbow, found.hand] == [joint(side, part) for part in ("Arm", "ForeArm", "Hand")]
    assert ankles(motion) == (joint("Left", "Foot"), joint("Right", "Foot"))
    assert trunk(motion) == (skeleton.index("Hips"), skeleton.index("Chest"))


def test_twist_joints_are_no_elbows() -> None:
    skeleton = _with_twists(biped())
    for side in ("Left", "Right"):
        found = arm(skeleton, side.lower())
        names = [skeleton.names[joint] for joint in dataclasses.astuple(found)]
        assert names == [f"{side}Arm", f"{side}ForeArm", f"{side}Hand"]


def _with_twists(skeleton: Skeleton) -> Skeleton:
    """The skeleton with a joint in the middle of every bone of the arms."""
    names, parents, offsets = list(skeleton.names), list(skeleton.parents), list(skeleton.offsets)
    rows: list[tuple[str, str | None, Any]] = []
    for name, parent, offset in zip(names, parents, offsets):
        above = None if parent < 0 else names[parent]
        if name.endswith(("ForeArm", "Hand")):
            twist = f"{name}Twist".replace("Hand", "Lower")
            rows += [(twist, above, offset / 2), (name, twist, offset / 2)]
        else:
            rows.append((name, above, offset))
    index = {name: joint for joint, (name, _, _) in enumerate(rows)}
    above_of = tuple(-1 if above is None else index[above] for _, above, _ in rows)
    return Skeleton(tuple(index), above_of, np.array([offset for _, _, offset in rows]))


def test_a_real_clip_has_them_all() -> None:
    motion = io.load(EXAMPLE_CLIP)
    assert set(attributes_for(motion)) >= set(BUILT_IN)
    assert score("verticality", motion) > 0.9


def test_what_a_skeleton_lacks_is_said() -> None:
    snake = random_motion(np.random.default_rng(0), frames=20, translating=(0,))
    have = {"speed", "activity", "turning", "hip_height"}
    assert set(attributes_for(snake)) & set(BUILT_IN) == have
    tee = posed({})
    handless = tee.replace(skeleton=dataclasses.replace(
        tee.skeleton, names=tuple(name.replace("Hand", "Hook") for name in tee.skeleton.names)))  # fmt: skip
    with pytest.raises(MotionGenError, match=r"0 left hands; this needs a biped with names such as LeftHand"):
        score("gral", handless)
    pegged = tee.replace(skeleton=dataclasses.replace(
        tee.skeleton, names=tuple(name.replace("Foot", "Peg") for name in tee.skeleton.names)))  # fmt: skip
    assert score("step_length", pegged) == score("step_length", tee), "whatever stands is a foot"
    parents = tuple(0 if name.endswith("Shoulder") else parent
                    for name, parent in zip(tee.skeleton.names, tee.skeleton.parents))  # fmt: skip
    spineless = tee.replace(skeleton=dataclasses.replace(tee.skeleton, parents=parents))
    with pytest.raises(MotionGenError, match="meet in 'Hips'; this needs a spine"):
        score("verticality", spineless)
    with pytest.raises(MotionGenError, match="has one frame; a speed needs two"):
        score("speed", tee[:1])
    with pytest.raises(MotionGenError, match="need 8 frames at least; 7 came"):
        score("gral", tee[:7])


# -- a user's own


@pytest.fixture
def own_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers is forgotten after it."""
    monkeypatch.setattr(registry, "_registered", dict(attributes()))


@pytest.mark.usefixtures("own_names")
def test_an_attribute_is_three_lines_of_python() -> None:
    @attribute("length", "frames")
    def length(motion: Motion) -> float:
        return len(motion)

    assert score("length", posed({}, frames=12)) == 12.0
    assert attributes()["length"].summary == "frames"
    assert length(posed({}, frames=12)) == 12, "the function stays what it is"


@pytest.mark.usefixtures("own_names")
def test_names_are_taken_once_and_scores_are_finite() -> None:
    with pytest.raises(MotionGenError, match="there is an attribute 'speed' already"):
        attribute("speed", "another")(lambda motion: 0.0)
    with pytest.raises(MotionGenError, match=r"must be letters, digits and _, not '\.\./speed'"):
        attribute("../speed", "another")
    attribute("nothing", "never a number")(lambda motion: math.nan)
    with pytest.raises(MotionGenError, match="attribute 'nothing' gives nan for 'motion'"):
        score("nothing", posed({}))
    with pytest.raises(MotionGenError, match=r"no attribute 'sped'; did you mean 'speed'\? there are gral, "):
        attribute_of("sped")


@pytest.mark.usefixtures("own_names")
def test_a_function_in_a_users_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from motiongen.attributes import attribute\n"
        'def plain(motion):\n    """How many frames."""\n    return len(motion)\n'
        '@attribute("named", "half as many")\ndef other(motion):\n    return len(motion) / 2\n'
        "number = 3\n"
    )
    for _ in range(2):  # a file that is run again defines the same
        plain = attribute_of(f"{path}:plain")
        assert (plain.name, plain.summary, plain.score(posed({}, frames=10))) == ("plain", "How many frames.", 10.0)
        other = attribute_of(f"{path}:other")
        assert (other.name, other.score(posed({}, frames=10))) == ("named", 5.0)
    for wrong, words in ((f"{path}:number", "no function 'number'"), (f"{tmp_path / 'no.py'}:plain", "no such file")):
        with pytest.raises(MotionGenError, match=words):
            attribute_of(wrong)
    path.write_text("1 / 0")
    with pytest.raises(MotionGenError, match=r"running it failed \(ZeroDivisionError: division by zero\)"):
        attribute_of(f"{path}:plain")


@pytest.mark.parametrize("wrong", [lambda motion: 1 / 0, lambda motion: None, lambda motion: [1.0, 2.0]])
def test_a_function_that_fails_costs_one_line(wrong: Any) -> None:
    broken = registry.Attribute("broken", "of no use", wrong)
    with pytest.raises(MotionGenError, match=r"^attribute 'broken' fails for '.*' \(\w+Error: .*\)$") as caught:
        broken.score(posed({}))
    assert "\n" not in str(caught.value)
