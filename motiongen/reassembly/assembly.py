"""A creature made of parts, and clips of its sources written on its skeleton."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.generators.constraints import Parts
from motiongen.motion import Motion, concatenate
from motiongen.skeleton import Skeleton
from motiongen.stance import facing

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Link:
    """How a joint of the creature takes its motion from a character.

    Its local rotation is left * (product along the chain) * right, its local translation scale * left * t + shift.

    Attributes:
        joint: the creature's joint.
        chain: the character's joints whose local rotations are multiplied, upper first.
        left: (4,) constant rotation.
        right: (4,) constant rotation.
        shift: (3,) constant, in the creature's unit; None where translation is not taken over.
        carries: whether the chain leads from the world to the joint that carries the character; t is then where that
            one is in the world, else the local translation of the chain's one joint.
        upright: whether the heading is taken out of such a chain, because the character sits on another body.
    """

    joint: int
    chain: tuple[int, ...]
    left: Array
    right: Array
    shift: Array | None = None
    carries: bool = False
    upright: bool = False

    def rotations(self, motion: Motion) -> Array:
        """(T, 4) local rotations of the creature's joint in a clip of the character."""
        turned = motion.rotations[:, self.chain[0]]
        for joint in self.chain[1:]:
            turned = rot.multiply(turned, motion.rotations[:, joint])
        if self.upright:
            turned = rot.multiply(rot.inverse(facing(motion)), turned)
        return rot.multiply(self.left, rot.multiply(turned, self.right))

    def translations(self, motion: Motion, scale: float) -> Array | None:
        """(T, 3) local translations of the creature's joint; None where it stays at its offset."""
        joint = self.chain[-1]
        if self.shift is None or not (self.carries or joint in motion.translating):
            return None
        moved = motion.positions[:, joint] if self.carries else motion.local_translations[:, joint]
        return scale * rot.rotate(self.left, moved) + self.shift


@dataclass(frozen=True, eq=False)
class Part:
    """One source's share of a creature with U joints.

    Attributes:
        name: what it is called.
        examples: the source's clips, as they came.
        joint_map: (J,) the creature's joint for each joint of the character; -1 for those that have none.
        joints: the creature's joints that this part drives, ascending. Every joint is driven by exactly one part.
        overlap: the joints that another part drives but whose motion this one knows too, ascending.
        scale: length in the creature of a unit of the character.
        links: how each known joint takes its motion.
    """

    name: str
    examples: tuple[Motion, ...]
    joint_map: tuple[int, ...]
    joints: tuple[int, ...]
    overlap: tuple[int, ...]
    scale: float
    links: tuple[Link, ...]

    @property
    def known(self) -> tuple[int, ...]:
        """The joints whose motion the part's examples know: `joints` and `overlap`, ascending."""
        return tuple(sorted((*self.joints, *self.overlap)))

    def __repr__(self) -> str:
        """A short form."""
        return f"Part('{self.name}', drives {len(self.joints)} joints, knows {len(self.overlap)} more)"


