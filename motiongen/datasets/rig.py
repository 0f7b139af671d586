"""The one skeleton of a dataset, and how clips are brought to it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.adapt import LARGEST_REST_TURN
from motiongen.contact import foot_joints
from motiongen.datasets.entities import EntityLayout
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

MOST_HELD = 0.05
"""How far, in skeleton heights, a joint below the root may move in its parent's frame and be held still. In the data's
representation bones have fixed lengths."""

SHORT_BONE = 1e-3
"""Bones shorter than this, in skeleton heights, have no direction to compare."""


@dataclass(frozen=True)
class Rig:
    """What a dataset's clips are brought to.

    Attributes:
        layout: the skeleton, with the first clip's bone lengths and its joint 0 at the origin, and its feet.
        patterns: which joints were asked for, as `Skeleton.select` takes them; none: all from the root down.
        unit: what the skeleton's lengths are in.
    """

    layout: EntityLayout
    patterns: tuple[str, ...]
    unit: str | None

    @property
    def skeleton(self) -> Skeleton:
        """The joints and their first clip's offsets."""
        return self.layout.skeleton


@dataclass(frozen=True)
class Fitted:
    """A clip with the joints of the rig, and what that took.

    Attributes:
        motion: with its own bone lengths, joint 0 alone translating.
        bones: by how much its bones differ from the rig's, at most, in heights of each.
        scale: its height over the rig's.
        held: how far a joint below the root moved in its parent's frame that no longer does, at most, in heights.
    """

    motion: Motion
    bones: float
    scale: float
    held: float


def choose_rig(motions: Sequence[Motion], patterns: Sequence[str] = ()) -> Rig:
    """The rig of the first motion's chosen joints.

    Its root is the joint that carries the character; joints above it, such as a still one over the hips, are merged
    into it. Feet are looked for in all of the motions that share the rig, for names do not always tell.

    Args:
        motions: the first few clips of a dataset.
        patterns: names or shell-style patterns of the joints to keep; by default all from the root down.

    Raises:
        MotionGenError: if a pattern matches nothing, or a joint is chosen whose parent is not.
    """
    first = motions[0]
    alike = [motion for motion in motions if first.skeleton.same_tree(motion.skeleton)]
    root = first.with_translating({joint for motion in alike for joint in motion.translating}).root
    chosen = _chosen(first.skeleton, root, patterns)
    reduced = _reduce(first, chosen)[0]
    offsets = reduced.skeleton.offsets.copy()
    offsets[0] = 0.0
    skeleton = dataclasses.replace(reduced.skeleton, offsets=offsets)
    rig = Rig(EntityLayout(skeleton), tuple(patterns), first.unit)
    feet = foot_joints([reduced, *_that_fit(motions[1:], rig)])
    return dataclasses.replace(rig, layout=EntityLayout(skeleton, feet))


def fit(motion: Motion, rig: Rig) -> Fitted:
    """A clip with the joints of the rig, in its order.

    Raises:
        MotionGenError: if its tree differs, a bone rests in another direction, so that rotations mean something else,
            or a joint below the root moves by more than `MOST_HELD`.
    """
    theirs, ours = motion.skeleton, rig.skeleton
    chosen = _chosen(theirs, theirs.index(ours.names[0]), rig.patterns)
    found = {theirs.names[joint] for joint in chosen}
    if missing := [name for name in ours.names if name not in found]:
        raise MotionGenError(f"it lacks joint '{missing[0]}'{_and_more(missing)}")
    if extra := sorted(found - set(ours.names)):
        raise MotionGenError(f"it has an extra joint '{extra[0]}'{_and_more(extra)}")
    order = [theirs.index(name) for name in ours.names]
    for joint, parent in zip(order[1:], ours.parents[1:]):
        if theirs.parents[joint] != order[parent]:
            raise MotionGenError(f"joint '{theirs.names[joint]}' hangs from another parent")
    reduced, held = _reduce(motion, order)
    if held > MOST_HELD:
        raise MotionGenError(
            f"a joint below '{ours.names[0]}' moves by {held:.1%} of the height in its parent's frame; "
            f"up to {MOST_HELD:.0%} is held still"
        )
    _check_rest(reduced.skeleton, ours)
    apart = reduced.skeleton.offsets / reduced.skeleton.height - ours.offsets / ours.height  # (J, 3)
    bones = float(np.linalg.norm(apart[1:], axis=-1).max(initial=0.0))
    return Fitted(reduced, bones, reduced.skeleton.height / ours.height, held)


