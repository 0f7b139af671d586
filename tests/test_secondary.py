"""Chains that swing: laws of motion that hold whatever hangs from whatever, and twins where the code is clever."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.secondary import Capsule, Chain, swing
from motiongen.secondary.solver import FOLD, World, _push
from motiongen.skeleton import Skeleton
from tests.strategies import generators, random_motion, random_skeleton

Array = NDArray[np.float64]
UP = np.array([0.0, 1.0, 0.0])


def pole(way: Array, turns: Array | None = None, frame_rate: float = 60.0, **settings: Any) -> Motion:
    """A joint `Base` that goes along a path (T, 3), turned by (T, 4), and a joint one metre above it."""
    skeleton = Skeleton(("Base", "Top"), (-1, 0), np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    rotations = np.tile(rot.IDENTITY, (len(way), 2, 1))
    if turns is not None:
        rotations[:, 0] = turns
    return Motion(skeleton, rotations, way[:, None], (0,), frame_rate, unit="m", **settings)


def still(seconds: float = 1.0, frame_rate: float = 60.0) -> Array:
    return np.zeros((round(seconds * frame_rate), 3))


def rope(bones: int = 6, length: float = 0.6, way: tuple[float, ...] = (0.0, 0.0, -1.0), **settings: Any) -> Chain:
    """A chain that leaves the joint `Top` of a pole."""
    settings = {"name": "Rope", "anchor": "Top"} | settings
    return Chain(offset=np.zeros(3), bones=np.tile(np.array(way) * length / bones, (bones, 1)), **settings)


def random_chains(rng: np.random.Generator, motion: Motion, count: int) -> list[Chain]:
    """Chains of one to four bones, from joints of the clip or from each other's."""
    anchors, chains = list(motion.skeleton.names), []
    for n in range(count):
        bones = rng.normal(size=(int(rng.integers(1, 5)), 3)) * motion.skeleton.height / 5
        settings = {"hertz": rng.uniform(0.2, 5), "drag": rng.uniform(0, 3), "weight": rng.uniform(0, 1)}
        chains.append(Chain(f"New{n}_", str(rng.choice(anchors)), rng.normal(size=3), bones, **settings))
        anchors += chains[-1].joints
    return chains


def tips(motion: Motion) -> Array:
    """(T, S, 3)"""
    return kinematics.end_site_positions(motion)


def chain_points(motion: Motion, chain: Chain) -> Array:
    """(T, N + 1, 3) the joints of a chain and its tip."""
    joints = [motion.skeleton.index(name) for name in chain.joints]
    tip = tips(motion)[:, motion.skeleton.end_sites.index(joints[-1])]
    return np.concatenate([motion.positions[:, joints], tip[:, None]], axis=1)


# -- the clip stays as it is


@given(generators(), st.integers(0, 4))
def test_the_clips_own_joints_do_not_feel_the_chains(rng: np.random.Generator, count: int) -> None:
    motion = random_motion(rng, random_skeleton(rng, int(rng.integers(1, 8))), frames=4, smooth=True)
    chains = random_chains(rng, motion, count)
    grown = swing(motion, chains, warm_up_seconds=0.2)
    own = [grown.skeleton.names.index(name) for name in motion.skeleton.names]
    assert own == sorted(own)
    assert np.array_equal(grown.rotations[:, own], motion.rotations)
    assert np.array_equal(grown.translations, motion.translations)
    assert [grown.skeleton.names[j] for j in grown.translating] == [
        motion.skeleton.names[j] for j in motion.translating
    ]
    assert np.array_equal(grown.positions[:, own], motion.positions)
    assert set(grown.skeleton.names) - set(motion.skeleton.names) == {name for c in chains for name in c.joints}
    for chain in chains:
        points = chain_points(grown, chain)
        lengths = np.linalg.norm(np.diff(points, axis=1), axis=-1)
        np.testing.assert_allclose(lengths, np.tile(np.linalg.norm(chain.bones, axis=-1), (4, 1)), rtol=1e-9)


