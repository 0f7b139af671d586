"""Parts of characters on one skeleton: what is taken over must move as it did, whatever rig it came from."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motiongen import io
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.features import layout_of, to_features
from motiongen.motion import Motion
from motiongen.reassembly import Assembly, PartSource, assemble
from motiongen.reassembly.source import plain_name
from motiongen.skeleton import Skeleton
from motiongen.stance import facing, stance
from tests.puppets import load_clip
from tests.rigs import on_other_axes, strider
from tests.strategies import generators, motions, random_quaternions

Array = NDArray[np.float64]
UP = np.array([0.0, 1.0, 0.0])
LIMB = "RightUpper0"


def apart(a: Array, b: Array) -> float:
    """The largest angle between rotations, in radians."""
    return float(rot.angle_between(np.broadcast_to(a, b.shape), b).max())


def stranger(rng: np.random.Generator, motion: Motion, scale: float = 1.0, prefix: str = "") -> Motion:
    """The same movement of another size, elsewhere, on other axes and under other names."""
    moved = motion.scale(scale).transform(rot.from_axis_angle(UP, rng.uniform(-3, 3)), rng.normal(size=3))
    moved = on_other_axes(moved, random_quaternions(rng, len(motion.skeleton)))
    names = tuple(prefix + name for name in moved.skeleton.names)
    return moved.replace(skeleton=dataclasses.replace(moved.skeleton, names=names), name="stranger")


def real(shared_data: Path, name: str) -> Motion:
    return load_clip(shared_data / "characters" / f"{name}.bvh")


# -- one source


@given(motions(max_frames=3))
def test_a_body_alone_is_itself(motion: Motion) -> None:
    creature = assemble([PartSource(motion)])
    assert creature.skeleton == motion.skeleton
    assert creature.lift(motion, 0) == motion
    assert creature.parts[0].joints == tuple(range(len(motion.skeleton)))
    assert creature.parts[0].overlap == ()


@given(motions(max_frames=3), st.data())
def test_what_is_left_out_changes_nothing_else(motion: Motion, data: st.DataObject) -> None:
    skeleton = motion.skeleton
    free = [j for j in range(1, len(skeleton)) if motion.root not in skeleton.subtree(j)]
    gone = data.draw(st.sets(st.sampled_from(free))) if free else set()
    creature = assemble([PartSource(motion, without=[skeleton.names[j] for j in gone])])
    left = [j for j in range(len(skeleton)) if not {j, *skeleton.ancestors(j)} & gone]
    lifted = creature.lift(motion, 0)
    assert creature.skeleton.names == tuple(skeleton.names[j] for j in left)
    assert np.array_equal(lifted.rotations, motion.rotations[:, left])
    assert np.array_equal(lifted.positions, motion.positions[:, left])
    for joint in range(len(left)):  # a limb that is cut short keeps its last bone
        was_leaf = not skeleton.children[left[joint]]
        is_leaf = not creature.skeleton.children[joint]
        assert not is_leaf or was_leaf or joint in creature.skeleton.end_sites


# -- a part of another rig


@given(generators(), st.floats(0.01, 50.0))
def test_a_limb_of_ones_own_comes_back_through_any_rig(rng: np.random.Generator, scale: float) -> None:
    """The whole law: axes, size, unit, names, place and heading of the other character leave no trace."""
    motion = strider(rng, translating=(0,))
    other = stranger(rng, motion, scale, prefix="other:")
    part = PartSource(other, joints=f"other:{LIMB}", replaces=LIMB, scale=1 / scale)
    creature = assemble([PartSource(motion), part])
    places = [
        creature.skeleton.names.index(n if n in creature.skeleton.names else f"other:{n}")
        for n in motion.skeleton.names
    ]
    assert len(creature.skeleton) == len(motion.skeleton)
    played = creature.play()
    np.testing.assert_allclose(played.positions[:, places], motion.positions, atol=1e-7 * motion.skeleton.height)
    body = [j for j, place in enumerate(places) if place in creature.parts[0].joints]
    assert np.array_equal(creature.examples[0][0].rotations[:, [places[j] for j in body]], motion.rotations[:, body])


@given(generators())
def test_both_know_a_joint_alike_that_they_share(rng: np.random.Generator) -> None:
    """Where two characters are one, the overlap of the part moves as the body's own joints, and the other way round."""
    motion = strider(rng, translating=(0,))
    other = stranger(rng, motion)
    creature = assemble([PartSource(motion), PartSource(other, LIMB, replaces=LIMB, scale=1.0, overlap="*")])
    own, lifted = (clips[0] for clips in creature.examples)
    top = creature.skeleton.index(LIMB)
    assert creature.parts[0].overlap == (top,)
    shared = creature.parts[1].overlap
    assert len(shared) == len(motion.skeleton) - len(motion.skeleton.subtree(motion.skeleton.index(LIMB)))
    assert apart(own.rotations[:, top], lifted.rotations[:, top]) < 1e-6
    below = [j for j in shared if j != creature.root]
    assert apart(own.rotations[:, below], lifted.rotations[:, below]) < 1e-6
    turn = rot.multiply(own.rotations[:, 0], rot.inverse(lifted.rotations[:, 0]))  # the other one's heading
    assert apart(turn[:1], turn) < 1e-6
    assert apart(rot.heading(turn), turn) < 1e-6
    np.testing.assert_allclose(np.ptp(lifted.positions[:, 0, 1] - own.positions[:, 0, 1]), 0.0, atol=1e-9)


