"""Random skeletons and motions for the tests: plain builders from a NumPy generator, and hypothesis strategies.

The builders take every size that matters as an argument. The strategies draw the sizes, which shrink, and a seed for
the numbers, which need not.

    from tests.strategies import motions, random_motion
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

# How joints are called in files: plainly, with a name space, with a blank.
NAME_STYLES = ("joint{}", "mixamorig:Bone_{}", "Bip01 L Bone{}", "Gelenk.{}")


def random_quaternions(rng: np.random.Generator, *shape: int) -> Array:
    """(*shape, 4) unit quaternions: three in four uniform over all rotations, the others where formulas break.

    Those are the identity of either sign, half turns about an axis of the frame, and turns of a billionth of a radian.
    """
    uniform = rng.normal(size=(*shape, 4))
    identity = np.broadcast_to(rot.IDENTITY, uniform.shape) * rng.choice([-1.0, 1.0], size=(*shape, 1))
    half_turn = np.eye(4)[rng.integers(0, 3, size=shape)]
    tiny = identity + 1e-9 * uniform
    kinds = np.stack([uniform, identity, half_turn, tiny])  # (4, *shape, 4)
    kind = rng.choice(4, size=shape, p=[0.76, 0.08, 0.08, 0.08])
    chosen = np.take_along_axis(kinds, kind[None, ..., None], axis=0)[0]
    return chosen / np.linalg.norm(chosen, axis=-1, keepdims=True)


def random_parents(rng: np.random.Generator, joints: int, depth_first: bool = False) -> tuple[int, ...]:
    """Parents of a random tree, before their children: anything from a single chain to a star.

    With `depth_first` each subtree is one contiguous run of joints, as a BVH file lists them.
    """
    bushy = rng.uniform(0, 1)  # 0: a chain
    parents = [-1]
    for joint in range(1, joints):
        open_joints = list(range(joint))
        if depth_first:  # the last joint and what is above it
            open_joints = [joint - 1]
            while open_joints[0] != 0:
                open_joints.insert(0, parents[open_joints[0]])
        parents.append(int(rng.choice(open_joints)) if rng.uniform() < bushy else joint - 1)
    return tuple(parents)


def random_skeleton(
    rng: np.random.Generator,
    joints: int | None = None,
    *,
    end_sites: bool = True,
    depth_first: bool = False,
    scale: float = 1.0,
    names: str = "joint{}",
) -> Skeleton:
    """A random tree with random offsets.

    Args:
        rng: where the numbers come from.
        joints: how many; 1 to 12 by default.
        end_sites: hang end sites from most of the leaves, some of them with zero offset, and sometimes two from one.
        depth_first: list the joints depth first, as a BVH file does.
        scale: length of a typical bone.
        names: what joints are called, with their index for {}.
    """
    joints = int(rng.integers(1, 13)) if joints is None else joints
    parents = random_parents(rng, joints, depth_first)
    tips: list[int] = []
    if end_sites:
        leaves = sorted(set(range(joints)) - set(parents))
        tips = sorted(leaf for leaf in leaves for _ in range(int(rng.choice([0, 1, 2], p=[0.15, 0.75, 0.1]))))
    offsets, tip_offsets = scale * rng.normal(size=(joints, 3)), scale * rng.normal(size=(len(tips), 3))
    tip_offsets[rng.uniform(size=len(tips)) < 0.15] = 0.0
    return Skeleton(tuple(names.format(j) for j in range(joints)), parents, offsets, tuple(tips), tip_offsets)


def random_motion(
    rng: np.random.Generator,
    skeleton: Skeleton | None = None,
    *,
    frames: int | None = None,
    translating: Sequence[int] | None = None,
    smooth: bool = False,
    **settings: Any,
) -> Motion:
    """A random motion.

    Args:
        rng: where the numbers come from.
        skeleton: whose motion; a random one by default.
        frames: how many; 1 to 12 by default.
        translating: which joints; by default none, joint 0, or joint 0 and a few others.
        smooth: swing like a body does, a few hertz at most, in place of an unrelated pose in each frame.
        settings: further attributes of the motion, such as `frame_rate` (30 Hz by default) or `unit`.
    """
    skeleton = random_skeleton(rng) if skeleton is None else skeleton
    frames = int(rng.integers(1, 13)) if frames is None else frames
    settings = {"frame_rate": 30.0} | settings
    joints = len(skeleton)
    if translating is None:
        others = [j for j in range(1, joints) if rng.uniform() < 0.25]
        translating = ([], [0], [0, *others])[int(rng.integers(0, 3))]
    moving = len(translating)
    rest = skeleton.offsets[list(translating)]  # (M, 3)
    if smooth:
        seconds = np.arange(frames) / settings["frame_rate"]
        angles = _swings(rng, seconds, joints)  # (T, J, 3) rotation vectors
        size = np.linalg.norm(angles, axis=-1)
        rotations = rot.from_axis_angle(angles / np.maximum(size, 1e-12)[..., None], size)
        translations = rest + 0.3 * skeleton.height * _swings(rng, seconds, moving)
    else:
        rotations = random_quaternions(rng, frames, joints)
        translations = rest + 0.3 * skeleton.height * rng.normal(size=(frames, moving, 3))
    return Motion(skeleton, rotations, translations, tuple(translating), **settings)


def _swings(rng: np.random.Generator, seconds: Array, count: int) -> Array:
    """(T, count, 3) sums of three sines between 0.2 and 2 Hz, within about -1 to 1."""
    size = rng.uniform(0.05, 0.4, size=(3, 1, count, 3))
    hertz, phase = rng.uniform(0.2, 2.0, size=size.shape), rng.uniform(0, 2 * np.pi, size=size.shape)
    return (size * np.sin(2 * np.pi * hertz * seconds[:, None, None] + phase)).sum(axis=0)


def generators() -> st.SearchStrategy[np.random.Generator]:
    """NumPy random generators with a drawn seed."""
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


@st.composite
def skeletons(
    draw: Callable[..., Any], min_joints: int = 1, max_joints: int = 12, depth_first: bool = False
) -> Skeleton:
    """Random trees of any shape, names of several styles, of a metre or of hundreds of units."""
    return random_skeleton(
        draw(generators()),
        draw(st.integers(min_joints, max_joints)),
        end_sites=draw(st.booleans()),
        depth_first=depth_first,
        scale=draw(st.sampled_from([1.0, 0.01, 40.0])),
        names=draw(st.sampled_from(NAME_STYLES)),
    )


@st.composite
def motions(
    draw: Callable[..., Any],
    of: st.SearchStrategy[Skeleton] | None = None,
    min_frames: int = 1,
    max_frames: int = 8,
    smooth: bool = False,
) -> Motion:
    """Random motions of the skeletons `of` (any by default), with no, one or several translating joints."""
    skeleton = draw(skeletons() if of is None else of)
    return random_motion(
        draw(generators()),
        skeleton,
        frames=draw(st.integers(min_frames, max_frames)),
        translating=sorted(draw(st.sets(st.integers(0, len(skeleton) - 1), max_size=4))),
        smooth=smooth,
        frame_rate=draw(st.sampled_from([30.0, 60.0, 24.0, 120.0, 29.97, 1.0])),
        unit=draw(st.sampled_from([None, "cm", "m", "in"])),
        up=draw(st.sampled_from(["y", "z"])),
    )


def symmetric_motion(rng: np.random.Generator, frames: int = 6, limbs: int = 2, **settings: Any) -> Motion:
    """A random motion of a rig with exact left and right: a spine, and `limbs` pairs of two-bone limbs from it."""
    names, parents = ["Hips", "Spine", "Head"], [-1, 0, 1]
    offsets = [np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.3, 0.02]), np.array([0.0, 0.3, 0.01])]
    for limb in range(limbs):
        upper, lower = rng.normal(size=(2, 3))
        for side, sign in (("Left", 1.0), ("Right", -1.0)):
            mirrored = np.array([sign, 1.0, 1.0])
            names += [f"{side}Upper{limb}", f"{side}Lower{limb}"]
            parents += [limb % 2, len(parents)]
            offsets += [upper * mirrored, lower * mirrored]
    skeleton = Skeleton(tuple(names), tuple(parents), np.array(offsets))
    return random_motion(rng, skeleton, **({"frames": frames, "translating": (0,)} | settings))
