"""Coarser and coarser skeletons, from the tree alone, and which entities of them a filter joins (section 3.2).

A *chain* is a run of joints that are each the only child of the one before. A reduction merges joints in one of two
ways:

- *pairing*: the joints of every chain merge two by two; where a chain is odd its first joint stays alone;
- *folding*: every leaf merges into its parent.

Pairing is chosen while it leaves at most three quarters of the joints, folding after that. Where pairing would leave
more, chains are short and many, and so are leaves: either way a reduction leaves no more than about three quarters, and
a skeleton of any shape, a star or a spider too, comes down to one joint in few reductions. The paper's biped goes
through 20, 12, 7, 2 and 1 joints, which are the numbers of its Table 3. Where a skeleton takes more reductions than
there are levels, those are kept whose sizes lie at the most even factors.

The root's motion is an entity beside the root joint at every level, and contact labels are entities beside their foot
joints. Beside one joint there are at most two: both feet of a biped stay apart to the last, as in the paper, and where
three or more feet have come together in one joint, they share one label.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.generators.modi.options import NetworkOptions
from motiongen.skeleton import Skeleton

Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Groups = tuple[tuple[int, ...], ...]
"""What merges into one, ascending; groups are sorted by their first member."""

PAIRING_KEEPS = 0.75
"""Pairing that leaves more than this share of the joints gives way to folding."""

FEET_APART = 2
"""So many contact labels stay apart beside one joint."""


@dataclass(frozen=True)
class Links:
    """Which entities a filter joins, and by which weights: link p feeds target p from source p.

    Attributes:
        targets: (P,) entity that the filter writes.
        sources: (P,) entity that it reads.
        blocks: (P,) which block of weights it takes; links of a skeleton have one each.
        shape: number of targets, number of sources.
    """

    targets: tuple[int, ...]
    sources: tuple[int, ...]
    blocks: tuple[int, ...]
    shape: tuple[int, int]

    @cached_property
    def mask(self) -> Mask:
        """(targets, sources) True where a link is."""
        mask = np.zeros(self.shape, dtype=bool)
        mask[list(self.targets), list(self.sources)] = True
        return mask

    @property
    def shared(self) -> bool:
        """Whether links share weights."""
        return len(set(self.blocks)) < len(self.blocks)


@dataclass(frozen=True)
class Level:
    """The entities at one level, and the tree that they are in.

    Attributes:
        members: (E,) entities of the motion's tensor that each entity holds, ascending: joints, the root's motion after
            them, then the feet's contact labels.
        parents: (E,) the entity that each entity hangs from, -1 for the first.
        names: (E,) what each entity is called.
    """

    members: Groups
    parents: tuple[int, ...]
    names: tuple[str, ...]

    def __len__(self) -> int:
        """The number of entities E."""
        return len(self.members)

    def neighbours(self, distance: int) -> Mask:
        """(E, E) True for entities at most `distance` bones apart, each with itself too."""
        step = np.eye(len(self), dtype=bool)
        for entity, parent in enumerate(self.parents):
            if parent >= 0:
                step[entity, parent] = step[parent, entity] = True
        near = np.eye(len(self), dtype=bool)
        for _ in range(min(distance, len(self))):
            near = near @ step
        return near


@dataclass(frozen=True)
class Hierarchy:
    """A skeleton at all levels, coarsest first.

    Attributes:
        levels: (L,) the levels.
        owners: (L - 1,) for the step from level l to the coarser level l - 1, at l - 1: the entity there that each
            entity here belongs to.
        image: whether entities are rows of an image, whose weights do not depend on the row, and no skeleton's.
    """

    levels: tuple[Level, ...]
    owners: tuple[tuple[int, ...], ...]
    image: bool = False

    def __len__(self) -> int:
        """The number of levels L."""
        return len(self.levels)

    @property
    def entities(self) -> tuple[int, ...]:
        """Entities at each level, coarsest first."""
        return tuple(len(level) for level in self.levels)

    def affinity(self, level: int) -> Mask:
        """(entities at `level`, entities at `level - 1`) True where the first belongs to the second."""
        owners = np.array(self.owners[level - 1])
        return owners[:, None] == np.arange(len(self.levels[level - 1]))

    def in_place_links(self, level: int, distance: int) -> Links:
        """Links of an in-place convolution at a level (Fig. 12): to each entity from those within `distance` bones."""
        near = self.levels[level].neighbours(distance)
        targets, sources = np.nonzero(near)
        return self._links(targets, sources, sources - targets + distance, near.shape)

    def down_links(self, level: int) -> Links:
        """Links of a scaler from `level` to `level - 1` (Fig. 2): to each entity from those that merge in it."""
        fine, places = np.arange(len(self.levels[level])), self._places(level)
        shape = (len(self.levels[level - 1]), len(fine))
        return self._links(np.array(self.owners[level - 1]), fine, places, shape)

    def up_links(self, level: int) -> Links:
        """Links of a scaler from `level - 1` to `level`: to each entity from the one that it is split from."""
        down = self.down_links(level)
        return Links(down.sources, down.targets, down.blocks, (down.shape[1], down.shape[0]))

    def _places(self, level: int) -> Indices:
        """(E,) the place of each entity among those that merge with it."""
        owners = self.owners[level - 1]
        return np.array([owners[:entity].count(owner) for entity, owner in enumerate(owners)])

    def _links(self, targets: Indices, sources: Indices, image_blocks: Indices, shape: tuple[int, int]) -> Links:
        blocks = np.unique(image_blocks, return_inverse=True)[1] if self.image else np.arange(len(targets))
        return Links(tuple(targets.tolist()), tuple(sources.tolist()), tuple(blocks.tolist()), shape)


def build_hierarchy(skeleton: Skeleton, feet: Sequence[int], options: NetworkOptions) -> Hierarchy:
    """The levels that `options` ask for.

    Args:
        skeleton: the finest level.
        feet: the foot joints, each of which has a contact label; may be empty.
        options: how many levels, and of what size; or that the skeleton is not to be followed.

    Raises:
        MotionGenError: if a foot is no joint, or comes twice.
    """
    if sorted(set(feet)) != sorted(feet) or any(not 0 <= foot < len(skeleton) for foot in feet):
        raise MotionGenError(f"feet must be different joints from 0 to {len(skeleton) - 1}, not {tuple(feet)}")
    if not options.skeleton_aware:
        finest = _level(skeleton, tuple((joint,) for joint in range(len(skeleton))), feet)
        return _hierarchy(_image_levels(finest, options.levels), image=True)
    steps = reductions(skeleton.parents)
    chosen = _choose_steps([len(step) for step in steps], options.levels, options.joints)
    return _hierarchy([_level(skeleton, steps[step], feet) for step in chosen], image=False)


def reductions(parents: Sequence[int]) -> list[Groups]:
    """A tree reduced again and again: groups of its joints, from each joint alone to all in one.

    Args:
        parents: (J,) parents before children, -1 for the root.
    """
    groups: Groups = tuple((joint,) for joint in range(len(parents)))
    steps = [groups]
    while len(groups) > 1:
        tree = _group_parents(groups, parents)
        merged = _paired(tree)
        if len(merged) > PAIRING_KEEPS * len(groups):
            merged = _folded(tree)
        groups = tuple(sorted(tuple(sorted(j for g in together for j in groups[g])) for together in merged))
        steps.append(groups)
    return steps


def _paired(parents: Sequence[int]) -> list[list[int]]:
    """The joints of every chain two by two, the first of an odd chain alone."""
    chains: list[list[int]] = []
    chain_of: dict[int, list[int]] = {}
    for joint, parent in enumerate(parents):
        if parent >= 0 and parents.count(parent) == 1:
            chain_of[joint] = chain_of[parent]
            chain_of[joint].append(joint)
        else:
            chain_of[joint] = [joint]
            chains.append(chain_of[joint])
    pairs = []
    for chain in chains:
        odd = len(chain) % 2
        pairs += [chain[:odd]] * odd + [chain[i : i + 2] for i in range(odd, len(chain), 2)]
    return pairs


def _folded(parents: Sequence[int]) -> list[list[int]]:
    """Every joint that has children, with those of them that have none."""
    inner = sorted(set(parents) - {-1})
    return [[joint, *(j for j, p in enumerate(parents) if p == joint and j not in inner)] for joint in inner]


def _group_parents(groups: Groups, parents: Sequence[int]) -> tuple[int, ...]:
    """(G,) the group that each group hangs from: the one that holds the parent of its first joint."""
    group_of = {joint: g for g, group in enumerate(groups) for joint in group}
    return tuple(group_of[parents[group[0]]] if parents[group[0]] >= 0 else -1 for group in groups)


def _choose_steps(sizes: Sequence[int], levels: int, wanted: Sequence[int] | None) -> list[int]:
    """The reductions to keep, coarsest first, each once where there are enough, the coarsest again where not.

    Args:
        sizes: joints after each reduction, finest first.
        levels: how many to keep.
        wanted: joints that each level should have, coarsest first; None: even factors from the last to the first.
    """
    last = len(sizes) - 1
    if levels == 1:
        return [0]
    targets = wanted or [sizes[0] ** (level / (levels - 1)) for level in range(levels)]
    if levels > last:
        return [last] * (levels - last - 1) + list(range(last, -1, -1))
    ends = [last] if wanted is None else range(levels - 1, last + 1)
    choices = [(*between, end) for end in ends for between in itertools.combinations(range(1, end), levels - 2)]

    def miss(steps: Sequence[int]) -> float:
        return sum(abs(math.log(sizes[step] / target)) for step, target in zip(steps[::-1], targets))

    return [*min(choices, key=miss)[::-1], 0]


def _level(skeleton: Skeleton, joints: Groups, feet: Sequence[int]) -> Level:
    """The level whose joint entities hold `joints`; beside them the root's motion and the contacts."""
    root_motion = len(skeleton)
    owner = {joint: g for g, group in enumerate(joints) for joint in group}
    beside: dict[int, list[int]] = {}  # joint entity: places of its feet in `feet`
    for place, foot in enumerate(feet):
        beside.setdefault(owner[foot], []).append(place)
    labels = [list(places) for places in beside.values() if len(places) > FEET_APART]
    labels = sorted(labels + [[place] for places in beside.values() if len(places) <= FEET_APART for place in places])
    held = [[feet[place] for place in places] for places in labels]
    return Level(
        (*joints, (root_motion,), *(tuple(root_motion + 1 + place for place in places) for places in labels)),
        (*_group_parents(joints, skeleton.parents), 0, *(owner[group[0]] for group in held)),
        (
            *(_group_name(skeleton, group) for group in joints),
            "motion of the root",
            *(f"contact of {_group_name(skeleton, group)}" for group in held),
        ),
    )


