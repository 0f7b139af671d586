"""`motiongen edit` from end to end, with a network of random weights."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen.attributes import attribute_of, registry
from motiongen.commands.edit import run
from motiongen.errors import MotionGenError
from motiongen.generators.modi.directions import load_direction, move, save_direction
from motiongen.generators.modi.latents import load_latents
from tests.bipeds import biped
from tests.checkpoints import random_checkpoint

pytest.importorskip("sklearn", reason="directions are learnt with scikit-learn, of the extra `latent`")

FEET = tuple(joint for joint, name in enumerate(biped().names) if name.endswith("Foot"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_checkpoint(tmp_path_factory.mktemp("modi") / "checkpoint", biped(), FEET, "m")


@pytest.fixture(scope="module")
def learnt(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a run that learnt a direction."""
    out = tmp_path_factory.mktemp("edit") / "out"
    run([f"generator.checkpoint={folder}", "input=[3,mean]", "attribute=hand_spread", "samples=80", "poses=2",
         "strengths=[-1.5,0,2]", f"output={out}"])  # fmt: skip
    return out


def test_there_is_a_motion_for_every_strength(folder: Path, learnt: Path) -> None:
    generator = mg.create("modi", checkpoint=str(folder))
    direction = load_direction(learnt / "hand_spread_direction.safetensors", generator)
    starts = np.stack([generator.latents(1, 3)[0], generator.mean_latent()])
    expected = move(generator.check_latents(starts), direction, (-1.5, 0.0, 2.0))
    kept = load_latents(learnt / "latents.safetensors", generator)
    names = [f"hand_spread_{start:02d}_{strength}" for start in range(2) for strength in ("-1.5", "+0", "+2")]
    assert kept.names == tuple(names)
    np.testing.assert_allclose(kept.codes, expected.swapaxes(0, 1).reshape(kept.codes.shape), atol=1e-6)
    for code, name in zip(kept.codes, names):
        motion = mg.load(learnt / f"{name}.bvh")
        np.testing.assert_allclose(motion.positions, generator.decode(code[None])[0].positions, atol=1e-4)
    assert {path.name for path in learnt.glob("*.png")} == {"hand_spread_00.png", "hand_spread_01.png"}


def test_the_report_has_the_scores_of_the_motions(learnt: Path) -> None:
    report = json.loads((learnt / "edit.json").read_text())
    assert [each["start"] for each in report["motions"]] == ["seed_3", "mean"]
    assert report["strengths"] == [-1.5, 0.0, 2.0]
    assert report["direction"]["name"] == report["attribute"]["name"] == "hand_spread"
    assert report["direction"]["samples"] == 80
    for each in report["motions"]:
        for name in ("hand_spread", "speed"):
            measured = [attribute_of(name).score(mg.load(learnt / f"{motion}.bvh")) for motion in each["motions"]]
            np.testing.assert_allclose(each["scores"][name], measured, atol=1e-3)


def test_a_learnt_direction_is_used_again(
    folder: Path, learnt: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = learnt / "hand_spread_direction.safetensors"
    run([f"generator.checkpoint={folder}", "input=3", f"direction={file}", "strengths=[2]", "format=npz", "poses=2",
         f"output={tmp_path / 'o'}"])  # fmt: skip
    said = capsys.readouterr().out
    assert "| +2 |" in said
    assert "hand_spread: mean distance between the hands" in said
    assert not (tmp_path / "o" / "hand_spread_direction.safetensors").exists(), "it was not learnt here"
    again, first = mg.load(tmp_path / "o" / "hand_spread_00_+2.npz"), mg.load(learnt / "hand_spread_00_+2.bvh")
    np.testing.assert_allclose(again.positions, first.positions, atol=1e-4)


def test_a_direction_that_comes_with_the_model_is_taken(tmp_path: Path, learnt: Path, folder: Path) -> None:
    own = random_checkpoint(tmp_path / "checkpoint", biped(), FEET, "m")
    generator = mg.create("modi", checkpoint=str(own))
    (own / "directions").mkdir()
    direction = load_direction(learnt / "hand_spread_direction.safetensors", mg.create("modi", checkpoint=str(folder)))
    save_direction(own / "directions" / "hand_spread.safetensors", generator, direction)
    run([f"generator.checkpoint={own}", "attribute=hand_spread", "samples=1", "strengths=[1]", "layers=[0]", "poses=2",
         f"output={tmp_path / 'o'}"])  # fmt: skip
    codes = load_latents(tmp_path / "o" / "latents.safetensors", generator).codes
    moved = np.abs(codes[0] - generator.latents(1, 0)).max(axis=-1)
    np.testing.assert_array_equal(moved > 1e-6, [True] + [False] * (len(moved) - 1), "only the first layer moved")


def test_an_attribute_of_ones_own(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", dict(registry.attributes()))
    (tmp_path / "mine.py").write_text("def nod(motion):\n    return motion.positions[-1, 3, 1]\n")
    run([f"generator.checkpoint={folder}", f"attribute={tmp_path / 'mine.py'}:nod", "orthogonal_to=[speed]",
         "samples=80", "strengths=[-1,1]", "poses=2", f"output={tmp_path / 'o'}"])  # fmt: skip
    report = json.loads((tmp_path / "o" / "edit.json").read_text())
    assert report["direction"]["orthogonal_to"] == ["speed"]
    assert (tmp_path / "o" / "nod_direction.safetensors").is_file()
    assert len(report["motions"][0]["scores"]["nod"]) == 2


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["attribute=sped"], "no attribute 'sped'; did you mean 'speed'"),
        (["strengths=2"], r"strengths must be a list of numbers such as \[-2,-1,0,1,2\], not 2"),
        (["strengths=[1,two]"], "strengths must be a list of numbers"),
        (["strengths=[1,1]"], "strengths must differ"),
        (["layers=3"], "layers must be a list of numbers"),
        (["layers=[-1]"], "layers must be a whole number of at least 0, not -1"),
        (["layers=[99]", "direction={direction}"], "layers must be from 0 to"),
        (["samples=0"], "samples must be a whole number of at least 1"),
        (["samples=9"], "9 samples are too few, or too much alike in 'gral'"),
        (["direction=nowhere.safetensors"], "no such file"),
        (["direction={direction}", "attribute=speed"], "a direction of 'hand_spread', not 'speed'"),
        (["direction={direction}", "orthogonal_to=[speed]"], "orthogonal_to needs a direction that is learnt"),
        (["input=null"], "input is missing"),
        (["format=abc"], "format must be one of bvh"),
        (["generator=genmm"], "generator=genmm has no latent space"),
        (["strenghts=[1]"], "unknown setting 'strenghts'; did you mean 'strengths'"),
    ],
)
def test_mistakes_are_said_and_leave_nothing(
    settings: list[str], words: str, folder: Path, learnt: Path, tmp_path: Path
) -> None:
    given = [setting.format(direction=learnt / "hand_spread_direction.safetensors") for setting in settings]
    checkpoint = [] if "generator=genmm" in given else [f"generator.checkpoint={folder}"]
    with pytest.raises(MotionGenError, match=words) as caught:
        run([*checkpoint, *given, f"output={tmp_path / 'o'}"])
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "o").exists()
