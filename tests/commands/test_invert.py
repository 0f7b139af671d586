"""`motiongen invert` from end to end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen.commands.invert import run
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.generators.modi.encoder import Encoder
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import InversionOptions, invert
from motiongen.generators.modi.latents import load_latents
from tests.datasets.clips import stride
from tests.train.runs import FRAMES, make_dataset, training_of
from train.encoder import EncoderSettings, EncoderTraining
from train.encoder import run as train_encoder

QUICK = ["inversion.steps=2", "inversion.candidates=4"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint, its encoder, and two clips."""
    folder = tmp_path_factory.mktemp("invert")
    dataset = Dataset.open(make_dataset(folder))
    training_of(dataset).save(folder / "modi", {})
    settings = EncoderSettings(iterations=1, batch=2)
    train_encoder(EncoderTraining(generator_in(folder), dataset, settings), folder / "encoder", {})
    for name, seed in (("a", 1), ("b", 2)):
        stride(seed, frames=FRAMES + 4).replace(name=name).save(folder / f"{name}.npz")
    return folder


def generator_in(folder: Path) -> MoDi:
    made = mg.create("modi", checkpoint=str(folder / "modi"))
    assert isinstance(made, MoDi)
    return made


def given(folder: Path, output: Path, *settings: str) -> list[str]:
    usual = [f"input={folder / 'a.npz'}", f"output={output}", f"generator.checkpoint={folder / 'modi'}", *QUICK]
    keys = {setting.split("=")[0] for setting in settings}
    return [*(setting for setting in usual if setting.split("=")[0] not in keys), *settings]


@pytest.mark.parametrize("method", ["optimiser", "encoder", "both"])
def test_what_is_written_is_what_the_library_gives(
    folder: Path, tmp_path: Path, method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run(given(folder, tmp_path / "out", f"method={method}", f"encoder={folder / 'encoder'}", "format=npz"))
    said = capsys.readouterr().out
    generator, clip = generator_in(folder), mg.load(folder / "a.npz")
    encoder, options = Encoder.load(folder / "encoder", generator), InversionOptions(steps=2, candidates=4)
    expected = {
        "optimiser": lambda: invert(generator, clip, options),
        "encoder": lambda: encoder.encode(clip),
        "both": lambda: invert(generator, clip, options, guess=encoder.encode(clip).codes),
    }[method]()
    kept = load_latents(tmp_path / "out" / "latents.safetensors", generator)
    np.testing.assert_array_equal(kept.codes, expected.codes)
    assert kept.names == ("a_0000", "a_0004")
    for motion, error in zip(expected.motions, expected.errors):
        assert mg.load(tmp_path / "out" / f"{motion.name}.npz").allclose(motion)
        assert f"{motion.name}.npz: {error}" in said
    report = json.loads((tmp_path / "out" / "inversion.json").read_text())
    assert {name: report[name] for name in ("windows", "report")} == expected.to_dict()
    assert (report["method"], report["clip"]) == (method, "a")
    assert (tmp_path / "out" / "film_strip.png").stat().st_size > 1000


@pytest.mark.parametrize("action", ["denoise", "fuse", "edit_joints", "predict"])
def test_actions_are_those_of_the_encoder(folder: Path, tmp_path: Path, action: str) -> None:
    more = [f"action={action}", f"encoder={folder / 'encoder'}", f"source={folder / 'b.npz'}", "joints=[Left*]",
            "first_frames=7", "frames=5", "format=npz"]  # fmt: skip
    run(given(folder, tmp_path / "out", *more))
    generator = generator_in(folder)
    encoder = Encoder.load(folder / "encoder", generator)
    a, b = (mg.load(folder / f"{name}.npz") for name in "ab")
    expected = {
        "denoise": lambda: encoder.denoise(a),
        "fuse": lambda: encoder.fuse(a, b, 7),
        "edit_joints": lambda: encoder.edit_joints(a, ["Left*"], b),
        "predict": lambda: encoder.predict(a, 5),
    }[action]()
    kept = load_latents(tmp_path / "out" / "latents.safetensors", generator)
    np.testing.assert_array_equal(kept.codes, expected.codes)
    for motion in expected.motions:
        assert len(mg.load(tmp_path / "out" / f"{motion.name}.npz")) == len(motion)


def test_settings_are_the_library_s_own() -> None:
    """The section `inversion` of the configuration has the defaults of `InversionOptions`."""
    from omegaconf import OmegaConf

    from motiongen.assets import config_folder

    section = OmegaConf.to_container(OmegaConf.load(config_folder() / "invert.yaml").inversion)
    assert section == InversionOptions().to_dict()


def test_settings_of_training_are_the_program_s_own() -> None:
    from omegaconf import OmegaConf

    from motiongen.assets import config_folder

    section = OmegaConf.to_container(OmegaConf.load(config_folder() / "encoder.yaml"), resolve=False)
    assert isinstance(section, dict)
    assert {name: section[name] for name in EncoderSettings().to_dict()} == EncoderSettings().to_dict()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["input=null"], "input=CLIP is missing"),
        (["input=nothing.bvh"], "no such file"),
        (["method=guess"], "method must be one of optimiser, encoder, both, not 'guess'"),
        (["method=both"], "method=both needs encoder=FOLDER; make one with python -m train.encoder"),
        (["action=fuse"], "action=fuse needs encoder=FOLDER"),
        (["action=fuse", "encoder={folder}/encoder"], "source=CLIP is missing"),
        (["action=edit_joints", "encoder={folder}/encoder", "source={folder}/b.npz"], "needs joints=[NAME,...]"),
        (["action=predict", "encoder={folder}/encoder", "frames=0"], "frames must be a whole number of at least 1"),
        (["method=encoder", "encoder={folder}/modi"], "no such file"),
        (["inversion.space=Z"], "space must be one of W, W+"),
        (["inversion.stepz=3"], "did you mean 'inversion.steps'"),
        (["generator=genmm"], "generator"),
    ],
)
def test_mistakes_cost_one_line_and_leave_nothing(
    folder: Path, tmp_path: Path, settings: list[str], words: str
) -> None:
    filled = [setting.replace("{folder}", str(folder)) for setting in settings]
    with pytest.raises(MotionGenError) as raised:
        run(given(folder, tmp_path / "out", *filled))
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "out").exists()
