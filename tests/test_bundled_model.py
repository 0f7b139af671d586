"""The model and the recogniser that come along: they load, fit each other, and say whose data they learned from."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import quality
from motiongen.assets import BUNDLED_MODEL, BUNDLED_RECOGNISER
from motiongen.attributes import attributes
from motiongen.cli import main
from motiongen.generators.modi.directions import kept_direction, load_direction, move
from motiongen.generators.modi.generator import MoDi
from motiongen.recognition import Recogniser

MOST_BYTES = 25e6


@pytest.fixture(scope="module")
def model() -> MoDi:
    made = mg.create("modi")
    assert isinstance(made, MoDi)
    return made


def test_it_is_small_and_says_what_it_may_not_be_used_for(model: MoDi) -> None:
    assert sum(path.stat().st_size for path in BUNDLED_MODEL.rglob("*")) < MOST_BYTES
    assert "CC BY-NC 4.0" in model.credit
    assert model.credit in (BUNDLED_MODEL / "README.md").read_text(encoding="utf-8")


def test_its_motions_move_and_differ_and_hold_together(model: MoDi) -> None:
    motions = model.sample(frames=64, count=8, seed=0)
    moving = [np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1).mean() for motion in motions]
    assert min(moving) > 0
    apart = [np.abs(one.rotations - other.rotations).mean() for one, other in itertools.pairwise(motions)]
    assert min(apart) > 0.01
    heights = [motion.positions[..., 1].max() / motion.skeleton.height for motion in motions]
    assert all(0.5 < height < 1.6 for height in heights), "it stands upright on the ground"
    assert np.mean([quality.jitter(motion) or 0.0 for motion in motions]) < 200


def test_the_recogniser_knows_its_skeleton_and_recognises_what_it_makes(model: MoDi) -> None:
    recogniser = Recogniser.load(BUNDLED_RECOGNISER)
    assert recogniser.card.skeleton.difference(model.skeleton) is None
    found = recogniser.probabilities(recogniser.of_motions(model.sample(frames=64, count=32, seed=1)))
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert len(set(found.argmax(axis=1))) >= 4, "it makes motions of several kinds"


@pytest.mark.parametrize("name", list(attributes()))
def test_a_direction_comes_along_for_each_attribute(model: MoDi, name: str) -> None:
    path = kept_direction(model, name)
    assert path is not None
    direction = load_direction(path, model)
    assert direction.name == name
    moved = move(model.latents(1), direction, [0.0, 1.0])
    np.testing.assert_allclose(np.linalg.norm(moved[1] - moved[0]), direction.spread, rtol=1e-4)


def test_it_is_listed_and_credited(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["list"]) == 0
    assert "CC BY-NC 4.0" in capsys.readouterr().out
    assert main(["list", "--json"]) == 0
    assert "iterations" in json.loads(capsys.readouterr().out)["models"]["modi"]
    assert main(["sample", "generator=modi", "frames=16", "preview=none"]) == 0
    assert "CC BY-NC 4.0" in capsys.readouterr().out
    assert "CC BY-NC 4.0" in json.loads((tmp_path / "motiongen-out" / "report.json").read_text())["run"]["credit"]
