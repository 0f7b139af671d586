"""`motiongen latent` from end to end, and what its settings can name."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import motiongen as mg
from motiongen.commands import latent_inputs
from motiongen.commands.latent import run
from motiongen.commands.latent_inputs import latent_generator, points
from motiongen.errors import MotionGenError
from motiongen.generators.base import Capabilities
from motiongen.generators.modi import latent
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.latents import load_latents, save_latents
from motiongen.motion import Motion
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE, stride

LAYERS = 5


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_checkpoint(tmp_path_factory.mktemp("modi") / "checkpoint", FIGURE, (4, 6), "m")


@pytest.fixture(scope="module")
def generator(checkpoint: Path) -> MoDi:
    made = mg.create("modi", checkpoint=str(checkpoint))
    assert isinstance(made, MoDi)
    return made


def made_by(checkpoint: Path, folder: Path, *settings: str) -> tuple[dict[str, Motion], dict[str, Any]]:
    """The motions that the command wrote, by name, and its report."""
    run([f"generator.checkpoint={checkpoint}", f"output={folder}", "poses=2", *settings])
    (report,) = folder.glob("*.json")
    return {path.stem: mg.load(path) for path in folder.glob("*.bvh")}, json.loads(report.read_text())


def assert_same(one: Motion, other: Motion) -> None:
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-4 * FIGURE.height)


def test_interpolation_is_that_of_the_library(checkpoint: Path, generator: MoDi, tmp_path: Path) -> None:
    settings = ("from=[3,4]", "to=mean", "steps=2", "frames=20")
    motions, report = made_by(checkpoint, tmp_path / "o", *settings)
    assert [column["from"] for column in report["columns"]] == ["seed_3", "seed_4"]
    for number, column in enumerate(report["columns"]):
        way = latent.interpolate(generator.latents(1, 3 + number)[0], generator.mean_latent(), 2)
        expected = generator.decode(way, 20)
        for name, motion in zip(column["motions"], expected):
            assert_same(motions[name], motion)
            assert len(motions[name]) == 20
        even = latent.smoothness(expected)
        assert column["ends"]["degrees"] == pytest.approx(even.ends.degrees)
        assert [step["heights"] for step in column["steps"]] == pytest.approx([step.heights for step in even.steps])
    kept = load_latents(tmp_path / "o" / "latents.safetensors", generator)
    assert list(kept.names) == report["motions"] == sorted(motions)
    for name, motion in zip(kept.names, generator.decode(kept.codes, 20)):
        assert_same(motions[name], motion)
    with Image.open(tmp_path / "o" / "interpolation.png") as picture:
        assert picture.height == 3 * 220, "a row for each step, a column for each start"


def test_ends_may_be_as_many_as_beginnings(checkpoint: Path, generator: MoDi, tmp_path: Path) -> None:
    motions, _ = made_by(checkpoint, tmp_path / "o", "from=[3,4]", "to=[5,6]", "steps=1")
    assert_same(motions["interpolation_01_01"], generator.sample(16, seed=6)[0])
    assert_same(motions["interpolation_01_00"], generator.sample(16, seed=4)[0])


def test_the_mean_motion_is_that_of_the_mean_code(checkpoint: Path, generator: MoDi, tmp_path: Path) -> None:
    motions, report = made_by(checkpoint, tmp_path / "o", "task=mean", "format=bvh")
    assert_same(motions["mean"], generator.decode(generator.mean_latent()[None])[0])
    assert report["speed_heights_per_second"] == pytest.approx(latent.speed(motions["mean"]), rel=1e-3)


@pytest.mark.parametrize("first", [0, 2, LAYERS])
def test_mixing_takes_each_with_each(checkpoint: Path, generator: MoDi, tmp_path: Path, first: int) -> None:
    settings = ("task=mixing", "coarse=[1,2]", "fine=[3,4,5]", f"first={first}")
    motions, report = made_by(checkpoint, tmp_path / "o", *settings)
    assert len(motions) == 2 + 3 + 6
    for row, coarse in enumerate((1, 2)):
        for column, fine in enumerate((3, 4, 5)):
            one, other = generator.check_latents(
                np.concatenate([generator.latents(1, coarse), generator.latents(1, fine)])
            )
            expected = generator.decode(latent.mix(one, other, first)[None])[0]
            assert_same(motions[f"mixing_{row:02d}_{column:02d}"], expected)
    away = {"from_fine": 0, "from_coarse": LAYERS}
    for name, alike in away.items():
        degrees = [each[name]["degrees"] for each in report["mixes"]]
        assert (max(degrees) < 1e-6) == (first == alike)


def test_without_a_layer_whole_levels_are_mixed(checkpoint: Path, tmp_path: Path) -> None:
    _, report = made_by(checkpoint, tmp_path / "o", "task=mixing", "coarse=1", "fine=2")
    assert report["first"] == 2, "the first layer of the second of two levels"


def test_a_crowd_holds_variations_that_keep_clear(checkpoint: Path, generator: MoDi, tmp_path: Path) -> None:
    settings = ("task=crowd", "around=[3,4]", "count=4", "sigma=0.5", "gap=0.2", "seed=2")
    motions, report = made_by(checkpoint, tmp_path / "o", *settings)
    assert len(motions) == 8
    placed = [motions[name] for name in report["motions"]]
    for index, one in enumerate(placed):
        for other in placed[:index]:
            ways = one.positions[:, :, None, [0, 2]] - other.positions[:, None, :, [0, 2]]
            assert np.linalg.norm(ways, axis=-1).min() >= 0.2 * FIGURE.height - 1e-4
    kept = load_latents(tmp_path / "o" / "latents.safetensors", generator)
    neighbours = latent.vary(generator.latents(1, 4)[0], 4, 0.5, latent.deviation(generator), 3)
    np.testing.assert_array_equal(kept.codes[4:], generator.check_latents(neighbours))
    for motion, here in zip(generator.decode(kept.codes), placed):
        np.testing.assert_allclose(here.rotations[:, 1:], motion.rotations[:, 1:], atol=1e-4)
    assert (tmp_path / "o" / "crowd.png").exists()


def test_a_crowd_of_no_sigma_is_one_motion_in_many_places(checkpoint: Path, tmp_path: Path) -> None:
    settings = ("task=crowd", "around=3", "count=3", "sigma=0", "heading_degrees=0")
    motions, report = made_by(checkpoint, tmp_path / "o", *settings)
    assert max(each["degrees"] for each in report["crowd"][0]["from_it"]) < 1e-6
    first, *others = motions.values()
    for other in others:
        shift = other.positions[0, 0] - first.positions[0, 0]
        np.testing.assert_allclose(other.positions, first.positions + shift, atol=1e-4)


@pytest.mark.skipif(importlib.util.find_spec("sklearn") is None, reason="needs the extra 'latent'")
def test_clusters_are_shown_by_motions_of_theirs(checkpoint: Path, generator: MoDi, tmp_path: Path) -> None:
    settings = ("task=clusters", "count=60", "clusters=3", "shown=2", "seed=4")
    motions, report = made_by(checkpoint, tmp_path / "o", *settings)
    codes = generator.latents(60, 4)
    found = latent.cluster(codes, 3, 4)
    assert [each["codes"] for each in report["clusters"]] == found.sizes.tolist()
    np.testing.assert_allclose(report["centres"], found.centres, atol=1e-6)
    for group, each in enumerate(report["clusters"]):
        assert (found.members[each["numbers"]] == group).all()
        for name, motion in zip(each["motions"], generator.decode(codes[each["numbers"]])):
            assert_same(motions[name], motion)
    pictures = {path.name for path in (tmp_path / "o").glob("*.png")}
    assert pictures == {"map.png", "cluster_00.png", "cluster_01.png", "cluster_02.png"}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["from=3", "steps=0"], "steps must be a whole number of at least 1, not 0"),
        (["from=3", "steps=40"], "steps makes a picture of 41 rows or columns"),
        (["from=[1,2,3]", "to=[4,5]"], "to must name one, or as many as from, 3, not 2"),
        ([], "from is missing; give a seed, a clip, a file of latents, or mean"),
        (["from=3", "to=nobody"], "to=nobody is no seed, clip, file of latents or mean"),
        (["from=3", "format=abc"], "format must be one of"),
        (["from=3", "frames=0"], "frames must be a whole number of at least 1"),
        (["from=3", "poses=x"], "poses must be a whole number"),
        (["from=3", "task=dance"], "there is no task 'dance'"),
        (["task=mixing", "coarse=1", "fine=2", "first=6"], "first must be from 0 to 5, the number of layers, not 6"),
        (["task=crowd", "around=1", "sigma=-1"], "sigma must be a number of at least 0, not -1"),
        (["task=crowd", "around=1", "sigma=much"], "sigma must be a number of at least 0, not 'much'"),
        (["task=crowd", "around=1", "count=0"], "count must be a whole number of at least 1"),
        (["task=crowd", "around=1", "moment=2"], "moment must be a share of the motion, 0 to 1, not 2"),
        (["task=clusters", "count=5", "clusters=6"], "count must be at least 6 for 6 clusters, not 5"),
        (["task=clusters", "count=3", "clusters=2"], "count must be at least 4 for 2 clusters, not 3"),
        (["from=3", "generator=genmm"], "generator=genmm has no latent space; generator=modi does"),
    ],
)
def test_mistakes_cost_one_line_and_leave_nothing(
    checkpoint: Path, tmp_path: Path, settings: list[str], words: str
) -> None:
    model = [] if "generator=genmm" in settings else [f"generator.checkpoint={checkpoint}"]
    with pytest.raises(MotionGenError) as caught:
        run([*model, f"output={tmp_path / 'o'}", *settings])
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "o").exists()


def test_clusters_without_the_extra_are_refused(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.cluster", None)
    with pytest.raises(MotionGenError, match=r"pip install 'motiongen\[latent\]'"):
        run([f"generator.checkpoint={checkpoint}", f"output={tmp_path / 'o'}", "task=clusters"])
    assert not (tmp_path / "o").exists()


# -- what a setting can name


def test_points_are_seeds_the_mean_files_and_clips(
    generator: MoDi, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codes = generator.check_latents(generator.latents(2, seed=8))
    save_latents(tmp_path / "kept.safetensors", generator, codes, ["one", "two"])
    stride(0).save(tmp_path / "walk.bvh")
    inverted = np.full((LAYERS, 8), 0.5, dtype=np.float32)
    monkeypatch.setattr(MoDi, "invert", lambda self, motion, seed=0: inverted)
    given = [7, "mean", str(tmp_path / "kept.safetensors"), str(tmp_path / "walk.bvh")]
    found = points(generator, given, "from")
    assert [point.name for point in found] == ["seed_7", "mean", "one", "two", "walk"]
    expected = [
        *generator.check_latents(generator.latents(1, 7)),
        *generator.check_latents(generator.mean_latent()[None]),
        *codes,
        inverted,
    ]
    for point, code in zip(found, expected):
        np.testing.assert_array_equal(point.code, code)
    (alone,) = points(generator, 7, "from")
    assert_same(generator.decode(alone.code[None])[0], generator.sample(16, seed=7)[0])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (None, "around is missing"),
        ([], "around is missing"),
        (-1, "around must be a whole number of at least 0, not -1"),
        (True, "around must be a whole number of at least 0, not True"),
        (1.5, "around=1.5 is no seed"),
        ("nothing.bvh", "there is no such file"),
        ("nothing.safetensors", "there is no such file"),
        ([1, "clip.abc"], "around=clip.abc is no seed, clip, file of latents or mean"),
    ],
)
def test_points_that_are_none_are_refused(generator: MoDi, given: Any, words: str) -> None:
    with pytest.raises(MotionGenError) as caught:
        points(generator, given, "around")
    assert words in str(caught.value)


def test_generators_of_the_command_have_a_latent_space(checkpoint: Path) -> None:
    assert isinstance(latent_generator({"name": "modi", "checkpoint": str(checkpoint)}), MoDi)
    with pytest.raises(MotionGenError, match="has no latent space"):
        latent_generator({"name": "genmm"})
    with pytest.raises(MotionGenError, match="truncated"):
        latent_generator({"name": "modi", "truncated": 1})


def test_codes_of_another_kind_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    other = SimpleNamespace(
        name="jumping",
        capabilities=Capabilities(has_latent_space=True),
        options_type=lambda: SimpleNamespace(build=dict),
        create=lambda options: object(),
    )
    monkeypatch.setattr(latent_inputs, "chosen_generator", lambda settings: (other, {}))
    with pytest.raises(MotionGenError, match=r"generator=jumping has latent codes of its own kind.*generator=modi"):
        latent_generator({"name": "jumping"})
