"""Mirroring: a reflection of the world on any symmetric rig, its own inverse, and left stays left on real rigs."""

from __future__ import annotations

import dataclasses
import tarfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose

from motiongen import Motion, MotionGenError, Skeleton, io
from motiongen import rotations as rot
from motiongen.mirror import counterparts
from tests.strategies import Array, generators, symmetric_motion

REFLECTION = np.array([-1.0, 1.0, 1.0])
# The rotations that take the axes of a frame to each other, and the reflections of single axes and of all three.
PERMUTATIONS = [np.roll(np.eye(3), shift, axis=0) for shift in range(3)]
FLIPS = [np.diag(signs) for signs in ([-1.0, 1, 1], [1.0, -1, 1], [1.0, 1, -1], [-1.0, -1, -1])]


def with_odd_axes(motion: Motion, rng: np.random.Generator) -> Motion:
    """The same movement on a rig whose bones' own axes point anywhere, mirrored between left and right."""
    skeleton = motion.skeleton
    pairs = counterparts(skeleton)
    world = np.diag(REFLECTION)
    bases: list[Array] = []  # of each joint's new frame in its old one
    for joint, pair in enumerate(pairs):
        if pair == joint:  # a frame that the mirror maps to itself: turned about x, its axes renamed
            turn = rot.to_matrix(rot.from_axis_angle(np.array([1.0, 0, 0]), rng.uniform(-3, 3)))
            bases.append(turn @ PERMUTATIONS[rng.integers(3)])
        elif pair > joint:
            bases.append(rot.to_matrix(rot.from_6d(rng.normal(size=6))))
        else:
            bases.append(world @ bases[pair] @ FLIPS[rng.integers(4)])
    above = [np.eye(3) if parent == -1 else bases[parent] for parent in skeleton.parents]
    offsets = np.stack([above[j].T @ skeleton.offsets[j] for j in range(len(skeleton))])
    matrices = rot.to_matrix(motion.rotations)
    turned = np.stack([above[j].T @ matrices[:, j] @ bases[j] for j in range(len(skeleton))], axis=1)
    moved = [motion.translations[:, m] @ above[j] for m, j in enumerate(motion.translating)]
    return motion.replace(
        skeleton=dataclasses.replace(skeleton, offsets=offsets),
        rotations=rot.from_matrix(turned),
        translations=np.stack(moved, axis=1) if moved else motion.translations,
    )


def reflected(motion: Motion) -> Array:
    """(T, J, 3) positions in a mirror, each joint's under its counterpart's index."""
    return motion.positions[:, list(counterparts(motion.skeleton))] * REFLECTION


@given(generators())
def test_positions_are_reflected_and_twice_is_the_same_motion(rng: np.random.Generator) -> None:
    for translating in ((0,), (), (0, 3), (1, 4)):
        motion = symmetric_motion(rng, translating=translating)
        mirrored = motion.mirror()
        assert_allclose(mirrored.positions, reflected(motion), rtol=0, atol=1e-9)
        assert mirrored.mirror().allclose(motion, tolerance=1e-7)
        assert (len(mirrored), mirrored.frame_rate) == (len(motion), motion.frame_rate)


@given(generators())
def test_bones_axes_do_not_matter(rng: np.random.Generator) -> None:
    motion = symmetric_motion(rng)
    odd = with_odd_axes(motion, rng)
    assert_allclose(odd.positions, motion.positions, rtol=0, atol=1e-9)
    assert_allclose(odd.mirror().positions, reflected(motion), rtol=0, atol=1e-9)
    assert odd.mirror().mirror().allclose(odd, tolerance=1e-6)


@given(generators())
def test_a_figure_that_stands_off_the_middle_is_reflected_too(rng: np.random.Generator) -> None:
    for translating in ((), (0,)):
        motion = symmetric_motion(rng, translating=translating).transform(shift=(3.0, 0.5, -2.0))
        assert_allclose(motion.mirror().positions, reflected(motion), rtol=0, atol=1e-9)


@given(generators())
def test_joint_order_does_not_matter(rng: np.random.Generator) -> None:
    """Right before left, or left limbs listed one after the other before any right one."""
    motion = symmetric_motion(rng)
    skeleton = motion.skeleton
    order = sorted(range(len(skeleton)), key=lambda j: (len(skeleton.ancestors(j)), rng.uniform()))
    place = {joint: index for index, joint in enumerate(order)}
    shuffled = Skeleton(
        tuple(skeleton.names[j] for j in order),
        tuple(-1 if skeleton.parents[j] == -1 else place[skeleton.parents[j]] for j in order),
        skeleton.offsets[order],
    )
    other = motion.replace(skeleton=shuffled, rotations=motion.rotations[:, order])
    assert_allclose(other.mirror().positions, motion.mirror().positions[:, order], rtol=0, atol=1e-9)