def _that_fit(motions: Sequence[Motion], rig: Rig) -> list[Motion]:
    fitting = []
    for motion in motions:
        try:
            fitting.append(fit(motion, rig).motion)
        except MotionGenError:
            continue  # it is refused, with the reason, when its turn comes
    return fitting


def _chosen(skeleton: Skeleton, root: int, patterns: Sequence[str]) -> list[int]:
    """The joints to keep, ascending: one tree, without what is above `root`."""
    if not patterns:
        return list(skeleton.subtree(root))
    above = skeleton.ancestors(root)
    chosen = [joint for joint in skeleton.select(patterns) if joint not in above]
    if not chosen:
        raise MotionGenError(f"only joints above the root '{skeleton.names[root]}' are chosen; choose it and others")
    for joint in chosen[1:]:
        if skeleton.parents[joint] not in chosen:
            name, parent = skeleton.names[joint], skeleton.names[skeleton.parents[joint]]
            raise MotionGenError(
                f"joint '{name}' is chosen and '{parent}' above it, which carries it, is not; choose both or neither"
            )
    return chosen


def _reduce(motion: Motion, joints: Sequence[int]) -> tuple[Motion, float]:
    """The motion of a tree of joints alone, the first of them as root, and how far the others moved in heights.

    World positions stay what they were, but for joints below the root that move in their parents' frames: they are held
    at the median place. Where a bone went on to a joint that is left out, an end site keeps it.
    """
    skeleton = motion.skeleton
    places = {joint: place for place, joint in enumerate(joints)}
    local = motion.local_translations[:, list(joints)]  # (T, J, 3)
    offsets = np.median(local, axis=0)
    parents = [-1, *(places[skeleton.parents[joint]] for joint in joints[1:])]
    sites = [(places[j], at) for j, at in zip(skeleton.end_sites, skeleton.end_site_offsets) if j in places]
    sites += [
        (places[parent], skeleton.offsets[joint])
        for joint, parent in enumerate(skeleton.parents)
        if joint not in places and parent in places
    ]
    reduced = Skeleton(
        tuple(skeleton.names[joint] for joint in joints),
        tuple(parents),
        offsets,
        tuple(joint for joint, _ in sites),
        np.array([at for _, at in sites]).reshape(-1, 3),
    )
    rotations = motion.rotations[:, list(joints)]
    rotations[:, 0] = motion.world_rotations[:, joints[0]]
    held = float(np.linalg.norm(local[:, 1:] - offsets[1:], axis=-1).max(initial=0.0)) / reduced.height
    changed = motion.replace(
        skeleton=reduced,
        rotations=rotations,
        translations=motion.positions[:, joints[0], None],
        translating=(0,),
        file_layout=None,
    )
    return changed, held


def _check_rest(theirs: Skeleton, ours: Skeleton) -> None:
    """Refuse bones that rest in another direction than the rig's: their rotations mean something else."""
    for joint in range(1, len(ours)):
        there, here = theirs.offsets[joint] / theirs.height, ours.offsets[joint] / ours.height
        lengths = float(np.linalg.norm(there)), float(np.linalg.norm(here))
        if min(lengths) < SHORT_BONE:
            continue
        turned = np.arccos(np.clip(there @ here / (lengths[0] * lengths[1]), -1.0, 1.0))
        if turned > LARGEST_REST_TURN:
            raise MotionGenError(
                f"joint '{ours.names[joint]}' rests {np.degrees(turned):.0f} degrees elsewhere than in the first clip, "
                f"where {np.degrees(LARGEST_REST_TURN):.0f} are allowed"
            )


def _and_more(names: Sequence[str]) -> str:
    return f" and {len(names) - 1} more" if len(names) > 1 else ""