@given(generators())
def test_joints_come_depth_first_where_the_clips_do(rng: np.random.Generator) -> None:
    motion = random_motion(rng, random_skeleton(rng, 6, depth_first=True), frames=2)
    skeleton = swing(motion, random_chains(rng, motion, 4), warm_up_seconds=0.0).skeleton
    for joint in range(len(skeleton)):
        family = skeleton.subtree(joint)
        assert family == tuple(range(joint, joint + len(family)))


def test_rotations_say_where_the_points_went() -> None:
    """Local rotations are made from directions in the world; forward kinematics must lead back to them."""
    rng = np.random.default_rng(0)
    motion = random_motion(rng, random_skeleton(rng, 5), frames=20, smooth=True)
    chains = random_chains(rng, motion, 1) + [dataclasses.replace(c, name="B") for c in random_chains(rng, motion, 1)]
    world = World(motion, chains, (), -1e9, 1.0, 120.0)
    along = world.directions()
    grown = swing(motion, chains, warm_up_seconds=1.0)
    for c, chain in enumerate(world.chains):
        points = chain_points(grown, chain)
        ways = np.diff(points, axis=1) / np.linalg.norm(chain.bones, axis=-1)[:, None]
        if points[..., 1].min() > kinematics.ground_height(motion) + 0.01:
            np.testing.assert_allclose(ways, along[:, : len(chain.bones), c], atol=1e-9)


def test_the_same_again() -> None:
    rng = np.random.default_rng(1)
    motion = random_motion(rng, random_skeleton(rng, 5), frames=10, smooth=True)
    chains = random_chains(rng, motion, 3)
    assert swing(motion, chains) == swing(motion, chains)


def test_nothing_to_add_adds_nothing() -> None:
    motion = pole(still())
    assert swing(motion, []) == motion


# -- physics


def test_without_weight_a_still_chain_keeps_its_rest_shape() -> None:
    grown = swing(pole(still()), [rope(weight=0.0)])
    assert rot.angle_between(grown.rotations, rot.IDENTITY).max() < 1e-7


@pytest.mark.parametrize("bones", [1, 3, 12, 40])
def test_a_still_chain_hangs_settled_from_the_first_frame(bones: int) -> None:
    """And it hangs alike into however many bones it is divided: the tip sinks by about g / (2 pi hertz)^2."""
    grown = swing(pole(still()), [chain := rope(bones, 0.5, hertz=1.5, weight=0.2)])
    points = chain_points(grown, chain)
    assert np.linalg.norm(points - points[:1], axis=-1).max() < 2e-3
    sunk = points[0, 0, 1] - points[0, -1, 1]
    expected = 0.2 * 9.81 / (2 * np.pi * 1.5) ** 2
    assert 0.3 * expected < sunk < 1.3 * expected


@pytest.mark.parametrize("frame_rate", [30.0, 120.0])
def test_shaken_hard_and_left_alone_it_comes_to_rest(frame_rate: float) -> None:
    """Energy is bounded while the pole is shaken, and gone some seconds later, soft or stiff, short or long."""
    seconds = np.arange(round(7 * frame_rate)) / frame_rate
    shaking = np.sin(2 * np.pi * 3 * seconds) * (seconds < 3)
    motion = pole(0.3 * shaking[:, None] * [1.0, 0.5, 0.0], rot.from_axis_angle(UP, 2 * shaking), frame_rate)
    chains = [
        rope(bones, name=f"Rope{n}_", hertz=hertz, damping=damping, drag=0.5, bend=bend)
        for n, (bones, hertz, damping, bend) in enumerate(
            itertools.product((1, 4, 10), (0.3, 3.0, 50.0), (0.7, 2.0), (0.5, 1.0))
        )
    ]
    grown = swing(motion, chains)
    speeds = np.linalg.norm(np.diff(tips(grown), axis=0), axis=-1) * frame_rate
    rigid = motion.positions[:, 1] + rot.rotate(motion.rotations[:, 0], np.array([0.0, 0.0, -0.6]))
    assert speeds.max() < 2 * np.linalg.norm(np.diff(rigid, axis=0), axis=-1).max() * frame_rate
    assert speeds[-round(0.5 * frame_rate) :].max() < 0.005 * speeds.max()
    turned = rot.angle_between(grown.rotations[:, 2:], rot.IDENTITY)
    assert turned.max() < FOLD + 1e-6


