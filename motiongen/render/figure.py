"""The stick figure of a skeleton: which bones are drawn, how thick, and on which side of the body they are."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen.errors import MotionGenError
from motiongen.mirror import counterparts
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

MIDDLE, LEFT, RIGHT = 0, 1, 2
"""The sides of the body."""

MARKED = 3
"""In place of a side: drawn in a colour of its own."""

# Radii in heights. A bone is as thick as the square root of the limb that is still to come: thick thighs, thin fingers,
# on any rig, from its lengths alone. A figure without bones is one large ball.
_THIN, _TAPER, _BALL, _LONE_BALL = 0.005, 0.024, 0.011, 0.06
_LARGEST_HEAD = 0.075


@dataclass(frozen=True, eq=False)
class Figure:
    """What is drawn of a skeleton with N = J + S nodes: its joints, then its end sites.

    Attributes:
        bones: (B, 2) the nodes that each bone runs between, upper end first.
        radii: (B, 2) the bone's radius at either end.
        sides: (B,) `MIDDLE`, `LEFT` or `RIGHT`, or `MARKED`.
        balls: (E, 2) nodes with a ball half way between them: one at the end of each limb, where both are the same
            node, one from a head's joint to its tip, and the root's alone where there is no bone.
        ball_radii: (E,) of the balls.
        ball_sides: (E,) `MIDDLE` or `MARKED`.
        root: the node that carries the figure.
    """

    bones: NDArray[np.int64]
    radii: Array
    sides: NDArray[np.int64]
    balls: NDArray[np.int64]
    ball_radii: Array
    ball_sides: NDArray[np.int64]
    root: int

    @property
    def drawn(self) -> NDArray[np.int64]:
        """The nodes that must be in the picture, ascending: all that something is drawn at, and the root."""
        return np.unique(np.concatenate([self.bones.ravel(), self.balls.ravel(), [self.root]]))

    def marking(self, joints: NDArray[np.bool_]) -> Figure:
        """The figure with the bones and balls marked that these joints (J,) turn."""
        turning = {lower: upper for upper, lower in self.bones.tolist()}
        bones = joints[self.bones[:, 0]]
        balls = joints[[turning.get(node, self.root) for node in self.balls[:, 1].tolist()]]
        return dataclasses.replace(
            self, sides=np.where(bones, MARKED, self.sides), ball_sides=np.where(balls, MARKED, self.ball_sides)
        )

    @property
    def thickest(self) -> float:
        """The largest radius."""
        return float(max(self.radii.max(initial=0.0), self.ball_radii.max()))


def node_positions(motion: Motion) -> Array:
    """(T, J + S, 3) world positions of the joints, then of the end sites."""
    return np.concatenate([motion.positions, kinematics.end_site_positions(motion)], axis=1)


def figure_scale(motion: Motion, nodes: Array) -> float:
    """What counts as the height of the figure, in the motion's unit.

    That is the skeleton's height, measured over the body alone: the rest offset of the joint that carries it is a place
    in the world, and in some files a far one. Where the offsets say little because translations make the pose, it is
    the middle extent of the poses, and where nothing has an extent, that of the way travelled.
    """
    skeleton, root = motion.skeleton, body_root(motion)
    tips = skeleton.rest_positions[list(skeleton.end_sites)] + skeleton.end_site_offsets
    body = _body(skeleton, root)
    height = float(np.ptp(np.concatenate([skeleton.rest_positions, tips])[body], axis=0).max())
    extent = float(np.median(np.ptp(nodes[:, body], axis=1).max(axis=1)))
    if extent > 3 * height:
        height = extent
    return height or float(np.ptp(nodes[:, root], axis=0).max()) or 1.0


def build_figure(motion: Motion, nodes: Array, height: float) -> Figure:
    """The figure of `motion`.

    Bones without length are left out, and so is what lies between a joint 0 that only carries the character and the
    character itself: that is a distance in the world, not a part of the body.

    Args:
        motion: the clip; its frames are not read.
        nodes: (T, J + S, 3) its `node_positions`, in any unit of length; radii come in the same.
        height: its `figure_scale`, in that unit.
    """
    skeleton, root = motion.skeleton, body_root(motion)
    parents = np.array([*skeleton.parents, *skeleton.end_sites])
    some = nodes[np.unique(np.linspace(0, len(nodes) - 1, 16).astype(int))]
    lengths = np.median(np.linalg.norm(some - some[:, parents], axis=-1), axis=0) / height  # (N,)
    above = {root, *skeleton.ancestors(root)}
    children = [n for n in range(len(parents)) if n not in above and lengths[n] > 1e-3]
    bones = np.array([(parents[n], n) for n in children], dtype=np.int64).reshape(-1, 2)
    reach = _reach(parents, lengths)
    still_to_come = np.stack([reach[bones[:, 1]] + lengths[bones[:, 1]], reach[bones[:, 1]]], axis=1)  # (B, 2)
    tips = np.setdiff1d(bones[:, 1], bones[:, 0]) if len(bones) else np.array([root])
    heads = _heads(skeleton, bones)
    balls = np.array([*heads, *((tip, tip) for tip in tips if tip not in {head[1] for head in heads})])
    sizes = [min(lengths[tip] / (2 if base != tip else 1), _LARGEST_HEAD) for base, tip in heads]
    sizes += [_BALL if len(bones) else _LONE_BALL] * (len(balls) - len(heads))
    radii = _THIN + _TAPER * np.sqrt(still_to_come)
    radii[[children.index(tip) for base, tip in heads if base != tip], 1] = 0.0  # in the ball, which touches the tip
    plain = np.full(len(balls), MIDDLE)
    sides = _sides(skeleton)[bones[:, 1]]
    return Figure(bones, height * radii, sides, balls, height * np.array(sizes), plain, root)


def body_root(motion: Motion) -> int:
    """The joint where the body begins: below the motion's root where its only child is translated on its own."""
    skeleton, root = motion.skeleton, motion.root
    while len(skeleton.children[root]) == 1 and root not in skeleton.end_sites:
        child = skeleton.children[root][0]
        if child not in motion.translating or len(skeleton.children[child]) == 0:
            break
        root = child
    return root


