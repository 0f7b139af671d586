"""The tools that measure inversion and the encoder, on a model that is nothing but small."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import pytest

import motiongen as mg
from motiongen.datasets import Dataset
from motiongen.generators.modi.generator import MoDi
from tests.train.runs import make_dataset, training_of
from tools import modi_encoder_tasks, modi_inversion
from train.encoder import EncoderSettings, EncoderTraining
from train.encoder import run as train_encoder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint, its encoder and its data."""
    folder = tmp_path_factory.mktemp("measured")
    dataset = Dataset.open(make_dataset(folder))
    training_of(dataset).save(folder / "modi", {})
    generator = mg.create("modi", checkpoint=str(folder / "modi"))
    assert isinstance(generator, MoDi)
    settings = EncoderSettings(iterations=1, batch=2)
    train_encoder(EncoderTraining(generator, dataset, settings), folder / "encoder", {})
    return folder


def given(folder: Path, out: Path, *more: str) -> list[str]:
    return ["tool", "--checkpoint", str(folder / "modi"), "--data", str(folder / "data"), "--out", str(out), *more]


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("with_encoder", [False, True])
def test_all_methods_are_measured_on_all_kinds(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_encoder: bool
) -> None:
    monkeypatch.setattr(modi_inversion, "STEPS", (1, 2))
    monkeypatch.setattr(modi_inversion, "FROM_GUESS", (1,))
    more = ["--encoder", str(folder / "encoder")] if with_encoder else []
    monkeypatch.setattr(sys, "argv", given(folder, tmp_path, "--windows", "2", "--steps", "3", *more))
    modi_inversion.main()
    methods = ["mean code", "optimiser, W", "optimiser, W+", *(["encoder", "both, W+"] if with_encoder else [])]
    rows = table(tmp_path / "errors.csv")
    assert [(row["motions"], row["method"]) for row in rows] == [(k, m) for k in modi_inversion.KINDS for m in methods]
    for row in rows:
        assert float(row["rotation_degrees"]) > 0
        assert (float(row["distance"]) == 0) == (row["method"] == "mean code")
    text = (tmp_path / "inversion.md").read_text()
    for kind in modi_inversion.KINDS:
        assert f"![{kind}]({kind}.png)" in text
        assert (tmp_path / f"{kind}.png").stat().st_size > 1000
    assert len(table(tmp_path / "time.csv")) == (4 if with_encoder else 2)


def test_all_tasks_of_the_encoder_are_measured(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    more = ["--encoder", str(folder / "encoder"), "--windows", "3", "--joints", "Left*"]
    monkeypatch.setattr(sys, "argv", given(folder, tmp_path, *more))
    modi_encoder_tasks.main()
    rows = table(tmp_path / "tasks.csv")
    names = [task.__name__ for task in modi_encoder_tasks.TASKS]
    assert list(dict.fromkeys(row["task"] for row in rows)) == names
    assert all(float(row["rotation_degrees"]) > 0 for row in rows)
    text = (tmp_path / "tasks.md").read_text()
    for name in names:
        assert f"![{name}]({name}.png)" in text
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
