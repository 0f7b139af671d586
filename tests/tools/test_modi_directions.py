"""The page on directions of MoDi's latent space, from a network of random weights."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen.generators.modi.directions import kept_direction, load_direction
from tests.bipeds import biped
from tests.checkpoints import random_checkpoint

pytest.importorskip("sklearn", reason="directions are learnt with scikit-learn, of the extra `latent`")
pytest.importorskip("matplotlib", reason="pictures are drawn with matplotlib, of the extra `plots`")


def test_what_rises() -> None:
    from tools.modi_directions import rising

    rows = np.array([[0, 1, 2], [0, 0, 1], [2, 1, 3], [1, 1, 1], [3, 2, 1], [1, 0.9, 4]], dtype=float)
    assert rising(rows.T, 0.5) == (2 / 6, 4 / 6)
    assert rising(rows.T, 1.5) == (3 / 6, 4 / 6), "small falls count for nothing"


def test_the_page_and_the_directions_that_the_checkpoint_keeps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tools import modi_directions

    names = ["hand_height", "speed"]
    monkeypatch.setattr(
        modi_directions, "attributes_for", lambda motion: {name: modi_directions.attribute_of(name) for name in names}
    )
    feet = tuple(joint for joint, name in enumerate(biped().names) if name.endswith("Foot"))
    folder = random_checkpoint(tmp_path / "checkpoint", biped(), feet, "m")
    settings = ["--checkpoint", str(folder), "--samples", "80", "--moved", "3", "--bundle"]
    assert modi_directions.main([str(tmp_path / "out"), *settings]) == 0
    page = (tmp_path / "out" / "directions.md").read_text()
    for picture in (tmp_path / "out").glob("*.png"):
        assert f"]({picture.name})" in page
    with (tmp_path / "out" / "disentanglement.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["direction"], row["kind"]) for row in rows] == [
        (name, kind) for kind in (modi_directions.PLAIN, modi_directions.ORTHOGONAL) for name in names
    ]
    generator = mg.create("modi", checkpoint=str(folder))
    for row in rows[:2]:
        path = kept_direction(generator, row["direction"])
        assert path is not None
        assert load_direction(path, generator).change == pytest.approx(float(row[row["direction"]]), abs=1e-4)
    assert modi_directions.main([str(tmp_path / "out"), "--checkpoint", str(tmp_path / "nowhere")]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("modi_directions: ")
