"""Poses of a like rig on another skeleton: fewer or more joints, other name prefixes, another unit."""

from __future__ import annotations

import numpy as np

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

LARGEST_REST_TURN = np.radians(25.0)
"""How far the rest direction of a bone may differ for its rotations to mean the same on both rigs."""


def adapt(motion: Motion, skeleton: Skeleton) -> tuple[Motion, tuple[int, ...]]:
    """A motion on another skeleton, and which joints it knows.

    Joints are paired by name, regardless of case and of a prefix before a colon (`mixamorig7:Hips` is `Hips`). Local
    rotations are taken over as they are; that is right where both rigs rest alike, which is checked. Moving
    translations are scaled by the length of the bones that both rigs have. Joints without a partner rest.

    Args:
        motion: poses of the other rig.
        skeleton: the rig to have them on.

    Returns:
        The motion on `skeleton`, and the (C,) joints of `skeleton` that have a partner.

    Raises:
        MotionGenError: if the root has no partner, or bones that both have rest in different directions.
    """
    there = {plain_name(name): joint for joint, name in enumerate(motion.skeleton.names)}
    pairs = {j: there[plain_name(n)] for j, n in enumerate(skeleton.names) if plain_name(n) in there}
    if 0 not in pairs:
        raise MotionGenError(
            f"'{motion.name}' has no joint '{plain_name(skeleton.names[0])}' to stand for the root; rename its joints"
        )
    bones = _common_bones(motion.skeleton, skeleton, pairs)
    _check_rest(motion, skeleton, bones)
    ours, theirs = (
        sum(float(np.linalg.norm(rig.offsets[bone[side]])) for bone in bones)
        for side, rig in ((0, skeleton), (1, motion.skeleton))
    )
    factor = ours / theirs if ours > 0 and theirs > 0 else skeleton.height / motion.skeleton.height
    frames = len(motion)
    rotations = np.tile(rot.IDENTITY, (frames, len(skeleton), 1))
    rotations[:, list(pairs)] = motion.rotations[:, list(pairs.values())]
    places = {joint: column for column, joint in enumerate(motion.translating)}
    moving = tuple(j for j, other in sorted(pairs.items()) if other in places)
    columns = [motion.translations[:, places[pairs[j]]] * factor for j in moving]
    translations = np.stack(columns, axis=1) if columns else np.zeros((frames, 0, 3))
    adapted = motion.replace(
        skeleton=skeleton, rotations=rotations, translations=translations, translating=moving, file_layout=None
    )
    return adapted, tuple(sorted(pairs))


def plain_name(name: str) -> str:
    """A joint's name without a prefix and without case."""
    return name.rpartition(":")[2].strip().lower()


def _common_bones(theirs: Skeleton, ours: Skeleton, pairs: dict[int, int]) -> list[tuple[int, int]]:
    """(joint here, joint there) of each bone that both rigs have."""
    return [
        (joint, other)
        for joint, other in pairs.items()
        if ours.parents[joint] != -1 and pairs.get(ours.parents[joint]) == theirs.parents[other]
    ]


def _check_rest(motion: Motion, skeleton: Skeleton, bones: list[tuple[int, int]]) -> None:
    for joint, other in bones:
        ours, theirs = skeleton.offsets[joint], motion.skeleton.offsets[other]
        size = np.linalg.norm(ours) * np.linalg.norm(theirs)
        if size > 1e-12 and np.arccos(np.clip(ours @ theirs / size, -1, 1)) > LARGEST_REST_TURN:
            raise MotionGenError(
                f"'{skeleton.names[joint]}' of '{motion.name}' rests in another direction than on the examples' rig; "
                "its rotations mean something else there"
            )