def sway(frame_rate: float, hertz: float = 0.8) -> Motion:
    """A pole that nods to and fro."""
    seconds = np.arange(round(5 * frame_rate)) / frame_rate
    nod = 0.5 * np.sin(2 * np.pi * hertz * seconds)
    return pole(np.zeros((len(seconds), 3)), rot.from_axis_angle(np.array([1.0, 0.0, 0.0]), nod), frame_rate)


def test_frame_rates_agree() -> None:
    chains = [rope(6, hertz=1.0), rope(2, name="Other", way=(1.0, 0.0, 0.0), hertz=2.0)]
    fine = swing(sway(120.0), chains)
    for rate in (30.0, 60.0):
        coarse = swing(sway(rate), chains)
        step = round(120 / rate)
        gap = np.linalg.norm(tips(fine)[::step][: len(coarse)] - tips(coarse), axis=-1)
        assert gap.max() < 0.02  # of ropes 0.6 long


def test_a_chain_lags_behind_and_its_tip_most() -> None:
    """Each bone's swing is the driver's some time later: the delay of best correlation grows along the chain."""
    motion = sway(120.0)
    chain = rope(6, way=(0.0, 1.0, 0.0), hertz=1.0, weight=0.0, drag=0.0)
    points = chain_points(swing(motion, [chain]), chain)
    lean = np.diff(points, axis=1)[..., 2]  # (T, N) how far each bone leans
    driver = rot.rotate(motion.rotations[:, 0], UP)[:, 2]

    def delay(signal: Array) -> int:
        scores = [
            np.corrcoef(driver[120 : len(driver) - 60], signal[120 + d : len(driver) - 60 + d])[0, 1] for d in range(60)
        ]
        assert max(scores) > 0.97
        return int(np.argmax(scores))

    delays = [delay(lean[:, n]) for n in range(lean.shape[1])]
    assert delays[0] > 0
    assert delays == sorted(delays)
    assert delays[-1] >= delays[0] + 5


def test_steady_travel_is_rest_where_there_is_no_air() -> None:
    frames = np.arange(360)[:, None]
    chain = rope(8, drag=0.0, weight=0.3)
    moving, resting = (swing(pole(speed * frames), [chain]) for speed in (np.array([0.02, 0.01, -0.03]), np.zeros(3)))
    assert rot.angle_between(moving.rotations, resting.rotations).max() < 0.01
    trailing = swing(pole(np.array([0.0, 0.0, 0.03]) * frames), [rope(8, drag=3.0, weight=0.0, way=(0.0, 1.0, 0.0))])
    assert (tips(trailing)[:, 0, 2] - trailing.positions[:, 0, 2] < -0.03).all()  # the wind blows it back


@given(generators(), st.floats(-3.0, 3.0))
def test_turning_the_world_turns_the_chains(rng: np.random.Generator, angle: float) -> None:
    motion = random_motion(rng, random_skeleton(rng, 4), frames=6, smooth=True, translating=(0,))
    chains = random_chains(rng, motion, 2)
    turn, shift = rot.from_axis_angle(UP, angle), np.array([3.0, 0.0, -2.0])
    turned = swing(motion.transform(turn, shift), chains, warm_up_seconds=0.3)
    assert turned.allclose(swing(motion, chains, warm_up_seconds=0.3).transform(turn, shift), 1e-5)