def test_a_root_for_the_root_under_a_joint_that_stands_still() -> None:
    """The other character's way is laid out in the frame of what stands above the creature's root."""
    rng = np.random.default_rng(8)
    body, guest = root_above_hips(), strider(rng, translating=(0,))
    tilted = rot.from_rotation_vector(np.array([0.4, -1.0, 0.2]))
    rotations = body.rotations.copy()
    rotations[:, 0] = tilted
    offsets = body.skeleton.offsets + np.eye(len(body.skeleton))[:, :1] * [1.0, 2.0, 3.0]
    body = body.replace(rotations=rotations, skeleton=dataclasses.replace(body.skeleton, offsets=offsets))
    creature = assemble([PartSource(body), PartSource(guest, LIMB, replaces=LIMB, overlap=["Hips"])])
    lifted, scale = creature.examples[1][0], creature.parts[1].scale
    assert creature.skeleton.names[creature.root] == "Hips"
    np.testing.assert_allclose(lifted.root_positions, scale * guest.root_positions, atol=1e-9)
    apart_by = rot.multiply(rot.inverse(guest.rotations[:, 0]), lifted.world_rotations[:, creature.root])
    assert apart(apart_by[:1], apart_by) < 1e-6  # other axes, and nothing else


@given(generators(), st.floats(-3.0, 3.0))
def test_a_mean_pose_of_any_source_is_the_mean_pose_of_the_creature(rng: np.random.Generator, angle: float) -> None:
    """What a joint's motion is measured against: the stance of one character maps to that of the other."""
    body, guest = strider(rng), stranger(rng, strider(rng))
    turn = rot.from_axis_angle(np.array([0.6, 0.0, 0.8]), angle)
    sources = [PartSource(body), PartSource(guest, LIMB, attach="Spine", rotation=turn, overlap="*")]
    creature = assemble(sources)
    for number, source in enumerate(sources):
        world = stance(source.examples)
        local = [
            world[j] if p == -1 else rot.multiply(rot.inverse(world[p]), world[j])
            for j, p in enumerate(source.skeleton.parents)
        ]
        pose = source.examples[0][0].replace(rotations=np.array(local)[None])
        known = [j for j in creature.parts[number].known if j != creature.root]
        assert apart(creature.stance[known], creature.lift(pose, number).rotations[0, known]) < 1e-6
    top = creature.skeleton.index(f"part2_{LIMB}")
    world = (
        creature.examples[0][0]
        .replace(
            rotations=creature.stance[None], translations=np.zeros((1, len(creature.examples[0][0].translating), 3))
        )
        .world_rotations[0]
    )
    frame = rot.multiply(rot.inverse(sources[0].rest_frame), sources[1].rest_frame)
    expected = rot.multiply(rot.multiply(turn, stance([guest])[guest.skeleton.index(LIMB)]), rot.inverse(frame))
    assert apart(expected, world[top]) < 1e-6


@given(generators(), st.floats(0.1, 10.0))
def test_a_part_keeps_its_shape_and_its_translations(rng: np.random.Generator, scale: float) -> None:
    body = strider(rng, translating=(0,))
    limb = [j for j, name in enumerate(body.skeleton.names) if name.startswith("Right")][:2]
    guest = stranger(rng, strider(rng, translating=(0, limb[1])))
    creature = assemble([PartSource(body), PartSource(guest, "Hips", attach="Head", scale=scale, without="Spine")])
    lifted = creature.examples[1][0]
    own = [j for j in range(len(guest.skeleton)) if creature.parts[1].joint_map[j] in creature.parts[1].joints]
    here = [creature.parts[1].joint_map[j] for j in own]
    gaps = [
        np.linalg.norm(p[:, :, None] - p[:, None], axis=-1)
        for p in (lifted.positions[:, here], guest.positions[:, own])
    ]
    np.testing.assert_allclose(gaps[0], scale * gaps[1], rtol=1e-9, atol=1e-9)


