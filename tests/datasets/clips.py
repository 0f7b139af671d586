"""Clips of one figure for datasets: it strides about, with feet, on bones and at a rate that a test says."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from motiongen.stance import facing
from tests.strategies import random_motion

Array = NDArray[np.float64]

NAMES = ("Hips", "Spine", "Head", "LeftLeg", "LeftFoot", "RightLeg", "RightFoot")
OFFSETS = np.array(
    [[0, 0.5, 0], [0, 0.2, 0], [0, 0.3, 0.02], [0.1, 0, 0], [0, -0.5, 0.05], [-0.1, 0, 0], [0, -0.5, 0.05]], dtype=float
)
FIGURE = Skeleton(NAMES, (-1, 0, 1, 0, 3, 0, 5), OFFSETS, (2, 4, 6), np.array([[0, 0.1, 0], [0, 0, 0.1], [0, 0, 0.1]]))


def stride(seed: int, frames: int = 24, frame_rate: float = 30.0, skeleton: Skeleton = FIGURE) -> Motion:
    """A clip of the figure that swings its limbs, turns about up and goes somewhere."""
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, skeleton, frames=frames, translating=(0,), smooth=True, frame_rate=frame_rate)
    turn = rot.from_axis_angle(
        np.array([0.0, 1.0, 0.0]), rng.uniform(-3, 3) + np.linspace(0, rng.uniform(-4, 4), frames)
    )
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    return motion.replace(rotations=rotations, name=f"clip{seed}")


def under_still_root(motion: Motion, rng: np.random.Generator) -> Motion:
    """The same movement below another root that stands still, somewhere, turned."""
    above = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), rng.uniform(-3, 3))
    place = rng.normal(size=3)
    skeleton = motion.skeleton
    deeper = dataclasses.replace(
        skeleton,
        names=("Base", *skeleton.names),
        parents=(-1, *(parent + 1 for parent in skeleton.parents)),
        offsets=np.concatenate([[place], skeleton.offsets]),
        end_sites=tuple(joint + 1 for joint in skeleton.end_sites),
    )
    rotations = np.concatenate([np.tile(above, (len(motion), 1, 1)), motion.rotations], axis=1)
    back = rot.inverse(above)
    rotations[:, 1] = rot.multiply(back, motion.rotations[:, 0])
    translations = rot.rotate(back, motion.translations - place)
    return motion.replace(skeleton=deeper, rotations=rotations, translations=translations, translating=(1,))


def in_other_order(motion: Motion, order: list[int]) -> Motion:
    """The same movement with its joints listed in another order, parents still before children."""
    skeleton = motion.skeleton
    place = {joint: at for at, joint in enumerate(order)}
    listed = Skeleton(
        tuple(skeleton.names[joint] for joint in order),
        tuple(place.get(skeleton.parents[joint], -1) for joint in order),
        skeleton.offsets[order],
        tuple(place[joint] for joint in skeleton.end_sites),
        skeleton.end_site_offsets,
    )
    return motion.replace(skeleton=listed, rotations=motion.rotations[:, order])


def save_clips(folder: Path, motions: dict[str, Motion]) -> Path:
    """Write clips into a folder, made if need be, under names with suffixes."""
    for name, motion in motions.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        motion.save(path)
    return folder


def seen_ahead(motion: Motion, start: int, frames: int) -> Array:
    """(frames, J, 3) joint positions from `start` on, in heights, turned to face +z and from where the root is then."""
    turned = rot.rotate(rot.inverse(facing(motion)[start]), motion.positions[start : start + frames])
    return (turned - turned[0, 0]) / motion.skeleton.height
