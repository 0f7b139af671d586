"""One movement on many rigs: a figure with sides that strides about, and the same on joints with other axes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from tests.strategies import symmetric_motion

Array = NDArray[np.float64]


def on_other_axes(motion: Motion, frames: Array) -> Motion:
    """The same movement on a rig whose joints have other axes: joint j's are turned by frames (J, 4)."""
    skeleton = motion.skeleton
    above = np.stack([rot.IDENTITY if p == -1 else frames[p] for p in skeleton.parents])
    sites = list(skeleton.end_sites)
    moved = dataclasses.replace(
        skeleton,
        offsets=rot.rotate(rot.inverse(above), skeleton.offsets),
        end_site_offsets=rot.rotate(rot.inverse(frames[sites]), skeleton.end_site_offsets),
    )
    return motion.replace(
        skeleton=moved,
        rotations=rot.multiply(rot.inverse(above), rot.multiply(motion.rotations, frames)),
        translations=rot.rotate(rot.inverse(above[list(motion.translating)]), motion.translations),
    )


def strider(rng: np.random.Generator, **settings: Any) -> Motion:
    """A symmetric rig with its left on +x, its limbs swinging, its root leaning a little and turning about up."""
    motion = symmetric_motion(rng, frames=40, smooth=True, **settings)
    offsets = motion.skeleton.offsets.copy()
    for joint, name in enumerate(motion.skeleton.names):
        side = 1.0 if name.startswith("Left") else -1.0 if name.startswith("Right") else 0.0
        offsets[joint, 0] = side * (0.3 + abs(offsets[joint, 0])) if side else 0.0
    motion = motion.replace(skeleton=dataclasses.replace(motion.skeleton, offsets=offsets))
    lean = rot.from_rotation_vector(0.1 * rng.normal(size=(40, 3)) * [1.0, 0.0, 1.0])
    turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.linspace(0, rng.uniform(-6, 6), 40))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, lean)
    return motion.replace(rotations=rotations)
