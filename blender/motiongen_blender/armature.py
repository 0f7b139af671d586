"""Between an armature's actions and motions.

A motion's joints have the world's axes at rest, y up. A bone has axes of its own, in an armature that may be turned and
scaled. So a joint's frame is the bone's, turned by its rest rotation, and lengths are the world's:

    world rotation of the joint = C P R^-1 C^-1

with P the rotation of the posed bone and R that of the resting one, both in the armature's space, and C the armature's
rotation in the world followed by the turn that brings z up to y up.

Bones move as they are keyed: bone constraints, drivers and keys of scale are not looked at.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

from . import frames as fr

Z_TO_Y_UP = np.array([-math.sin(math.pi / 4), 0.0, 0.0, math.cos(math.pi / 4)])
LINEAR = 1
STILL = 1e-5
"""A bone that moves less than this many heights in its parent's frame does not translate."""


class RigError(Exception):
    """What cannot be done with this armature; says why."""


@dataclass(frozen=True)
class Rig:
    """An armature object as a skeleton.

    Attributes:
        bones: parents before children.
        names: of the joints: those of the bones, after a still root where several bones have no parent.
        parents: index of each joint's parent, -1 for the first.
        rest: (J, 4) rotation of each joint's bone at rest, in the armature's space.
        turn: C above.
        scale: of lengths in the armature's space to those in the world.
        place: (3,) the armature's origin in the world, y up.
        offsets: (J, 3) rest position of each joint in its parent's frame, in the world's lengths.
    """

    bones: list[bpy.types.Bone]
    names: list[str]
    parents: list[int]
    rest: np.ndarray
    turn: np.ndarray
    scale: float
    place: np.ndarray
    offsets: np.ndarray

    @property
    def first(self) -> int:
        """The joint of the first bone: 1 under a still root."""
        return len(self.names) - len(self.bones)

    @property
    def height(self) -> float:
        """The longest side of the resting joints' bounding box."""
        return fr.height(self.parents, self.offsets)


def rig_of(armature: bpy.types.Object) -> Rig:
    """The skeleton of an armature object, where it stands now.

    Raises:
        RigError: if it has no bones, or is squashed flat or mirrored.
    """
    bones = sorted_bones(armature.data.bones)
    if not bones:
        raise RigError(f"'{armature.name}' has no bones")
    place, rotation, scale = armature.matrix_world.decompose()
    if min(scale) <= 0:
        raise RigError(f"'{armature.name}' has a scale of {tuple(scale)}; apply it first (Object > Apply > Scale)")
    names, parents = [bone.name for bone in bones], []
    several = sum(bone.parent is None for bone in bones) > 1
    if several:
        taken = set(names)
        root = next(name for name in _numbered(armature.name) if name not in taken)
        names, parents = [root, *names], [-1]
    index = {name: joint for joint, name in enumerate(names)}
    for bone in bones:
        parents.append(index[bone.parent.name] if bone.parent else (0 if several else -1))
    turn = fr.multiply(Z_TO_Y_UP, _xyzw(rotation))
    factor = float(np.prod(scale)) ** (1 / 3)
    rest = [[0.0, 0.0, 0.0, 1.0]] * several + [_xyzw(bone.matrix_local.to_quaternion()) for bone in bones]
    heads = np.array([[0.0, 0.0, 0.0]] * several + [list(bone.head_local) for bone in bones])
    origin = fr.rotate(Z_TO_Y_UP, np.array(place))
    world = fr.rotate(turn, heads) * factor + origin
    offsets = np.array([world[j] - (world[p] if p >= 0 else 0.0) for j, p in enumerate(parents)])
    return Rig(bones, names, parents, np.array(rest), turn, factor, origin, offsets)


def sorted_bones(bones: Iterable[bpy.types.Bone]) -> list[bpy.types.Bone]:
    """Parents before children, in the armature's own order otherwise."""
    pending, ordered = [bone for bone in bones if bone.parent is None], []
    while pending:
        bone = pending.pop(0)
        ordered.append(bone)
        pending = [*bone.children, *pending]
    return ordered


# -- reading


