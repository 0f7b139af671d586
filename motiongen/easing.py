"""Make a motion hold given poses exactly, and let what comes before and after flow into them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Easing:
    """How much of the correction at the held frames before and after each frame reaches it.

    Attributes:
        before: (T,) index of the last held frame at or before each frame (or the first held one).
        after: (T,) index of the first held frame at or after it (or the last held one).
        weight_before: (T,) share of the correction of `before`.
        weight_after: (T,) share of the correction of `after`; 0 where both are the same.
    """

    before: Indices
    after: Indices
    weight_before: Array
    weight_after: Array

    def spread(self, corrections: Array) -> Array:
        """Corrections at the held frames (n, ...) as corrections of all frames (T, ...)."""
        extra = (1,) * (corrections.ndim - 1)
        return corrections[self.before] * self.weight_before.reshape(-1, *extra) + corrections[
            self.after
        ] * self.weight_after.reshape(-1, *extra)


def easing(held: Indices, frames: int, window: float, circular: bool = False) -> Easing:
    """Shares that fall from 1 at a held frame to 0 at `window` frames from it, with level ends (a half cosine).

    Where two held frames lie closer than that, the shares of both fall just so far that they add up to 1 in between.

    Args:
        held: (n,) ascending held frames, at least one.
        frames: T.
        window: in frames. With infinity each correction reaches to the next held frame, and beyond the first and the
            last one it stays.
        circular: frame T is frame 0 again.
    """
    numbers = np.arange(len(held))
    if circular:
        held, numbers = np.concatenate([held - frames, held, held + frames]), np.tile(numbers, 3)
    time = np.arange(frames)
    before = np.searchsorted(held, time, side="right") - 1  # -1: there is none
    after = np.searchsorted(held, time)  # len(held): there is none
    to_before = np.where(before >= 0, time - held[before], np.inf)
    to_after = np.where(after < len(held), held[after.clip(max=len(held) - 1)] - time, np.inf)
    reach = np.maximum(np.minimum(window, to_before + to_after), 1.0)

    def share(distance: Array) -> Array:
        with np.errstate(invalid="ignore"):  # infinity by infinity, where there is no such held frame
            fallen = np.minimum(distance / reach, 1.0)
        return np.where(np.isinf(distance), 0.0, 0.5 * (1 + np.cos(np.pi * np.nan_to_num(fallen))))

    return Easing(
        before=numbers[before.clip(min=0)],
        after=numbers[after.clip(max=len(held) - 1)],
        weight_before=share(to_before),
        weight_after=np.where(to_after == 0, 0.0, share(to_after)),  # a held frame is its own neighbour on both sides
    )


def limit_turns(motion: Motion, limit_radians: float, circular: bool = False) -> Motion:
    """Spread turns of the whole body that are quicker than anything the body does.

    Frames blended from two patches that face opposite ways have no direction of their own, and the body spins round in
    a frame or two. What a frame's turn about the up axis has in excess of the limit is taken out and spread over as
    many frames as it needs, by a half cosine, half of the limit at most; the body faces as before outside of them.
    Turns within the limit stay as they are.

    Args:
        motion: what to calm.
        limit_radians: the largest turn of a frame, more than zero: the examples' own.
        circular: the end leads into the beginning.
    """
    root, frames = motion.root, len(motion)
    if frames < 2 or limit_radians <= 0:
        return motion
    world = motion.world_rotations[:, root]  # (T, 4)
    following = np.concatenate([world[1:], world[:1]])
    turns = rot.to_rotation_vector(rot.heading(rot.multiply(following, rot.inverse(world))))[:, 1]  # (T,) t -> t + 1
    if not circular:
        turns[-1] = 0.0
    excess = turns - np.clip(turns, -limit_radians, limit_radians)
    if not excess.any():
        return motion
    spread = -excess
    time = np.arange(frames)
    for frame in np.flatnonzero(excess):
        reach = max(1.0, np.pi * abs(excess[frame]) / (2 * limit_radians))  # frames to each side
        distance = np.abs(time - frame)
        distance = np.minimum(distance, frames - distance) if circular else distance
        share = np.where(distance <= reach, 1 + np.cos(np.pi * np.minimum(distance / reach, 1.0)), 0.0)
        spread += excess[frame] * share / share.sum()
    change = np.concatenate([[0.0], np.cumsum(spread)[:-1]])  # (T,) radians that each frame faces elsewhere
    turned = rot.multiply(rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), change), world)
    parent = motion.skeleton.parents[root]
    if parent != -1:
        turned = rot.multiply(rot.inverse(motion.world_rotations[:, parent]), turned)
    rotations = motion.rotations.copy()
    rotations[:, root] = turned
    return motion.replace(rotations=rot.continuous(rotations))


def hold_poses(
    motion: Motion,
    held: Indices,
    poses: Motion,
    window: float,
    joints: tuple[int, ...] | None = None,
    ground: bool = True,
    circular: bool = False,
) -> Motion:
    """A motion that has the given poses at the held frames, bit for bit, and flows into them.

    At a held frame the correction is the whole difference; around it, it fades out within `window` frames. On the
    ground it does not fade but is spread over all frames between two held ones, and stays before the first and after
    the last: a character that arrives elsewhere takes slightly other steps, and does not slide at the end.

    Args:
        motion: (T frames) what to correct.
        held: (n,) ascending frames of `motion`.
        poses: (n frames) what holds there; of the same skeleton, with the same translating joints.
        window: in frames.
        joints: the joints that are held; all by default.
        ground: hold where the root stands on the ground, too, not only its height.
        circular: the end of the motion leads into its beginning.
    """
    chosen = list(range(len(motion.skeleton))) if joints is None else list(joints)
    fading = easing(held, len(motion), window, circular)
    rotations = motion.rotations.copy()
    wrong = rot.multiply(poses.rotations[:, chosen], rot.inverse(rotations[held][:, chosen]))  # (n, C, 4)
    turns = fading.spread(rot.to_rotation_vector(wrong))
    rotations[:, chosen] = rot.multiply(rot.from_rotation_vector(turns), rotations[:, chosen])
    rotations[held[:, None], chosen] = poses.rotations[:, chosen]
    translations = motion.translations.copy()
    for column, joint in enumerate(motion.translating):
        if joint not in chosen:
            continue
        wrong_place = poses.translations[:, column] - translations[held, column]  # (n, 3)
        if joint != motion.root:
            translations[:, column] += fading.spread(wrong_place)
        else:
            translations[:, column] += _root_shift(motion, held, wrong_place, fading, ground, circular)
        if joint != motion.root or ground:
            translations[held, column] = poses.translations[:, column]
    return motion.replace(rotations=rotations, translations=translations)


def _root_shift(motion: Motion, held: Indices, wrong: Array, fading: Easing, ground: bool, circular: bool) -> Array:
    """(T, 3) what to add to the root's translation in its parent's frame; `wrong` (n, 3) is it at the held frames."""
    parent = motion.skeleton.parents[motion.root]
    turned = motion.world_rotations[:, parent] if parent != -1 else np.tile(rot.IDENTITY, (len(motion), 1))
    world = rot.rotate(turned[held], wrong)
    upright, level = world * [0.0, 1.0, 0.0], world * [1.0, 0.0, 1.0]
    shift = fading.spread(upright)
    if ground:
        shift = shift + easing(held, len(motion), np.inf, circular).spread(level)
    return rot.rotate(rot.inverse(turned), shift)
