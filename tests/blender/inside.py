"""Run by Blender's Python, not by pytest: a rig, its actions, and what the extension makes of them.

usage: inside.py FOLDER EXTENSION COMMAND

Leaves in FOLDER what was found: `found.json`, and `NAME.npz` with what Blender says of each motion.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

FRAMES = 120
START = 11
CASES = {
    # rotation, location, scale of the object; whether there are two roots
    "plain": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, False),
    "turned": ((0.3, -0.2, 1.1), (2.0, -1.0, 0.5), 0.01, False),
    "two_roots": ((math.pi / 2, 0.0, 0.4), (0.0, 3.0, 0.0), 2.5, True),
}


def make_rig(name: str) -> bpy.types.Object:
    """A small biped whose bones rest at odd angles, some connected, with all kinds of rotation modes."""
    rotation, location, scale, two_roots = CASES[name]
    unit = 1 / scale
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = armature.data.edit_bones

    def add(bone: str, head: tuple, tail: tuple, parent: str | None, roll: float, connect: bool = False) -> None:
        made = bones.new(bone)
        made.head, made.tail, made.roll = Vector(head) * unit, Vector(tail) * unit, roll
        if parent:
            made.parent, made.use_connect = bones[parent], connect

    add("Hips", (0, 0, 1.0), (0.05, 0.02, 1.15), None, 0.7)
    add("Spine", (0.05, 0.02, 1.15), (0, 0.1, 1.5), "Hips", -0.4, connect=True)
    add("Head", (0, 0.1, 1.5), (0, 0, 1.8), "Spine", 0.2, connect=True)
    for side, sign in (("L", 1), ("R", -1)):
        add(f"Arm.{side}", (0.2 * sign, 0.1, 1.45), (0.5 * sign, 0.05, 1.3), "Spine", 1.3 * sign)
        add(f"Hand.{side}", (0.5 * sign, 0.05, 1.3), (0.7 * sign, -0.1, 1.2), f"Arm.{side}", 0.3, connect=True)
        add(f"Leg.{side}", (0.12 * sign, 0, 0.95), (0.15 * sign, -0.05, 0.5), "Hips", 0.1 * sign)
        add(f"Foot.{side}", (0.15 * sign, -0.05, 0.5), (0.15 * sign, 0.0, 0.05), f"Leg.{side}", -0.9, connect=True)
    if two_roots:
        add('Prop "x"', (1, 1, 0), (1, 1.2, 0.1), None, 0.2)
    bpy.ops.object.mode_set(mode="OBJECT")
    for bone, mode in (("Spine", "XYZ"), ("Head", "ZXY"), ("Arm.L", "AXIS_ANGLE"), ("Leg.R", "YZX")):
        armature.pose.bones[bone].rotation_mode = mode
    armature.data.bones["Head"].use_inherit_rotation = not two_roots
    armature.data.bones["Arm.R"].use_local_location = not two_roots
    armature.matrix_world = Matrix.LocRotScale(Vector(location), Euler(rotation), Vector((scale,) * 3))
    bpy.context.view_layer.update()
    return armature


def animate(armature: bpy.types.Object, speed: float = 1.0) -> bpy.types.Action:
    """Key every bone now and then: smooth and different for each."""
    unit = 1 / armature.matrix_world.to_scale()[0]
    for frame in range(START, START + FRAMES, 7):
        for number, bone in enumerate(armature.pose.bones):
            phase = speed * frame / 9 + number
            turn = Euler((0.5 * math.sin(phase), 0.4 * math.cos(phase * 1.3), 0.3 * math.sin(phase * 0.7)))
            channel = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(
                bone.rotation_mode, "rotation_euler"
            )
            if channel == "rotation_quaternion":
                bone.rotation_quaternion = turn.to_quaternion()
            elif channel == "rotation_axis_angle":
                axis, angle = turn.to_quaternion().to_axis_angle()
                bone.rotation_axis_angle = (angle, *axis)
            else:
                bone.rotation_euler = turn.to_quaternion().to_euler(bone.rotation_mode)
            bone.keyframe_insert(channel, frame=frame)
            if bone.name in ("Hips", "Arm.R"):
                at = Vector((frame * 0.01, 0.05 * math.sin(phase), 0.04 * math.cos(phase)))
                bone.location = at * unit * (1.0 if bone.name == "Hips" else 0.3)
                bone.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(START)
    return armature.animation_data.action


def seen(armature: bpy.types.Object, frames: int) -> np.ndarray:
    """(T, J, 3) where Blender itself has the heads of all bones, in the world with z up."""
    found = []
    for frame in range(START, START + frames):
        bpy.context.scene.frame_set(frame)
        found.append([list(armature.matrix_world @ bone.head) for bone in armature.pose.bones])
    return np.array(found)


def state(armature: bpy.types.Object) -> list[Any]:
    """What must stay as it is."""
    rest = [[list(row) for row in bone.matrix_local] for bone in armature.data.bones]
    return [[list(row) for row in armature.matrix_world], [bone.name for bone in armature.data.bones], rest]


def compare(name: str, folder: Path, rigs: Any, operators: Any) -> dict[str, Any]:
    """Read, write back, generate: what Blender says of each, and what went over the pipe."""
    armature = make_rig(name)
    action = animate(armature)
    sent = rigs.motion_of(armature, action, 30.0)
    before, example = state(armature), seen(armature, FRAMES)
    rigs.assign(armature, rigs.action_of(armature, sent, "back", START, 30.0))
    returned = seen(armature, FRAMES)
    rigs.assign(armature, action)
    settings = bpy.context.scene.motiongen
    settings.frames, settings.count, settings.seed, settings.loop = 90, 2, 3, name == "plain"
    answers = generate(operators)
    np.savez(folder / f"{name}.npz", example=example, returned=returned, made=seen(armature, 90))
    made = armature.animation_data.action
    return {
        "unchanged": state(armature) == before and action.name in bpy.data.actions,
        "is_new": made != action,
        "bones": [bone.name for bone in armature.pose.bones],
        "range": list(made.frame_range),
        "sent": sent,
        "answers": answers,
    }


def generate(operators: Any) -> list[dict[str, Any]]:
    """Press the button; returns the motions that the worker sent."""
    answers = []
    make = operators.rigs.action_of

    def noting(armature: bpy.types.Object, motion: dict[str, Any], *rest: Any) -> bpy.types.Action:
        answers.append(motion)
        return make(armature, motion, *rest)

    operators.rigs.action_of = noting
    try:
        assert bpy.ops.motiongen.generate() == {"FINISHED"}, bpy.context.window_manager.motiongen.message
    finally:
        operators.rigs.action_of = make
    return answers


def hold(rigs: Any, operators: Any) -> dict[str, Any]:
    """Keys, kept bones and a segment of one rig."""
    armature, scene = make_rig("turned"), bpy.context.scene
    action, settings = animate(armature), scene.motiongen
    sent = rigs.motion_of(armature, action, 30.0)
    settings.frames, settings.count, settings.loop = 0, 1, False
    for curve in rigs.curves_of(action, armature):
        for point in curve.keyframe_points:
            point.select_control_point = round(point.co[0]) in (START + 14, START + 70)
    for bone in armature.pose.bones:  # since 5.0 it is the pose that knows
        (bone if hasattr(bone, "select") else bone.bone).select = bone.name in ("Arm.L", "Hand.L")
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, START + 40, START + 69
    held = {"sent": sent}
    armature.animation_data.action = None
    other = animate(armature, speed=1.7)  # what is made is like this one, what is held is of the first
    assert bpy.ops.motiongen.add_example() == {"FINISHED"}
    assert other != action
    for name in ("use_keys", "keep_bones", "use_segment"):
        rigs.assign(armature, action)
        settings.frames = 100 if name == "use_keys" else 0
        setattr(settings, name, True)
        held[name] = generate(operators)[0]
        setattr(settings, name, False)
    assert bpy.ops.motiongen.remove_example() == {"FINISHED"}
    rigs.assign(armature, action)
    return held


def cancel(operators: Any) -> dict[str, Any]:
    """Cancel as soon as there is progress, and see that the next request is answered."""
    run, settings = bpy.context.window_manager.motiongen, bpy.context.scene.motiongen
    settings.frames, settings.count = 1000, 100
    worker = operators.worker_of(bpy.context)
    poll = worker.poll

    def impatient(timeout: float = 0.0) -> list[dict[str, Any]]:
        messages = poll(timeout)
        run.cancel = run.cancel or any(message["type"] == "progress" for message in messages)
        return messages

    worker.poll = impatient
    actions = len(bpy.data.actions)
    ended = bpy.ops.motiongen.generate()
    worker.poll = poll
    found = {"ended": list(ended), "message": run.message, "new_actions": len(bpy.data.actions) - actions}
    settings.frames, settings.count = 60, 1
    found["afterwards"] = len(generate(operators))
    return found


def undo(operators: Any) -> dict[str, Any]:
    """Generate as a person does, and take it back."""
    name = bpy.context.object.name
    action = bpy.context.object.animation_data.action.name
    actions = len(bpy.data.actions)
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.motiongen.generate("EXEC_DEFAULT", True) == {"FINISHED"}
    made = len(bpy.data.actions) - actions
    bpy.ops.ed.undo()
    again = bpy.data.objects[name].animation_data.action.name
    return {"made": made, "left": len(bpy.data.actions) - actions, "same": again == action}


def main(folder: Path, extension: Path, command: str) -> None:
    """Everything, into the folder."""
    sys.path[:0] = [str(extension.parent), str(Path(__file__).parent)]
    import by_hand
    import motiongen_blender
    from motiongen_blender import armature as rigs
    from motiongen_blender import operators, panel

    motiongen_blender.register()
    operators.find_command = lambda chosen: command
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.0
    assert bpy.ops.motiongen.refresh() == {"FINISHED"}
    found = {
        "options": [option.name for option in scene.motiongen.options if option.generator == "genmm"],
        "cases": {name: compare(name, folder, rigs, operators) for name in CASES},
        "hold": hold(rigs, operators),
        "cancel": cancel(operators),
        "undo": undo(operators),
        "panels": by_hand.panels(panel),
        "presses": by_hand.presses(operators),
    }
    motiongen_blender.unregister()
    found["left"] = [name for name in ("Scene", "WindowManager") if hasattr(getattr(bpy.types, name), "motiongen")]
    (folder / "found.json").write_text(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
