"""Figures and small helpers for the tests of pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]


def biped(way: Array, frame_rate: float = 30.0, scale: float = 1.0, **settings: Any) -> Motion:
    """A stiff figure, facing +z, 1.8 units tall times `scale`, whose hips go along `way` (T, 3) above the ground."""
    names = ["Hips", "Spine", "Head", "LeftLeg", "LeftFoot", "RightLeg", "RightFoot", "LeftArm", "RightArm"]
    parents = [-1, 0, 1, 0, 3, 0, 5, 1, 1]
    offsets = [[0, 0.9, 0], [0, 0.5, 0], [0, 0.2, 0], [0.1, 0, 0], [0, -0.9, 0], [-0.1, 0, 0], [0, -0.9, 0]]
    offsets += [[0.2, 0, 0], [-0.2, 0, 0]]
    tips = [[0, 0.2, 0], [0, 0, 0.2], [0, 0, 0.2], [0.4, 0, 0], [-0.4, 0, 0]]
    skeleton = Skeleton(
        tuple(names), tuple(parents), scale * np.array(offsets), (2, 4, 6, 7, 8), scale * np.array(tips)
    )
    frames = len(way)
    rotations = np.tile(rot.IDENTITY, (frames, len(names), 1))
    translations = scale * (way + np.array([0.0, 0.9, 0.0]))[:, None]
    return Motion(skeleton, rotations, translations, (0,), frame_rate, **settings)


def standing(frames: int = 10, **settings: Any) -> Motion:
    """The stiff figure standing still."""
    return biped(np.zeros((frames, 3)), **settings)


def walking(frames: int = 30, speed: float = 1.2, frame_rate: float = 30.0, **settings: Any) -> Motion:
    """The stiff figure gliding ahead along +z."""
    way = np.zeros((frames, 3))
    way[:, 2] = speed * np.arange(frames) / frame_rate
    return biped(way, frame_rate, **settings)


def one_joint(way: Array, frame_rate: float = 30.0) -> Motion:
    """A skeleton of one joint, going along `way` (T, 3)."""
    skeleton = Skeleton(("point",), (-1,), np.zeros((1, 3)))
    return Motion(skeleton, np.tile(rot.IDENTITY, (len(way), 1, 1)), way[:, None], (0,), frame_rate)


def spider(frames: int = 4) -> Motion:
    """Eight legs of three bones each, by no name left or right, symmetric about x = 0."""
    names, parents, offsets = ["body"], [-1], [np.array([0.0, 0.4, 0.0])]
    for side in (-1.0, 1.0):
        for leg in range(4):
            ahead = (leg - 1.5) * 0.3
            steps = [[0.1 * side, 0, ahead / 3], [0.4 * side, 0.3, ahead], [0.4 * side, -0.7, ahead]]
            for number, step in enumerate(steps):
                parents.append(0 if number == 0 else len(parents) - 1)
                names.append(f"leg{len(names)}")
                offsets.append(np.array(step))
    rotations = np.tile(rot.IDENTITY, (frames, len(names), 1))
    return Motion(
        Skeleton(tuple(names), tuple(parents), np.array(offsets)), rotations, np.zeros((frames, 0, 3)), (), 30.0
    )


def pixels(picture: Image.Image) -> NDArray[np.int64]:
    """(H, W, 3) the colours of a picture."""
    return np.asarray(picture.convert("RGB")).astype(np.int64)


def changed(first: Image.Image, second: Image.Image) -> NDArray[np.bool_]:
    """(H, W) where two pictures of one size differ."""
    return (pixels(first) != pixels(second)).any(axis=-1)