def _reach(parents: NDArray[np.int64], lengths: Array) -> Array:
    """(N,) the length of the longest chain below each node: parents come before children, end sites last of all."""
    reach = np.zeros(len(parents))
    for node in sorted(range(1, len(parents)), key=lambda n: (parents[n], n), reverse=True):
        reach[parents[node]] = max(reach[parents[node]], reach[node] + lengths[node])
    return reach


def _heads(skeleton: Skeleton, bones: NDArray[np.int64]) -> list[tuple[int, int]]:
    """The nodes between which a ball makes a face: the ends of the last bone, where the upper one is called a head.

    Some rigs end with the joint of the head, which is at its base: the ball is around that one then.
    """
    uppers = bones[:, 0].tolist()

    def is_head(node: int) -> bool:
        return node < len(skeleton) and "head" in skeleton.names[node].lower()

    last = [(upper, lower) for upper, lower in bones.tolist() if lower not in uppers and uppers.count(upper) == 1]
    between = [(upper, lower) for upper, lower in last if is_head(upper)]
    around = [(lower, lower) for upper, lower in last if is_head(lower) and not is_head(upper)]
    return [*between, *around]


def facing(skeleton: Skeleton, nodes: Array) -> Array | None:
    """(T, 3) unit ground vectors from the figure's right to its left, turned to its front; None without sides."""
    sides = _sides(skeleton)[: len(skeleton)]
    # Shoulders and hips: two joints deep from the trunk, for arms and legs swing about.
    trunk = {joint for joint, side in enumerate(sides) if side == MIDDLE}
    trunk |= {joint for joint, parent in enumerate(skeleton.parents) if parent in trunk}
    girdle = np.array([parent in trunk for parent in skeleton.parents])
    left, right = (np.flatnonzero(girdle & (sides == side)) for side in (LEFT, RIGHT))
    if not len(left) or not len(right):
        return None
    across = nodes[:, left].mean(axis=1) - nodes[:, right].mean(axis=1)  # (T, 3)
    front = np.stack([-across[:, 2], np.zeros(len(across)), across[:, 0]], axis=1)  # left x up
    return front / np.maximum(np.linalg.norm(front, axis=1, keepdims=True), 1e-12)


def _sides(skeleton: Skeleton) -> NDArray[np.int64]:
    """(J + S,) the side of every node: by the joints' names, else by which side of a symmetric rest pose it is on."""
    sides = np.zeros(len(skeleton), dtype=np.int64)
    try:
        for joint, pair in enumerate(counterparts(skeleton)):
            if joint != pair:
                sides[joint] = LEFT if _says_left(skeleton.names[joint], skeleton.names[pair]) else RIGHT
    except MotionGenError:
        sides = _sides_of_rest_pose(skeleton)
    for joint, parent in enumerate(skeleton.parents[1:], start=1):
        sides[joint] = sides[joint] or sides[parent]  # what hangs from a left limb is left
    return np.concatenate([sides, sides[list(skeleton.end_sites)]])


def _says_left(name: str, other: str) -> bool:
    """Whether `name` is the left one of a pair of names: their first difference is an l against an r."""
    return next((a for a, b in zip(name.lower(), other.lower()) if a != b), "") == "l"


def _sides_of_rest_pose(skeleton: Skeleton) -> NDArray[np.int64]:
    """(J,) sides by the sign of x, where the rest pose is symmetric about x = 0; else all in the middle."""
    at = (skeleton.rest_positions - skeleton.rest_positions[0]) / skeleton.height
    twin = at * [-1.0, 1.0, 1.0]
    # Memory for (J, J) distances: a skeleton of thousands of joints is no body with two sides.
    if len(at) > 2000 or max(np.linalg.norm(at - t, axis=1).min() for t in twin) > 0.03:
        return np.zeros(len(at), dtype=np.int64)
    return np.where(at[:, 0] > 0.02, LEFT, np.where(at[:, 0] < -0.02, RIGHT, MIDDLE))


def _body(skeleton: Skeleton, root: int) -> list[int]:
    """The nodes of the root and all below it, end sites too."""
    joints: Iterable[int] = skeleton.subtree(root)
    below = set(joints)
    return [*joints, *(len(skeleton) + s for s, joint in enumerate(skeleton.end_sites) if joint in below)]
