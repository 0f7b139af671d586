"""Reads the animated skeleton of a GLB file, whichever program wrote it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.io.glb.container import Container, DamageError, read_container
from motiongen.io.glb.layout import Array, GlbLayout
from motiongen.io.glb.writer import END_SITE, SAME_RATE, UNKNOWN_UNIT
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

UNEVEN = 1e-3
"""Scales of a node's axes that differ by less than this share are one."""

STILL = 1e-6
"""A node whose translation moves by less than this share of the skeleton's height does not move."""

MOST_FRAMES = 1_000_000
MOST_POSES = 10_000_000
"""Frames times joints of a file that has not as many bytes: few keys can span any time."""


@dataclass(frozen=True)
class Track:
    """How a property of a node moves.

    Attributes:
        times: (N,) of the keys, in seconds.
        values: (N, width), or (3 N, width) for cubic splines.
        interpolation: LINEAR, STEP or CUBICSPLINE.
    """

    times: Array
    values: Array
    interpolation: str


@dataclass(frozen=True)
class Nodes:
    """The scene's nodes.

    Attributes:
        names: (N,) unique.
        parents: (N,) -1 where a node hangs from none.
        translations: (N, 3).
        rotations: (N, 4).
        scales: (N,) one for each, since skeletons are not scaled unevenly.
        uneven: (N,) whether a node is scaled unevenly after all.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    translations: Array
    rotations: Array
    scales: Array
    uneven: NDArray[np.bool_]


def read_glb(path: Path, up: str | None = None, unit: str | None = None) -> Motion:
    """Read a GLB file (see `motiongen.io.load`): the first animation of its skeleton, in world axes.

    glTF is y-up and in metres; `up` may only be "y", and `unit` says what the numbers are where they are no metres.

    Raises:
        MotionGenError: if it cannot be read, nothing in it is animated, or its skeleton is scaled unevenly.
    """
    if up == "z":
        raise MotionGenError(f"{path}: glTF files are y-up; leave up out")
    container = read_container(path)
    try:
        return _motion(container, path, unit)
    except MotionGenError:
        raise
    except (DamageError, KeyError, TypeError, ValueError, IndexError, RecursionError) as error:
        raise MotionGenError(f"{path}: the file is damaged or not made for this ({error}); export it anew") from error


def _motion(container: Container, path: Path, unit: str | None) -> Motion:
    nodes = _nodes(container)
    animations = container.document.get("animations", [])
    if not animations:
        raise MotionGenError(f"{path}: nothing in this file is animated; export it with its animation")
    tracks = _tracks(container, animations[0])
    moving = _moving(nodes, tracks)
    order = _joints(container, nodes, moving or {node for node, what in tracks if what != "scale"})
    layout = _layout(container, nodes, order)
    skeleton = _skeleton(container, nodes, order, layout, path)
    layout = replace(layout, height=skeleton.height)
    rate, frames, start = _grid(tracks, path)
    if frames * len(order) > max(MOST_POSES, len(container.binary)):
        raise MotionGenError(f"{path}: {frames} frames of {len(order)} joints are too many for its keys; export fewer")
    seconds = start + np.arange(frames) / rate
    local = np.tile(nodes.rotations[order], (frames, 1, 1))
    translating, moved = [], []
    for joint, node in enumerate(order):
        if (track := tracks.get((node, "rotation"))) is not None:
            local[:, joint] = sampled(track, seconds, turning=True)
        if (track := tracks.get((node, "translation"))) is not None:
            values = sampled(track, seconds)
            away = np.abs(values - nodes.translations[node]).max() * layout.parent_scale[joint]
            if joint == 0 or away > STILL * skeleton.height:
                translating.append(joint)
                moved.append(values)
    joints = tuple(translating)
    stacked = np.stack(moved, axis=1) if moved else np.zeros((frames, 0, 3))
    notes = []
    if len(animations) > 1:
        notes.append(f"of {len(animations)} animations, this is the first, '{animations[0].get('name', '')}'")
    scaled = sorted({node for node, what in tracks if what == "scale"} & set(order) & moving)
    if scaled:
        notes.append(f"the scale of '{nodes.names[scaled[0]]}' is animated, which is left out")
    return Motion(
        skeleton,
        layout.rotations_from_nodes(local),
        layout.translations_from_nodes(stacked, joints),
        joints,
        rate,
        unit or _unit(container),
        name=path.stem,
        notes=tuple(notes),
        file_layout=layout,
    )


def _unit(container: Container) -> str | None:
    extras = container.document.get("asset", {}).get("extras") or {}
    return None if extras.get(UNKNOWN_UNIT) else "m"


# -- what stands in the document


def _nodes(container: Container) -> Nodes:
    specs = container.document.get("nodes", [])
    if not specs:
        raise DamageError("it has no nodes")
    parents = [-1] * len(specs)
    for index in range(len(specs)):
        for child in container.item("nodes", index).get("children", []):
            container.item("nodes", child)
            if parents[child] >= 0 or child == index:
                raise DamageError(f"nodes[{child}] hangs from two nodes")
            parents[child] = index
    translations, rotations, scales, uneven = [], [], [], []
    for spec in specs:
        translation, rotation, scale = _pose(spec)
        translations.append(translation)
        rotations.append(rotation)
        scales.append(float(scale.mean()))
        uneven.append(float(np.ptp(scale)) > UNEVEN * float(np.abs(scale).max()) or float(scale.min()) <= 0)
    names: list[str] = []
    for index, spec in enumerate(specs):
        name = str(spec.get("name") or f"node_{index}")
        names.append(name if name not in names else f"{name}_{index}")
    return Nodes(
        tuple(names), tuple(parents), np.array(translations), np.array(rotations), np.array(scales), np.array(uneven)
    )


def _pose(spec: dict[str, Any]) -> tuple[Array, Array, Array]:
    """Translation, rotation and scale of a node."""
    if "matrix" not in spec:
        rotation = np.array(spec.get("rotation", rot.IDENTITY), dtype=np.float64)
        length = np.linalg.norm(rotation)
        if rotation.shape != (4,) or not length > 0:
            raise DamageError("a node's rotation is none")
        scale = np.array(spec.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
        return np.array(spec.get("translation", (0.0, 0.0, 0.0)), dtype=np.float64), rotation / length, scale
    matrix = np.array(spec["matrix"], dtype=np.float64).reshape(4, 4).T
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if not (scale > 0).all():
        raise DamageError("a node's matrix squeezes space flat")
    return matrix[:3, 3], rot.from_matrix(matrix[:3, :3] / scale), scale


def _tracks(container: Container, animation: dict[str, Any]) -> dict[tuple[int, str], Track]:
    """How the nodes move, by node and property."""
    found = {}
    for channel in animation["channels"]:
        target = channel.get("target", {})
        node, path = target.get("node"), target.get("path")
        if node is None or path not in ("rotation", "translation", "scale"):
            continue  # morph targets, and what extensions animate
        container.item("nodes", node)
        sampler = animation["samplers"][channel["sampler"]]
        times = container.array(sampler["input"])[:, 0]
        values = container.array(sampler["output"])
        interpolation = sampler.get("interpolation", "LINEAR")
        width, rows = (4 if path == "rotation" else 3), (3 if interpolation == "CUBICSPLINE" else 1)
        if values.shape != (rows * len(times), width) or not (np.isfinite(values).all() and np.isfinite(times).all()):
            raise DamageError(f"the animation of nodes[{node}] is damaged")
        if (np.diff(times) <= 0).any():
            raise DamageError(f"the keys of nodes[{node}] are out of order")
        found[node, path] = Track(times, values, interpolation)
    return found


def _moving(nodes: Nodes, tracks: dict[tuple[int, str], Track]) -> set[int]:
    """The nodes whose tracks ever take them away from their rest; programs write tracks for still ones, too."""
    found = set()
    for (node, what), track in tracks.items():
        values = track.values[1::3] if track.interpolation == "CUBICSPLINE" else track.values
        rest = {"rotation": nodes.rotations, "translation": nodes.translations, "scale": nodes.scales}[what][node]
        if what == "rotation":
            values = values * np.where(values @ rest < 0, -1.0, 1.0)[:, None]
        least = UNEVEN if what == "scale" else STILL
        if np.abs(values - rest).max() > least * max(1.0, float(np.abs(rest).max())):
            found.add(node)
    return found


def _joints(container: Container, nodes: Nodes, moving: set[int]) -> list[int]:
    """The nodes of the skeleton, parents before children: those of the skins, or else what is animated.

    All that lies between them belongs to it, and what is animated above it.
    """
    skins = container.document.get("skins", [])
    bound = {joint for index in range(len(skins)) for joint in container.item("skins", index)["joints"]}
    chosen = bound or moving
    if not chosen or not moving:
        raise DamageError("no node is turned or moved by its animation")

    def above(node: int) -> list[int]:
        line = [node]
        while nodes.parents[line[-1]] >= 0:
            line.append(nodes.parents[line[-1]])
            if len(line) > len(nodes.names):
                raise DamageError("its nodes hang from each other in a circle")
        return line[::-1]

    lines = [above(node) for node in sorted(chosen)]
    common = 0
    while all(len(line) > common and line[common] == lines[0][common] for line in lines):
        common += 1
    if common == 0:
        raise DamageError("its joints hang from no common node")
    animated_above = [depth for depth in range(common) if lines[0][depth] in moving]
    first = min([common - 1, *animated_above])
    kept = {node for line in lines for node in line[first:]}
    in_file = sorted(kept)
    if all(nodes.parents[node] < node for node in in_file if node != lines[0][first]) and in_file[0] == lines[0][first]:
        return in_file
    order: list[int] = []
    pending = [lines[0][first]]
    while pending:
        node = pending.pop()
        order.append(node)
        pending += [c for c in reversed(container.item("nodes", node).get("children", [])) if c in kept]
    return order


def _layout(container: Container, nodes: Nodes, order: Sequence[int]) -> GlbLayout:
    world: dict[int, tuple[Array, Array, float]] = {-1: (np.zeros(3), rot.IDENTITY, 1.0)}

    def pose(node: int) -> tuple[Array, Array, float]:
        """Where a node is, how it is turned, and how large."""
        line = [node]
        while line[-1] not in world:
            line.append(nodes.parents[line[-1]])
        for each in reversed(line[:-1]):
            place, turn, scale = world[nodes.parents[each]]
            if nodes.uneven[each]:
                raise DamageError(f"'{nodes.names[each]}' is scaled unevenly or mirrored; apply its scale first")
            world[each] = (
                place + scale * rot.rotate(turn, nodes.translations[each]),
                rot.multiply(turn, nodes.rotations[each]),
                scale * float(nodes.scales[each]),
            )
        return world[node]

    own = [pose(node) for node in order]
    from_above = [pose(nodes.parents[node]) for node in order]
    return GlbLayout(
        container.document,
        bytes(container.binary),
        tuple(order),
        np.array([turn for _, turn, _ in own]),
        np.array([turn for _, turn, _ in from_above]),
        np.array([scale for _, _, scale in from_above]),
        from_above[0][0],
    )


def _skeleton(container: Container, nodes: Nodes, order: Sequence[int], layout: GlbLayout, path: Path) -> Skeleton:
    place = {node: joint for joint, node in enumerate(order)}
    every = tuple(range(len(order)))
    offsets = layout.translations_from_nodes(nodes.translations[list(order)][None], every)[0]
    parents = [-1, *(place[nodes.parents[node]] for node in order[1:])]
    tips = [
        (place[parent], index)
        for index, parent in enumerate(nodes.parents)
        if parent in place and (container.item("nodes", index).get("extras") or {}).get(END_SITE)
    ]
    scales = [layout.parent_scale[joint] * nodes.scales[order[joint]] for joint, _ in tips]
    ends = [s * rot.rotate(layout.rest[joint], nodes.translations[node]) for s, (joint, node) in zip(scales, tips)]
    return Skeleton(
        tuple(nodes.names[node] for node in order),
        tuple(parents),
        offsets,
        tuple(joint for joint, _ in tips),
        np.array(ends).reshape(-1, 3),
    )


# -- time


def _grid(tracks: dict[tuple[int, str], Track], path: Path) -> tuple[float, int, float]:
    """Frame rate in Hz, number of frames, and when the first one is: those of the track with the most keys."""
    densest = max(tracks.values(), key=lambda track: len(track.times)).times
    start = min(float(track.times[0]) for track in tracks.values())
    end = max(float(track.times[-1]) for track in tracks.values())
    if len(densest) < 2:
        return 30.0, 1, start
    steps = np.diff(densest)
    step = float(np.median(steps))
    if np.ptp(steps) < UNEVEN * step:
        step = float(steps.mean())  # of even keys the span tells most exactly
    rate = 1.0 / step
    if (whole := round(rate)) and abs(rate - whole) < SAME_RATE * whole:
        rate = float(whole)
    frames = round((end - start) * rate) + 1
    if frames > MOST_FRAMES:
        raise MotionGenError(f"{path}: {frames} frames at {rate:g} Hz are more than {MOST_FRAMES}; export fewer")
    return rate, frames, start


def sampled(track: Track, seconds: Array, turning: bool = False) -> Array:
    """(T, width) values of a track at times (T,); before the first key and after the last, those of these.

    Args:
        track: the keys.
        seconds: when.
        turning: whether the values are unit quaternions, between which the way is a great circle.
    """
    times, values = track.times, track.values
    if track.interpolation == "CUBICSPLINE":
        arriving, values, leaving = values[0::3], values[1::3], values[2::3]
    after = np.clip(np.searchsorted(times, seconds, side="right"), 1, max(len(times) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(times) - 1)
    span = np.where(after > before, times[after] - times[before], 1.0)
    share = np.clip((seconds - times[before]) / span, 0.0, 1.0)
    if track.interpolation == "STEP":
        return values[np.where(share >= 1.0, after, before)]
    if track.interpolation == "CUBICSPLINE":
        s, d = share[:, None], span[:, None]
        found = (
            (2 * s**3 - 3 * s**2 + 1) * values[before]
            + d * (s**3 - 2 * s**2 + s) * leaving[before]
            + (3 * s**2 - 2 * s**3) * values[after]
            + d * (s**3 - s**2) * arriving[after]
        )
        return found / np.linalg.norm(found, axis=-1, keepdims=True) if turning else found
    if turning:
        units = values / np.linalg.norm(values, axis=-1, keepdims=True)
        return rot.slerp(units[before], units[after], share)
    return values[before] + share[:, None] * (values[after] - values[before])