@pytest.mark.parametrize("unit", ["cm", "in", None])
def test_units_do_not_matter(unit: str | None) -> None:
    """A clip of unknown unit is taken to be of human size, and so is one metre and three quarters of pole."""
    motion = sway(60.0)
    chain = rope(5)
    if unit is None:
        motion = motion.scale(1.75, "m")
        chain = dataclasses.replace(chain, bones=1.75 * chain.bones)
        other, factor = motion.scale(7.3, None), 7.3
    else:
        other = motion.convert_unit(unit)
        factor = other.skeleton.height / motion.skeleton.height
    scaled = dataclasses.replace(chain, bones=factor * chain.bones)
    assert rot.angle_between(swing(motion, [chain]).rotations, swing(other, [scaled]).rotations).max() < 1e-6


def test_chains_do_not_see_each_other() -> None:
    """All are solved in one batch, filled up to the longest; each must move as it does alone."""
    motion = sway(30.0)[:40]
    chains = [rope(n, name=f"Rope{n}_", hertz=n / 2, collides=n % 2 == 0) for n in (2, 7, 1, 4)]
    capsules = [Capsule("Base", "Top", 0.2)]
    together = swing(motion, chains, capsules)
    for chain in chains:
        alone = swing(motion, [chain], capsules)
        np.testing.assert_allclose(chain_points(together, chain), chain_points(alone, chain), atol=1e-9)


def test_the_warm_up_is_long_enough_to_be_forgotten() -> None:
    chains = [rope(6, hertz=0.6), rope(10, name="Long", length=0.9, hertz=0.6)]
    motion = sway(60.0)
    short, long = (swing(motion, chains, warm_up_seconds=seconds) for seconds in (3.0, 4.5))
    assert np.linalg.norm(tips(short) - tips(long), axis=-1).max() < 0.02
    cold = swing(motion, chains, warm_up_seconds=0.0)
    assert np.linalg.norm(tips(cold) - tips(long), axis=-1)[0].max() > 0.05


def test_it_sets_off_at_the_speed_that_it_has() -> None:
    """No jolt at the first frame: the chain's acceleration there is what it is later."""
    motion = sway(60.0)[50:]  # in the midst of a swing
    speed = np.diff(tips(swing(motion, [rope(6)]))[:, 0], axis=0) * 60
    jolts = np.linalg.norm(np.diff(speed, axis=0), axis=-1) * 60
    assert jolts[:10].max() < 1.5 * jolts[60:].max()


def test_a_driven_chain_follows_its_drive() -> None:
    frames = 240
    beat = 0.6 * np.sin(np.linspace(0, 6 * np.pi, frames))
    drive = rot.from_axis_angle(np.array([0.0, 0.0, 1.0]), beat)
    chain = rope(3, way=(1.0, 0.0, 0.0), hertz=6.0, weight=0.0, drag=0.0, drive=drive)
    points = chain_points(swing(pole(np.zeros((frames, 3))), [chain]), chain)
    lift = np.arctan2(points[:, -1, 1] - points[:, 0, 1], points[:, -1, 0] - points[:, 0, 0])
    assert np.abs(lift - beat).max() < 0.25
    assert np.corrcoef(lift, beat)[0, 1] > 0.95


# -- obstacles


@given(generators())
def test_capsules_push_as_the_plain_twin_says(rng: np.random.Generator) -> None:
    points, ends, radii = rng.normal(size=(9, 3)), rng.normal(size=(3, 2, 3)), rng.uniform(0.1, 1.5, size=3)
    ends[0, 1] = ends[0, 0]  # a ball
    expected = points.copy()
    for p, point in enumerate(points):
        for (start, end), radius in zip(ends, radii):
            way = end - start
            share = 0.0 if not way.any() else min(max((point - start) @ way / (way @ way), 0.0), 1.0)
            off = point - start - share * way
            distance = np.linalg.norm(off)
            if distance < radius:
                expected[p] += 0.3 * (radius - distance) * off / distance
    np.testing.assert_allclose(points + 0.3 * _push(points, ends, radii), expected, atol=1e-9)