def _group_name(skeleton: Skeleton, group: Sequence[int]) -> str:
    first = skeleton.names[group[0]]
    return first if len(group) == 1 else f"{first} and {len(group) - 1} more"


def _image_levels(finest: Level, levels: int) -> list[Level]:
    """The entities as rows of an image, each next to those before and after it, halved from level to level."""
    rows = []
    for level in reversed(range(levels)):
        size = 2**level
        starts = range(0, len(finest), size)
        members = tuple(tuple(range(start, min(start + size, len(finest)))) for start in starts)
        names = tuple(finest.names[group[0]] for group in members)
        rows.append(Level(members, tuple(range(-1, len(starts) - 1)), names))
    return rows


def _hierarchy(levels: Sequence[Level], image: bool) -> Hierarchy:
    """The hierarchy of `levels`, coarsest first, each a merging of the next."""
    owners = []
    for coarse, fine in itertools.pairwise(levels):
        owner = {member: entity for entity, group in enumerate(coarse.members) for member in group}
        owners.append(tuple(owner[group[0]] for group in fine.members))
    return Hierarchy(tuple(levels), tuple(owners), image)


def describe(hierarchy: Hierarchy) -> list[str]:
    """The levels as text, coarsest first: the tree of entities, with how many of the motion's entities each holds."""
    lines = []
    for number, level in enumerate(hierarchy.levels):
        lines.append(f"level {number}: {len(level)} entities")
        children = [[e for e, parent in enumerate(level.parents) if parent == above] for above in range(len(level))]
        pending = [(0, "", "  ")]
        while pending:
            entity, branch, indent = pending.pop()
            lines.append(f"  {branch}{level.names[entity]}")
            below = children[entity]
            pending += reversed(
                [
                    (child, indent[2:] + ("└ " if last else "├ "), indent + ("  " if last else "│ "))
                    for child in below
                    for last in [child == below[-1]]
                ]
            )
    return lines
