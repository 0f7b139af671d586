"""Which joints are a leg: from a foot up to the trunk, on any skeleton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motiongen.contact import NEAR_GROUND
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# A leg is lifted and stretched by the lowest joint that has this share of its length below it.
_LIMB = 2 / 3


@dataclass(frozen=True)
class Legs:
    """The legs of a skeleton, each bent at one joint and swung at another.

    However many bones a leg has, these two are enough to bring its foot anywhere within reach; all others between hip
    and ankle keep their pose in their parents' frames. A joint that never takes part, such as the one between the
    pelvis and the thigh in many captured rigs, stays still.

    Attributes:
        hips: (L,) the joint that each leg swings at.
        knees: (L,) the joint between hip and ankle that it bends at.
        ankles: (L,) the topmost joint of its foot.
        feet: (K,) all foot joints of all legs, parents before children.
        leg: (K,) the leg that each foot joint belongs to.
        above: (K,) which of `feet` is the nearest above it; -1 for an ankle.
        label: (K,) which of the given foot joints it is; -1 for an ankle that was not among them.
    """

    hips: Indices
    knees: Indices
    ankles: Indices
    feet: Indices
    leg: Indices
    above: Indices
    label: Indices

    def __len__(self) -> int:
        """The number of legs L."""
        return len(self.hips)

    @cached_property
    def foot(self) -> NDArray[np.bool_]:
        """(K, L) whether each foot joint is of the foot of each leg."""
        return self.leg[:, None] == np.arange(len(self))


def find_legs(motion: Motion, feet: Sequence[int]) -> Legs:
    """The legs that `feet` belong to.

    A leg goes up from its ankle, the topmost of its foot joints, to the trunk: it ends below the root and below any
    joint that carries another foot; and, once it has two joints, below any joint that branches. Toes that meet before
    that, near their tips, are one foot, and the joint where they meet is its ankle. Feet with fewer than two joints
    above them cannot be moved; they are left out.

    Args:
        motion: the clip; its poses tell at which joint a leg of many bones bends most.
        feet: the foot joints.
    """
    skeleton = motion.skeleton
    trunk = {motion.root, *skeleton.ancestors(motion.root)}
    ankles = _ankles(skeleton, feet, trunk)
    rows, found = [], []
    for ankle in ankles:
        chain = _chain(skeleton, ankle, ankles, trunk)
        if len(chain) < 2:
            continue
        hip = _hip(skeleton, ankle, chain)
        found.append((hip, _knee(motion, ankle, chain[: chain.index(hip)], hip), ankle))
        rows += [(j, len(found) - 1) for j in skeleton.subtree(ankle) if j == ankle or j in feet]
    rows.sort()
    joints = [joint for joint, _ in rows]
    above = [max((joints.index(a) for a in skeleton.ancestors(j) if a in joints), default=-1) for j in joints]
    label = [list(feet).index(j) if j in feet else -1 for j in joints]
    hips, knees, ankle_joints = np.array(found, dtype=np.intp).reshape(-1, 3).T
    leg = [leg for _, leg in rows]
    return Legs(hips, knees, ankle_joints, *(np.array(x, dtype=np.intp) for x in (joints, leg, above, label)))


def _ankles(skeleton: Skeleton, feet: Sequence[int], trunk: set[int]) -> list[int]:
    """The topmost foot joints; toes that meet close by have the joint where they meet for an ankle."""
    ankles = sorted({j for j in feet if not set(skeleton.ancestors(j)) & set(feet)})
    for ankle in ankles:
        chain = _chain(skeleton, ankle, ankles, trunk)
        meet = skeleton.parents[chain[-1] if chain else ankle]
        if len(chain) >= 2 or meet in trunk or meet == -1:
            continue
        toes = [j for j in ankles if meet in skeleton.ancestors(j)]
        if len(toes) > 1 and max(_way(skeleton, meet, toe) for toe in toes) <= NEAR_GROUND * skeleton.height:
            return _ankles(skeleton, [meet, *(j for j in ankles if j not in toes)], trunk)
    return ankles


def _chain(skeleton: Skeleton, ankle: int, ankles: Sequence[int], trunk: set[int]) -> list[int]:
    """The joints of a leg above its ankle, from the ankle up."""
    carrying = trunk.union(*(skeleton.ancestors(other) for other in ankles if other != ankle))
    chain: list[int] = []
    joint = skeleton.parents[ankle]
    while joint != -1 and joint not in carrying and (len(chain) < 2 or len(skeleton.children[joint]) == 1):
        chain.append(joint)
        joint = skeleton.parents[joint]
    return chain


def _way(skeleton: Skeleton, top: int, joint: int) -> float:
    """Length of the bones from `top` down to `joint`."""
    path = [j for j in (*skeleton.ancestors(joint), joint) if top in skeleton.ancestors(j)]
    return float(np.linalg.norm(skeleton.offsets[path], axis=-1).sum())


def _hip(skeleton: Skeleton, ankle: int, chain: Sequence[int]) -> int:
    """The lowest joint of the chain, its first apart, that has most of the leg's length below it."""
    length = _way(skeleton, chain[-1], ankle)
    return next(joint for joint in chain[1:] if _way(skeleton, joint, ankle) >= _LIMB * length)


def _knee(motion: Motion, ankle: int, between: Sequence[int], hip: int) -> int:
    """The joint that stands out furthest from the line between hip and ankle, over the clip: the best lever."""
    start = motion.positions[:, hip]
    line = motion.positions[:, ankle] - start
    line = line / np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-9 * motion.skeleton.height)
    out = [np.linalg.norm(np.cross(line, motion.positions[:, joint] - start), axis=-1).mean() for joint in between]
    return between[int(np.argmax(out))]