def test_a_capsule_keeps_a_chain_out() -> None:
    """A rope that would hang down inside the pole hangs outside of it."""
    settings: dict[str, Any] = {"way": (0.0, -1.0, -0.05), "hertz": 0.3, "weight": 1.0}
    inside, outside = rope(6, **settings), rope(6, name="Out", collides=True, **settings)
    grown = swing(pole(np.array([0.0, 1.0, 0.0]) + still()), [inside, outside], [Capsule("Base", "Top", 0.15)])
    gaps = [np.hypot(*np.moveaxis(chain_points(grown, chain)[:, 3:, [0, 2]], -1, 0)) for chain in (inside, outside)]
    assert gaps[0].max() < 0.08
    assert gaps[1].min() > 0.1


def test_the_ground_holds() -> None:
    chain = rope(10, length=2.0, way=(0.0, -0.9, -0.4), hertz=0.3, weight=1.0)
    points = chain_points(swing(pole(still()), [chain]), chain)  # the ground is where the base is
    assert points[..., 1].min() > -0.05
    assert np.abs(points[:, -3:, 1]).max() < 0.05  # its end lies there
    assert np.linalg.norm(points[-1] - points[-20], axis=-1).max() < 0.01  # and lies still


def test_cloth_takes_its_neighbours_along() -> None:
    def moved(cloth: float) -> float:
        names = ("A", "B", "C")
        chains = [
            rope(
                4, name=name, way=(0.0, -1.0, -0.05), hertz=0.5, weight=0.5, cloth=cloth,
                beside=tuple(other for other in names if other != name), collides=name == "A",
            )
            for name in names
        ]  # fmt: skip
        grown = swing(pole(UP + still()), [*chains], [Capsule("Base", "Top", 0.2)])
        return float(-chain_points(grown, chains[1])[-1, -1, 2])

    assert moved(0.5) > moved(0.0) + 0.02


# -- refused


@pytest.mark.parametrize(
    ("chains", "settings", "words"),
    [
        (lambda: [rope(anchor="Topp")], {}, "there is no joint 'Topp'; did you mean 'Top'?"),
        (lambda: [rope(name="A", anchor="B1"), rope(name="B", anchor="A1")], {}, "in a circle"),
        (lambda: [rope(name="A", anchor="B1"), rope(name="B", anchor="Nose")], {}, "no joint 'Nose'"),
        (lambda: [rope(), rope()], {}, "unique"),
        (lambda: [rope(drive=np.zeros((3, 4)))], {}, "drive of chain 'Rope' must have shape (60, 4)"),
        (lambda: [rope()], {"warm_up_seconds": -1.0}, "warm_up_seconds"),
        (lambda: [rope()], {"steps_per_second": 0.0}, "steps_per_second"),
        (lambda: [rope()], {"capsules": [Capsule("Base", "Tip", 1.0)]}, "there is no joint 'Tip'"),
        (lambda: [rope(way=(0.0, 0.0, 0.0))], {}, "all of some length"),
        (lambda: [Chain("Rope", "Top", np.zeros(3), np.zeros((0, 3)))], {}, "at least one bone"),
        (lambda: [Chain("Rope", "Top", np.zeros(2), np.ones((1, 3)))], {}, "offset of chain 'Rope'"),
        (lambda: [rope(damping=0.5)], {}, "damping of chain 'Rope' must be at least 0.7, not 0.5"),
        (lambda: [rope(bend=1.5)], {}, "bend of chain 'Rope' must be from 0 to 1, not 1.5"),
        (lambda: [rope(hertz=float("nan"))], {}, "hertz of chain 'Rope' must be at least 0, not nan"),
    ],
)
def test_nonsense_is_refused_in_one_line(
    chains: Callable[[], list[Chain]], settings: dict[str, Any], words: str
) -> None:
    with pytest.raises(MotionGenError) as caught:
        swing(pole(still()), chains(), **settings)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
