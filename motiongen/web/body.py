"""What a clip looks like on the stage of the page: where its bones, feet and marks are at any of its frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen.contact import contact_labels, foot_joints
from motiongen.motion import Motion
from motiongen.render.camera import glide
from motiongen.render.figure import Figure, node_positions
from motiongen.render.stage import cast
from motiongen.web.shapes import LIMB_TAPER

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

STATURE = 1.7
"""How tall a figure is on the stage: it is in metres then, more or less, whatever the clip is in."""

_SOLID = 1.25 * STATURE  # shaded limbs look thinner than the flat ones that the figure's radii are made for
_BLOCK = 1024  # frames that are worked on at a time
_STRETCH = 5e-4 * STATURE  # bones that change their length by less than this are drawn at one length


@dataclass(frozen=True, eq=False)
class Body:
    """A clip on the stage, in stage units, y up, the ground at y = 0, its root's first place over the origin.

    Attributes:
        figure: its bones and balls; nodes are indices into `nodes`, radii are in stage units.
        nodes: (T, N, 3) where everything that is drawn is.
        joints: (E, 2) nodes with a ball half way between them: the figure's own, and one at every joint of bones.
        joint_radii: (E,) of those.
        joint_bones: (E,) the bone that ends there and gives the ball its colour, or -1: heads, and where all begins.
        limbs: (B, 3) how wide, long and deep each bone is.
        stretching: whether bones change their length, so that `limbs` is the mean.
        feet: (C,) the nodes of the feet.
        standing: (T, C) whether each stands on the ground.
        calm: (T, 2) a calm track of the root over the ground, x and z.
        front: (3,) the ground direction that it faces, over all.
        top: how high its highest node is, most of the time.
        low, high: (2,) the corners of the ground, x and z, that it ever covers.
        origin: (2,) where on the ground the root begins, x and z in the clip's unit.
        unit: one unit of the stage in the clip's.
        frame_rate: in Hz.
    """

    figure: Figure
    nodes: Float32
    joints: NDArray[np.int64]
    joint_radii: Array
    joint_bones: NDArray[np.int64]
    limbs: Float32
    stretching: bool
    feet: NDArray[np.int64]
    standing: NDArray[np.bool_]
    calm: Array
    front: Array
    top: float
    low: Array
    high: Array
    origin: Array
    unit: float
    frame_rate: float

    def __len__(self) -> int:
        """The number of frames T."""
        return len(self.nodes)

    @property
    def way(self) -> Float32:
        """(T, 2) the root's way over the ground, x and z."""
        return self.nodes[:, self.figure.root, ::2]

    def frame_at(self, seconds: float) -> int:
        """The frame nearest to a time; the first and last one before and after the clip."""
        return int(np.clip(round(seconds * self.frame_rate), 0, len(self) - 1))

    def over_at(self, seconds: float) -> bool:
        """Whether the clip has ended before that time."""
        return round(seconds * self.frame_rate) >= len(self)

    def limbs_at(self, frame: int) -> tuple[Float32, Float32, Float32]:
        """Where the bones begin (B, 3), how they are turned (B, 4), wxyz, and their sizes (B, 3)."""
        upper, lower = self.nodes[frame][self.figure.bones.T]
        along = lower - upper
        lengths = np.linalg.norm(along, axis=1)
        sizes = self.limbs
        if self.stretching:
            sizes = sizes.copy()
            sizes[:, 1] = lengths
        return upper, upright_to(along, lengths), sizes

    def balls_at(self, frame: int) -> Float32:
        """(E, 3) where the balls are."""
        first, second = self.nodes[frame][self.joints.T]
        return (first + second) / 2

    def to_clip(self, place: Array) -> Array:
        """Ground places (..., 2) of the stage in the clip's unit."""
        return self.origin + place * self.unit

    def to_stage(self, place: Array) -> Array:
        """Ground places (..., 2) in the clip's unit on the stage."""
        return (place - self.origin) / self.unit


def upright_to(along: Float32, lengths: Float32) -> Float32:
    """(B, 4) quaternions, wxyz, that turn the up axis to the vectors `along` (B, 3) of the given lengths (B,).

    Which way round the turn goes about the vector itself is of no matter to a round limb. The shorter arc is taken
    from the end of the axis that is nearer, up or down, so that there is no direction where it fails.
    """
    x, y, z = (along / np.where(lengths > 0, lengths, 1)[:, None]).T
    turns = np.zeros((len(along), 4), dtype=np.float32)
    rises = y >= 0
    turns[:, 0] = np.where(rises, 1 + y, z)
    turns[:, 1] = np.where(rises, z, 1 - y)
    turns[:, 2] = np.where(rises, 0, x)
    turns[:, 3] = np.where(rises, -x, 0)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return turns


