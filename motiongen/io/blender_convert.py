"""Runs inside Blender: the armature of an FBX file to GLB, or that of a GLB file to FBX.

Arguments: the file to read, the file to write, the frame rate.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path


def convert(source: Path, target: Path, rate: float) -> None:
    """Import one file and export the other; `rate` 0 keeps the imported file's own."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    if rate:
        scene.render.fps, scene.render.fps_base = round(rate), 1.0
    if source.suffix.lower() == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(source), ignore_leaf_bones=False, automatic_bone_orientation=False)
    else:
        bpy.ops.import_scene.gltf(filepath=str(source))
    for each in list(bpy.data.objects):  # meshes, and the shapes that the importer gives to bones
        if each.type != "ARMATURE":
            bpy.data.objects.remove(each)
    kept = {each.animation_data.action for each in bpy.data.objects if each.animation_data}
    for action in list(bpy.data.actions):
        if action not in kept:
            bpy.data.actions.remove(action)
    ranges = [action.frame_range for action in bpy.data.actions]
    if ranges:
        scene.frame_start = round(min(first for first, _ in ranges))
        scene.frame_end = round(max(last for _, last in ranges))
    if target.suffix.lower() == ".glb":
        bpy.ops.export_scene.gltf(
            filepath=str(target), export_format="GLB", export_force_sampling=True, export_optimize_animation_size=False
        )
    else:
        bpy.ops.export_scene.fbx(
            filepath=str(target), object_types={"ARMATURE"}, add_leaf_bones=False,
            bake_anim_simplify_factor=0.0, bake_anim_use_all_actions=False,
            bake_anim_use_nla_strips=False, bake_anim_force_startend_keying=True,
        )  # fmt: skip


def leave() -> None:
    """End a Python that has imported Blender: at its usual end the package of Blender 4.2 and 4.3 crashes."""
    import bpy

    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    inside_program = "--" in sys.argv
    given = sys.argv[sys.argv.index("--") + 1 :] if inside_program else sys.argv[1:]
    convert(Path(given[0]), Path(given[1]), float(given[2]))
    if not inside_program:
        leave()
