"""Writes GLB files: a skeleton with a mesh of bones, or a new animation in the file that a clip came from."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np

from motiongen import rotations as rot
from motiongen.io.glb.bones import bone_mesh
from motiongen.io.glb.container import ARRAY_BUFFER, Container
from motiongen.io.glb.layout import Array, GlbLayout
from motiongen.motion import METRES_PER_UNIT, Motion

SAME_RATE = 1e-4
"""Frame rates this near to a whole number (a share of it) become it: 0.016667 s a frame is meant as 60 Hz."""

END_SITE = "motiongen_end_site"
"""Marks nodes that are the tips of last bones."""

UNKNOWN_UNIT = "motiongen_unit_unknown"
"""Marks files whose lengths are not in metres, as they should be, because nobody knows what they are in."""

BONE = {"baseColorFactor": [0.8, 0.55, 0.3, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7}
"""What bones are made of: dull, light brown."""


def write_glb(motion: Motion, path: Path) -> None:
    """Write a GLB file (see `motiongen.io.save`): y up, in metres where the unit is known.

    A motion whose file layout is a GLB file's is put into that file as its first animation: meshes, materials and all
    else stay as they were, in the size that they have there.
    """
    layout = motion.file_layout
    if isinstance(layout, GlbLayout) and len(layout.nodes) == len(motion.skeleton):
        container = Container(copy.deepcopy(layout.document), bytearray(layout.binary))
        rotations = layout.rotations_to_nodes(motion.rotations)
        grown = motion.skeleton.height / layout.height if layout.height else 1.0  # in another unit, or made larger
        translations = layout.translations_to_nodes(motion.translations / grown, motion.translating)
        nodes = layout.nodes
    else:
        in_metres = motion if motion.unit is None else motion.scale(METRES_PER_UNIT[motion.unit], "m")
        container = _new_document(in_metres)
        rotations, translations = in_metres.rotations, in_metres.translations
        nodes = tuple(range(len(motion.skeleton)))
    _add_animation(container, motion, nodes, rotations, translations)
    container.save(path)


def _add_animation(
    container: Container, motion: Motion, nodes: tuple[int, ...], rotations: Array, translations: Array
) -> None:
    times = container.add(np.arange(len(motion)) / _rate(motion.frame_rate), bounds=True)
    animation: dict[str, Any] = {"name": motion.name, "samplers": [], "channels": []}

    def animate(node: int, path: str, values: Array) -> None:
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": {"node": node, "path": path}})
        sampler = {"input": times, "output": container.add(values), "interpolation": "LINEAR"}
        animation["samplers"].append(sampler)

    for joint, turning in enumerate(np.moveaxis(rot.continuous(rotations), 1, 0)):
        animate(nodes[joint], "rotation", turning)
    for joint, moving in zip(motion.translating, np.moveaxis(translations, 1, 0)):
        animate(nodes[joint], "translation", moving)
    container.document.setdefault("animations", []).insert(0, animation)


def _rate(frame_rate: float) -> float:
    whole = round(frame_rate)
    return float(whole) if whole and abs(frame_rate - whole) < SAME_RATE * whole else frame_rate


def _new_document(motion: Motion) -> Container:
    """A scene with the skeleton at rest and a mesh of bones that follows it."""
    from motiongen import __version__

    skeleton = motion.skeleton
    joints = len(skeleton)
    nodes: list[dict[str, Any]] = [
        {"name": name, "translation": offset.tolist()} for name, offset in zip(skeleton.names, skeleton.offsets)
    ]
    hanging = [list(children) for children in skeleton.children]
    for joint, tip in zip(skeleton.end_sites, skeleton.end_site_offsets):
        hanging[joint].append(len(nodes))
        name = f"{skeleton.names[joint]}_end"
        nodes.append({"name": name, "translation": tip.tolist(), "extras": {END_SITE: True}})
    for node, children in zip(nodes, hanging):
        if children:
            node["children"] = children
    nodes.append({"name": f"{motion.name} bones", "mesh": 0, "skin": 0})
    container = Container(
        {
            "asset": {
                "version": "2.0",
                "generator": f"motiongen {__version__}",
                **({"extras": {UNKNOWN_UNIT: True}} if motion.unit is None else {}),
            },
            "scene": 0,
            "scenes": [{"name": motion.name, "nodes": [0, len(nodes) - 1]}],
            "nodes": nodes,
            "buffers": [{}],
            "materials": [{"name": "bone", "pbrMetallicRoughness": BONE}],
        },
        bytearray(),
    )
    positions, normals, owners = bone_mesh(skeleton)
    binding = np.tile(np.eye(4), (joints, 1, 1))
    binding[:, 3, :3] = -skeleton.rest_positions  # a column-major matrix that undoes the rest position
    moved_with = np.zeros((len(owners), 4))
    moved_with[:, 0] = owners
    attributes = {
        "POSITION": container.add(positions, target=ARRAY_BUFFER, bounds=True),
        "NORMAL": container.add(normals, target=ARRAY_BUFFER),
        "JOINTS_0": container.add(moved_with, "<u2", target=ARRAY_BUFFER),
        "WEIGHTS_0": container.add(np.tile([1.0, 0.0, 0.0, 0.0], (len(owners), 1)), target=ARRAY_BUFFER),
    }
    container.document["meshes"] = [{"name": "bones", "primitives": [{"attributes": attributes, "material": 0}]}]
    container.document["skins"] = [
        {
            "name": motion.name,
            "joints": list(range(joints)),
            "skeleton": 0,
            "inverseBindMatrices": container.add(binding.reshape(joints, 16)),
        }
    ]
    return container
