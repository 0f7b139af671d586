"""Checkpoints: what is saved comes back, whole or not at all, and what is damaged costs one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import motiongen as mg
from motiongen.errors import MotionGenError
from motiongen.generators.modi import checkpoint
from motiongen.generators.modi.checkpoint import load_model, load_training, save_checkpoint
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return random_checkpoint(tmp_path / "one", FIGURE, (4, 6), "m")


def test_what_is_saved_comes_back(saved: Path, tmp_path: Path) -> None:
    card, weights = load_model(saved)
    strided = {name: weight.T if weight.ndim == 2 else weight for name, weight in weights.items()}
    shared = {"a": torch.arange(6.0), "empty": torch.zeros(0)}
    shared["b"] = shared["a"][2:]
    save_checkpoint(tmp_path / "deep" / "two", card, strided, ({"iteration": 3}, shared))
    again, weights_again = load_model(tmp_path / "deep" / "two")
    for name in ("network", "layout", "frame_rate", "unit", "data_fingerprint", "iteration", "samples"):
        assert getattr(again, name) == getattr(card, name)
    np.testing.assert_array_equal(again.mean, card.mean)
    np.testing.assert_array_equal(again.deviation, card.deviation)
    assert again.mean.dtype == np.float32
    assert all(torch.equal(weights_again[name], strided[name]) for name in strided)
    state, tensors = load_training(tmp_path / "deep" / "two")
    assert state == {"iteration": 3}
    assert set(tensors) == set(shared)
    assert all(torch.equal(tensors[name], shared[name]) for name in shared)
    assert {path.name for path in tmp_path.iterdir()} == {"one", "deep"}


def test_one_to_sample_from_cannot_be_trained_on(saved: Path) -> None:
    with pytest.raises(MotionGenError, match=r"holds no training\.json"):
        load_training(saved)


def test_nothing_half_written_is_left(saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    card, weights = load_model(saved)
    before = {path: path.read_bytes() for path in saved.iterdir()}
    with pytest.raises(MotionGenError, match="cannot be written"):
        save_checkpoint(saved, card, weights)  # something is there
    with pytest.raises(MotionGenError, match="cannot be written"):
        save_checkpoint(saved / "model.json" / "under-a-file", card, weights)
    monkeypatch.setattr("safetensors.torch.save_file", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(MotionGenError, match="disk full"):
        save_checkpoint(tmp_path / "two", card, weights)
    assert [path.name for path in tmp_path.iterdir()] == ["one"]
    assert {path: path.read_bytes() for path in saved.iterdir()} == before


def edited(**changes: Any) -> Callable[[Path], None]:
    """What changes model.json."""

    def edit(folder: Path) -> None:
        path = folder / "model.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return edit


def truncated(name: str) -> Callable[[Path], None]:
    def truncate(folder: Path) -> None:
        path = folder / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return truncate


def foreign(folder: Path) -> None:
    from safetensors.torch import save_file

    save_file({"weight": torch.zeros(2)}, folder / "model.safetensors")


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (truncated("model.json"), "model cannot be read"),
        (truncated("model.safetensors"), "model cannot be read"),
        (lambda folder: (folder / "model.json").unlink(), "this is no checkpoint of modi"),
        (lambda folder: (folder / "model.safetensors").unlink(), "model cannot be read"),
        (lambda folder: (folder / "model.json").write_bytes(b"\xff\x00"), "model cannot be read"),
        (lambda folder: (folder / "model.json").write_text("[]"), "no JSON object"),
        (lambda folder: (folder / "model.json").write_text("{}"), "a checkpoint of 'None'"),
        (foreign, "the weights are not the model's"),
        (edited(format=checkpoint.FORMAT + 1), "in format 2; .* update motiongen"),
        (edited(generator="other"), "a checkpoint of 'other'"),
        (edited(network={"chanels": [8]}), r"model\.json is damaged .*chanels"),
        (edited(network={"frames": 16, "channels": [8, 8]}), "the weights are not the model's|mean and deviation"),
        (edited(network=3), "damaged"),
        (edited(layout={}), "damaged"),
        (edited(mean=[[0.0]]), "damaged .*shape"),
        (edited(mean="much"), "damaged"),
        (edited(frame_rate_hz=None), "damaged"),
    ],
)
def test_damage_costs_one_line(saved: Path, harm: Callable[[Path], None], words: str) -> None:
    harm(saved)
    with pytest.raises(MotionGenError, match=words) as raised:
        mg.create("modi", checkpoint=str(saved))
    assert "\n" not in str(raised.value)
    assert str(saved) in str(raised.value)


def test_no_code_runs_from_a_checkpoint(saved: Path) -> None:
    assert {path.suffix for path in saved.iterdir()} == {".json", ".safetensors"}