@given(generators(), st.floats(-3.0, 3.0))
def test_a_whole_character_on_another_ones_back_does_not_steer(rng: np.random.Generator, angle: float) -> None:
    """With its root it brings its lean, but neither its way nor its heading."""
    body, rider = strider(rng, translating=(0,)), strider(rng, translating=(0,))
    creature = assemble([PartSource(body), PartSource(rider, attach="Spine", prefix="rider_")])
    turned = rider.transform(rot.from_axis_angle(UP, angle), [5.0, 0.0, 1.0])
    a, b = creature.lift(rider, 1), creature.lift(turned, 1)
    assert apart(a.rotations, b.rotations) < 1e-6
    np.testing.assert_allclose(a.positions, b.positions, atol=1e-9)
    top = creature.skeleton.index("rider_Hips")
    np.testing.assert_allclose(creature.skeleton.offsets[top], 0.0)


def test_an_offset_is_seen_from_the_body() -> None:
    rng = np.random.default_rng(3)
    body = strider(rng, translating=(0,))
    creature = assemble([PartSource(body), PartSource(strider(rng), LIMB, attach="Spine", offset=(0.1, 0.2, 0.3))])
    pose = creature.examples[1][0]  # knows nothing of the body, which so stands in its mean pose, facing +z
    way = (
        pose.positions[:, creature.skeleton.index(f"part2_{LIMB}")]
        - pose.positions[:, creature.skeleton.index("Spine")]
    )
    np.testing.assert_allclose(way, np.tile([0.1, 0.2, 0.3], (len(pose), 1)), atol=1e-9)


# -- the books


@given(generators())
def test_every_joint_is_driven_once(rng: np.random.Generator) -> None:
    a, b, c = strider(rng), stranger(rng, strider(rng)), stranger(rng, strider(rng))
    creature = assemble(
        [
            PartSource(a),
            PartSource(b, LIMB, replaces=LIMB),
            PartSource(c, "Spine", attach="RightLower0", without="Head"),
        ]
    )
    driven = [joint for part in creature.parts for joint in part.joints]
    assert sorted(driven) == list(range(len(creature.skeleton)))
    for number, (part, source) in enumerate(zip(creature.parts, (a, b, c))):
        assert not set(part.joints) & set(part.overlap)
        mask = creature.known_mask(number)
        assert tuple(np.flatnonzero(mask)) == part.known == tuple(sorted(link.joint for link in part.links))
        assert sorted(u for u in part.joint_map if u >= 0) == list(part.known)
        assert len(part.joint_map) == len(source.skeleton)
        # What it does not know stands still.
        lifted = creature.examples[number][0]
        others = np.flatnonzero(~mask)
        assert np.array_equal(lifted.rotations[:, others], np.tile(creature.stance[others], (len(lifted), 1, 1)))
    kept = [name for name in creature.skeleton.names if name in a.skeleton.names and name != LIMB]
    assert kept == sorted(kept, key=creature.skeleton.names.index)


def test_rates_are_those_of_the_body() -> None:
    rng = np.random.default_rng(0)
    body, guest = strider(rng, frame_rate=30.0), strider(rng, frame_rate=120.0)
    creature = assemble([PartSource(body), PartSource(guest, LIMB, replaces=LIMB)])
    assert {clip.frame_rate for clips in creature.examples for clip in clips} == {30.0}
    assert len(creature.examples[1][0]) == 10
    joint = creature.skeleton.index(LIMB)
    assert apart(creature.lift(guest[::4], 1).rotations[:, joint], creature.examples[1][0].rotations[:, joint]) < 1e-9


