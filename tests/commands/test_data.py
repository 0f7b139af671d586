"""`motiongen data` from end to end, on a few small clips."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from motiongen.commands.data import run
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from tests.datasets.clips import save_clips, stride

SMALL = ("--frames", "8", "--stride", "4", "--workers", "1", "--held-back", "0.3")


def data(*arguments: object) -> None:
    run([str(argument) for argument in arguments])


@pytest.fixture
def source(tmp_path: Path) -> Path:
    clips = {f"walk_[bold]_{i}.npz": stride(i, frames=20 if i else 5) for i in range(8)}
    return save_clips(tmp_path / "clips", clips)


def test_from_clips_to_a_dataset_and_through_a_packed_file(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data("import", source, tmp_path / "out", *SMALL, "--labels", "{what}_{how}_{number}")
    said = capsys.readouterr().out
    for words in ("dropped: 1 files", "1 too short", "walk_[bold]_0", "5 frames", "Hips", "LeftFoot", "label how"):
        assert words in said
    dataset = Dataset.open(tmp_path / "out")
    assert dataset.labels["how"] == ("[bold]",) * 7
    assert (dataset.window_frames, dataset.index.settings.stride, dataset.frame_rate) == (8, 4, 30.0)

    data("pack", tmp_path / "out", tmp_path / "packed.npz")
    assert "degrees" in capsys.readouterr().out
    data("unpack", tmp_path / "packed.npz", tmp_path / "back")
    assert Dataset.open(tmp_path / "back").fingerprint in capsys.readouterr().out

    data("info", tmp_path / "back", "--json")
    facts = json.loads(capsys.readouterr().out)
    assert facts["packed_from"] == dataset.fingerprint
    assert facts["clips"] == {split: len(dataset.clips(split)) for split in ("training", "held_back")}
    data("info", tmp_path / "out")
    assert dataset.fingerprint[:20] in capsys.readouterr().out


def test_several_sources_joints_and_a_rate(source: Path, tmp_path: Path) -> None:
    other = save_clips(tmp_path / "other", {"run.npz": stride(9, frames=40, frame_rate=60.0)})
    data("import", source, other, tmp_path / "out", *SMALL, "--joints", "Hips", "left*", "--rate", "30")
    dataset = Dataset.open(tmp_path / "out")
    assert dataset.skeleton.names == ("Hips", "LeftLeg", "LeftFoot")
    assert "run" in dataset.names


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "motiongen data --help"),
        (["imprt"], "import"),
        (["import"], "SOURCE"),
        (["import", "nothing", "out"], "no such file"),
        (["import", "clips", "out", "--frames", "many"], "many"),
        (["import", "clips", "out", "--stride", "0"], "stride must be"),
        (["import", "clips", "out", "--workers", "0"], "workers must be"),
        (["import", "clips", "out", "--labels", "plain"], "no field"),
        (["import", "clips", "out", "--joints", "Tail"], "no joint matches 'Tail'"),
        (["import", "clips", "clips", *SMALL], "this exists"),
        (["info", "clips"], "no such file"),
        (["pack", "clips", "file.npz"], "no such file"),
        (["unpack", "nothing.npz", "out"], "no such file"),
    ],
)
def test_a_mistake_costs_one_line_and_leaves_nothing(
    arguments: list[str], words: str, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MotionGenError) as caught:
        run(arguments)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["clips"]
