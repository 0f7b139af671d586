"""What a character gives to a creature: which joints, from which clips, and where they go."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton, frozen_array
from motiongen.stance import stance

Array = NDArray[np.float64]

_PREFIX = re.compile(r".*[:|]|^(?:bip\d*|bn|def|org|jnt|joint|bone|b|j)[\s_.-]+", re.IGNORECASE)
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDES = {"l": "left", "r": "right"}


def plain_name(name: str) -> frozenset[str]:
    """A joint's name but for prefixes, case, word order and the spelling of sides: {left, arm} for rig:arm_L."""
    words = _WORD.findall(_PREFIX.sub("", name))
    return frozenset(str(int(w)) if w.isdigit() else _SIDES.get(w.lower(), w.lower()) for w in words)


@dataclass(frozen=True, eq=False)
class PartSource:
    """What one character gives to a creature, and where it goes.

    Directions and rotations given here are in the axes of the body: x to its left, y up, z ahead.

    Attributes:
        motions: example clips of the character, one or several.
        joints: names or shell-style patterns; each joint brings everything below it. All by default.
        without: names or patterns of joints that stay behind, each with everything below it.
        attach: the joint of the body assembled so far that the part hangs from.
        replaces: or the joint of the body whose place the part takes; that joint and all below it go. The first source
            is the body and has neither of the two; every other source has one.
        overlap: joints of this character that stand for joints of the body, which it does not drive but whose motion
            it knows: they bridge the parts in matching. Given as own name -> name in the body, or as own names and
            patterns whose counterparts have the same name but for prefixes, case and the spelling of sides. By
            default the joints above the part and above its place that have the same name, roots apart, and the joint
            that is replaced with the part's top joint. Empty: none.
        scale: length in the body of a unit of this character; by default the ratio of the skeletons' heights.
        offset: (3,) where the part's top joint sits, seen from the joint that it hangs from, in the unit of the body;
            by default where the replaced joint sat, or as in its own character, scaled.
        rotation: (4,) constant turn of the part about its top joint, xyzw, on top of the orientation that it has in
            its own character; none by default.
        prefix: put before the part's joint names; by default only if one of them is taken: "part2_" for the second.
        name: what to call the part; by default the first clip's name.

    Raises:
        MotionGenError: if there is no clip, the clips differ in skeleton, or a number is out of range.
    """

    motions: Motion | Sequence[Motion]
    joints: str | Sequence[str] = "*"
    without: str | Sequence[str] = ()
    attach: str | None = None
    replaces: str | None = None
    overlap: Mapping[str, str] | Sequence[str] | None = None
    scale: float | None = None
    offset: ArrayLike | None = None
    rotation: ArrayLike | None = None
    prefix: str | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without the other sources."""
        if not self.examples:
            raise MotionGenError("a part needs at least one clip of its character; none came")
        first = self.examples[0]
        moving = {joint for motion in self.examples for joint in motion.translating}
        for motion in self.examples[1:]:
            if found := first.skeleton.difference(motion.skeleton, ignoring=moving):
                raise MotionGenError(f"{self.label}: '{motion.name}' has another skeleton than '{first.name}': {found}")
        if self.scale is not None and not (math.isfinite(self.scale) and self.scale > 0):
            raise MotionGenError(f"{self.label}: a scale must be a positive number, not {self.scale}")
        if self.offset is not None:
            object.__setattr__(self, "offset", frozen_array(self.offset, (3,), f"{self.label}: offset"))
        if self.rotation is not None:
            rotation = frozen_array(self.rotation, (4,), f"{self.label}: rotation")
            if (norm := float(np.linalg.norm(rotation))) < 1e-6:
                raise MotionGenError(f"{self.label}: a rotation must be a quaternion (x, y, z, w), not zero")
            object.__setattr__(self, "rotation", rotation / norm)

    @cached_property
    def examples(self) -> tuple[Motion, ...]:
        """The clips."""
        return (self.motions,) if isinstance(self.motions, Motion) else tuple(self.motions)

    @property
    def label(self) -> str:
        """How messages call this source."""
        return f"part '{self.name or self.examples[0].name}'" if self.examples else "a part"

    @property
    def skeleton(self) -> Skeleton:
        """The character's skeleton."""
        return self.examples[0].skeleton

    @cached_property
    def root(self) -> int:
        """The joint that carries the character."""
        moving = {joint for motion in self.examples for joint in motion.translating}
        return self.examples[0].with_translating(moving).root

    @property
    def above(self) -> tuple[int, ...]:
        """The root, and the joints above it, which only place the character."""
        return (*self.skeleton.ancestors(self.root), self.root)

    @cached_property
    def stance(self) -> Array:
        """(J, 4) mean world rotations of the joints, facing +z."""
        return stance(self.examples)

    @cached_property
    def rest_frame(self) -> Array:
        """(4,) from the axes in which the root's rest offsets are given to those of the body, to quarter turns."""
        quarters = _quarter_turns()
        return quarters[np.argmax(np.abs(quarters @ self.stance[self.root]))]

    def taken(self) -> tuple[int, ...]:
        """The joints that the part consists of, ascending.

        Raises:
            MotionGenError: if patterns match nothing, nothing is left, or what is left does not hang together.
        """
        skeleton = self.skeleton
        chosen = {j for joint in self._select(self.joints) for j in skeleton.subtree(joint)}
        chosen -= {j for joint in self._select(self.without) for j in skeleton.subtree(joint)}
        if not chosen:
            raise MotionGenError(f"{self.label}: no joint is left; leave fewer out")
        tops = [j for j in sorted(chosen) if skeleton.parents[j] not in chosen]
        if len(tops) > 1:
            raise MotionGenError(
                f"{self.label}: its joints do not hang together: nothing joins '{skeleton.names[tops[0]]}' and "
                f"'{skeleton.names[tops[1]]}'; take the joint above both, or make two parts"
            )
        return tuple(sorted(chosen))

    def _select(self, patterns: str | Sequence[str]) -> tuple[int, ...]:
        return self.index(patterns) if isinstance(patterns, str) else tuple(j for p in patterns for j in self.index(p))

    def index(self, pattern: str) -> tuple[int, ...]:
        """The joints that a name or pattern means.

        Raises:
            MotionGenError: if there is none; the message names the nearest one.
        """
        try:
            return self.skeleton.select(pattern)
        except MotionGenError as error:
            raise MotionGenError(f"{self.label}: {error}") from None


def _quarter_turns() -> Array:
    """(24, 4) the rotations that take axes to axes."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    frames = [np.stack([a, b, np.cross(a, b)], axis=-1) for a in axes for b in axes if a @ b == 0]
    return rot.from_matrix(np.stack(frames))
