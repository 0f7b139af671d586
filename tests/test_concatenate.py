"""Joining clips: nothing is lost, the character walks on where it was going, and what does not fit is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from motiongen import Motion, MotionGenError, Skeleton, concatenate
from motiongen import rotations as rot
from tests.strategies import Array, generators, motions, random_motion, random_skeleton, skeletons

UP = np.array([0.0, 1.0, 0.0])


def pair_of_clips(
    rng: np.random.Generator, skeleton: Skeleton, smooth: bool = False, min_frames: int = 1
) -> list[Motion]:
    """Two clips of one skeleton that differ in length, place, heading and translating joints."""
    clips = []
    for frames in rng.integers(min_frames, 6, size=2):
        clip = random_motion(rng, skeleton, frames=int(frames), smooth=smooth)
        clips.append(clip.transform(rot.from_axis_angle(UP, rng.uniform(-3, 3)), rng.normal(size=3)))
    return clips


def walk(
    frames: int, heading_radians: float, speed: float, still_root: bool = False, rest: Array = rot.IDENTITY
) -> Motion:
    """A body that walks straight on, leaning a little; with a root that stands still above it, if asked.

    `rest` is how the hips' own axes lie when it stands upright and looks along z.
    """
    names, parents = ("Root", "Hips", "Head"), (-1, 0, 1)
    offsets = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], rot.rotate(rot.inverse(rest), UP)])
    hips = 1
    if not still_root:
        names, parents, offsets, hips = names[1:], (-1, 0), offsets[1:], 0
    seconds = np.arange(frames) / 30.0
    heading = rot.from_axis_angle(UP, heading_radians)
    lean = rot.from_axis_angle(np.array([1.0, 0.0, 0.0]), 0.1 * np.sin(4 * seconds))
    rotations = np.tile(rot.IDENTITY, (frames, len(names), 1))
    rotations[:, hips] = rot.multiply(rot.multiply(heading, lean), rest)
    way = np.stack([0 * seconds, 1 + 0.05 * np.sin(9 * seconds), speed * seconds], axis=-1)
    skeleton = Skeleton(names, parents, offsets)
    return Motion(skeleton, rotations, rot.rotate(heading, way)[:, None], (hips,), 30.0)


# -- without alignment


@given(skeletons(), generators())
def test_unaligned_clips_stay_where_they_are(skeleton: Skeleton, rng: np.random.Generator) -> None:
    clips = pair_of_clips(rng, skeleton)
    joined = concatenate(clips, align=False)
    positions = np.concatenate([clip.positions for clip in clips])
    room = 1e-10 * (skeleton.height + np.abs(positions).max())
    assert_allclose(joined.positions, positions, rtol=0, atol=room)
    assert np.array_equal(joined.rotations, np.concatenate([clip.rotations for clip in clips]))


@given(motions(min_frames=2, max_frames=10), st.data(), st.booleans())
def test_a_clip_cut_in_pieces_is_put_together_again(motion: Motion, data: st.DataObject, keep: bool) -> None:
    cuts = sorted(data.draw(st.sets(st.integers(1, len(motion) - 1), max_size=3)))
    pieces = [motion[a:b] for a, b in zip([0, *cuts], [*cuts, len(motion)])]
    assert concatenate(pieces, align=False) == motion
    assert concatenate([motion], align=keep).allclose(motion)


# -- with alignment


@given(skeletons(), generators(), st.booleans())
def test_aligned_clips_keep_their_poses_and_steps(skeleton: Skeleton, rng: np.random.Generator, smooth: bool) -> None:
    """What is below the root moves as one: joints keep their distances, and the root its heights and step lengths."""
    clips = pair_of_clips(rng, skeleton, smooth)
    joined = concatenate(clips)
    root = joined.root
    carried = list(skeleton.subtree(root))
    start = len(clips[0])
    assert len(joined) == start + len(clips[1])
    room = 1e-9 * (skeleton.height + max(float(np.abs(clip.positions).max()) for clip in [joined, *clips]))
    assert_allclose(joined.positions[:start], clips[0].positions, rtol=0, atol=room)
    before, after = clips[1].positions[:, carried], joined.positions[start:, carried]
    assert_allclose(after[..., 1], before[..., 1], rtol=0, atol=room)  # heights
    for reference in (0, -1):
        apart = np.linalg.norm(before - before[:, reference, None], axis=-1)
        assert_allclose(np.linalg.norm(after - after[:, reference, None], axis=-1), apart, rtol=0, atol=room)
    steps = np.linalg.norm(np.diff(before, axis=0), axis=-1)
    assert_allclose(np.linalg.norm(np.diff(after, axis=0), axis=-1), steps, rtol=0, atol=room)


# How the hips' own axes lie at rest: as the world's, upside down, on their side, and skew.
RESTS = {
    "upright": rot.IDENTITY,
    "upside down": np.array([1.0, 0.0, 0.0, 0.0]),
    "on the side": np.array([0.0, 0.0, 0.5**0.5, 0.5**0.5]),
    "skew": np.array([0.5, 0.5, 0.5, 0.5]),
}


@pytest.mark.parametrize("rest", RESTS.values(), ids=RESTS)
@pytest.mark.parametrize("still_root", [False, True], ids=["hips on top", "still root above"])
def test_a_walk_goes_on_where_it_was_going(still_root: bool, rest: Array) -> None:
    clips = [walk(20, heading, 1.2, still_root, rest) for heading in (0.3, -2.0, 2.9)]
    clips[1] = clips[1].transform(shift=(5.0, 0.0, -3.0)) if not still_root else clips[1]
    joined = concatenate(clips)
    ahead = np.array([np.sin(0.3), 0.0, np.cos(0.3)])
    ground = np.diff(joined.root_positions, axis=0) * [1.0, 0.0, 1.0]
    assert_allclose(ground, np.tile(1.2 / 30 * ahead, (59, 1)), rtol=0, atol=1e-9)
    heights = np.concatenate([clip.root_positions[:, 1] for clip in clips])
    assert_allclose(joined.root_positions[:, 1], heights, atol=1e-9)
    straight = rot.from_axis_angle(UP, 0.3)
    looking = rot.multiply(joined.world_rotations[:, joined.root], rot.inverse(rest))
    # The clips begin upright, and the one before ends leaning by a twentieth: the heading hardly differs.
    assert rot.angle_between(rot.heading(looking), straight).max() < 1e-2
    assert joined.root == (1 if still_root else 0)


def test_a_still_root_stays_still() -> None:
    joined = concatenate([walk(10, 0.0, 1.0, still_root=True), walk(10, 1.0, 1.0, still_root=True)])
    assert joined.translating == (1,)
    assert_allclose(joined.positions[:, 0], 0.0, atol=0)
    assert_allclose(joined.world_rotations[:, 0], np.tile(rot.IDENTITY, (20, 1)), atol=0)


def test_a_figure_without_any_translation_can_be_aligned() -> None:
    rng = np.random.default_rng(6)
    skeleton = random_skeleton(rng, 5)
    clips = [random_motion(rng, skeleton, frames=4, translating=(), smooth=True) for _ in range(2)]
    clips[1] = clips[1].transform(rot.from_axis_angle(UP, 1.0), (3.0, 0.0, 1.0))
    joined = concatenate(clips)
    assert joined.translating == (0,)
    assert_allclose(joined.root_positions, np.tile(clips[0].root_positions[:1], (8, 1)), atol=1e-9)


@given(skeletons(), generators(), st.integers(1, 3))
def test_many_clips_are_joined_from_the_left(skeleton: Skeleton, rng: np.random.Generator, count: int) -> None:
    # Not of one frame: such a clip says nothing about where it was going.
    clips = [clip for _ in range(count) for clip in pair_of_clips(rng, skeleton, smooth=True, min_frames=2)]
    at_once = concatenate(clips)
    assert len(at_once) == sum(map(len, clips))
    translating = {j for clip in clips for j in clip.translating}
    assert translating <= set(at_once.translating)
    wide = [clip.with_translating(at_once.translating) for clip in clips]
    assert concatenate([concatenate(wide[:-1]), wide[-1]]).allclose(at_once, tolerance=1e-6)


def test_the_first_clip_gives_name_unit_and_up() -> None:
    first = walk(3, 0.0, 1.0).replace(name="one", unit="m", up="z")
    joined = concatenate([first, walk(3, 0.0, 1.0).replace(name="two")])
    assert (joined.name, joined.unit, joined.up, joined.frame_rate) == ("one", "m", "z", 30.0)


# -- refusals


def test_what_does_not_fit_is_refused() -> None:
    first = walk(4, 0.0, 1.0).replace(name="one")
    with pytest.raises(MotionGenError, match="concatenate needs at least one motion; none came"):
        concatenate([])
    with pytest.raises(MotionGenError, match="'two' runs at 60 Hz and 'one' at 30 Hz; resample one of them first"):
        concatenate([first, first.replace(name="two", frame_rate=60.0)])
    renamed = dataclasses.replace(first.skeleton, names=("Pelvis", "Head"))
    with pytest.raises(MotionGenError, match="'two' has another skeleton than 'one': it lacks joint 'Hips'"):
        concatenate([first, first.replace(name="two", skeleton=renamed)])
    with pytest.raises(MotionGenError, match=r"joint 'Head' sits .* of the height elsewhere"):
        concatenate([first, first.scale(2.0)])