def motion_of(armature: bpy.types.Object, action: bpy.types.Action, frame_rate: float) -> dict[str, Any]:
    """An action as a motion for the worker, one frame for each whole frame of its range."""
    rig = rig_of(armature)
    first, last = frame_range(action)
    curves = {(curve.data_path, curve.array_index): curve for curve in curves_of(action, armature)}
    times = range(first, last + 1)
    posed = _posed(armature, rig, curves, times)
    rotations = np.empty((len(times), len(rig.names), 4))
    positions = np.empty((len(times), len(rig.names), 3))
    rotations[:, : rig.first], positions[:, : rig.first] = [0.0, 0.0, 0.0, 1.0], 0.0
    for time, matrices in enumerate(posed):
        for joint, matrix in enumerate(matrices, start=rig.first):
            rotations[time, joint] = _xyzw(matrix.to_quaternion())
            positions[time, joint] = matrix.translation
    world = fr.multiply(fr.multiply(rig.turn, rotations), fr.inverse(fr.multiply(rig.turn, rig.rest)))
    where = fr.rotate(rig.turn, positions) * rig.scale + rig.place
    local, moved = fr.to_local(rig.parents, world, where)
    apart = np.abs(moved - rig.offsets).max(axis=(0, 2))
    translating = [j for j in range(len(rig.names)) if j == rig.first or apart[j] > STILL * rig.height]
    ends = [j for j in range(rig.first, len(rig.names)) if j not in rig.parents]
    tips = [rig.bones[j - rig.first].tail_local - rig.bones[j - rig.first].head_local for j in ends]
    return {
        "name": action.name,
        "unit": None,
        "frame_rate": frame_rate,
        "names": rig.names,
        "parents": rig.parents,
        "offsets": fr.encode(rig.offsets),
        "end_sites": ends,
        "end_site_offsets": fr.encode(fr.rotate(rig.turn, np.array(tips).reshape(-1, 3)) * rig.scale),
        "rotations": fr.encode(local),
        "translating": translating,
        "translations": fr.encode(moved[:, translating]),
    }


def frame_range(action: bpy.types.Action) -> tuple[int, int]:
    """The first and the last whole frame of an action."""
    first, last = action.frame_range
    return math.floor(first + 0.5), math.floor(last + 0.5)


def _posed(armature: bpy.types.Object, rig: Rig, curves: dict, times: Sequence[int]) -> list[list[Matrix]]:
    """The matrices of all bones in the armature's space, frame by frame."""
    bases = [_bases(armature.pose.bones[bone.name], curves, times) for bone in rig.bones]
    posed = []
    for time in range(len(times)):
        matrices: list[Matrix] = []
        for number, bone in enumerate(rig.bones):
            above = rig.parents[number + rig.first] - rig.first
            matrices.append(_through(bone, bases[number][time], matrices[above] if bone.parent else None))
        posed.append(matrices)
    return posed


def _through(bone: bpy.types.Bone, matrix: Matrix, parent: Matrix | None, invert: bool = False) -> Matrix:
    """A bone's own matrix to the armature's space, as its settings of inheritance say, or back."""
    above = {} if parent is None else {"parent_matrix": parent, "parent_matrix_local": bone.parent.matrix_local}
    return bone.convert_local_to_pose(matrix, bone.matrix_local, **above, invert=invert)


def _bases(bone: bpy.types.PoseBone, curves: dict, times: Sequence[int]) -> list[Matrix]:
    """What a bone does by itself: keyed where it is, else as it stands."""
    prefix = f'pose.bones["{bpy.utils.escape_identifier(bone.name)}"]'

    def values(name: str) -> list[Sequence[float]]:
        channels = []
        for axis, still in enumerate(getattr(bone, name)):
            curve = curves.get((f"{prefix}.{name}", axis))
            channels.append([curve.evaluate(time) for time in times] if curve else itertools.repeat(still, len(times)))
        return list(zip(*channels))

    rotations = [_quaternion(bone.rotation_mode, each) for each in values(rotation_channel(bone))]
    return [Matrix.LocRotScale(Vector(at), turn, None) for at, turn in zip(values("location"), rotations)]


def rotation_channel(bone: bpy.types.PoseBone) -> str:
    """The property that holds a bone's rotation."""
    named = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    return named.get(bone.rotation_mode, "rotation_euler")


def _quaternion(mode: str, values: Sequence[float]) -> Quaternion:
    if mode == "QUATERNION":
        return Quaternion(values).normalized()
    if mode == "AXIS_ANGLE":
        return Quaternion(values[1:], values[0])
    return Euler(values, mode).to_quaternion()


def selected_keys(action: bpy.types.Action, armature: bpy.types.Object) -> list[int]:
    """The whole frames within the action at which a keyframe is selected."""
    first, last = frame_range(action)
    points = (point for curve in curves_of(action, armature) for point in curve.keyframe_points)
    frames = {round(point.co[0]) for point in points if point.select_control_point}
    return sorted(frame for frame in frames if first <= frame <= last)


def selected_bones(armature: bpy.types.Object) -> list[str]:
    """The names of the bones that are selected in pose mode."""
    # Since 5.0 it is the pose that knows.
    return [bone.name for bone in armature.pose.bones if (bone if hasattr(bone, "select") else bone.bone).select]


# -- writing


