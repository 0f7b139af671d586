"""Runs inside Blender: imports files and writes where their bones are at every frame, as JSON.

python import_files.py OUT.json FILE:RATE:SCALE ...
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy


def places(path: Path, rate: int, scale: float) -> dict[str, list[list[float]]]:
    """Heads of the bones in the world, z up, by name: one for each frame."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = rate
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    else:
        bpy.ops.import_anim.bvh(filepath=str(path), global_scale=scale, rotate_mode="NATIVE")
    armature = next(each for each in bpy.data.objects if each.type == "ARMATURE")
    first, last = map(round, armature.animation_data.action.frame_range)
    found: dict[str, list[list[float]]] = {bone.name: [] for bone in armature.pose.bones}
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        for bone in posed.pose.bones:
            found[bone.name].append(list(posed.matrix_world @ bone.head))
    return found


if __name__ == "__main__":
    out, *files = sys.argv[1:]
    result = {}
    for given in files:
        name, rate, scale = given.rsplit(":", 2)
        result[name] = places(Path(name), int(rate), float(scale))
    Path(out).write_text(json.dumps(result))
