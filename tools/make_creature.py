"""A creature with as many joints as wanted, from a clip: `python -m tools.make_creature CLIP OUT.bvh --joints 433`.

More joints than the clip has: it grows a tail, wings with feathers, a skirt and hair, which swing behind its motion
(`motiongen.secondary`); its own joints move as before. Fewer: fingers and then the shortest last bones are left out.
The GenMM paper's skeletons (Table 3) have 24, 65 and 433 joints; a clip of 65 gives all three.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import motiongen as mg
from motiongen import rotations as rot
from motiongen.contact import foot_joints
from motiongen.errors import MotionGenError
from motiongen.mirror import counterparts
from motiongen.motion import Motion
from motiongen.reassembly import PartSource, assemble
from motiongen.secondary import Capsule, Chain, swing
from motiongen.skeleton import Skeleton
from motiongen.stance import stance

Array = NDArray[np.float64]

FINGERS = ("thumb", "index", "middle", "ring", "pinky", "finger")

LEFT, UP, AHEAD = np.eye(3)
"""The axes of a body that faces +z."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.make_creature", description=__doc__.splitlines()[0])
    parser.add_argument("clip", help="the clip to start from")
    parser.add_argument("out", help="the file to write")
    parser.add_argument("--joints", type=int, default=433, help="how many joints in all (default: 433)")
    options = parser.parse_args()
    try:
        made = creature(mg.load(options.clip), options.joints)
        made.save(options.out)
    except MotionGenError as error:
        parser.error(str(error))
    print(f"{options.out}: {len(made)} frames at {made.frame_rate:g} Hz, {len(made.skeleton)} joints")


def creature(motion: Motion, joints: int) -> Motion:
    """The clip on a creature with exactly so many joints.

    Raises:
        MotionGenError: if fewer than two joints are asked for.
    """
    if joints < 2:
        raise MotionGenError(f"a creature needs at least 2 joints, not {joints}")
    own = len(motion.skeleton)
    return reduced(motion, joints) if joints <= own else grown(motion, joints - own)


# -- fewer joints


def reduced(motion: Motion, joints: int) -> Motion:
    """The clip without its smallest last bones, until so many joints are left: fingers first, and pairs together."""
    skeleton, left_out = motion.skeleton, set[int]()
    pairs = _pairs(skeleton)
    while (surplus := len(skeleton) - len(left_out) - joints) > 0:
        leaves = [j for j in range(1, len(skeleton)) if set(skeleton.subtree(j)) - {j} <= left_out - {j}]
        leaves = [j for j in leaves if j not in left_out and j != motion.root]
        ranked = sorted(leaves, key=lambda j: (not _is_finger(skeleton.names[j]), _length(skeleton, j), j))
        fitting = [{j, pairs[j]} for j in ranked if len({j, pairs[j]}) <= surplus]
        left_out |= fitting[0] if fitting else {ranked[0]}
    if not left_out:
        return motion
    without = [skeleton.names[j] for j in sorted(left_out)]
    return assemble([PartSource(motion, without=without)]).lift(motion, 0)


def _pairs(skeleton: Skeleton) -> tuple[int, ...]:
    """(J,) the joint on the other side; a joint's own index where it has none."""
    try:
        return counterparts(skeleton)
    except MotionGenError:
        return tuple(range(len(skeleton)))


def _is_finger(name: str) -> bool:
    return any(finger in name.lower() for finger in FINGERS)


def _length(skeleton: Skeleton, joint: int) -> float:
    return float(np.linalg.norm(skeleton.offsets[joint]))


# -- more joints


@dataclass(frozen=True)
class Plan:
    """How many chains of how many joints; a number of chains is per side where there are two."""

    tail: int
    wing: int = 0
    feathers: int = 0
    feather: int = 0
    skirts: int = 0
    skirt: int = 0
    hairs: int = 0
    hair: int = 0

    @property
    def joints(self) -> int:
        """How many joints that makes."""
        sides = 2 * (self.wing + self.feathers * self.feather)
        return self.tail + sides + self.skirts * self.skirt + self.hairs * self.hair


FULL = Plan(tail=16, wing=4, feathers=12, feather=6, skirts=16, skirt=8, hairs=12, hair=6)
"""What 368 joints are spent on, which make 433 of 65."""


def plan(joints: int) -> Plan:
    """The richest plan for so many joints in all, none left over: the tail takes what no other chain can."""
    best, tried, percent = Plan(tail=joints), Plan(0), 5
    while tried.joints <= joints:
        factor = math.sqrt(percent / 100)  # half of the growth goes into more chains, half into longer ones
        scaled = {name: max(1, round(count * factor)) for name, count in vars(FULL).items()}
        best, tried = tried if tried.tail else best, Plan(**scaled | {"wing": max(2, scaled["wing"])})
        percent += 1
    return replace(best, tail=best.tail + joints - best.joints)