def test_all_clips_have_one_layout_of_features_and_each_source_its_columns() -> None:
    rng = np.random.default_rng(1)
    body, guest = strider(rng, translating=(0,)), strider(rng, translating=(0, 4))
    creature = assemble([PartSource([body, body[5:20]]), PartSource(guest, LIMB, replaces=LIMB)])
    clips = [clip for clips in creature.examples for clip in clips]
    layout = layout_of(clips)
    assert layout.root == creature.root
    known = [set(layout.joint_features(part.known).tolist()) for part in creature.parts]
    assert known[0] | known[1] == set(range(layout.size))
    assert set(range(layout.root_steps.start, layout.root_height.stop)) <= known[0] - known[1]
    still = np.ptp(to_features(creature.examples[1][0], layout), axis=0)
    assert still[sorted(set(range(layout.size)) - known[1])].max() < 1e-12


def test_playing_repeats_every_part_at_its_own_length() -> None:
    rng = np.random.default_rng(2)
    body, guest = strider(rng, translating=(0,)), strider(rng)[:7]
    creature = assemble([PartSource(body), PartSource(guest, LIMB, replaces=LIMB)])
    played = creature.play(100)
    limb = list(creature.parts[1].joints)
    assert len(played) == 100
    assert apart(played.rotations[7:, limb], played.rotations[:-7, limb]) < 1e-9
    assert np.array_equal(played[:40].rotations[:, creature.root], creature.examples[0][0].rotations[:, creature.root])


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("mixamorig7:LeftArm", "arm_l"),
        ("Bip01_Spine2", "mixamorig:Spine2"),
        ("Bip01 L Forearm", "rig|lForearm"),
        ("BN_Tail_01", "Tail1"),
        ("Shoulder_R", "RightShoulder"),
    ],
)
def test_names_that_mean_the_same(one: str, other: str) -> None:
    assert plain_name(one) == plain_name(other)


@pytest.mark.parametrize(("one", "other"), [("LeftArm", "RightArm"), ("Spine1", "Spine2"), ("Head", "HeadTop_End")])
def test_names_that_do_not(one: str, other: str) -> None:
    assert plain_name(one) != plain_name(other)


# -- refused

GIVEN = strider(np.random.default_rng(5), translating=(0,), name="body")
GUEST = strider(np.random.default_rng(6), translating=(0,), name="guest")


def pair(**settings: Any) -> list[PartSource]:
    return [PartSource(GIVEN), PartSource(GUEST, **settings)]


def root_above_hips() -> Motion:
    """A figure whose hips carry it, under a root that stands still."""
    old = GUEST.skeleton
    skeleton = Skeleton(
        ("World", *old.names), (-1, *(p + 1 for p in old.parents)), np.concatenate([np.zeros((1, 3)), old.offsets])
    )
    rotations = np.concatenate([np.tile(rot.IDENTITY, (len(GUEST), 1, 1)), GUEST.rotations], axis=1)
    return GUEST.replace(skeleton=skeleton, rotations=rotations, translating=(1,), name="carried")


@pytest.mark.parametrize(
    ("sources", "words"),
    [
        (list, "at least one source"),
        (lambda: [PartSource([])], "at least one clip"),
        (lambda: [PartSource([GIVEN, GIVEN.scale(2.0)])], "another skeleton"),
        (lambda: [PartSource(GIVEN, attach="Head")], "the body: it takes no attach"),
        (lambda: [PartSource(GIVEN, without="Hips")], "no joint is left"),
        (lambda: [PartSource(GIVEN, joints="Spine")], "must keep its root 'Hips'"),
        (lambda: [PartSource(root_above_hips(), without="Hips")], "must keep its root 'Hips'"),
        (lambda: pair(joints=LIMB), "needs one of attach and replaces, none came"),
        (lambda: pair(joints=LIMB, attach="Head", replaces="Head"), "not both"),
        (lambda: pair(joints="RihgtUpper0", attach="Head"), "no joint matches 'RihgtUpper0'; did you mean 'RightUp"),
        (lambda: pair(joints=LIMB, attach="Haed"), "the body so far has no joint 'Haed'; did you mean 'Head'?"),
        (lambda: pair(joints=["LeftUpper0", LIMB], attach="Head"), "do not hang together"),
        (lambda: pair(joints=LIMB, replaces="Hips"), "cannot replace 'Hips'"),
        (lambda: pair(joints=LIMB, attach="Head", prefix=""), "the body has a joint"),
        (lambda: pair(joints=LIMB, attach="Head", scale=0.0), "positive number"),
        (lambda: pair(joints=LIMB, attach="Head", rotation=[0, 0, 0, 0]), "quaternion"),
        (lambda: pair(joints=LIMB, attach="Head", offset=[1, 2]), "shape"),
        (lambda: pair(joints=LIMB, attach="Head", overlap={"Spine": "Nowhere"}), "no joint 'Nowhere'"),
        (lambda: pair(joints=LIMB, attach="Head", overlap={LIMB: "Spine"}), "a joint of the part itself"),
        (lambda: pair(joints=LIMB, attach="Head", overlap={"Hips": "Spine"}), "only a root can stand for the root"),
        (lambda: pair(joints=LIMB, attach="Head", overlap={"Spine": "Hips"}), "only a root can stand for the root"),
        (
            lambda: pair(joints=LIMB, attach="Head", overlap={"Spine": "Head", "Head": "Head"}),
            "for which another joint stands already",
        ),
        (lambda: pair(joints=LIMB, replaces=LIMB, overlap={"Spine": "RightLower0"}), "which is replaced"),
        (lambda: pair(joints=LIMB, attach="Head", overlap=[LIMB]), "nothing in the body corresponds"),
        (
            lambda: [PartSource(GIVEN), PartSource(root_above_hips(), attach="Head")],
            "'World' only places its character in the world; take joints='Hips'",
        ),
        (
            lambda: [*pair(joints=LIMB, attach="p3", prefix="2"), PartSource(third(), "p3", attach="2RightLower0")],
            "but of this or a later part",
        ),
        (
            lambda: [*pair(joints=LIMB, attach="Head"), PartSource(GUEST, "LeftUpper0", replaces="Head", prefix="x")],
            "nothing is left of part 'guest'",
        ),
    ],
)  # fmt: skip
def test_nonsense_is_refused_in_one_line(sources: Callable[[], list[PartSource]], words: str) -> None:
    with pytest.raises(MotionGenError) as caught:
        assemble(sources())
    message = str(caught.value)
    assert words in message
    assert "\n" not in message


