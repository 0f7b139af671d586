"""Programs that train, measure and bundle models of MoDi, each at its smallest, for real."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

import motiongen as mg
from motiongen import rotations as rot
from motiongen.datasets import Dataset
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE
from tests.recognition.kinds import make_dataset, trained
from tools import bundle_model
from tools.paper_tables import architectures
from tools.paper_tables.__main__ import main as paper_tables

BUDGET = {
    "network.channels": "[8,8]",
    "network.latent_size": "8",
    "network.mapping_layers": "2",
    "network.deviation_group": "2",
    "trainer.iterations": "2",
    "trainer.batch": "4",
    "trainer.measured": "50",
}


def test_every_architecture_is_trained_once_and_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = make_dataset(tmp_path)
    trained(Dataset.open(data), iterations=5).save(tmp_path / "recogniser")
    monkeypatch.setattr(architectures, "BUDGET", BUDGET)
    given = ["modi", "--data", str(data), "--recogniser", str(tmp_path / "recogniser"), "--seeds", "1", "--count", "12"]
    given += ["--runs", str(tmp_path / "runs"), "--out", str(tmp_path / "out"), "--only", "full,positions"]
    assert paper_tables(given) == 0
    first = (tmp_path / "out" / "architectures.csv").read_text()
    rows = list(csv.DictReader(first.splitlines()))
    assert [row["name"] for row in rows] == ["real", "full", "positions"]
    assert all(np.isfinite(float(row[name])) for row in rows for name in architectures.FIGURES)
    page = (tmp_path / "out" / "architectures.md").read_text()
    assert "(11.5)" in page
    assert "`trainer.iterations=2`" in page

    def refuse(*arguments: object, **settings: object) -> None:
        raise AssertionError("what is trained is not trained again")

    monkeypatch.setattr(architectures.subprocess, "run", refuse)
    assert paper_tables(given) == 0
    assert (tmp_path / "out" / "architectures.csv").read_text() == first
    assert paper_tables([*given[:-1], "fool"]) == 2
    assert "there is no architecture 'fool'" in capsys.readouterr().err


def test_a_bundled_model_is_half_as_large_moves_alike_and_says_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = random_checkpoint(tmp_path / "run" / "best", FIGURE, (4, 6), "m")
    schedule = {"network": {"channels": [8, 8]}, "trainer": {"batch": 16}, "versions": {"torch": "2.13.0"}}
    (tmp_path / "run" / "run.json").write_text(json.dumps(schedule))
    figure = {"value": 1.5, "low": 1.0, "high": 2.0}
    evaluation = {"comparisons": {"generator": {"fid": figure}}, "physical": {"generator": {"jitter": None}}}
    (tmp_path / "evaluation.json").write_text(json.dumps(evaluation))
    (tmp_path / "faults.md").write_text("## Faults\n\nIt shakes.\n")
    out = tmp_path / "bundled"
    (out / "directions").mkdir(parents=True)  # of a model that stood there before
    given = [str(whole), "--credit", "By A, CC BY-NC 4.0.", "--out", str(out)]
    given += ["--evaluation", str(tmp_path / "evaluation.json"), "--faults", str(tmp_path / "faults.md")]
    assert bundle_model.main(given) == 0
    assert sorted(path.name for path in out.iterdir()) == ["README.md", "model.json", "model.safetensors"]
    assert {str(weight.dtype) for weight in load_file(out / "model.safetensors").values()} == {"float16"}
    one, other = (mg.create("modi", checkpoint=str(folder)).sample(16)[0] for folder in (whole, out))
    assert rot.angle_between(one.rotations, other.rotations).max() < 0.02
    assert mg.create("modi", checkpoint=str(out)).credit == "By A, CC BY-NC 4.0."
    card = (out / "README.md").read_text()
    for words in ("CC BY-NC 4.0", "| batch | 16 |", "1.5 [1, 2]", "It shakes.", "torch 2.13.0"):
        assert words in card
    assert bundle_model.main([str(tmp_path / "nowhere"), "--credit", "x", "--out", str(out)]) == 2
    assert "no checkpoint of modi" in capsys.readouterr().err
    assert (out / "README.md").read_text() == card
