"""Secondary motion: chains of new joints that hang from a clip's joints and swing behind them: a tail, hair, cloth.

What comes out is an ordinary `Motion`: bones keep their lengths, the chains' joints only turn, and the clip's own
joints move as before.

    tail = Chain("Tail", "Hips", offset, bones)
    swing(walk, [tail]).save("tailed.bvh")
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.errors import MotionGenError, nearest_of
from motiongen.motion import Motion
from motiongen.secondary.chains import Capsule, Chain
from motiongen.secondary.solver import STEPS_PER_SECOND, WARM_UP_SECONDS, World, unit
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

__all__ = ["Capsule", "Chain", "swing"]


def swing(
    motion: Motion,
    chains: Sequence[Chain],
    capsules: Iterable[Capsule] = (),
    warm_up_seconds: float = WARM_UP_SECONDS,
    steps_per_second: float = STEPS_PER_SECOND,
) -> Motion:
    """The clip with chains added that swing behind it; the motion of its own joints stays as it is, bit for bit.

    Before the first frame the clip is led on backwards, turned about its first pose so that it runs into it at the
    speed that it has there; whatever the chains began with is forgotten by then. The ground (`kinematics.ground_height`
    of the clip) and the capsules push softly: what is pressed on them sinks in a little.

    Args:
        motion: the clip.
        chains: what to add; a chain that hangs from another one's joint is driven by that one. They do not act back.
        capsules: what pushes those chains away that collide.
        warm_up_seconds: how long before the first frame to begin.
        steps_per_second: the least number of steps.

    Returns:
        The clip with the new joints behind those of the subtree that they hang from.

    Raises:
        MotionGenError: if an anchor is not there, chains hang from each other in a circle, or names come twice.
    """
    if not (math.isfinite(warm_up_seconds) and warm_up_seconds >= 0):
        raise MotionGenError(f"warm_up_seconds must be a number not below 0, not {warm_up_seconds}")
    if not (math.isfinite(steps_per_second) and steps_per_second > 0):
        raise MotionGenError(f"steps_per_second must be a positive number, not {steps_per_second}")
    for chain in chains:
        if chain.drive is not None and np.shape(chain.drive) != (len(motion), 4):
            raise MotionGenError(
                f"the drive of chain '{chain.name}' must have shape ({len(motion)}, 4), not {np.shape(chain.drive)}"
            )
    result, capsules, waiting = motion, tuple(capsules), list(chains)
    ground = kinematics.ground_height(motion)
    while waiting:
        ready = [chain for chain in waiting if chain.anchor in result.skeleton.names]
        if not ready:
            raise MotionGenError(_no_anchor(result.skeleton, waiting))
        world = World(result, ready, capsules, ground, warm_up_seconds, steps_per_second)
        along = world.directions()
        result = _added(result, ready, along[:, :, [world.chains.index(chain) for chain in ready]])
        waiting = [chain for chain in waiting if chain not in ready]
    return result


def _no_anchor(skeleton: Skeleton, waiting: Sequence[Chain]) -> str:
    """Why none of the waiting chains can be hung up."""
    coming = {joint for chain in waiting for joint in chain.joints}
    for chain in waiting:
        if chain.anchor not in coming:
            nearest = nearest_of(chain.anchor, [*skeleton.names, *coming])
            return f"chain '{chain.name}': there is no joint '{chain.anchor}'{nearest}"
    return f"the chains hang from each other in a circle, '{waiting[0].name}' among them; hang one from the clip"


def _shortest_turn(a: Array, b: Array) -> Array:
    """(..., 4) the shortest rotation that takes unit vectors a to b, (..., 3) each."""
    halfway = np.concatenate([np.cross(a, b), 1 + np.sum(a * b, axis=-1, keepdims=True)], axis=-1)
    opposite = halfway[..., 3] < 1e-9
    if opposite.any():  # any axis across will do
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=-1)])
        halfway = np.where(opposite[..., None], np.concatenate([across, np.zeros_like(across[..., :1])], -1), halfway)
    return halfway / np.linalg.norm(halfway, axis=-1, keepdims=True)


def _added(motion: Motion, chains: Sequence[Chain], along: Array) -> Motion:
    """The motion with the joints of chains whose bones point along (T, N, C, 3) unit vectors in the world."""
    old = motion.skeleton
    names, parents, offsets = list(old.names), list(old.parents), list(old.offsets)
    sites, tips, turns = list(old.end_sites), list(old.end_site_offsets), [motion.rotations]
    for c, chain in enumerate(chains):
        parent = old.index(chain.anchor)
        world = motion.world_rotations[:, parent]
        offset = chain.offset
        for n, (name, bone) in enumerate(zip(chain.joints, chain.bones)):
            local = _shortest_turn(unit(bone), rot.rotate(rot.inverse(world), along[:, n, c]))
            world = rot.multiply(world, local)
            turns.append(local[:, None])
            names.append(name)
            parents.append(parent)
            offsets.append(offset)
            parent, offset = len(names) - 1, bone
        sites.append(parent)
        tips.append(offset)
    order = _inserted(len(old), parents)
    place = {joint: at for at, joint in enumerate(order)}
    skeleton = Skeleton(
        tuple(names[joint] for joint in order),
        tuple(-1 if parents[joint] == -1 else place[parents[joint]] for joint in order),
        np.array(offsets)[order],
        tuple(place[joint] for joint in sites),
        np.array(tips),
    )
    moving = sorted(motion.translating, key=place.__getitem__)
    return motion.replace(
        skeleton=skeleton,
        rotations=np.concatenate(turns, axis=1)[:, order],
        translations=motion.translations[:, [motion.translating.index(joint) for joint in moving]],
        translating=tuple(place[joint] for joint in moving),
        notes=(),
    )


def _inserted(old: int, parents: Sequence[int]) -> list[int]:
    """An order of joints with the first `old` as they are and the others behind all that hangs from their parents."""
    order = list(range(old))
    for joint in range(old, len(parents)):
        family, last = {parents[joint]}, order.index(parents[joint])
        for at in range(last + 1, len(order)):
            if parents[order[at]] in family:
                family.add(order[at])
                last = at
        order.insert(last + 1, joint)
    return order
