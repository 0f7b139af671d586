"""What a visitor asks for is in what comes back, and too much is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import CancelledError, MotionGenError
from motiongen.generators.base import Generator
from motiongen.generators.constraints import FixedJoints, Keyframes, Loop, RootPath, Segment
from motiongen.motion import Motion
from motiongen.trajectory import path_through
from motiongen.web.limits import Limits
from motiongen.web.wishes import LOOPS, MOST_TAKES, Take, Wish, make_takes

CLIP = mg.load(EXAMPLE_CLIP)[:140]
LIMITS = Limits()


@pytest.fixture(scope="module")
def generator() -> Generator:
    return mg.create("genmm").fit([CLIP])


def made(generator: Generator, wish: Wish, clip: Motion | None = CLIP) -> list[Take]:
    return make_takes(generator, clip, wish, LIMITS, lambda share: None)


def one(generator: Generator, wish: Wish) -> Motion:
    (take,) = made(generator, wish)
    return take.motion


# -- each is kept


def test_keys_are_held_exactly_at_their_frames(generator: Generator) -> None:
    keys = (0, 33, 61)
    motion = one(generator, Wish(70, keys=keys))
    for key in keys:
        np.testing.assert_allclose(np.abs((motion.rotations[key] * CLIP.rotations[key]).sum(axis=-1)), 1.0, atol=1e-9)
        assert motion.translations[key, 0, 1] == pytest.approx(CLIP.translations[key, 0, 1], abs=1e-9)
    assert not motion[:70].allclose(CLIP[:70]), "between them it is another motion"


def test_keys_keep_their_time_at_another_rate() -> None:
    (keys,) = Wish(40, keys=(20, 61)).constraints(CLIP, CLIP.frame_rate / 2)
    assert isinstance(keys, Keyframes)
    assert dict(keys.poses) == {10: CLIP[20], 30: CLIP[61]}


def test_outside_a_segment_every_bit_stays(generator: Generator) -> None:
    motion = one(generator, Wish(len(CLIP), segment=(50, 90)))
    for frames in (slice(0, 50), slice(90, None)):
        np.testing.assert_array_equal(motion.rotations[frames], CLIP.rotations[frames])
        np.testing.assert_array_equal(motion.translations[frames], CLIP.translations[frames])
    assert not np.array_equal(motion.rotations[50:90], CLIP.rotations[50:90])


def test_kept_joints_move_as_in_the_clip(generator: Generator) -> None:
    names = CLIP.skeleton.names
    kept = names[-4:]
    motion = one(generator, Wish(60, kept=kept))
    joints = [names.index(name) for name in kept]
    rest = [joint for joint in range(len(names)) if joint not in joints]
    np.testing.assert_array_equal(motion.rotations[:, joints], CLIP.rotations[:60, joints])
    assert not np.allclose(motion.rotations[:, rest], CLIP.rotations[:60, rest])


def test_names_with_stars_and_brackets_mean_themselves() -> None:
    odd, *others = "*", "[a-z]*", "Leg[1]?"
    names = (*CLIP.skeleton.names[:-3], odd, *others)
    clip = CLIP.replace(skeleton=dataclasses.replace(CLIP.skeleton, names=names))
    (constraint,) = Wish(60, kept=(odd, *others)).constraints(clip, 30.0)
    assert isinstance(constraint, FixedJoints)
    assert clip.skeleton.select(constraint.joints) == tuple(range(len(names) - 3, len(names)))


@pytest.mark.parametrize("loop", [name for name in LOOPS if name != "no"])
def test_a_loop_ends_where_it_begins(generator: Generator, loop: str) -> None:
    motion = one(generator, Wish(80, loop=loop))
    steps = np.abs(np.diff(motion.rotations, axis=0)).max(axis=(1, 2))
    seam = min(np.abs(motion.rotations[-1] - sign * motion.rotations[0]).max() for sign in (1, -1))
    assert seam <= 2 * steps.max(), "the seam is a step like the others"
    if loop == "in place":
        ground = motion.positions[:, 0, [0, 2]]
        paces = np.linalg.norm(np.diff(ground, axis=0), axis=1)
        assert np.linalg.norm(ground[-1] - ground[0]) <= 2 * paces.max() + 1e-6


def test_the_character_travels_along_the_path(generator: Generator) -> None:
    way = CLIP.positions[[0, -1], 0][:, [0, 2]]
    far = 1.1 * np.linalg.norm(way[1] - way[0])  # as far as it goes by itself in that time
    points = ((0.0, 0.0), (0.0, 0.5 * far), (0.3 * far, 0.9 * far))
    motion = one(generator, Wish(len(CLIP), path=points))
    went = motion.positions[:, 0, [0, 2]]
    line = path_through(np.array(points)).places
    apart = np.linalg.norm(went[:, None] - line, axis=-1).min(axis=1)
    assert apart.max() < 0.1 * CLIP.skeleton.height
    assert np.linalg.norm(went[0] - points[0]) < 0.2 * CLIP.skeleton.height


# -- as constraints


def test_a_wish_for_nothing_asks_for_nothing_and_needs_no_clip() -> None:
    assert Wish(60).constraints(None, 30.0) == []


def test_every_wish_is_one_constraint() -> None:
    wish = Wish(140, keys=(3,), segment=(10, 20), kept=("Hips",), path=((0.0, 0.0), (1.0, 2.0)), loop="in place")
    kinds = {type(each): each for each in wish.constraints(CLIP, CLIP.frame_rate)}
    assert set(kinds) == {Keyframes, Segment, FixedJoints, RootPath, Loop}
    assert kinds[Loop].in_place is True
    assert kinds[RootPath].points.tolist() == [[0.0, 0.0], [1.0, 2.0]]
    assert kinds[Keyframes].poses[3] == CLIP[3]
    assert (kinds[Segment].start, kinds[Segment].stop) == (10, 20)


@pytest.mark.parametrize("loop", list(LOOPS))
def test_each_loop_is_that_of_the_library(loop: str) -> None:
    loops = Wish(60, loop=loop).constraints(None, 30.0)
    assert [each.in_place for each in loops if isinstance(each, Loop)] == ([] if loop == "no" else [LOOPS[loop]])


# -- several


def test_seeds_side_by_side_are_the_motions_of_single_wishes(generator: Generator) -> None:
    takes = made(generator, Wish(50, count=3, seed=7, compare=True))
    assert [take.motion for take in takes] == [one(generator, Wish(50, seed=seed)) for seed in (7, 8, 9)]
    assert [take.label for take in takes] == ["seed 7", "seed 8", "seed 9"]
    assert len({take.motion.name for take in takes}) == 3


def test_motions_of_one_seed_are_those_of_the_library(generator: Generator) -> None:
    takes = made(generator, Wish(50, count=3, seed=7))
    assert [take.motion for take in takes] == generator.sample(50, 3, 7)
    assert [take.label for take in takes] == ["seed 7, 1 of 3", "seed 7, 2 of 3", "seed 7, 3 of 3"]
    assert len({take.motion.name for take in takes}) == 3
    assert not any(take.accepted for take in takes)


@pytest.mark.parametrize("compare", [False, True])
def test_progress_grows_from_nothing_to_all(generator: Generator, compare: bool) -> None:
    shares: list[float] = []
    make_takes(generator, CLIP, Wish(50, count=3, compare=compare), LIMITS, shares.append)
    assert shares == sorted(shares)
    assert 0 <= shares[0] < 0.5
    assert shares[-1] == pytest.approx(1.0)


def test_it_can_be_cancelled_from_its_progress(generator: Generator) -> None:
    def stop(share: float) -> None:
        raise CancelledError

    with pytest.raises(CancelledError):
        make_takes(generator, CLIP, Wish(50), LIMITS, stop)


# -- mistakes


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        (Wish(50, count=0), f"0 motions are asked for; 1 to {MOST_TAKES}"),
        (Wish(50, count=MOST_TAKES + 1), f"1 to {MOST_TAKES} are made at a time"),
        (Wish(2501, count=8), "8 x 2501 frames are asked for; at most 20000 in all"),
        (Wish(0), "frames must be"),
        (Wish(50, seed=-1), "seed must not be negative"),
        (Wish(200, keys=(3, 140)), "the key at frame 140 lies behind the clip, which has 140 frames"),
        (Wish(50, keys=(60,)), "no frame 60 for a key"),
        (Wish(50, segment=(10, 20)), "has 140 frames; ask for as many, not 50"),
        (Wish(140, segment=(30, 150)), "30:150 does not lie"),
        (Wish(50, kept=("Nose",)), "Nose"),
        (Wish(150, kept=("Hips",)), "has 140 frames, 150 are asked for"),
        (Wish(50, path=((0.0, 0.0),)), "needs at least two points"),
        (Wish(50, path=((1.0, 1.0), (1.0, 1.0))), "two different points"),
        (Wish(50, path=((0.0, 0.0), (0.0, 1e300))), "1e+300 away; nothing goes so far"),
    ],
)
def test_what_does_not_go_is_said_in_one_line(generator: Generator, wish: Wish, words: str) -> None:
    with pytest.raises(MotionGenError) as caught:
        made(generator, wish)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wish", [Wish(50, keys=(1,)), Wish(50, segment=(1, 3)), Wish(50, kept=("Hips",))])
def test_what_is_taken_from_a_clip_needs_one(wish: Wish) -> None:
    with pytest.raises(MotionGenError, match="are taken from a clip; load one first"):
        wish.constraints(None, 30.0)


def test_a_generator_that_takes_no_keys_says_so() -> None:
    generator = mg.create("modi")
    with pytest.raises(MotionGenError, match="MoDi does not take the constraint Keyframes"):
        made(generator, Wish(64, keys=(1,)))


def test_the_limit_holds_for_all_motions_together(generator: Generator) -> None:
    limits = Limits(frames=100)
    assert len(make_takes(generator, CLIP, Wish(50, count=2), limits, lambda share: None)) == 2
    with pytest.raises(MotionGenError, match="2 x 51 frames are asked for; at most 100 in all"):
        make_takes(generator, CLIP, Wish(51, count=2), limits, lambda share: None)


def test_the_limit_counts_at_the_clips_rate() -> None:
    """A result of one frame a second is made at the clip's own rate before."""
    slow = mg.create("genmm", output_rate=1.0).fit([CLIP])
    with pytest.raises(MotionGenError, match="50 frames are asked for; at most 100 in all"):
        make_takes(slow, CLIP, Wish(50), Limits(frames=100), lambda share: None)