def bodies(motions: Sequence[Motion]) -> list[Body]:
    """The motions as they come on the stage, at one scale where they share a unit (see `motiongen.render`)."""
    if not motions:
        return []
    few = [np.unique(np.linspace(0, len(motion) - 1, 16).astype(int)) for motion in motions]
    actors = cast(motions, [""] * len(motions), few)
    return [_make(motion, actor.figure, actor.front, actor.yard / STATURE) for motion, actor in zip(motions, actors)]


def _make(motion: Motion, figure: Figure, front: Array, unit: float) -> Body:
    """The body of a motion whose figure is given in heights."""
    feet = foot_joints(motion)
    used = np.union1d(figure.drawn, np.array(feet, dtype=np.int64))
    drawn = dataclasses.replace(
        figure,
        bones=np.searchsorted(used, figure.bones),
        balls=np.searchsorted(used, figure.balls),
        root=int(np.searchsorted(used, figure.root)),
        radii=_SOLID * figure.radii,
        ball_radii=STATURE * figure.ball_radii,
    )
    nodes, origin = _nodes(motion, used, figure.root, unit)
    lengths, stretching = _lengths(nodes, drawn.bones)
    limbs = _limbs(drawn, lengths)
    joints, joint_radii, joint_bones = _joints(drawn, limbs)
    low, high = nodes[..., ::2].min(axis=(0, 1)), nodes[..., ::2].max(axis=(0, 1))
    way = nodes[:, drawn.root].astype(np.float64) * [1.0, 0.0, 1.0]
    return Body(
        figure=drawn,
        nodes=nodes,
        joints=joints,
        joint_radii=joint_radii,
        joint_bones=joint_bones,
        limbs=limbs,
        stretching=stretching,
        feet=np.searchsorted(used, np.array(feet, dtype=np.int64)),
        standing=contact_labels(motion, feet),
        calm=STATURE * glide(way / STATURE, motion.frame_rate)[:, ::2],
        front=front,
        top=float(np.percentile(nodes[..., 1].max(axis=1), 95)) + drawn.thickest,
        low=low - drawn.thickest,
        high=high + drawn.thickest,
        origin=origin,
        unit=unit,
        frame_rate=motion.frame_rate,
    )


def _nodes(motion: Motion, used: NDArray[np.int64], root: int, unit: float) -> tuple[Float32, Array]:
    """(T, N, 3) the used nodes on the stage, and (2,) the root's first place on the ground in the clip's unit."""
    every = node_positions(motion)
    origin = every[0, root].copy()
    origin[1] = kinematics.ground_height(motion)
    nodes = np.empty((len(every), len(used), 3), dtype=np.float32)
    for first in range(0, len(every), _BLOCK):  # a long clip of many joints is not copied as a whole
        block = slice(first, first + _BLOCK)
        nodes[block] = (every[block, used] - origin) / unit
    return nodes, origin[::2]


def _lengths(nodes: Float32, bones: NDArray[np.int64]) -> tuple[Float32, bool]:
    """(B,) the mean lengths of the bones, and whether any of them stretches."""
    least, most = np.full(len(bones), np.inf), np.zeros(len(bones))
    for first in range(0, len(nodes), _BLOCK):
        block = nodes[first : first + _BLOCK]
        lengths = np.linalg.norm(block[:, bones[:, 1]] - block[:, bones[:, 0]], axis=-1)
        least, most = np.minimum(least, lengths.min(axis=0)), np.maximum(most, lengths.max(axis=0))
    return ((least + most) / 2).astype(np.float32), bool((most - least > _STRETCH).any())


def _limbs(figure: Figure, lengths: Float32) -> Float32:
    """(B, 3) how wide, long and deep limbs of these lengths (B,) are; the shape's own taper stands for each bone's."""
    upper, lower = figure.radii.T
    radii = np.where(lower > 0, np.sqrt(upper * lower / LIMB_TAPER), upper)  # one that ends inside a head has no lower
    return np.stack([radii, lengths, radii], axis=1).astype(np.float32)


def _joints(figure: Figure, limbs: Float32) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
    """Where balls are, between which nodes (E, 2), their radii (E,), and the bones (E,) whose colour they have.

    A ball is as thick as the thickest limb (B, 3) that begins or ends there.
    """
    balls = {(first, second): radius for (first, second), radius in zip(figure.balls.tolist(), figure.ball_radii)}
    heads = {second for first, second in balls if first != second}
    ends: dict[int, int] = {}
    for bone, ((upper, lower), width) in enumerate(zip(figure.bones.tolist(), limbs[:, 0])):
        balls[upper, upper] = max(balls.get((upper, upper), 0.0), width)
        if lower not in heads:
            balls[lower, lower] = max(balls.get((lower, lower), 0.0), LIMB_TAPER * width)
            ends[lower] = bone
    joints = np.array(list(balls), dtype=np.int64)
    bones = [ends.get(first, -1) if first == second else -1 for first, second in balls]
    return joints, np.array(list(balls.values()), dtype=np.float64), np.array(bones, dtype=np.int64)
