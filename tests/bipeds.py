"""A biped in a T-pose that faces +z, and what it does where a test says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

X, Y, Z = np.eye(3)

_TRUNK = {"Hips": (None, (0, 0.9, 0)), "Spine": ("Hips", (0, 0.2, 0)), "Chest": ("Spine", (0, 0.2, 0)),
          "Head": ("Chest", (0, 0.3, 0))}  # fmt: skip
_ARM = {"Shoulder": ("Chest", (0.05, 0.1, 0)), "Arm": ("Shoulder", (0.1, 0, 0)), "ForeArm": ("Arm", (0.3, 0, 0)),
        "Hand": ("ForeArm", (0.25, 0, 0))}  # fmt: skip
_LEG = {"UpLeg": ("Hips", (0.1, 0, 0)), "Leg": ("UpLeg", (0, -0.45, 0)), "Foot": ("Leg", (0, -0.45, 0))}


def biped(names: str = "{side}{part}") -> Skeleton:
    """The skeleton, its limbs' joints named from `side` (Left, Right) and `part`; depth first, as BVH files have it."""
    rows: list[tuple[str, str | None, tuple[float, float, float]]] = [
        (name, parent, offset) for name, (parent, offset) in _TRUNK.items()
    ]
    for limb in (_ARM, _LEG):
        for side, sign in (("Left", 1), ("Right", -1)):
            for part, (parent, (x, y, z)) in limb.items():
                above = parent if parent in _TRUNK else names.format(side=side, part=parent)
                rows.append((names.format(side=side, part=part), above, (sign * x, y, z)))
    index = {name: joint for joint, (name, _, _) in enumerate(rows)}
    parents = tuple(-1 if parent is None else index[parent] for _, parent, _ in rows)
    return Skeleton(tuple(index), parents, np.array([offset for _, _, offset in rows]))


def posed(turns: Mapping[str, Array], frames: int = 64, way: Array | None = None, **settings: Any) -> Motion:
    """A motion whose joints turn by given local rotations (T, 4) or (4,), and whose hips go a given way (T, 3)."""
    skeleton = biped()
    rotations = np.tile(rot.IDENTITY, (frames, len(skeleton), 1))
    for name, turn in turns.items():
        rotations[:, skeleton.index(name)] = turn
    hips = skeleton.offsets[0] + (np.zeros((frames, 3)) if way is None else way)
    return Motion(skeleton, rotations, hips[:, None], (0,), **{"frame_rate": 30.0} | settings)
