"""A motion: how the joints of one skeleton turn and move over time. Immutable; every change gives a new one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.skeleton import Skeleton, frozen_array

Array = NDArray[np.float64]

MOST_FRAMES = 10_000_000
"""Of what is made by calculation alone: a mistyped number must not ask for all of the memory."""

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""The length units that a motion can be in, and how long each is."""

UP_AXES = ("y", "z")
"""The up axes that a file can have; inside, y is always up."""

# Turns a z-up world into a y-up one: (x, y, z) -> (x, z, -y).
Z_TO_Y_UP = rot.from_axis_angle(np.array([1.0, 0.0, 0.0]), -math.pi / 2)


@dataclass(frozen=True, eq=False)
class Motion:
    """Frames of local rotations, and local translations of the few joints whose translation is animated.

    A joint that is not in `translating` sits at its offset in the skeleton. World space is y-up.

    Attributes:
        skeleton: the tree with its offsets, in `unit`.
        rotations: (T, J, 4) unit quaternions, xyzw, each joint in its parent's frame.
        translations: (T, M, 3) position of each translating joint in its parent's frame, in `unit`.
        translating: (M,) the joints whose translation is animated, ascending.
        frame_rate: in Hz.
        unit: the length unit, one of `METRES_PER_UNIT`, or None where it is not known.
        up: the up axis of the file it came from and will be written to; inside, y is up whatever this says.
        name: what to call it, usually the file's stem.
        notes: what the reader found odd about the file, in words.
        file_layout: how the file was laid out; opaque here, only `motiongen.io` reads it.

    Raises:
        MotionGenError: if shapes disagree, a number is not finite, a quaternion has no direction, or a setting is
            out of range.
    """

    skeleton: Skeleton
    rotations: Array
    translations: Array
    translating: tuple[int, ...]
    frame_rate: float
    unit: str | None = None
    up: str = "y"
    name: str = "motion"
    notes: tuple[str, ...] = ()
    file_layout: Any = None

    def __post_init__(self) -> None:
        """Check everything and freeze the arrays."""
        joints = len(self.skeleton)
        rotations = frozen_array(self.rotations, (-1, joints, 4), "rotations")
        if len(rotations) == 0:
            raise MotionGenError("a motion needs at least one frame; none came")
        norms = np.sqrt(np.einsum("tjc,tjc->tj", rotations, rotations))
        if (norms < 1e-6).any():
            frame, joint = (int(i) for i in np.argwhere(norms < 1e-6)[0])
            raise MotionGenError(f"the rotation of joint '{self.skeleton.names[joint]}' at frame {frame} is zero")
        if (np.abs(norms - 1) > 1e-9).any():  # unit ones stay as they are, bit for bit
            rotations = rotations / norms[..., None]
            rotations.flags.writeable = False
        object.__setattr__(self, "rotations", rotations)
        translating = tuple(int(j) for j in self.translating)
        if list(translating) != sorted(set(translating)) or any(not 0 <= j < joints for j in translating):
            raise MotionGenError(f"translating must be ascending joint indices below {joints}, not {translating}")
        object.__setattr__(self, "translating", translating)
        shape = (len(rotations), len(translating), 3)
        empty = np.size(self.translations) == 0 and not translating  # of any shape
        translations = np.zeros(shape) if empty else self.translations
        object.__setattr__(self, "translations", frozen_array(translations, shape, "translations"))
        if not (math.isfinite(self.frame_rate) and self.frame_rate > 0):
            raise MotionGenError(f"frame_rate must be a positive number of Hz, not {self.frame_rate}")
        object.__setattr__(self, "frame_rate", float(self.frame_rate))
        if self.unit is not None and self.unit not in METRES_PER_UNIT:
            raise MotionGenError(f"unit must be one of {', '.join(METRES_PER_UNIT)} or None, not '{self.unit}'")
        if self.up not in UP_AXES:
            raise MotionGenError(f"up must be 'y' or 'z', not '{self.up}'")

    # -- size and time

    def __len__(self) -> int:
        """The number of frames T."""
        return len(self.rotations)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self) - 1) / self.frame_rate

    def __repr__(self) -> str:
        """A short form: the arrays are not shown."""
        return f"Motion('{self.name}', {len(self)} frames at {self.frame_rate:g} Hz, {len(self.skeleton)} joints)"

    def __eq__(self, other: object) -> bool:
        """True for the same skeleton, frames, frame rate, unit and up axis, to the last bit; names do not count."""
        if not isinstance(other, Motion):
            return NotImplemented
        return (
            self.skeleton == other.skeleton
            and (self.translating, self.frame_rate, self.unit, self.up)
            == (other.translating, other.frame_rate, other.unit, other.up)
            and np.array_equal(self.rotations, other.rotations)
            and np.array_equal(self.translations, other.translations)
        )

    def __hash__(self) -> int:
        """A hash over the skeleton and the size."""
        return hash((self.skeleton, len(self), self.frame_rate))

    def allclose(self, other: Motion, tolerance: float = 1e-6) -> bool:
        """True for the same tree, frames and rate, with joints within `tolerance` heights and radians of each other."""
        if not self.skeleton.same_tree(other.skeleton) or len(self) != len(other):
            return False
        apart = np.linalg.norm(self.positions - other.positions, axis=-1).max() / self.skeleton.height
        turned = rot.angle_between(self.rotations, other.rotations).max()
        return bool(
            apart <= tolerance and turned <= tolerance and math.isclose(self.frame_rate, other.frame_rate, rel_tol=1e-6)
        )

    # -- where things are

    @cached_property
    def local_translations(self) -> Array:
        """(T, J, 3) position of every joint in its parent's frame: animated, or its offset."""
        full = np.broadcast_to(self.skeleton.offsets, (len(self), len(self.skeleton), 3))
        if self.translating:
            full = full.copy()
            full[:, list(self.translating)] = self.translations
            full.flags.writeable = False
        return full

    @cached_property
    def _world(self) -> tuple[Array, Array]:
        world = kinematics.forward(self.skeleton, self.rotations, self.local_translations)
        for array in world:
            array.flags.writeable = False
        return world

    @property
    def world_rotations(self) -> Array:
        """(T, J, 4) rotation of every joint in the y-up world."""
        return self._world[0]

    @property
    def positions(self) -> Array:
        """(T, J, 3) position of every joint in the y-up world, in `unit`."""
        return self._world[1]

    @cached_property
    def root(self) -> int:
        """The joint that carries the character: the translating joint with the largest subtree.

        That is joint 0 in most files, and the hips where a still root stands above them. Where nothing translates, or
        only joints with less than half of the skeleton below them, it is joint 0.
        """
        if not self.translating:
            return 0
        sizes = [1] * len(self.skeleton)
        for joint in reversed(range(1, len(self.skeleton))):
            sizes[self.skeleton.parents[joint]] += sizes[joint]
        largest = max(self.translating, key=lambda joint: (sizes[joint], -joint))
        return largest if 2 * sizes[largest] >= len(self.skeleton) else 0

    @property
    def root_positions(self) -> Array:
        """(T, 3) world position of the root joint."""
        return self.positions[:, self.root]

    # -- changes

    def replace(self, **changes: Any) -> Motion:
        """A copy with the given attributes changed, checked anew."""
        return dataclasses.replace(self, **changes)

    def __iter__(self) -> Iterator[Motion]:
        """Each frame as a motion of its own."""
        return (self[frame] for frame in range(len(self)))

    def __getitem__(self, key: int | slice) -> Motion:
        """The frames of a slice, or one frame as a motion of its own.

        A step divides the frame rate, so that the motion keeps its pace; a negative one plays it backwards.

        Raises:
            MotionGenError: if the frame does not exist or the slice is empty.
        """
        if isinstance(key, slice):
            step = abs(key.step or 1)
            if not range(*key.indices(len(self))):
                wanted = ":".join("" if bound is None else str(bound) for bound in (key.start, key.stop, key.step))
                raise MotionGenError(f"frames [{wanted}] of a clip with frames 0 to {len(self) - 1} are none at all")
        else:
            if not -len(self) <= key < len(self):
                raise MotionGenError(f"there is no frame {key} in a clip with frames 0 to {len(self) - 1}")
            step, key = 1, slice(key, key + 1 or None)
        return self.replace(
            rotations=self.rotations[key], translations=self.translations[key], frame_rate=self.frame_rate / step
        )

    def with_translating(self, joints: Iterable[int]) -> Motion:
        """The same motion with the translation of `joints` stored per frame, besides those that already are."""
        joints = tuple(sorted(set(joints) | set(self.translating)))
        return self.replace(translating=joints, translations=self.local_translations[:, list(joints)])

    def resample(self, frame_rate: float) -> Motion:
        """The same motion at another rate: spherical interpolation of rotations, linear of translations.

        The first frame stays the first and nothing is extrapolated, so the last frame is the last one that falls
        within the clip. Frames that exist at both rates are kept bit for bit. Lowering the rate filters nothing.
        """
        if not (math.isfinite(frame_rate) and frame_rate > 0):
            raise MotionGenError(f"frame_rate must be a positive number of Hz, not {frame_rate}")
        ratio = self.frame_rate / frame_rate
        count = math.floor((len(self) - 1) / ratio + 1e-6) + 1
        if count > MOST_FRAMES:
            raise MotionGenError(f"at {frame_rate:g} Hz there would be {count} frames, more than {MOST_FRAMES}")
        times = np.arange(count) * ratio  # in frames of this motion
        times = np.where(np.abs(times - np.round(times)) < 1e-6, np.round(times), times)
        before = np.minimum(times.astype(int), len(self) - 1)  # (T',)
        after = np.minimum(before + 1, len(self) - 1)
        weight = times - before
        rotations, translations = self.rotations[before], self.translations[before]
        between = np.flatnonzero(weight)
        w = weight[between, None]
        rotations[between] = rot.slerp(rotations[between], self.rotations[after[between]], w)
        step = self.translations[after[between]] - translations[between]
        translations[between] += w[..., None] * step
        return self.replace(rotations=rotations, translations=translations, frame_rate=frame_rate)

    def transform(
        self, rotation: Sequence[float] | Array = rot.IDENTITY, shift: Sequence[float] | Array = (0.0, 0.0, 0.0)
    ) -> Motion:
        """The motion turned about the world's origin by a unit quaternion, then shifted by a vector in `unit`."""
        rotation, shift = np.asarray(rotation, dtype=float), np.asarray(shift, dtype=float)
        offsets = self.skeleton.offsets.copy()
        offsets[0] = rot.rotate(rotation, offsets[0]) + shift
        rotations = self.rotations.copy()
        rotations[:, 0] = rot.multiply(rotation, rotations[:, 0])
        translations = self.translations.copy()
        if 0 in self.translating:
            translations[:, 0] = rot.rotate(rotation, translations[:, 0]) + shift
            offsets[0] = self.skeleton.offsets[0]
        skeleton = dataclasses.replace(self.skeleton, offsets=offsets)
        return self.replace(skeleton=skeleton, rotations=rotations, translations=translations)

    def scale(self, factor: float, unit: str | None = None) -> Motion:
        """The motion with all lengths multiplied by `factor`, said to be in `unit`."""
        if not (math.isfinite(factor) and factor > 0):
            raise MotionGenError(f"a scale must be a positive number, not {factor}")
        skeleton = dataclasses.replace(
            self.skeleton,
            offsets=self.skeleton.offsets * factor,
            end_site_offsets=self.skeleton.end_site_offsets * factor,
        )
        return self.replace(skeleton=skeleton, translations=self.translations * factor, unit=unit)

    def convert_unit(self, unit: str) -> Motion:
        """The same motion with its lengths in another unit.

        Raises:
            MotionGenError: if this motion's unit is not known.
        """
        if unit not in METRES_PER_UNIT:
            raise MotionGenError(f"unit must be one of {', '.join(METRES_PER_UNIT)}, not '{unit}'")
        if self.unit is None:
            raise MotionGenError(f"the unit of '{self.name}' is not known; say what it is when loading it")
        return self.scale(METRES_PER_UNIT[self.unit] / METRES_PER_UNIT[unit], unit)

    def change_up(self, up: str) -> Motion:
        """The same motion, to be written with another up axis. Inside nothing changes: y stays up."""
        return self.replace(up=up)

    def turn_up(self, up: str) -> Motion:
        """A motion whose arrays have `up` up, turned so that y is; `up` is remembered for writing."""
        turned = self if up == "y" else _turn_root(self, Z_TO_Y_UP)
        return turned.replace(up=up)

    def mirror(self) -> Motion:
        """Left and right exchanged, as seen in a mirror that stands across the character's way.

        See `motiongen.mirror` for how the pairs are found and what is refused.
        """
        from motiongen.mirror import mirror

        return mirror(self)

    def save(self, path: str | Path) -> None:
        """Write to a file; the suffix chooses the format (see `motiongen.io`)."""
        from motiongen import io

        io.save(self, path)


