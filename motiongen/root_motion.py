"""Where a character goes, apart from how it moves: for game engines, which move it over the ground themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from motiongen.stance import facing

Array = NDArray[np.float64]

GROUND = np.array([1.0, 0.0, 1.0])
"""What of a place lies in the ground."""


def in_place(motion: Motion) -> Motion:
    """The motion on the spot: the character stays over the ground point where it begins. It still turns and jumps.

    Only the translation of the joint that carries it (`Motion.root`) changes.
    """
    ways = (motion.root_positions - motion.root_positions[0]) * GROUND  # (T, 3)
    moved = motion.with_translating([motion.root])
    parent = motion.skeleton.parents[motion.root]
    if parent >= 0:
        ways = rot.rotate(rot.inverse(motion.world_rotations[:, parent]), ways)
    translations = moved.translations.copy()
    translations[:, moved.translating.index(motion.root)] -= ways
    return moved.replace(translations=translations)


def split_root(motion: Motion, name: str = "root") -> Motion:
    """The same motion with a new joint 0 that holds where the character is on the ground and which way it faces.

    This is what engines call root motion: the new joint turns about the up axis and moves over the ground under the
    joint that carries the character (`Motion.root`); everything else hangs from it and stays where it was in the world.

    Args:
        motion: any motion.
        name: what to call the new joint.

    Raises:
        MotionGenError: if the skeleton has such a joint already.
    """
    old = motion.skeleton
    if name in old.names:
        raise MotionGenError(f"the skeleton has a joint '{name}' already; give the new one another name")
    turns, places = facing(motion), motion.root_positions * GROUND  # (T, 4), (T, 3)
    back = rot.inverse(turns)
    free = motion.with_translating([0])
    rotations = np.concatenate([turns[:, None], free.rotations], axis=1)
    rotations[:, 1] = rot.multiply(back, free.rotations[:, 0])
    translations = np.concatenate([places[:, None], free.translations], axis=1)
    translations[:, 1] = rot.rotate(back, free.translations[:, 0] - places)
    skeleton = Skeleton(
        (name, *old.names),
        (-1, *(parent + 1 for parent in old.parents)),
        np.concatenate([np.zeros((1, 3)), old.offsets]),
        tuple(joint + 1 for joint in old.end_sites),
        old.end_site_offsets,
    )
    return free.replace(
        skeleton=skeleton,
        rotations=rotations,
        translations=translations,
        translating=(0, *(joint + 1 for joint in free.translating)),
        file_layout=None,
    )