def grown(motion: Motion, joints: int) -> Motion:
    """The clip with so many joints more."""
    body = Body(motion)
    wanted = plan(joints)
    chains = [*tail(body, wanted), *wings(body, wanted), *skirt(body, wanted), *hair(body, wanted)]
    return swing(motion, chains, body.capsules)


@dataclass(frozen=True, eq=False)
class Body:
    """What the new parts need to know of a clip's character, whatever its joints are called."""

    motion: Motion

    @cached_property
    def stance(self) -> Array:
        """(J, 4) mean world rotations, facing +z."""
        return stance([self.motion])

    @cached_property
    def standing(self) -> Array:
        """(J, 3) where the joints are in the mean pose, from the root."""
        skeleton = self.motion.skeleton
        at = np.zeros((len(skeleton), 3))
        for joint, parent in enumerate(skeleton.parents[1:], start=1):
            at[joint] = at[parent] + rot.rotate(self.stance[parent], skeleton.offsets[joint])
        return at - at[self.motion.root]

    @property
    def height(self) -> float:
        """In the unit of the clip."""
        return self.motion.skeleton.height

    @cached_property
    def head(self) -> int:
        """The joint called a head that has most below it, or else the highest one in the mean pose."""
        skeleton = self.motion.skeleton
        called = [j for j, name in enumerate(skeleton.names) if "head" in name.lower()]
        if called:
            return max(called, key=lambda j: (len(skeleton.subtree(j)), -j))
        return int(np.argmax(self.standing[:, 1]))

    @cached_property
    def crown(self) -> Array:
        """(3,) from the head's joint to the highest point below it in the tree, in heights."""
        skeleton = self.motion.skeleton
        below = skeleton.subtree(self.head)
        at = [self.standing[joint] for joint in below]
        for joint, tip in zip(skeleton.end_sites, skeleton.end_site_offsets):
            at += [self.standing[joint] + rot.rotate(self.stance[joint], tip)] if joint in below else []
        return (max(at, key=lambda point: point[1]) - self.standing[self.head]) / self.height

    @cached_property
    def chest(self) -> int:
        """The last joint on the way to the head that something else hangs from too; the root if there is none."""
        skeleton, root = self.motion.skeleton, self.motion.root
        way = [j for j in skeleton.ancestors(self.head) if root in skeleton.ancestors(j)]
        return next((j for j in reversed(way) if len(skeleton.children[j]) > 1), root)

    @cached_property
    def capsules(self) -> tuple[Capsule, ...]:
        """The legs and the trunk, which nothing passes through."""
        skeleton, root, h = self.motion.skeleton, self.motion.root, self.height
        trunk = [root, *(j for j in skeleton.ancestors(self.head) if root in skeleton.ancestors(j)), self.head]
        # Radii in heights.
        found = [(a, b, 0.055) for a, b in itertools.pairwise(trunk)]
        for foot in foot_joints(self.motion):
            leg = [j for j in (*skeleton.ancestors(foot), foot) if root in skeleton.ancestors(j)]
            found += [(a, b, 0.04) for a, b in itertools.pairwise(leg) if (a, b, 0.04) not in found]
        return tuple(Capsule(skeleton.names[a], skeleton.names[b], radius * h) for a, b, radius in found)

    @cached_property
    def activity(self) -> Array:
        """(T,) from 0 to 1: how lively the clip is around each frame, from the mean speed of the joints."""
        step = np.diff(self.motion.positions, axis=0, prepend=self.motion.positions[:1])
        speed = np.linalg.norm(step, axis=-1).mean(axis=1) * self.motion.frame_rate / self.height
        width = max(1, round(0.5 * self.motion.frame_rate))
        bell = np.hanning(2 * width + 1)
        smooth = np.convolve(np.pad(speed, width, mode="edge"), bell / bell.sum(), mode="valid")
        return np.clip(smooth / 0.8, 0.0, 1.0)

    def name(self, wanted: str) -> str:
        """A name for a chain whose joints no joint of the clip has."""
        taken = any(name.lower().startswith(wanted.lower()) for name in self.motion.skeleton.names)
        return f"Creature{wanted}" if taken else wanted

    def chain(self, name: str, anchor: str, joint: int, at: Array, ways: Array, **how: Any) -> Chain:
        """A chain given in the axes of the body and in heights.

        Args:
            name: of the chain.
            anchor: the joint that it hangs from.
            joint: the clip's joint in whose frame it is said: the anchor itself, or what the anchor's chain hangs from.
            at: (3,) where it begins, from the anchor.
            ways: (N, 3) its bones.
            how: further attributes of the chain.
        """
        frame = rot.inverse(self.stance[joint])
        return Chain(name, anchor, self.height * rot.rotate(frame, at), self.height * rot.rotate(frame, ways), **how)

    def hung(self, name: str, joint: int, at: Array, ways: Array, **how: Any) -> Chain:
        """A chain that hangs from a joint of the clip."""
        return self.chain(name, self.motion.skeleton.names[joint], joint, at, ways, **how)


