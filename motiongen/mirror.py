"""Exchange left and right on any rig, whatever way its bones' own axes point."""

from __future__ import annotations

import dataclasses
import itertools
import re

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

# A side is a word of its own in a name: LeftArm, arm_l, Bip01 L Hand, hand.R, RHipJoint, lThigh.
_SIDES = (
    re.compile(r"left|right", re.IGNORECASE),
    re.compile(r"(?<![a-zA-Z])[lrLR](?![a-zA-Z])"),
    re.compile(r"(?<![a-zA-Z])[lrLR](?=[A-Z][a-z])"),
)
_OTHER = {"left": "right", "right": "left", "l": "r", "r": "l"}

# The reflections a rig's local frames can be mirrored by: one axis flipped, or all three.
_REFLECTIONS = tuple(np.diag(signs) for signs in itertools.product((-1.0, 1.0), repeat=3) if np.prod(signs) < 0)
_WORLD = [tuple(np.diag(flip)) for flip in _REFLECTIONS].index((-1.0, 1.0, 1.0))  # the mirror stands across x


def counterparts(skeleton: Skeleton) -> tuple[int, ...]:
    """(J,) the joint on the other side of each joint, by name; a joint without one is its own.

    Raises:
        MotionGenError: if no joint has a counterpart, or the pairs do not agree with the tree.
    """
    pairs = tuple(_counterpart(skeleton, joint) for joint in range(len(skeleton)))
    if all(pair == joint for joint, pair in enumerate(pairs)):
        raise MotionGenError("no joint names come in left and right pairs (LeftArm/RightArm, arm_l/arm_r); rename them")
    for joint, pair in enumerate(pairs[1:], start=1):
        if pairs[skeleton.parents[joint]] != skeleton.parents[pair]:
            raise MotionGenError(
                f"joints '{skeleton.names[joint]}' and '{skeleton.names[pair]}' do not hang from a pair of joints"
            )
    return pairs


def _counterpart(skeleton: Skeleton, joint: int) -> int:
    name = skeleton.names[joint]
    for side in _SIDES:
        swapped = side.sub(lambda found: _like(found.group(), _OTHER[found.group().lower()]), name)
        if swapped != name and swapped in skeleton.names:
            return skeleton.names.index(swapped)
    return joint


def _like(pattern: str, word: str) -> str:
    """`word` in the case of `pattern`."""
    return word.upper() if pattern.isupper() else word.capitalize() if pattern[0].isupper() else word


def mirror(motion: Motion) -> Motion:
    """The motion as seen in a mirror.

    The world is reflected along x. Each joint takes the reflected rotation of its counterpart, with its local frame
    reflected by the axis flip under which the rest offsets of the two sides agree. Where several flips fit (a chain of
    single bones says nothing about its twist), those are taken that keep the counterparts' mean rotations closest.
    Offsets stay this skeleton's own: where left and right bones differ in length, positions are mirrored to that
    extent only.

    Raises:
        MotionGenError: if joints do not come in pairs, or the rest offsets of a pair are no mirror images.
    """
    skeleton = motion.skeleton
    pairs = counterparts(skeleton)
    flips = _local_flips(motion, pairs)
    world = _REFLECTIONS[_WORLD]
    matrices = rot.to_matrix(motion.rotations)  # (T, J, 3, 3)
    parents = [world if p == -1 else flips[p] for p in skeleton.parents]
    mirrored = np.stack([parents[j] @ matrices[:, j] @ flips[j] for j in range(len(skeleton))], axis=1)
    rotations = rot.from_matrix(mirrored)[:, list(pairs)]  # counterparts are their own inverse
    wide = motion.with_translating({pairs[j] for j in motion.translating})
    if 0 not in wide.translating:  # then its offset says where the whole character stands
        offsets = skeleton.offsets.copy()
        offsets[0] = world @ offsets[0]
        wide = wide.replace(skeleton=dataclasses.replace(skeleton, offsets=offsets))
    moved = {j: wide.translations[:, m] @ parents[j] for m, j in enumerate(wide.translating)}
    translations = np.stack([moved[pairs[j]] for j in wide.translating], axis=1) if moved else wide.translations
    return wide.replace(rotations=rot.continuous(rotations), translations=translations, notes=())


def _local_flips(motion: Motion, pairs: tuple[int, ...]) -> list[Array]:
    """For each joint the reflection that takes its frame to its counterpart's frame.

    Of all choices under which the offsets agree, the one is taken that keeps the counterparts' mean rotations closest,
    summed over all joints and found from the leaves to the root, since each joint's choice bears on those below it.
    """
    skeleton = motion.skeleton
    flips = np.stack(_REFLECTIONS)  # (4, 3, 3)
    gaps = np.array([[_offset_gap(skeleton, pairs, j, flip) for flip in flips] for j in range(len(skeleton))])  # (J, 4)
    lopsided = gaps.min(axis=1)
    if lopsided.max() > 0.05 * skeleton.height:
        joint = int(np.argmax(lopsided))
        raise MotionGenError(
            f"the bones below '{skeleton.names[joint]}' and '{skeleton.names[pairs[joint]]}' are no mirror images; "
            "this rig cannot be mirrored"
        )
    mean = rot.to_matrix(motion.rotations).mean(axis=0)  # (J, 3, 3), a mean direction good enough to compare with
    turned = np.einsum("aij,njk,bkl->nabil", flips, mean, flips) - mean[list(pairs)][:, None, None]
    cost = np.linalg.norm(turned, axis=(-2, -1))  # (J, 4, 4): by the parent's flip and the joint's own
    # Which way the figure looks says nothing about its frames.
    cost[[*skeleton.ancestors(motion.root), motion.root]] = 0.0
    # On a lopsided rig a wrong flip may by chance fit a straight bone better than the right one does. All that fit as
    # well as the rig's worst bone can are left to choose from; on an exact rig those are the exact ones.
    fits = gaps <= 2 * lopsided.max() + 1e-3 * skeleton.height
    cost += np.where(fits, 0.0, np.inf)[:, None, :]
    for joint in reversed(range(1, len(skeleton))):
        cost[skeleton.parents[joint]] += cost[joint].min(axis=1)
    chosen: list[int] = []
    for joint, (pair, parent) in enumerate(zip(pairs, skeleton.parents)):
        above = _WORLD if parent == -1 else chosen[parent]
        chosen.append(chosen[pair] if pair < joint else int(np.argmin(cost[joint, above])))  # a pair shares its flip
    return [flips[choice] for choice in chosen]


def _offset_gap(skeleton: Skeleton, pairs: tuple[int, ...], joint: int, flip: Array) -> float:
    """How far the reflected child offsets of `joint` lie from those of its counterpart, at most."""
    gaps = [
        float(np.linalg.norm(flip @ skeleton.offsets[child] - skeleton.offsets[pairs[child]]))
        for child in skeleton.children[joint]
    ]
    return max(gaps, default=0.0)
