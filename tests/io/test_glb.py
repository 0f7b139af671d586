"""GLB files: what is written means the same to a literal reading of glTF, and what is read is what glTF says."""

from __future__ import annotations

import base64
import copy
import json
import struct
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

import motiongen as mg
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.io.glb.container import Container, read_container
from motiongen.io.glb.reader import Track, sampled
from motiongen.motion import METRES_PER_UNIT, Motion
from tests.strategies import motions, random_motion, random_skeleton

Array = NDArray[np.float64]


# -- a slow twin: glTF read literally, one node and one frame after the other


def matrix_of(node: dict[str, Any]) -> Array:
    """(4, 4) of a node's translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"]).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix() * node.get("scale", (1, 1, 1))
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def places(container: Container, animation: int, frame: int) -> dict[str, Array]:
    """Where each named node is at a key of an animation."""
    nodes = json.loads(json.dumps(container.document["nodes"]))
    spec = container.document["animations"][animation]
    for channel in spec["channels"]:
        sampler = spec["samplers"][channel["sampler"]]
        node = nodes[channel["target"]["node"]]
        node[channel["target"]["path"]] = container.array(sampler["output"])[frame].tolist()
    found = {}

    def walk(index: int, above: Array) -> None:
        own = above @ matrix_of(nodes[index])
        found[nodes[index].get("name", str(index))] = own[:3, 3]
        for child in nodes[index].get("children", []):
            walk(child, own)

    for index in container.document["scenes"][0]["nodes"]:
        walk(index, np.eye(4))
    return found


def saved(motion: Motion, folder: Path, name: str = "any.glb") -> Path:
    motion.save(folder / name)
    return folder / name


# -- our own files


@given(motions())
def test_any_motion_comes_back(motion: Motion) -> None:
    metres = METRES_PER_UNIT[motion.unit] if motion.unit else 1.0
    with tempfile.TemporaryDirectory() as folder:
        again = mg.load(saved(motion, Path(folder)))
    assert again.skeleton.names == motion.skeleton.names
    assert again.skeleton.parents == motion.skeleton.parents
    assert again.skeleton.end_sites == motion.skeleton.end_sites
    assert len(again) == len(motion)
    assert (again.up, again.unit) == ("y", "m" if motion.unit else None)
    if len(motion) > 1:
        assert again.frame_rate == pytest.approx(motion.frame_rate, rel=2e-3)
    size = np.abs(motion.positions).max() + motion.skeleton.height
    np.testing.assert_allclose(again.positions / metres, motion.positions, atol=1e-5 * size)
    np.testing.assert_allclose(
        again.skeleton.end_site_offsets / metres, motion.skeleton.end_site_offsets, atol=1e-5 * size
    )
    assert rot.angle_between(again.rotations, motion.rotations).max() < 1e-5


@given(motions(), st.integers(0, 2**31))
def test_what_is_written_means_the_motion(motion: Motion, seed: int) -> None:
    metres = METRES_PER_UNIT[motion.unit] if motion.unit else 1.0
    with tempfile.TemporaryDirectory() as folder:
        container = read_container(saved(motion, Path(folder)))
    frame = seed % len(motion)
    found = places(container, 0, frame)
    size = np.abs(motion.positions).max() + motion.skeleton.height
    for joint, name in enumerate(motion.skeleton.names):
        np.testing.assert_allclose(found[name] / metres, motion.positions[frame, joint], atol=1e-5 * size)


def test_the_mesh_hangs_on_the_bones(tmp_path: Path) -> None:
    """Every vertex is bound to one joint, triangles face outwards, and bindings undo the rest pose."""
    rng = np.random.default_rng(2)
    motion = random_motion(rng, random_skeleton(rng, 12), frames=3)
    container = read_container(saved(motion, tmp_path))
    primitive = container.document["meshes"][0]["primitives"][0]["attributes"]
    corners, normals = container.array(primitive["POSITION"]), container.array(primitive["NORMAL"])
    owners = container.array(primitive["JOINTS_0"])[:, 0].astype(int)
    assert (container.array(primitive["WEIGHTS_0"]) == [1, 0, 0, 0]).all()
    assert set(owners) <= set(range(len(motion.skeleton)))
    for bone in range(len(corners) // 24):
        own = slice(24 * bone, 24 * bone + 24)
        middle = corners[own].mean(axis=0)
        assert (np.einsum("vc,vc->v", corners[own] - middle, normals[own]) > -1e-9).all()
        assert len(set(owners[own])) == 1
    skin = container.document["skins"][0]
    binding = container.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    rest = motion.skeleton.rest_positions
    np.testing.assert_allclose(
        np.einsum("jab,jb->ja", binding[:, :3, :3], rest) + binding[:, :3, 3], 0 * rest, atol=1e-5
    )


# -- other programs' files


def foreign(rng: np.random.Generator, frames: int = 9) -> Container:
    """A file as modelling programs write them: turned, scaled nodes above the joints, bones turned at rest, a mesh."""

    def turn() -> list[float]:
        return list(rot.from_rotation_vector(rng.normal(size=3)))

    nodes: list[dict[str, Any]] = [
        {"name": "Scene root", "children": [1, 6], "matrix": (2 * np.eye(4)).tolist()},
        {"name": "Armature", "children": [2], "rotation": turn(), "scale": [0.01] * 3, "translation": [3.0, 0.5, -1.0]},
        {"name": "Hips", "children": [3, 4], "rotation": turn(), "translation": [0.0, 90.0, 0.0]},
        {"name": "Spine", "children": [5], "rotation": turn(), "translation": [0.0, 40.0, 3.0]},
        {"name": "Leg", "rotation": turn(), "translation": [10.0, -40.0, 0.0]},
        {"name": "Head", "rotation": turn(), "translation": [0.0, 30.0, 0.0], "scale": [1.5] * 3},
        {"name": "Body", "mesh": 0, "skin": 0},
    ]
    nodes[0]["matrix"] = (np.diag([2.0, 2.0, 2.0, 1.0])).ravel().tolist()
    container = Container(
        {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": nodes,
            "buffers": [{}],
            "meshes": [{"primitives": [{"attributes": {}}]}],
            "materials": [{"name": "cloth"}],
            "skins": [{"joints": [4, 2, 3, 5]}],
            "animations": [{"name": "dance", "channels": [], "samplers": []}],
        },
        bytearray(),
    )
    container.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = container.add(
        rng.normal(size=(3, 3)), bounds=True
    )
    times = container.add(np.arange(frames) / 24.0, bounds=True)
    animation = container.document["animations"][0]
    for node in (2, 3, 5):  # the leg keeps its rest rotation
        turns = rot.continuous(rot.from_rotation_vector(np.cumsum(rng.normal(size=(frames, 3)) * 0.3, axis=0)))
        animation["samplers"].append({"input": times, "output": container.add(turns)})
        animation["channels"].append(
            {"sampler": len(animation["samplers"]) - 1, "target": {"node": node, "path": "rotation"}}
        )
    moves = container.add(rng.normal(size=(frames, 3)) * 20)
    animation["samplers"].append({"input": times, "output": moves})
    animation["channels"].append({"sampler": 3, "target": {"node": 2, "path": "translation"}})
    return container


@given(st.integers(0, 2**31))
def test_a_rig_turned_and_scaled_at_rest_moves_as_gltf_says(seed: int) -> None:
    container = foreign(np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        container.save(Path(folder) / "theirs.glb")
        motion = mg.load(Path(folder) / "theirs.glb")
    assert motion.skeleton.names == ("Hips", "Spine", "Leg", "Head")
    assert (motion.frame_rate, len(motion), motion.unit) == (24.0, 9, "m")
    for frame in range(len(motion)):
        found = places(container, 0, frame)
        for joint, name in enumerate(motion.skeleton.names):
            np.testing.assert_allclose(motion.positions[frame, joint], found[name], atol=1e-5)


@given(st.integers(0, 2**31))
def test_a_new_motion_goes_back_into_the_file_it_came_from(seed: int) -> None:
    rng = np.random.default_rng(seed)
    container = foreign(rng)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        container.save(folder / "theirs.glb")
        motion = mg.load(folder / "theirs.glb")
        new = motion[::-1].replace(name="backwards", frame_rate=60.0)
        written = read_container(saved(new, folder))
        again = mg.load(folder / "any.glb")
    assert [animation["name"] for animation in written.document["animations"]] == ["backwards", "dance"]
    for kept in ("meshes", "materials", "skins", "nodes", "scenes"):
        assert written.document[kept] == container.document[kept]
    assert bytes(written.binary).startswith(bytes(container.binary))
    for frame in (0, 4, 8):
        found = places(written, 0, frame)
        for joint, joint_name in enumerate(new.skeleton.names):
            np.testing.assert_allclose(found[joint_name], new.positions[frame, joint], atol=1e-5)
    np.testing.assert_allclose(again.positions, new.positions, atol=1e-5)
    assert "of 2 animations" in again.notes[0]


@given(st.integers(0, 2**31), st.sampled_from(["cm", "in"]))
def test_in_another_unit_a_motion_goes_back_in_the_size_of_the_file(seed: int, unit: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        foreign(np.random.default_rng(seed)).save(folder / "theirs.glb")
        motion = mg.load(folder / "theirs.glb")
        larger = motion.scale(1 / METRES_PER_UNIT[unit], unit)
        saved(larger, folder)
        again = mg.load(folder / "any.glb")
        saved(mg.load(folder / "theirs.glb", unit="cm").scale(0.01, "m"), folder)
        smaller = mg.load(folder / "any.glb")
    for each in (again, smaller):
        assert each.skeleton == motion.skeleton
        np.testing.assert_allclose(each.positions, motion.positions, atol=1e-5)


def test_data_that_stands_in_the_document_is_kept_and_added_to(tmp_path: Path) -> None:
    container = foreign(np.random.default_rng(3))
    container.save(tmp_path / "theirs.glb")
    motion = mg.load(tmp_path / "theirs.glb")
    held = copy.deepcopy(container.document)
    text = base64.b64encode(container.binary).decode()
    held["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
    (tmp_path / "theirs.glb").unlink()
    Container(held, bytearray()).save(tmp_path / "theirs.glb")
    inside = mg.load(tmp_path / "theirs.glb")
    np.testing.assert_array_equal(inside.positions, motion.positions)
    written = read_container(saved(inside[::-1], tmp_path))
    assert bytes(written.binary).startswith(bytes(container.binary))
    assert "uri" not in written.document["buffers"][0]
    np.testing.assert_allclose(mg.load(tmp_path / "any.glb").positions, motion.positions[::-1], atol=1e-5)


def test_a_generator_gives_motions_that_go_back_into_the_file(tmp_path: Path) -> None:
    container = foreign(np.random.default_rng(1), frames=60)
    container.save(tmp_path / "theirs.glb")
    made = mg.create("genmm").fit([mg.load(tmp_path / "theirs.glb")]).sample(frames=80)[0]
    written = read_container(saved(made, tmp_path))
    assert written.document["materials"] == container.document["materials"]
    np.testing.assert_allclose(mg.load(tmp_path / "any.glb").positions, made.positions, atol=1e-5)


# -- interpolation


def test_keys_are_joined_as_gltf_says() -> None:
    rng = np.random.default_rng(0)
    times = np.array([0.0, 0.5, 0.6, 2.0])
    seconds = np.linspace(-0.5, 2.5, 61)
    inside = np.clip(seconds, 0.0, 2.0)
    values = rng.normal(size=(4, 3))
    linear = sampled(Track(times, values, "LINEAR"), seconds)
    np.testing.assert_allclose(linear, np.stack([np.interp(inside, times, column) for column in values.T], axis=1))
    stepped = sampled(Track(times, values, "STEP"), seconds)
    np.testing.assert_array_equal(stepped, values[np.searchsorted(times, inside, side="right") - 1])
    slopes = rng.normal(size=(4, 3))
    spline = sampled(Track(times, np.stack([slopes, values, slopes], axis=1).reshape(12, 3), "CUBICSPLINE"), seconds)
    np.testing.assert_allclose(spline, CubicHermiteSpline(times, values, slopes)(inside), atol=1e-12)
    one = sampled(Track(times[:1], values[:1], "LINEAR"), seconds)
    np.testing.assert_array_equal(one, np.tile(values[:1], (61, 1)))


def test_integers_that_stand_for_fractions_are_read_as_such(tmp_path: Path) -> None:
    container = Container({"buffers": [{}]}, bytearray())
    index = container.add(np.array([[-32768, -32767, 0, 32767]]), "<i2")
    container.document["accessors"][index]["normalized"] = True
    np.testing.assert_allclose(container.array(index), [[-1.0, -1.0, 0.0, 1.0]])


# -- what cannot be read


@given(st.integers(0, 2**31))
def test_damage_costs_one_line(seed: int) -> None:
    """Bytes lost, changed or repeated anywhere: it is read or refused, and never anything else."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "any.glb"
        foreign(rng).save(path)
        content = bytearray(path.read_bytes())
        kind = seed % 3
        if kind == 0:
            content = content[: int(rng.integers(len(content)))]
        for _ in range(0 if kind == 0 else 1 + seed % 5):
            content[int(rng.integers(len(content)))] = int(rng.integers(256))
        path.write_bytes(content)
        with suppress(MotionGenError):
            mg.load(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("animations"), "nothing in this file is animated"),
        (lambda d: d["nodes"][3].update(scale=[1.0, 2.0, 1.0]), "'Spine' is scaled unevenly"),
        (lambda d: d["nodes"][5].update(children=[2]), "hangs from two nodes"),
        (lambda d: d["accessors"][1].update(count=10**9), "reaches beyond the data"),
        (
            lambda d: (
                d["accessors"].append({"count": 10**9, "componentType": 5126, "type": "VEC4"})
                or d["animations"][0]["samplers"][0].update(output=len(d["accessors"]) - 1)
            ),
            "hold more than 50,000,000 numbers",
        ),
        (lambda d: d["accessors"][1].update(sparse={}), "sparse"),
        (lambda d: d["buffers"][0].update(uri="theirs.bin"), "lies in another file"),
        (lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]), "needs the extension KHR_draco"),
        (lambda d: d["asset"].update(version="2.0") or d["animations"][0]["channels"].clear(), "no node is turned"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, change: Any, words: str) -> None:
    container = foreign(np.random.default_rng(0))
    change(container.document)
    container.save(tmp_path / "theirs.glb")
    with pytest.raises(MotionGenError, match=words) as caught:
        mg.load(tmp_path / "theirs.glb")
    assert str(caught.value).count("theirs.glb") == 1


