"""A skeleton: named joints in a tree, with rest offsets."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen.errors import MotionGenError, nearest_of

Array = NDArray[np.float64]


def frozen_array(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """`values` as a read-only float64 array of `shape` (-1: any length) with finite entries.

    Raises:
        MotionGenError: if the shape differs or an entry is not finite; `what` names the array in the message.
    """
    # What is frozen already, and owns its numbers, cannot change under us and need not be copied.
    frozen = isinstance(values, np.ndarray) and not values.flags.writeable and values.base is None
    array = np.asarray(values, dtype=np.float64) if frozen else np.array(values, dtype=np.float64)
    if array.size == 0 and len(shape) > 1 and shape[0] in (-1, 0):
        array = array.reshape((0, *shape[1:]))
    if array.ndim != len(shape) or any(want not in (-1, got) for want, got in zip(shape, array.shape)):
        allowed = ", ".join("any" if size == -1 else str(size) for size in shape)
        raise MotionGenError(f"{what} must have shape ({allowed}), not {array.shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise MotionGenError(f"{what} must be finite numbers; entry {where} is {array[where]}")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints in a tree, parents before children, one root, names unique.

    Attributes:
        names: (J,) joint names.
        parents: (J,) index of each joint's parent; -1 for the root, which is joint 0.
        offsets: (J, 3) rest position of each joint in its parent's frame, in the unit of the clip.
        end_sites: (S,) index of the joint that each end site (the tip of a last bone) hangs from.
        end_site_offsets: (S, 3) rest position of each end site in its joint's frame.

    Raises:
        MotionGenError: if the arrays do not describe such a tree.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    end_sites: tuple[int, ...] = ()
    end_site_offsets: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        """Check the tree and freeze the arrays."""
        joints = len(self.names)
        if joints == 0:
            raise MotionGenError("a skeleton needs at least one joint; none came")
        for name, kind in (("names", str), ("parents", int), ("end_sites", int)):
            object.__setattr__(self, name, tuple(kind(value) for value in getattr(self, name)))
        if len(set(self.names)) != joints:
            twice = next(name for i, name in enumerate(self.names) if name in self.names[:i])
            raise MotionGenError(f"joint names must be unique; '{twice}' came twice")
        if len(self.parents) != joints:
            raise MotionGenError(f"{joints} joints need {joints} parents; {len(self.parents)} came")
        if self.parents[0] != -1:
            raise MotionGenError(f"joint 0 must be the root, with parent -1, not {self.parents[0]}")
        for joint, parent in enumerate(self.parents[1:], start=1):
            if not 0 <= parent < joint:
                raise MotionGenError(
                    f"joint {joint} '{self.names[joint]}' has parent {parent}; "
                    "parents must come before children, and only joint 0 is a root"
                )
        if any(not 0 <= joint < joints for joint in self.end_sites):
            raise MotionGenError(f"end sites must hang from joints 0 to {joints - 1}; {self.end_sites} came")
        object.__setattr__(self, "offsets", frozen_array(self.offsets, (joints, 3), "offsets"))
        tips = frozen_array(self.end_site_offsets, (len(self.end_sites), 3), "end_site_offsets")
        object.__setattr__(self, "end_site_offsets", tips)

    def __len__(self) -> int:
        """The number of joints J."""
        return len(self.names)

    def __eq__(self, other: object) -> bool:
        """True for the same names, tree, offsets and end sites, to the last bit."""
        if not isinstance(other, Skeleton):
            return NotImplemented
        return (
            self.same_tree(other)
            and self.end_sites == other.end_sites
            and np.array_equal(self.offsets, other.offsets)
            and np.array_equal(self.end_site_offsets, other.end_site_offsets)
        )

    def __hash__(self) -> int:
        """A hash over the names and the tree."""
        return hash((self.names, self.parents))

    def __repr__(self) -> str:
        """A short form: the arrays are not shown."""
        return f"Skeleton({len(self)} joints, root '{self.names[0]}', height {self.height:.4g})"

    def same_tree(self, other: Skeleton) -> bool:
        """True for the same joint names in the same order under the same parents, whatever the bone lengths."""
        return self.names == other.names and self.parents == other.parents

    def difference(self, other: Skeleton, ignoring: Iterable[int] = (), tolerance: float = 1e-3) -> str | None:
        """Say in words how `other` differs from this skeleton, or return None where it does not.

        Args:
            other: the skeleton to compare.
            ignoring: joints whose offsets do not matter, because their translation is animated.
            tolerance: largest allowed offset difference, in skeleton heights.
        """
        if missing := [name for name in self.names if name not in other.names]:
            return f"it lacks joint '{missing[0]}'" + (f" and {len(missing) - 1} more" if len(missing) > 1 else "")
        if extra := [name for name in other.names if name not in self.names]:
            return f"it has an extra joint '{extra[0]}'" + (f" and {len(extra) - 1} more" if len(extra) > 1 else "")
        if not self.same_tree(other):
            return "its joints come in another order or under other parents"
        apart = np.linalg.norm(self.offsets - other.offsets, axis=-1) / self.height  # (J,)
        apart[list(ignoring)] = 0.0
        apart[0] = 0.0  # where the root rests is no part of the body
        worst = int(np.argmax(apart))
        if apart[worst] > tolerance:
            return f"joint '{self.names[worst]}' sits {apart[worst]:.1%} of the height elsewhere"
        return None

    @cached_property
    def body(self) -> int:
        """The joint where the body begins: the first, from the root down, that has more than one child.

        What stands above it, such as a still root over the hips, only places the body in the world; its rest offset may
        be anything. A skeleton that never branches is all body.
        """
        joint = 0
        while len(self.children[joint]) == 1:
            joint = self.children[joint][0]
        return joint if self.children[joint] else 0

    @cached_property
    def height(self) -> float:
        """The scale of the skeleton: the longest side of the rest pose's bounding box, joints and end sites together.

        For a biped in a T-pose this is its stature. A skeleton without extent has height 1.
        """
        body = self.subtree(self.body)
        tips = [site for site, joint in enumerate(self.end_sites) if joint in body]
        tip_positions = self.rest_positions[[self.end_sites[site] for site in tips]] + self.end_site_offsets[tips]
        extent = float(np.ptp(np.concatenate([self.rest_positions[list(body)], tip_positions]), axis=0).max())
        return extent if extent > 0 else 1.0

    @cached_property
    def rest_positions(self) -> Array:
        """(J, 3) joint positions with every rotation at identity."""
        positions = self.offsets.copy()
        for joint, parent in enumerate(self.parents[1:], start=1):
            positions[joint] += positions[parent]
        positions.flags.writeable = False
        return positions

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """(J,) the children of each joint, in order."""
        kids: list[list[int]] = [[] for _ in self.names]
        for joint, parent in enumerate(self.parents[1:], start=1):
            kids[parent].append(joint)
        return tuple(tuple(k) for k in kids)

    @cached_property
    def levels(self) -> tuple[tuple[int, ...], ...]:
        """The joints grouped by their distance from the root: level 0 is the root alone."""
        depth = [0] * len(self)
        for joint, parent in enumerate(self.parents[1:], start=1):
            depth[joint] = depth[parent] + 1
        grouped: list[list[int]] = [[] for _ in range(max(depth) + 1)]
        for joint, level in enumerate(depth):
            grouped[level].append(joint)
        return tuple(tuple(level) for level in grouped)

    def subtree(self, joint: int) -> tuple[int, ...]:
        """`joint` and everything below it, parents before children."""
        inside = {joint}
        for j in range(joint + 1, len(self)):
            if self.parents[j] in inside:
                inside.add(j)
        return tuple(sorted(inside))

    def ancestors(self, joint: int) -> tuple[int, ...]:
        """The joints above `joint`, root first, without `joint` itself."""
        chain: list[int] = []
        while (joint := self.parents[joint]) != -1:
            chain.append(joint)
        return tuple(reversed(chain))

    def index(self, name: str) -> int:
        """The index of the joint called `name`.

        Raises:
            MotionGenError: if there is none; the message names the nearest one.
        """
        try:
            return self.names.index(name)
        except ValueError:
            raise MotionGenError(f"there is no joint '{name}'{nearest_of(name, self.names)}") from None

    def select(self, patterns: str | Sequence[str]) -> tuple[int, ...]:
        """Joints whose names match any of the shell-style `patterns`, regardless of case, in joint order.

        A pattern that is the name of a joint selects that joint alone, whatever brackets are in it.

        Raises:
            MotionGenError: if a pattern matches nothing.
        """
        chosen: set[int] = set()
        for pattern in [patterns] if isinstance(patterns, str) else patterns:
            if pattern in self.names:
                hits = {self.names.index(pattern)}
            else:
                hits = {j for j, name in enumerate(self.names) if fnmatch.fnmatchcase(name.lower(), pattern.lower())}
            if not hits:
                raise MotionGenError(f"no joint matches '{pattern}'{nearest_of(pattern, self.names)}")
            chosen |= hits
        return tuple(sorted(chosen))