@dataclass(frozen=True, eq=False)
class Assembly:
    """A creature made of parts.

    Attributes:
        skeleton: the union of U joints, in the unit of the first source, whose joints keep order and offsets.
        parts: one for each source, in their order.
        root: the joint that carries the creature.
        stance: (U, 4) local rotations of the mean pose, facing +z.
        like: a clip of the first source; unit, up axis, frame rate and file layout are taken from it.
    """

    skeleton: Skeleton
    parts: tuple[Part, ...]
    root: int
    stance: Array
    like: Motion

    def __repr__(self) -> str:
        """A short form."""
        return f"Assembly({self.skeleton!r}, {', '.join(map(repr, self.parts))})"

    @property
    def frame_rate(self) -> float:
        """The rate in Hz of the first source's first clip, to which all others are resampled."""
        return self.like.frame_rate

    @cached_property
    def examples(self) -> tuple[tuple[Motion, ...], ...]:
        """For each part its clips on the union skeleton (see `lift`)."""
        return tuple(tuple(self.lift(clip, p) for clip in part.examples) for p, part in enumerate(self.parts))

    @property
    def clips(self) -> tuple[Motion, ...]:
        """All `examples` in a row, for `Generator.fit`."""
        return tuple(clip for clips in self.examples for clip in clips)

    @property
    def constraint(self) -> Parts:
        """With this a generator that was fitted to `clips` takes each part's motion from the clips of its source."""
        given = [part.name for part in self.parts]
        names = [name if given.count(name) == 1 else f"{name} {number}" for number, name in enumerate(given)]
        ends = list(itertools.accumulate((len(part.examples) for part in self.parts), initial=0))
        return Parts(
            {name: [self.skeleton.names[j] for j in part.known] for name, part in zip(names, self.parts)},
            {name: range(ends[number], ends[number + 1]) for number, name in enumerate(names)},
        )

    def known_mask(self, source: int) -> NDArray[np.bool_]:
        """(U,) whether the clips of that source know the motion of each joint."""
        mask = np.zeros(len(self.skeleton), dtype=bool)
        mask[list(self.parts[source].known)] = True
        return mask

    def lift(self, motion: Motion, source: int) -> Motion:
        """A clip of a source's character, written on the union skeleton.

        Joints that the source does not know (`known_mask`) stand in the mean pose of the part that drives them, and a
        root that it does not know stands still.

        Args:
            motion: the clip; resampled to `frame_rate` where it runs at another.
            source: index of the source.

        Raises:
            MotionGenError: if the clip has another skeleton than the source.
        """
        part = self.parts[source]
        if found := part.examples[0].skeleton.difference(motion.skeleton, ignoring=motion.translating):
            raise MotionGenError(f"'{motion.name}' is no clip of part '{part.name}': {found}")
        if not math.isclose(motion.frame_rate, self.frame_rate, rel_tol=1e-6):
            motion = motion.resample(self.frame_rate)
        rotations = np.tile(self.stance, (len(motion), 1, 1))
        moved = {joint: np.tile(place, (len(motion), 1)) for joint, place in self._standing.items()}
        for link in part.links:
            rotations[:, link.joint] = link.rotations(motion)
            translations = link.translations(motion, part.scale)
            if translations is not None:
                moved[link.joint] = translations
        joints = sorted(moved)
        return self.like.replace(
            skeleton=self.skeleton,
            rotations=rotations,
            translations=np.stack([moved[j] for j in joints], axis=1) if joints else np.zeros((0, 0, 3)),
            translating=tuple(joints),
            name=motion.name,
            notes=(),
        )

    @cached_property
    def _standing(self) -> dict[int, Array]:
        """Where the root stands in clips that do not know it, (3,) in its parent's frame; empty if it never moves."""
        own = self.parts[0].joint_map.index(self.root)
        if own not in self.like.translating:
            return {}
        return {self.root: self.like.local_translations[:, own].mean(axis=0)}

    def play(self, frames: int | None = None) -> Motion:
        """Each part plays its first clip over and over, heedless of the others: a first look at the creature.

        Args:
            frames: how many; by default as many as the first source's clip has.
        """
        clips = [clips[0] for clips in self.examples]
        frames = len(clips[0]) if frames is None else frames
        moving = sorted({j for clip in clips for j in clip.translating})
        body = concatenate([clips[0]] * math.ceil(frames / len(clips[0])))[:frames].with_translating(moving)
        rotations, translations = body.rotations.copy(), body.translations.copy()
        for part, clip in zip(self.parts[1:], clips[1:]):
            joints, turn = list(part.joints), np.arange(frames) % len(clip)
            rotations[:, joints] = rot.continuous(clip.rotations[turn][:, joints])
            own = [j for j in joints if j in moving]
            translations[:, [moving.index(j) for j in own]] = clip.local_translations[turn][:, own]
        return body.replace(rotations=rotations, translations=translations, name="assembly")