def action_of(
    armature: bpy.types.Object, motion: dict[str, Any], name: str, start: float, scene_rate: float
) -> bpy.types.Action:
    """A new action that moves the armature's bones as the motion does, from frame `start` on.

    Raises:
        RigError: if the motion's joints are not the armature's.
    """
    rig = rig_of(armature)
    if motion["names"] != rig.names or motion["parents"] != rig.parents:
        other = next((n for n in motion["names"] if n not in rig.names), motion["names"][0])
        raise RigError(
            f"the motion is of another skeleton than '{armature.name}' (joint '{other}'); a trained generator makes "
            "motions on the skeleton that it was trained on only"
        )
    world, where = fr.to_world(rig.parents, fr.decode(motion["rotations"]), fr.local_translations(motion, rig.offsets))
    turned = fr.multiply(fr.multiply(fr.inverse(rig.turn), world), fr.multiply(rig.turn, rig.rest))
    heads = fr.rotate(fr.inverse(rig.turn), (where - rig.place) / rig.scale)
    times = start + np.arange(len(world)) * scene_rate / motion["frame_rate"]
    action, curves = _new_action(armature, name)
    posed: list[list[Matrix]] = []
    for number, bone in enumerate(rig.bones):
        joint = number + rig.first
        above = posed[rig.parents[joint] - rig.first] if bone.parent else itertools.repeat(None)
        poses = [
            Matrix.LocRotScale(Vector(head), Quaternion((turn[3], *turn[:3])), None)
            for head, turn in zip(heads[:, joint], turned[:, joint])
        ]
        bases = [_through(bone, pose, parent, invert=True) for pose, parent in zip(poses, above)]
        posed.append(poses)
        _key_bone(curves, armature.pose.bones[bone.name], bases, times, joint in motion["translating"])
    return action


def _key_bone(curves: Any, bone: bpy.types.PoseBone, bases: list[Matrix], times: np.ndarray, moves: bool) -> None:
    """Key a bone's rotation, and its location where it moves."""
    prefix = f'pose.bones["{bpy.utils.escape_identifier(bone.name)}"]'
    if moves and not (bone.bone.use_connect and bone.parent):
        _key(curves, f"{prefix}.location", np.array([base.translation for base in bases]), times, bone.name)
    rotations = _in_mode(bone.rotation_mode, [base.to_quaternion() for base in bases])
    _key(curves, f"{prefix}.{rotation_channel(bone)}", rotations, times, bone.name)


def _in_mode(mode: str, rotations: list[Quaternion]) -> np.ndarray:
    """Rotations as a bone's rotation mode has them, (T, 3 or 4), without jumps."""
    signed = [Quaternion(q) for q in fr.continuous(np.array(rotations))]
    if mode == "QUATERNION":
        return np.array(signed)
    if mode == "AXIS_ANGLE":
        return np.array([(q.angle, *q.axis) for q in signed])
    angles = [signed[0].to_euler(mode)]
    for each in signed[1:]:
        angles.append(each.to_euler(mode, angles[-1]))
    return np.array(angles)


def _key(curves: Any, path: str, values: np.ndarray, times: np.ndarray, group: str) -> None:
    for axis, channel in enumerate(values.T):
        curve = curves.new(path, index=axis)
        curve.keyframe_points.add(len(times))
        curve.keyframe_points.foreach_set("co", np.stack([times, channel], axis=1).ravel())
        curve.keyframe_points.foreach_set("interpolation", [LINEAR] * len(times))
        curve.update()


# -- actions of Blender 4.2 to 4.3, and those with slots from 4.4 on


def curves_of(action: bpy.types.Action, armature: bpy.types.Object) -> list[bpy.types.FCurve]:
    """The curves of an action that move this armature."""
    if not hasattr(action, "slots"):
        return list(action.fcurves)
    slot = slot_of(action, armature)
    bags = [strip.channelbag(slot) for layer in action.layers for strip in layer.strips] if slot else []
    return [curve for bag in bags if bag for curve in bag.fcurves]


def slot_of(action: bpy.types.Action, armature: bpy.types.Object) -> Any:
    """The slot of an action that moves this armature: the one in use, else the first for objects."""
    data = armature.animation_data
    if data and data.action == action and data.action_slot:
        return data.action_slot
    return next((slot for slot in action.slots if slot.target_id_type in ("OBJECT", "UNSPECIFIED")), None)


def _new_action(armature: bpy.types.Object, name: str) -> tuple[bpy.types.Action, Any]:
    """An empty action that is kept though nobody uses it, and where its curves go."""
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    if not hasattr(action, "slots"):
        return action, action.fcurves
    slot = action.slots.new(id_type="OBJECT", name=armature.name)
    strip = action.layers.new("Layer").strips.new(type="KEYFRAME")
    return action, strip.channelbag(slot, ensure=True).fcurves


def assign(armature: bpy.types.Object, action: bpy.types.Action) -> None:
    """Let the armature move as the action says."""
    data = armature.animation_data or armature.animation_data_create()
    data.action = action
    if hasattr(action, "slots"):
        data.action_slot = slot_of(action, armature)


def _xyzw(quaternion: Quaternion) -> np.ndarray:
    return np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w])


def _numbered(name: str) -> Iterable[str]:
    return itertools.chain([name], (f"{name}.{number}" for number in itertools.count(1)))
