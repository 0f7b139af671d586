"""`python -m train.encoder` from end to end: it learns, goes on where it was, and refuses what does not go together."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor

import motiongen as mg
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.generators.modi.encoder import WEIGHTS, Encoder
from motiongen.generators.modi.generator import MoDi
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE
from tests.train.runs import training_of
from train.encoder import CORRUPTIONS, TRAINING, EncoderSettings, EncoderTraining, main, run


@pytest.fixture(scope="module")
def checkpoint(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkpoint") / "modi"
    training_of(dataset).save(folder, {})
    return folder


@pytest.fixture(scope="module")
def generator(checkpoint: Path) -> MoDi:
    made = mg.create("modi", checkpoint=str(checkpoint))
    assert isinstance(made, MoDi)
    return made


def training(generator: MoDi, dataset: Dataset, **settings: Any) -> EncoderTraining:
    return EncoderTraining(generator, dataset, EncoderSettings.build({"batch": 4, "iterations": 8} | settings))


def command(monkeypatch: pytest.MonkeyPatch, *given: str) -> int:
    monkeypatch.setattr(sys, "argv", ["encoder", *given])
    return main()


def test_it_learns(generator: MoDi, dataset: Dataset) -> None:
    """The loss falls, and codes of motions that it has not seen are nearer than the best of those that do not look."""
    encoder = training(generator, dataset, iterations=150, batch=8, corrupted=0.0, code_weight=1.0, learning_rate=0.01)
    figures = [encoder.step() for _ in range(150)]
    for name in ("loss/all", "rotation/real", "rotation/made", "position/real", "position/made"):
        begun, ended = (np.mean([float(each[name]) for each in some]) for some in (figures[:5], figures[-20:]))
        assert ended < 0.8 * begun, name
    codes = generator.network.codes(torch.randn(64, generator.latent_size, generator=torch.Generator().manual_seed(99)))
    with torch.no_grad():
        found = encoder.network(generator.network.synthesis(codes))
    assert (found - codes).square().mean() < 0.75 * (codes - generator.network.mean_code).square().mean()


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_spoiled_motions_are_as_they_should_be(
    generator: MoDi, dataset: Dataset, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("train.encoder.CORRUPTIONS", (kind,))
    encoder = training(generator, dataset, corrupted=1.0)
    whole, same = training(generator, dataset, corrupted=0.0)._real()
    torch.testing.assert_close(whole, same, rtol=0, atol=0)
    given, wanted = encoder._real()
    assert given.shape == wanted.shape == whole.shape
    mended = kind in ("noise", "cut")
    assert torch.equal(given, wanted) != mended, "a network that gives back what it is given mends nothing"
    assert (given != whole).any()
    assert torch.equal(wanted, whole) == mended
    if kind == "cut":
        unknown = (given == 0).flatten(2).all(dim=2)
        assert unknown[:, -1].any()
        assert not unknown[:, 0].any()


def test_made_motions_have_codes_of_one_or_two(generator: MoDi, dataset: Dataset) -> None:
    for mixing, most in ((0.0, 1), (1.0, 2)):
        codes = training(generator, dataset, mixing=mixing, batch=16)._codes()
        counts = [len(torch.unique(code, dim=0)) for code in codes]
        assert max(counts) == min(counts) == most


def tensors(folder: Path) -> dict[str, Tensor]:
    return {f"{name}.{key}": value for name in (WEIGHTS, TRAINING) for key, value in load_file(folder / name).items()}


def test_a_run_that_was_broken_off_goes_on_as_if_it_had_not(
    generator: MoDi, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(training(generator, dataset), tmp_path / "whole", {})
    broken = training(generator, dataset, checkpoint_every=3)
    step = broken.step

    def until_the_fifth() -> dict[str, Tensor]:
        if broken.iteration == 5:
            raise KeyboardInterrupt
        return step()

    monkeypatch.setattr(broken, "step", until_the_fifth)
    with pytest.raises(KeyboardInterrupt):
        run(broken, tmp_path / "broken", {})
    again = training(generator, dataset, log_every=1)
    assert run(again, tmp_path / "broken", {}) == whole
    one, other = tensors(tmp_path / "whole"), tensors(tmp_path / "broken")
    assert one.keys() == other.keys()
    assert [name for name in one if not torch.equal(one[name], other[name])] == []


def test_the_command_leaves_an_encoder(
    checkpoint: Path, generator: MoDi, data: Path, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "out"
    given = [f"checkpoint={checkpoint}", f"data={data}", f"output={out}", "iterations=2", "batch=4"]
    assert command(monkeypatch, *given) == 0
    assert "2 iterations in" in capsys.readouterr().out
    record = json.loads((out / "encoder.json").read_text())
    assert record["data"] == dataset.fingerprint
    assert record["settings"]["batch"] == 4
    assert record["versions"]["torch"] == torch.__version__
    assert record["held_back"]["rotation_degrees"] > 0
    expected = training(generator, dataset, iterations=2)
    for _ in range(2):
        expected.step()
    kept = Encoder.load(out, generator).network.state_dict()
    for name, value in expected.network.state_dict().items():
        torch.testing.assert_close(kept[name], value)
    before = {path: path.read_bytes() for path in out.glob("*.safetensors")}
    assert command(monkeypatch, *given, "seed=4") == 2
    assert "was trained with seed=0, not 4; give the same, or another output" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in out.glob("*.safetensors")} == before


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["data=null"], "data=FOLDER is missing"),
        (["data=/nowhere/at/all"], "/nowhere/at/all"),
        (["checkpoint=/nowhere/at/all"], "this is no checkpoint of modi"),
        (["bach=3"], "unknown setting 'bach'; did you mean 'batch'"),
        (["mixing=2"], "mixing must be at most 1, not 2"),
        (["device=abacus"], "device 'abacus' cannot be used"),
    ],
)
def test_a_mistake_costs_one_line_and_leaves_nothing(
    checkpoint: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    changes: list[str], words: str,
) -> None:  # fmt: skip
    given = [f"checkpoint={checkpoint}", f"data={data}", f"output={tmp_path / 'out'}", *changes]
    assert command(monkeypatch, *given) == 2
    said = capsys.readouterr().err
    assert said.startswith("train.encoder: ")
    assert words in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_data_of_another_kind_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    footless = mg.create("modi", checkpoint=str(random_checkpoint(tmp_path / "one", FIGURE)))
    assert isinstance(footless, MoDi)
    with pytest.raises(MotionGenError, match="the dataset's feet"):
        training(footless, dataset)
    longer = mg.create(
        "modi", checkpoint=str(random_checkpoint(tmp_path / "two", FIGURE, dataset.layout.feet, frames=32))
    )
    assert isinstance(longer, MoDi)
    with pytest.raises(MotionGenError, match="the dataset's window is 16, the checkpoint's 32"):
        training(longer, dataset)