def third() -> Motion:
    names = tuple("p3" if name == "Spine" else name for name in GUEST.skeleton.names)
    return GUEST.replace(skeleton=dataclasses.replace(GUEST.skeleton, names=names))


def test_a_clip_of_someone_else_is_refused() -> None:
    creature = assemble(pair(joints=LIMB, attach="Head"))
    with pytest.raises(MotionGenError, match="is no clip of part 'guest'"):
        creature.lift(GUEST.scale(2.0), 1)


# -- real characters


@pytest.fixture(scope="module")
def elephant_man(shared_data: Path) -> Assembly:
    walk, elephant = real(shared_data, "Walk-In-Circle"), real(shared_data, "elephant-idle1")
    return assemble([PartSource(walk), PartSource(elephant, "Bip01_Head", replaces="mixamorig7:Head")])


def test_an_elephants_head_on_a_man(elephant_man: Assembly) -> None:
    skeleton, walk = elephant_man.skeleton, elephant_man.like
    played = elephant_man.play()
    assert len(skeleton) == 65 - 2 + 14
    assert [skeleton.names[j] for j in elephant_man.parts[1].overlap] == [
        f"mixamorig7:{name}" for name in ("Spine", "Spine1", "Spine2", "Neck")
    ]
    assert np.array_equal(played.root_positions, walk.root_positions)
    # It looks where the man goes, its trunk hangs down, and its ears are on their sides.
    front = rot.rotate(facing(played), np.array([0.0, 0.0, 1.0]))
    head, trunk, ear_left, ear_right = (
        played.positions[:, skeleton.index(name)] for name in ("Bip01_Head", "BN_Nose_04", "BN_Ear_L_01", "BN_Ear_R_01")
    )
    assert (np.sum((trunk - head) * front, axis=-1) > 10).all()
    assert ((trunk - head)[:, 1] < -30).all()
    assert (np.cross(front, ear_left - ear_right)[:, 1] > 20).all()


def test_a_creature_survives_its_file(elephant_man: Assembly, tmp_path: Path) -> None:
    played = elephant_man.play(50)
    io.save(played, tmp_path / "creature.bvh")
    assert io.load(tmp_path / "creature.bvh", up="y").allclose(played, 1e-5)


def test_an_arm_of_ones_own_from_a_rig_with_meaningless_axes(shared_data: Path) -> None:
    walk = real(shared_data, "Walk-In-Circle")[:200]
    other = stranger(np.random.default_rng(0), walk, 0.01)
    arm = "mixamorig7:RightArm"
    creature = assemble([PartSource(walk), PartSource(other, arm, replaces=arm, scale=100.0)])
    assert creature.skeleton.same_tree(walk.skeleton)
    np.testing.assert_allclose(creature.play().positions, walk.positions, atol=1e-6)
