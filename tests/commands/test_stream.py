"""`motiongen stream` from end to end."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.cli import main


def test_chunks_are_those_of_the_program(tmp_path: Path) -> None:
    clip = mg.load(EXAMPLE_CLIP)[:300]
    clip.save(tmp_path / "clip.bvh")
    settings = [f"input={tmp_path / 'clip.bvh'}", "chunk_frames=90", "chunks=3", "seed=4", f"output={tmp_path / 'o'}"]
    assert main(["stream", *settings]) == 0
    generator = mg.create("genmm").fit([mg.load(tmp_path / "clip.bvh")])
    made = list(itertools.islice(generator.stream(90, 4), 3))
    paths = sorted((tmp_path / "o").glob("*.bvh"))
    assert [path.stem for path in paths] == [chunk.name for chunk in made]
    for path, chunk in zip(paths, made):
        np.testing.assert_allclose(mg.load(path).positions, chunk.positions, atol=1e-4 * clip.skeleton.height)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["chunks=0"], "chunks must be a whole number of at least 1"),
        (["format=abc"], "format must be one of bvh, glb, fbx, npz, not 'abc'"),
        (["chunk_frames=0"], "chunk"),
        (["input=nothing.bvh"], "no such file"),
        (["chunkz=3"], "chunks"),
    ],
)
def test_mistakes_cost_one_line_and_leave_nothing(
    settings: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["stream", f"output={tmp_path / 'o'}", *settings]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "o").exists()
