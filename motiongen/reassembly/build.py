"""Putting the parts together: the union skeleton, who drives which joint, and who knows it besides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError, nearest_of
from motiongen.reassembly.assembly import Assembly, Link, Part
from motiongen.reassembly.source import PartSource, plain_name
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]


def assemble(sources: Sequence[PartSource]) -> Assembly:
    """One creature out of parts of several characters.

    Args:
        sources: the body first, whose root carries the creature; then the parts, each attached to what is there by
            then.

    Raises:
        MotionGenError: if there is no body, a joint is not there, a part does not hang together or hangs from nothing,
            or two joints end up with one name.
    """
    if not sources:
        raise MotionGenError("a creature needs at least one source, the body; none came")
    body = _Body(tuple(sources))
    for number in range(len(sources)):
        body.add(number)
    return body.finish()


@dataclass(eq=False)
class _Node:
    """A joint of the creature that is being built."""

    name: str
    parent: _Node | None
    offset: Array  # (3,)
    number: int  # of the source that drives it
    joint: int  # of that source
    stance: Array  # (4,) mean world rotation, facing +z


@dataclass(eq=False)
class _Body:
    """The creature as far as it is built: nodes, parents before children, and which source knows which."""

    sources: tuple[PartSource, ...]
    nodes: list[_Node] = field(default_factory=list)
    maps: list[dict[int, _Node]] = field(default_factory=list)  # for each source its joint -> node
    scales: list[float] = field(default_factory=list)
    turns: list[Array] = field(default_factory=list)  # for each source from its rest axes to the creature's

    def add(self, number: int) -> None:
        """Add the part of a source."""
        source = self.sources[number]
        taken = source.taken()
        holder, replaced = self._place(number, taken[0])
        self.scales.append(self._scale(number))
        self.turns.append(rot.multiply(rot.inverse(self.sources[0].rest_frame), source.rest_frame))
        if number == 0:
            self.turns[0] = rot.IDENTITY
        names = self._names(number, taken, replaced)
        fresh: dict[int, _Node] = {}
        for joint, name in zip(taken, names):
            parent = fresh.get(source.skeleton.parents[joint], holder)
            offset = self.scales[number] * rot.rotate(self.turns[number], source.skeleton.offsets[joint])
            if joint == taken[0] and holder is not None:
                offset = replaced.offset if replaced else self._top_offset(number, joint, holder)
                if source.offset is not None:
                    offset = rot.rotate(rot.inverse(holder.stance), np.asarray(source.offset))
            stance = rot.multiply(
                rot.multiply(self._rotation(number), source.stance[joint]), rot.inverse(self.turns[number])
            )
            fresh[joint] = _Node(name, parent, offset, number, joint, stance)
        shared = self._overlap(number, fresh, holder, replaced)
        self._insert(fresh, holder, replaced)
        self.maps.append(fresh | {joint: node for joint, node in shared.items() if node is not replaced})
        if replaced is not None and shared.get(taken[0]) is replaced:
            self.maps[replaced.number][replaced.joint] = fresh[taken[0]]
            self.maps[number][taken[0]] = fresh[taken[0]]

    # -- where a part goes

    def _place(self, number: int, top: int) -> tuple[_Node | None, _Node | None]:
        """The node that a part hangs from, and the one that it replaces."""
        source = self.sources[number]
        ways = [name for name in (source.attach, source.replaces) if name is not None]
        if number == 0:
            if ways or source.scale is not None or source.offset is not None or source.rotation is not None:
                raise MotionGenError(
                    f"{source.label} comes first and is the body: it takes no attach, replaces, scale, offset or "
                    "rotation; put the source with the root first"
                )
            if source.root not in source.taken() or top != 0:
                name = source.skeleton.names[0 if top != 0 else source.root]
                raise MotionGenError(f"{source.label} is the body and must keep its root '{name}'")
            return None, None
        if len(ways) != 1:
            raise MotionGenError(
                f"{source.label} needs one of attach and replaces, {'not both' if ways else 'none came'}; "
                "only the first source is the body"
            )
        if top in source.skeleton.ancestors(source.root):
            raise MotionGenError(
                f"{source.label}: '{source.skeleton.names[top]}' only places its character in the world; "
                f"take joints='{source.skeleton.names[source.root]}' or less"
            )
        found = self._find(number, ways[0])
        if source.attach is not None:
            return found, None
        if found in self._above_root():
            raise MotionGenError(f"{source.label} cannot replace '{found.name}', which carries the creature")
        return found.parent, found

    def _find(self, number: int, name: str) -> _Node:
        """The node called `name`, for the source `number`."""
        for node in self.nodes:
            if node.name == name:
                return node
        label = self.sources[number].label
        if any(name in later.skeleton.names for later in self.sources[number:]):
            raise MotionGenError(
                f"{label}: '{name}' is no joint of the body so far but of this or a later part; put the parts in the "
                "order in which they hang from each other"
            )
        nearest = nearest_of(name, [node.name for node in self.nodes])
        raise MotionGenError(f"{label}: the body so far has no joint '{name}'{nearest}")

    def _above_root(self) -> list[_Node]:
        """The creature's root and the nodes above it."""
        return [self.maps[0][joint] for joint in self.sources[0].above if joint in self.maps[0]]

    def _scale(self, number: int) -> float:
        source, body = self.sources[number], self.sources[0]
        return body.skeleton.height / source.skeleton.height if source.scale is None else source.scale

    def _top_offset(self, number: int, top: int, holder: _Node) -> Array:
        """Where a part's top joint sits in its holder's frame, as in its own character."""
        source = self.sources[number]
        if top == source.root:
            return np.zeros(3)  # its own offset is a place in the world
        above = source.stance[source.skeleton.parents[top]]
        way = rot.rotate(above, source.skeleton.offsets[top])
        return self.scales[number] * rot.rotate(rot.inverse(holder.stance), way)

    def _names(self, number: int, taken: Sequence[int], replaced: _Node | None) -> list[str]:
        source = self.sources[number]
        gone = self._below(replaced)
        used = {node.name for node in self.nodes if node not in gone}
        own = [source.skeleton.names[joint] for joint in taken]
        prefix = source.prefix
        if prefix is None:
            prefix = f"part{number + 1}_" if used & set(own) else ""
        names = [prefix + name for name in own]
        if twice := sorted(used & set(names)):
            raise MotionGenError(f"{source.label}: the body has a joint '{twice[0]}' too; give this part a prefix")
        return names

    def _below(self, top: _Node | None) -> set[_Node]:
        """A node and all below it."""
        inside: set[_Node] = set() if top is None else {top}
        for node in self.nodes:
            if node.parent in inside:
                inside.add(node)
        return inside

    def _insert(self, fresh: dict[int, _Node], holder: _Node | None, replaced: _Node | None) -> None:
        """Put new nodes in the place of a replaced one, or after all that hangs from their holder."""
        if holder is None:
            self.nodes += fresh.values()
            return
        gone = self._below(replaced)
        last = replaced or max(self._below(holder), key=self.nodes.index)
        at = self.nodes.index(last) + 1
        self.nodes = [*self.nodes[:at], *fresh.values(), *self.nodes[at:]]
        self.nodes = [node for node in self.nodes if node not in gone]
        for number, known in enumerate(self.maps):
            had = any(node.number == number for node in known.values())
            self.maps[number] = {joint: node for joint, node in known.items() if node not in gone}
            if had and not any(node.number == number for node in self.maps[number].values()):
                raise MotionGenError(f"nothing is left of {self.sources[number].label}, which a later part replaces")

    # -- what a part knows besides

    def _overlap(
        self, number: int, fresh: dict[int, _Node], holder: _Node | None, replaced: _Node | None
    ) -> dict[int, _Node]:
        """Own joint -> node of the body that it stands for. A part's top joint may stand for the replaced one."""
        source = self.sources[number]
        if holder is None:
            return {}
        if isinstance(source.overlap, Mapping):
            return self._given_overlap(number, source.overlap, fresh, replaced)
        pairs = self._counterparts(number, fresh, replaced)
        if source.overlap is None:
            top = next(iter(fresh))
            above = {holder, *self._above(holder)} - set(self._above_root())
            own = {top, *source.skeleton.ancestors(top)}
            return {j: node for j, node in pairs.items() if j in own and (node in above or node is replaced)}
        chosen: dict[int, _Node] = {}
        for pattern in [source.overlap] if isinstance(source.overlap, str) else source.overlap:
            found = {j: pairs[j] for j in source.index(pattern) if j in pairs}
            if not found:
                raise MotionGenError(
                    f"{source.label}: nothing in the body corresponds to '{pattern}' by name; give pairs, "
                    "own name -> name in the body"
                )
            chosen |= found
        return chosen

    def _counterparts(self, number: int, fresh: dict[int, _Node], replaced: _Node | None) -> dict[int, _Node]:
        """All joints of a source that may stand for a node of the same plain name, a root for the root only."""
        source, gone, roots = self.sources[number], self._below(replaced), self._above_root()
        named: dict[frozenset[str], list[_Node]] = {}
        for node in self.nodes:
            if node not in gone:
                plain = plain_name(self.sources[node.number].skeleton.names[node.joint])
                named.setdefault(plain, []).append(node)
        pairs = {} if replaced is None else {next(iter(fresh)): replaced}
        for joint, name in enumerate(source.skeleton.names):
            found = named.get(plain_name(name), [])
            if len(found) == 1 and joint not in fresh and self._may_stand_for(number, joint, found[0], roots):
                pairs[joint] = found[0]
        twice = [node for node in pairs.values() if list(pairs.values()).count(node) > 1]
        return {joint: node for joint, node in pairs.items() if node not in twice}

    def _may_stand_for(self, number: int, joint: int, node: _Node, roots: list[_Node]) -> bool:
        """Whether a source's joint and a node both are the root, or both are below it."""
        source = self.sources[number]
        if joint == source.root and node is roots[-1]:
            return True
        return joint not in source.above and node not in roots

    def _given_overlap(
        self, number: int, pairs: Mapping[str, str], fresh: dict[int, _Node], replaced: _Node | None
    ) -> dict[int, _Node]:
        """The overlap that is given as pairs of names."""
        source, gone, roots = self.sources[number], self._below(replaced), self._above_root()
        chosen: dict[int, _Node] = {}
        for own, other in pairs.items():
            joint, node = source.index(own)[0], self._find(number, other)
            said = f"{source.label}: '{own}' cannot stand for '{other}'"
            if node is replaced and joint == next(iter(fresh)):
                chosen[joint] = node
                continue
            if joint in fresh:
                raise MotionGenError(f"{said}: it is a joint of the part itself")
            if node in gone:
                raise MotionGenError(f"{said}, which is replaced")
            if node in chosen.values():
                raise MotionGenError(f"{said}, for which another joint stands already")
            if not self._may_stand_for(number, joint, node, roots):
                raise MotionGenError(f"{said}: only a root can stand for the root")
            chosen[joint] = node
        return chosen

    def _above(self, node: _Node) -> list[_Node]:
        above = []
        while node.parent is not None:
            node = node.parent
            above.append(node)
        return above

    # -- the end

    def finish(self) -> Assembly:
        """The assembly of all that was added."""
        place = {node: u for u, node in enumerate(self.nodes)}
        tips = [(u, tip) for u, node in enumerate(self.nodes) for tip in self._tips(node)]
        skeleton = Skeleton(
            tuple(node.name for node in self.nodes),
            tuple(-1 if node.parent is None else place[node.parent] for node in self.nodes),
            np.stack([node.offset for node in self.nodes]),
            tuple(u for u, _ in tips),
            np.array([tip for _, tip in tips]).reshape(-1, 3),
        )
        stance = np.stack([self._local_stance(node) for node in self.nodes])
        parts = tuple(self._part(number, place) for number in range(len(self.sources)))
        root = place[self.maps[0][self.sources[0].root]]
        return Assembly(skeleton, parts, root, stance, self.sources[0].examples[0])

    def _local_stance(self, node: _Node) -> Array:
        """(4,) the mean pose of a node in its parent's frame; what stands above the root stands there as it does."""
        roots = self._above_root()
        if node in roots[:-1]:
            return self.sources[0].examples[0].rotations[0, node.joint]
        above = self._ground(node.parent)[0] if node is roots[-1] else None
        if above is None and node.parent is not None:
            above = rot.inverse(node.parent.stance)
        return node.stance if above is None else rot.multiply(above, node.stance)

    def _tips(self, node: _Node) -> list[Array]:
        """Offsets of a node's end sites; where all its children were left out, the farthest becomes one."""
        skeleton = self.sources[node.number].skeleton
        own = [tip for joint, tip in zip(skeleton.end_sites, skeleton.end_site_offsets) if joint == node.joint]
        if not own and skeleton.children[node.joint] and all(other.parent is not node for other in self.nodes):
            own = [max(skeleton.offsets[list(skeleton.children[node.joint])], key=np.linalg.norm)]
        return [self.scales[node.number] * rot.rotate(self.turns[node.number], tip) for tip in own]

    def _part(self, number: int, place: dict[_Node, int]) -> Part:
        source, known = self.sources[number], self.maps[number]
        return Part(
            source.name or source.examples[0].name,
            source.examples,
            tuple(place[known[joint]] if joint in known else -1 for joint in range(len(source.skeleton))),
            tuple(u for node, u in place.items() if node.number == number),
            tuple(sorted(place[node] for node in known.values() if node.number != number)),
            self.scales[number],
            tuple(self._link(number, joint, place) for joint in sorted(known, key=lambda j: place[known[j]])),
        )

    def _link(self, number: int, joint: int, place: dict[_Node, int]) -> Link:
        """How a source's joint moves the node that it drives or knows: from its mean pose to the node's."""
        source, node, turn = self.sources[number], self.maps[number][joint], self.turns[number]
        skeleton, parent = source.skeleton, node.parent
        is_driven = node.number == number
        if is_driven and (parent is None or parent.number == number):  # inside the part
            shift = node.offset - self.scales[number] * rot.rotate(turn, skeleton.offsets[joint])
            return Link(place[node], (joint,), turn, rot.inverse(turn), shift)
        above = (*skeleton.ancestors(joint), joint)
        if parent is None or (joint == source.root and not is_driven):  # a root for the root
            left, shift = self._ground(parent)
            right = rot.multiply(rot.inverse(source.stance[joint]), node.stance)
            return Link(place[node], above, left, right, shift, carries=True)
        if joint == source.root:
            left = rot.multiply(rot.inverse(parent.stance), self._rotation(number))
            return Link(place[node], above, left, rot.inverse(turn), upright=True)
        anchor = next((own for own, other in self.maps[number].items() if other is parent), -1)
        if anchor not in above:
            anchor = skeleton.parents[joint]
        holding = self.maps[number].get(anchor)
        is_turned = is_driven or (holding is not None and holding.number == number)  # with the part
        rotation = self._rotation(number) if is_turned else rot.IDENTITY
        left = rot.multiply(rot.inverse(parent.stance), rot.multiply(rotation, source.stance[anchor]))
        right = rot.multiply(rot.inverse(rot.multiply(rotation, source.stance[joint])), node.stance)
        # Where a joint sits is for the part to say that drives it.
        own = node.offset - self.scales[number] * rot.rotate(left, skeleton.offsets[joint]) if is_driven else None
        return Link(place[node], above[above.index(anchor) + 1 :], left, right, own)

    def _ground(self, parent: _Node | None) -> tuple[Array, Array]:
        """From the world to the frame of the joint above the creature's root, which stands still: turn and shift."""
        if parent is None:
            return rot.IDENTITY, np.zeros(3)
        clip = self.sources[0].examples[0]
        left = rot.inverse(clip.world_rotations[0, parent.joint])
        return left, -rot.rotate(left, clip.positions[0, parent.joint])

    def _rotation(self, number: int) -> Array:
        """(4,) how a part is turned on top of the orientation that it has in its own character."""
        rotation = self.sources[number].rotation
        return rot.IDENTITY if rotation is None else np.asarray(rotation)