def _turn_root(motion: Motion, rotation: Array) -> Motion:
    """Turn a motion and the rest offset of its joint 0 about the origin; undone by the inverse rotation."""
    turned = motion.transform(rotation)
    offsets = turned.skeleton.offsets.copy()
    offsets[0] = rot.rotate(rotation, motion.skeleton.offsets[0])
    return turned.replace(skeleton=dataclasses.replace(turned.skeleton, offsets=offsets))


def concatenate(motions: Sequence[Motion], align: bool = True) -> Motion:
    """The motions one after the other.

    Args:
        motions: clips of one skeleton at one frame rate.
        align: turn the root of each clip about the up axis and move it over the ground, so that it sets off where and
            whither the one before it was going; joints above the root, which stand still, stay. Without, the clips
            stay where they are.

    Raises:
        MotionGenError: if there is no clip, or skeletons or frame rates differ.
    """
    if not motions:
        raise MotionGenError("concatenate needs at least one motion; none came")
    first = motions[0]
    translating = {j for m in motions for j in m.translating}
    if any(not np.array_equal(m.skeleton.offsets[0], first.skeleton.offsets[0]) for m in motions):
        translating.add(0)  # the joined clip has one skeleton, and joint 0 rests in one place there
    if align:
        translating.add(first.with_translating(translating).root)
    joined = [first.with_translating(translating)]
    for following in motions[1:]:
        motion = following.with_translating(translating)
        if found := first.skeleton.difference(motion.skeleton, ignoring=translating):
            raise MotionGenError(f"'{motion.name}' has another skeleton than '{first.name}': {found}")
        if not math.isclose(motion.frame_rate, first.frame_rate, rel_tol=1e-6):
            raise MotionGenError(
                f"'{motion.name}' runs at {motion.frame_rate:g} Hz and '{first.name}' at {first.frame_rate:g} Hz; "
                "resample one of them first"
            )
        joined.append(_aligned(motion, joined[-1]) if align else motion)
    return joined[0].replace(
        rotations=np.concatenate([m.rotations for m in joined]),
        translations=np.concatenate([m.translations for m in joined]),
    )


