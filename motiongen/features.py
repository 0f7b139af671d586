"""Motion to feature vectors with named slices, and back, exactly.

One frame's features are what the GenMM paper calls M (section 3.1): local rotations R as 6D, root displacement V as
steps over the ground plus the height above it, and, where asked for, foot-contact labels L. Joints below the root whose
translation is animated add theirs. Beside the labels stand the feet's own steps, which tell a foot that slides in the
clip itself from one that a synthesis lets slide. All lengths are in skeleton heights, so that nothing depends on the
file's unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.contact import contact_labels, foot_joints
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

GROUND_AXES = (0, 2)
UP_AXIS = 1


@dataclass(frozen=True)
class FeatureLayout:
    """Which numbers of a feature vector mean what. The only place that knows.

    Attributes:
        skeleton: whose features these are.
        root: the joint whose steps and height are stored.
        translating: the other joints whose translation is stored.
        feet: the foot joints whose contact labels and steps are stored; none: no such features.
    """

    skeleton: Skeleton
    root: int
    translating: tuple[int, ...] = ()
    feet: tuple[int, ...] = ()

    @cached_property
    def rotations(self) -> slice:
        """Local rotations, 6 numbers a joint: the first two columns of its matrix."""
        return slice(0, 6 * len(self.skeleton))

    @cached_property
    def root_steps(self) -> slice:
        """The root's step over the ground since the frame before, along world x and z, in heights."""
        return slice(self.rotations.stop, self.rotations.stop + 2)

    @cached_property
    def root_height(self) -> slice:
        """The root's height above the world's origin, in heights."""
        return slice(self.root_steps.stop, self.root_steps.stop + 1)

    @cached_property
    def translations(self) -> slice:
        """Local translation of each translating joint, less its offset, in heights."""
        return slice(self.root_height.stop, self.root_height.stop + 3 * len(self.translating))

    @cached_property
    def contacts(self) -> slice:
        """One label a foot: 1 on the ground, 0 off it."""
        return slice(self.translations.stop, self.translations.stop + len(self.feet))

    @cached_property
    def foot_steps(self) -> slice:
        """Each foot joint's step over the ground since the frame before, along world x and z, in heights."""
        return slice(self.contacts.stop, self.contacts.stop + 2 * len(self.feet))

    @property
    def size(self) -> int:
        """The number of features D of a frame."""
        return self.foot_steps.stop

    def joint_features(self, joints: Iterable[int]) -> NDArray[np.int64]:
        """Indices of all features that belong to `joints`: rotations, translations, contacts, steps."""
        joints = sorted(set(joints))
        chosen = [i for joint in joints for i in range(*rotation_features(joint).indices(self.size))]
        if self.root in joints:
            chosen += range(self.root_steps.start, self.root_height.stop)
        for k, joint in enumerate(self.translating):
            chosen += [self.translations.start + 3 * k + i for i in range(3)] if joint in joints else []
        for k, joint in enumerate(self.feet):
            first_step = self.foot_steps.start + 2 * k
            chosen += [self.contacts.start + k, first_step, first_step + 1] if joint in joints else []
        return np.array(chosen, dtype=np.int64)


def rotation_features(joint: int) -> slice:
    """Where the 6D rotation of a joint stands in a feature vector."""
    return slice(6 * joint, 6 * joint + 6)


def layout_of(motions: Sequence[Motion], contacts: bool = False) -> FeatureLayout:
    """The layout that holds all of `motions`: every joint that moves in any of them has its translation stored.

    Args:
        motions: clips of one skeleton.
        contacts: whether foot-contact labels and the feet's steps are stored.

    Raises:
        MotionGenError: if there is no motion, or skeletons differ; the message names the difference.
    """
    if not motions:
        raise MotionGenError("at least one motion is needed; none came")
    first = motions[0]
    moving = sorted({joint for motion in motions for joint in motion.translating})
    for motion in motions[1:]:
        if found := first.skeleton.difference(motion.skeleton, ignoring=moving):
            raise MotionGenError(f"'{motion.name}' has another skeleton than '{first.name}': {found}")
    root = first.with_translating(moving).root
    feet = foot_joints(list(motions)) if contacts else ()
    return FeatureLayout(first.skeleton, root, tuple(j for j in moving if j != root), feet)