def tail(body: Body, wanted: Plan) -> Iterator[Chain]:
    """A tail that leaves the body backwards, hangs down and lifts its tip."""
    droop = np.radians(np.interp(np.linspace(0, 1, wanted.tail), [0, 0.4, 1], [-35, -65, -15]))[:, None]
    ways = _length_of(0.55, np.sin(droop) * UP - np.cos(droop) * AHEAD)
    at = 0.02 * UP - 0.05 * AHEAD
    yield body.hung(body.name("Tail"), body.motion.root, at, ways, hertz=0.55, drag=1.0, collides=True)


def wings(body: Body, wanted: Plan) -> Iterator[Chain]:
    """Two wings that beat, the more and the faster the livelier the clip is, and their feathers."""
    if not wanted.wing:
        return
    phase = 2 * np.pi * np.cumsum(0.7 + 1.1 * body.activity) / body.motion.frame_rate
    beat = np.radians(4 + 26 * body.activity) * np.sin(phase)  # (T,) upwards
    axis = rot.rotate(rot.inverse(body.stance[body.chest]), AHEAD)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        out, name, feather = sign * LEFT, body.name(f"{side}Wing"), body.name(f"{side}Feather")
        bow = np.linspace(0, 1, wanted.wing)[:, None]
        bones = _length_of(0.62, out + (0.75 - 1.05 * bow) * UP - (0.25 + 0.2 * bow) * AHEAD)
        at = 0.03 * out + 0.03 * UP - 0.05 * AHEAD
        drive = rot.from_axis_angle(axis, sign * beat)
        yield body.hung(name, body.chest, at, bones, hertz=2.2, weight=0.2, drag=2.0, drive=drive)
        for n in range(wanted.feathers):
            along = (n + 0.5) / wanted.feathers  # of the wing
            bone, within = divmod(along * wanted.wing, 1)
            anchor, at = f"{name}{int(bone) + 1}", within * bones[int(bone)]
            way = (0.1 + 0.9 * along**2) * out - (1.0 - 0.5 * along) * UP - 0.35 * AHEAD
            ways = _length_of(0.2 + 0.16 * along, np.tile(way, (wanted.feather, 1)))
            how = {"hertz": 1.3, "weight": 0.15, "drag": 2.0}
            yield body.chain(f"{feather}{n + 1}_", anchor, body.chest, at, ways, **how)


def skirt(body: Body, wanted: Plan) -> Iterator[Chain]:
    """A skirt around the hips, which the legs push out."""
    names = [f"{body.name('Skirt')}{n + 1}_" for n in range(wanted.skirts)]
    for n, name in enumerate(names):
        angle = 2 * np.pi * n / wanted.skirts
        out = np.cos(angle) * AHEAD + np.sin(angle) * LEFT
        at = out * np.hypot(0.075 * np.cos(angle), 0.095 * np.sin(angle)) - 0.01 * UP
        ways = _length_of(0.3, np.tile(0.35 * out - UP, (wanted.skirt, 1)))
        cloth = {"beside": (names[n - 1], names[(n + 1) % len(names)]), "cloth": 0.5, "collides": True}
        yield body.hung(name, body.motion.root, at, ways, hertz=0.5, weight=0.6, drag=1.5, **cloth)


def hair(body: Body, wanted: Plan) -> Iterator[Chain]:
    """Hair around the back of the head."""
    for n, angle in enumerate(np.radians(np.linspace(-110, 110, wanted.hairs))):
        out = np.sin(angle) * LEFT - np.cos(angle) * AHEAD
        bow = np.linspace(0, 1, wanted.hair)[:, None]
        ways = _length_of(0.26, (0.7 - 0.6 * bow) * out - (0.4 + 0.6 * bow) * UP)
        name, at = f"{body.name('Hair')}{n + 1}_", 0.6 * body.crown + 0.045 * out
        yield body.hung(name, body.head, at, ways, hertz=0.65, weight=0.5, drag=1.5, collides=True)


def _length_of(length: float, ways: Array) -> Array:
    """(N, 3) bones of one length along the given ways, that make `length` together."""
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True) * (length / len(ways))


if __name__ == "__main__":
    main()