def _aligned(motion: Motion, before: Motion) -> Motion:
    """`motion` turned and moved on the ground so that its first frame comes one step after the last of `before`."""
    root = before.root
    # Heading of the relative turn, not difference of headings: some rigs' roots rest with their own y axis upside down.
    turn = rot.heading(rot.multiply(before.world_rotations[-1, root], rot.inverse(motion.world_rotations[0, root])))
    rotations = rot.multiply(turn, motion.world_rotations[:, root])  # (T, 4)
    positions = rot.rotate(turn, motion.positions[:, root])  # (T, 3)
    step = before.root_positions[-1] - before.root_positions[-2] if len(before) > 1 else np.zeros(3)
    shift = before.root_positions[-1] + step - positions[0]
    shift[1] = 0.0
    return _moved(motion, root, rotations, positions + shift)


def _moved(motion: Motion, joint: int, world_rotations: Array, positions: Array) -> Motion:
    """`motion` with a translating joint put at world rotations (T, 4) and positions (T, 3)."""
    parent = motion.skeleton.parents[joint]
    if parent != -1:
        back = rot.inverse(motion.world_rotations[:, parent])
        world_rotations = rot.multiply(back, world_rotations)
        positions = rot.rotate(back, positions - motion.positions[:, parent])
    rotations, translations = motion.rotations.copy(), motion.translations.copy()
    rotations[:, joint], translations[:, motion.translating.index(joint)] = world_rotations, positions
    return motion.replace(rotations=rotations, translations=translations)