def test_few_keys_that_span_a_long_time_are_refused(tmp_path: Path) -> None:
    """A tenth of a megabyte must not ask for gigabytes of poses."""
    rng = np.random.default_rng(0)
    skeleton = random_skeleton(rng, 40)
    path = saved(random_motion(rng, skeleton, frames=30).replace(frame_rate=1000.0), tmp_path)
    container = read_container(path)
    for sampler in container.document["animations"][0]["samplers"]:
        spec = container.item("accessors", sampler["input"])
        times = container.array(sampler["input"])
        times[-1] = 900.0
        sampler["input"] = container.add(times.astype(np.float32), bounds=True)
        assert spec["count"] == 30
    container.save(path)
    with pytest.raises(MotionGenError, match="joints are too many for its keys"):
        mg.load(path)


def test_what_is_no_glb_file_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"glTF", b"HIERARCHY\nROOT Hips and so on", struct.pack("<4sII", b"glTF", 1, 20) + bytes(8)):
        (tmp_path / "not.glb").write_bytes(content)
        with pytest.raises(MotionGenError, match="no GLB file"):
            mg.load(tmp_path / "not.glb")
    with pytest.raises(MotionGenError, match="y-up"):
        mg.load(
            saved(
                random_motion(np.random.default_rng(0), random_skeleton(np.random.default_rng(0), 3), frames=4),
                tmp_path,
            ),
            up="z",
        )
