"""A motion as an array of entities, (frames, entities, 4), and back (MoDi, section 3.1).

The entities are the joints, each with its rotation as a unit quaternion xyzw; the root's step since the frame before,
in skeleton heights along world x, y and z, its fourth channel zero; and a contact label for each foot joint in the
first channel, the others zero. Left out is where the root stands: `from_entities` puts it over the ground's origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.contact import contact_labels
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

CHANNELS = 4
"""Features of an entity: a quaternion's four numbers, and zeros behind what has fewer (K in the paper)."""

_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class EntityLayout:
    """Which entity is what. The only place that knows.

    Attributes:
        skeleton: the joints; joint 0 is the one that moves through the world, no other one's translation is animated.
        feet: (C,) the foot joints that have contact labels.
    """

    skeleton: Skeleton
    feet: tuple[int, ...] = ()

    @property
    def joints(self) -> slice:
        """The joints' rotations, in joint order."""
        return slice(0, len(self.skeleton))

    @property
    def root(self) -> int:
        """The root's step."""
        return len(self.skeleton)

    @property
    def contacts(self) -> slice:
        """The contact labels, in the order of `feet`."""
        return slice(self.root + 1, self.count)

    @property
    def count(self) -> int:
        """The number of entities E."""
        return len(self.skeleton) + 1 + len(self.feet)

    def to_dict(self) -> dict[str, Any]:
        """The layout as plain data that JSON can hold."""
        skeleton = self.skeleton
        return {
            "names": list(skeleton.names),
            "parents": list(skeleton.parents),
            "offsets": skeleton.offsets.tolist(),
            "end_sites": list(skeleton.end_sites),
            "end_site_offsets": skeleton.end_site_offsets.tolist(),
            "feet": list(self.feet),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> EntityLayout:
        """The layout of plain data as `to_dict` gives it.

        Raises:
            KeyError, TypeError, ValueError: if the data is not like that.
        """
        skeleton = Skeleton(
            tuple(data["names"]),
            tuple(data["parents"]),
            data["offsets"],
            tuple(data["end_sites"]),
            data["end_site_offsets"],
        )
        feet = tuple(int(joint) for joint in data["feet"])
        if not all(0 <= joint < len(skeleton) for joint in feet):
            raise ValueError(f"the feet {feet} are no joints of {len(skeleton)}")
        return cls(skeleton, feet)


def to_entities(motion: Motion, layout: EntityLayout) -> Array:
    """(T, E, 4) entities of a motion in the world it is in.

    The first frame has no frame before it and takes the second frame's step. Lengths are measured in the motion's own
    skeleton heights, so one on a larger rig of the same tree goes as far, in heights, on that of `layout`.

    Args:
        motion: on a skeleton of the layout's tree, with no joint but joint 0 translating.
        layout: what goes where.
    """
    entities = np.zeros((len(motion), layout.count, CHANNELS))
    entities[:, layout.joints] = rot.continuous(motion.rotations)
    steps = np.diff(motion.positions[:, 0], axis=0) / motion.skeleton.height
    entities[1:, layout.root, :3] = steps
    entities[0, layout.root, :3] = steps[0] if len(steps) else 0.0
    entities[:, layout.contacts, 0] = contact_labels(motion, layout.feet)
    return entities


def from_entities(
    entities: NDArray[Any], layout: EntityLayout, frame_rate: float, unit: str | None = None, name: str = "motion"
) -> Motion:
    """The motion that (T, E, 4) entities describe: the inverse of `to_entities` but for where the motion is.

    Its root starts over the world's origin, at the height that puts the ground (`kinematics.ground_height`) at zero.
    Rotations are normalised; the first frame's step and the contact labels are not used.

    Raises:
        MotionGenError: if a number is not finite or a quaternion is zero.
    """
    entities = np.asarray(entities, dtype=np.float64)
    steps = entities[:, layout.root, :3].copy()
    steps[:1] = 0.0
    motion = Motion(
        layout.skeleton,
        entities[:, layout.joints],
        (np.cumsum(steps, axis=0) * layout.skeleton.height)[:, None],
        (0,),
        frame_rate,
        unit,
        name=name,
    )
    down = np.array([0.0, kinematics.ground_height(motion), 0.0])
    return motion.replace(translations=motion.translations - down)


def heading_radians(facing: Array) -> Array:
    """The angle about the up axis of turns (..., 4) about it, -pi to pi: (...)."""
    angle = 2 * np.arctan2(facing[..., 1], facing[..., 3])
    return (angle + np.pi) % (2 * np.pi) - np.pi


def turn_about_up(windows: NDArray[Any], layout: EntityLayout, angles_radians: NDArray[Any]) -> None:
    """Turn windows (B, T, E, 4) about the up axis by angles (B,), in place: the root's rotation and its steps."""
    turn = rot.from_axis_angle(_UP, np.asarray(angles_radians, dtype=np.float64))[:, None]  # (B, 1, 4)
    windows[:, :, 0] = rot.multiply(turn, windows[:, :, 0])
    windows[:, :, layout.root, :3] = rot.rotate(turn, windows[:, :, layout.root, :3])


def choose_signs(windows: NDArray[Any], layout: EntityLayout, reference: NDArray[Any]) -> None:
    """Give each joint of windows (B, T, E, 4) the sign, for the whole window, that is near `reference` (J, 4) at first.

    A quaternion and its negative are the same rotation; a network should not have to learn that. In place.
    """
    first = windows[:, 0, layout.joints]  # (B, J, 4)
    signs = np.where(np.einsum("bjc,jc->bj", first, reference) < 0, -1, 1).astype(windows.dtype)
    windows[:, :, layout.joints] *= signs[:, None, :, None]