# -- who is whose counterpart


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("LeftArm", "RightArm"),
        ("arm_left", "arm_right"),
        ("LEFT_ARM", "RIGHT_ARM"),
        ("mixamorig:LeftArm", "mixamorig:RightArm"),
        ("arm_l", "arm_r"),
        ("upperarm_l_01", "upperarm_r_01"),
        ("hand.L", "hand.R"),
        ("thigh.L.001", "thigh.R.001"),
        ("Bip01 L Hand", "Bip01 R Hand"),
        ("L_Hip", "R_Hip"),
        ("LHipJoint", "RHipJoint"),
        ("lThigh", "rThigh"),
    ],
)
def test_sides_are_found_in_names(left: str, right: str) -> None:
    skeleton = Skeleton(("Pelvis", left, "Spine", right), (-1, 0, 0, 0), np.zeros((4, 3)))
    assert counterparts(skeleton) == (0, 3, 2, 1)


def test_names_without_sides_are_refused() -> None:
    for names in (("Pelvis", "Tail", "Leftover"), ("root", "Collar", "cLeft")):
        skeleton = Skeleton(names, (-1, 0, 0), np.zeros((3, 3)))
        with pytest.raises(MotionGenError, match="no joint names come in left and right pairs"):
            counterparts(skeleton)


def test_pairs_that_hang_from_different_places_are_refused() -> None:
    skeleton = Skeleton(("Pelvis", "Spine", "LeftArm", "RightArm"), (-1, 0, 0, 1), np.zeros((4, 3)))
    with pytest.raises(MotionGenError, match="joints 'LeftArm' and 'RightArm' do not hang from a pair of joints"):
        counterparts(skeleton)


def test_bones_that_are_no_mirror_images_are_refused() -> None:
    motion = symmetric_motion(np.random.default_rng(7))
    offsets = motion.skeleton.offsets.copy()
    offsets[motion.skeleton.index("LeftLower0")] = [0.3, 1.7, 0.2]
    lame = motion.replace(skeleton=dataclasses.replace(motion.skeleton, offsets=offsets))
    with pytest.raises(MotionGenError, match="below 'LeftUpper0' and 'RightUpper0' are no mirror images"):
        lame.mirror()


# -- real rigs

# The two rigs of most kinds, and how far their left and right bones differ from exact images, in heights.
RIGS = {
    "characters/Walk-In-Circle.bvh": 0.01,
    "characters/xia-normal-walk.bvh": 0.03,
    "characters/elephant-idle1.bvh": 0.05,
    "cmu/01_01.bvh": 0.03,
}


def hold_to_the_mirror(motion: Motion, lopsided: float) -> None:
    """Positions are reflected, twice is the same, and no bone is turned about itself to get there."""
    mirrored = motion.mirror()
    pairs, height = list(counterparts(motion.skeleton)), motion.skeleton.height
    apart = np.linalg.norm(mirrored.positions - reflected(motion), axis=-1) / height
    assert apart.max() < lopsided
    assert mirrored.mirror().allclose(motion)
    # A mean pose and its mirror image are both poses of this rig: each joint is turned about as its counterpart was.
    local = [j for j in range(len(pairs)) if j not in (*motion.skeleton.ancestors(motion.root), motion.root)]
    mean, mean_mirrored = (np.sum(rot.to_matrix(m.rotations), axis=0)[local] for m in (motion, mirrored))
    between = np.einsum("jab,jab->j", mean, mean_mirrored) / (
        np.linalg.norm(mean, axis=(1, 2)) * np.linalg.norm(mean_mirrored, axis=(1, 2))
    )  # 1: the same; -1/3: half a turn apart
    twisted = [motion.skeleton.names[j] for j, value in zip(local, between) if value < 0.35]
    assert twisted == []


@pytest.mark.parametrize("name", RIGS)
def test_real_rigs_are_mirrored_without_twists(shared_data: Path, name: str) -> None:
    clip = io.load(shared_data / name)
    step = max(1, len(clip) // 60)
    hold_to_the_mirror(clip[1::step], RIGS[name])
    # The same, looking another way: which way a figure walks is no part of its rig.
    quarter = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.pi / 2)
    hold_to_the_mirror(clip[1::step].transform(quarter), RIGS[name])


def test_walks_on_odd_bone_axes_keep_left_and_right(shared_data: Path, tmp_path: Path) -> None:
    """Bandai Namco's rig: bones lie along other axes on either side, and a still root stands above the hips."""
    archive = shared_data / "bandai-namco" / "dataset-1.tar.xz"
    if not archive.is_file():
        pytest.skip(f"real clips are not part of the project; there is no file {archive}")
    with tarfile.open(archive, mode="r|xz") as members:
        walks = (member for member in members if Path(member.name).name.startswith("dataset-1_walk_"))
        clips = []
        for member, _ in zip(walks, range(3)):
            content = members.extractfile(member)
            assert content is not None
            path = tmp_path / Path(member.name).name
            path.write_bytes(content.read())
            clips.append(io.load(path))
    assert len(clips) == 3
    for clip in clips:
        hold_to_the_mirror(clip[::3], 0.01)
        for motion in (clip, clip.mirror()):
            way = motion.root_positions[-1] - motion.root_positions[0]
            to_the_left = np.cross([0.0, 1.0, 0.0], way)
            left, right = (motion.positions[:, motion.skeleton.index(name)] for name in ("UpperLeg_L", "UpperLeg_R"))
            assert ((left - right) @ to_the_left > 0).mean() > 0.9