def to_features(motion: Motion, layout: FeatureLayout) -> Array:
    """(T, D) features of a motion.

    The first frame has no frame before it; it takes the second frame's step, so that a patch that starts there keeps
    its pace. Where the motion stands on the ground is not kept: `from_features` takes it as `start`.
    """
    height = layout.skeleton.height
    features = np.empty((len(motion), layout.size))
    features[:, layout.rotations] = rot.to_6d(motion.rotations).reshape(len(motion), -1)
    positions = motion.positions / height
    features[:, layout.root_steps] = _ground_steps(positions[:, [layout.root]])
    features[:, layout.root_height] = positions[:, layout.root, [UP_AXIS]]
    if layout.translating:
        joints = list(layout.translating)
        moved = motion.local_translations[:, joints] - layout.skeleton.offsets[joints]
        features[:, layout.translations] = moved.reshape(len(motion), -1) / height
    if layout.feet:
        features[:, layout.contacts] = contact_labels(motion, layout.feet)
        features[:, layout.foot_steps] = _ground_steps(positions[:, list(layout.feet)])
    return features


def _ground_steps(positions: Array) -> Array:
    """(T, 2 n) steps over the ground of positions (T, n, 3); the first frame has that of the second."""
    steps = np.diff(positions[..., GROUND_AXES], axis=0)
    first = steps[:1] if len(steps) else np.zeros_like(positions[..., GROUND_AXES])
    return np.concatenate([first, steps]).reshape(len(positions), -1)


def from_features(features: Array, layout: FeatureLayout, like: Motion, start: Array | None = None) -> Motion:
    """The motion that (T, D) features describe; the exact inverse of `to_features`.

    Rotations are made orthonormal, the nearest way. Contact labels and the feet's steps are not used.

    Args:
        features: (T, D).
        layout: what they mean.
        like: frame rate, unit, up axis, name and file layout are taken from it.
        start: (2,) where the root stands on the ground (x, z) in the first frame, in the motion's unit; by default
            where `like` starts.
    """
    frames, height = len(features), layout.skeleton.height
    if start is None:
        start = like.positions[0, layout.root][list(GROUND_AXES)]
    rotations = rot.from_6d(features[:, layout.rotations].reshape(frames, -1, 6))
    root = np.empty((frames, 3))
    steps = features[:, layout.root_steps].copy()
    steps[0] = 0.0
    root[:, GROUND_AXES] = np.cumsum(steps, axis=0) * height + start
    root[:, UP_AXIS] = features[:, layout.root_height.start] * height
    translating = tuple(sorted({layout.root, *layout.translating}))
    local = np.broadcast_to(layout.skeleton.offsets, (frames, len(layout.skeleton), 3)).copy()
    if layout.translating:
        joints = list(layout.translating)
        local[:, joints] += features[:, layout.translations].reshape(frames, -1, 3) * height
    local[:, layout.root] = _into_parent(root, rotations, local, layout)
    return like.replace(
        skeleton=layout.skeleton,
        rotations=rot.continuous(rotations),
        translations=local[:, list(translating)],
        translating=translating,
        notes=(),
    )


def _into_parent(root: Array, rotations: Array, local: Array, layout: FeatureLayout) -> Array:
    """World positions (T, 3) of the root joint in its parent's frame; no joint above it translates."""
    above = layout.skeleton.ancestors(layout.root)
    if not above:
        return root
    world_rotations, world_positions = kinematics.forward_chain(rotations[:, list(above)], local[:, list(above)])
    return rot.rotate(rot.inverse(world_rotations), root - world_positions)
