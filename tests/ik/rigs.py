"""Made-up characters with legs, and how far their feet go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

SIDE = np.array([1.0, 0.0, 0.0])


def character(
    limbs: dict[str, tuple[Array, Sequence[Array], Sequence[float]]],
    frames: int = 60,
    frame_rate: float = 30.0,
    root: Array | None = None,
    extra: int = 0,
) -> Motion:
    """A trunk with limbs of any number of joints, each bent about its own x axis by given angles, on a moving root.

    Args:
        limbs: name -> offsets of its first joint from the root, of all joints below it, and their bends in radians.
        frames: how many.
        frame_rate: in Hz.
        root: (T, 3) where the root is; by default where the rest pose's feet are on the ground.
        extra: joints of a tail, which turns.
    """
    names, parents, offsets = ["Hips", "Head"], [-1, 0], [np.zeros(3), np.array([0.0, 0.5, 0.0])]
    bends: list[float] = [0.0, 0.0]
    for name, (first, rest, angles) in limbs.items():
        for index, (offset, angle) in enumerate(zip([first, *rest], angles)):
            parents.append(len(names) - 1 if index else 0)
            names.append(f"{name}{index}" if index < len(rest) else f"{name}Foot")
            offsets.append(np.asarray(offset, dtype=float))
            bends.append(angle)
    for index in range(extra):
        parents.append(len(names) - 1 if index else 0)
        names.append(f"Tail{index}")
        offsets.append(np.array([0.0, 0.0, -0.1]))
        bends.append(0.3)
    skeleton = Skeleton(tuple(names), tuple(parents), np.array(offsets))
    rotations = np.tile(rot.from_axis_angle(SIDE, np.array(bends)), (frames, 1, 1))
    placed = Motion(skeleton, rotations, np.zeros((frames, 1, 3)), (0,), frame_rate)
    if root is None:
        root = np.array([0.0, -placed.positions[0, :, 1].min(), 0.0])
    return placed.replace(translations=np.broadcast_to(root, (frames, 3))[:, None].copy())


def biped(bend: float = 0.5, toes: bool = True, **settings: Any) -> Motion:
    """Two legs of thigh, shin, foot and toe; height about 1."""
    limbs = {}
    for name, x in (("Left", 0.1), ("Right", -0.1)):
        chain = [np.array([0.0, -0.25, 0.0]), np.array([0.0, -0.25, 0.0])]
        limbs[name] = (np.array([x, -0.02, 0.0]), chain, [-bend / 2, bend, -bend / 2])
    motion = character(limbs, **settings)
    return with_toes(motion) if toes else motion


def with_toes(motion: Motion) -> Motion:
    """The same with a toe below each foot."""
    skeleton = motion.skeleton
    feet = [j for j, name in enumerate(skeleton.names) if name.endswith("Foot")]
    names = [*skeleton.names, *(skeleton.names[j].replace("Foot", "Toe") for j in feet)]
    offsets = [*skeleton.offsets, *([[0.0, -0.02, 0.1]] * len(feet))]
    rotations = np.concatenate([motion.rotations, np.tile(rot.IDENTITY, (len(motion), len(feet), 1))], axis=1)
    longer = Skeleton(tuple(names), (*skeleton.parents, *feet), np.array(offsets))
    return motion.replace(skeleton=longer, rotations=rotations)


def spider(**settings: Any) -> Motion:
    """Eight legs of five joints."""
    limbs = {}
    for index, angle in enumerate(np.linspace(0.3, 2 * np.pi + 0.3, 8, endpoint=False)):
        out = np.array([np.cos(angle), 0.0, np.sin(angle)])
        up = np.array([0.0, 1.0, 0.0])
        chain = [0.05 * out, 0.2 * out + 0.2 * up, 0.1 * out, 0.15 * out - 0.3 * up]
        limbs[f"Leg{'ABCDEFGH'[index]}"] = (0.1 * out, chain, [0.0] * 5)
    return character(limbs, extra=3, **settings)


def drifting(motion: Motion, shift: Array) -> Motion:
    """The motion with its root moved by `shift` (T, 3)."""
    return motion.replace(translations=motion.translations + shift[:, None])


def sway(frames: int, size: float = 0.02, frame_rate: float = 30.0) -> Array:
    """(T, 3) a slow wander over the ground."""
    seconds = np.arange(frames) / frame_rate
    return size * np.stack([np.sin(2.1 * seconds), np.zeros(frames), np.cos(1.3 * seconds) - 1], axis=-1)


def ground_steps(motion: Motion, joints: Sequence[int]) -> Array:
    """(T - 1, C) how far joints move over the ground from frame to frame, in heights."""
    places = motion.positions[:, list(joints)][..., [0, 2]]
    return np.linalg.norm(np.diff(places, axis=0), axis=-1) / motion.skeleton.height
