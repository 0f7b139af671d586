"""`python -m train.recogniser` from end to end."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from motiongen.datasets import Dataset
from motiongen.recognition import Recogniser
from motiongen.recognition.positions import window_positions
from tests.recognition.kinds import KINDS, make_dataset
from train.recogniser import Draws, RecogniserSettings, classes_of, main, measured, summary

QUICK = ["label=kind", "channels=[4,8]", "iterations=4", "batch=8"]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_dataset(tmp_path_factory.mktemp("kinds"), clips=9)


@pytest.fixture(scope="module")
def dataset(data: Path) -> Dataset:
    return Dataset.open(data)


def test_a_run_leaves_a_recogniser_and_says_how_well_it_knows_motions(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*QUICK, f"data={data}", f"output={tmp_path / 'made'}"]) == 0
    card = Recogniser.load(tmp_path / "made").card
    dataset = Dataset.open(data)
    assert card.classes == tuple(sorted(KINDS))
    assert (card.data_fingerprint, card.frames, card.label) == (dataset.fingerprint, dataset.window_frames, "kind")
    assert card.confusion is not None
    assert card.confusion.sum() == len(dataset.windows("held_back"))
    assert card.accuracy == card.confusion.trace() / card.confusion.sum()
    said = capsys.readouterr().out.splitlines()
    assert said == [*summary(card), f"recogniser: {tmp_path / 'made'}"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made"]


def test_the_same_seed_gives_the_same_recogniser(data: Path, tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert main([*QUICK, f"data={data}", f"seed={seed}", f"output={tmp_path / name}"]) == 0
    weights = [(tmp_path / name / "model.safetensors").read_bytes() for name in "abc"]
    assert weights[0] == weights[1] != weights[2]


def test_accuracy_is_what_the_kept_recogniser_reaches(dataset: Dataset, data: Path, tmp_path: Path) -> None:
    assert main([*QUICK, "iterations=12", f"data={data}", f"output={tmp_path / 'made'}"]) == 0
    kept = Recogniser.load(tmp_path / "made")
    _, class_of = classes_of(dataset, RecogniserSettings.build({"label": "kind"}))
    again = measured(kept, dataset, class_of)
    assert again.card.to_dict() == kept.card.to_dict()
    windows = dataset.windows("held_back")
    positions = window_positions(dataset, windows)
    right = kept.probabilities(positions).argmax(axis=1) == class_of[windows[:, 0]]
    assert kept.card.accuracy == pytest.approx(right.mean())
    by_class = [right[class_of[windows[:, 0]] == k].mean() for k in np.unique(class_of[windows[:, 0]])]
    assert kept.card.balanced_accuracy == pytest.approx(np.mean(by_class))


@pytest.mark.parametrize("balance", [0.0, 0.5, 1.0])
def test_rare_classes_are_favoured_as_far_as_asked(dataset: Dataset, balance: float) -> None:
    """Two classes and clips of none: the share of a class is its places to the power of 1 - balance."""
    class_of = np.full(len(dataset.names), 1)
    clips = dataset.clips("training")
    class_of[clips[:3]], class_of[clips[3]] = 0, -1
    windows = Draws(dataset, class_of, balance).windows(4000, np.random.default_rng(0))
    assert not (windows[:, 0] == clips[3]).any()
    dataset.batch(windows[:200])  # all lie within their clips
    places = dataset.index.lengths - dataset.window_frames + 1
    sizes = np.array([places[clips[class_of[clips] == k]].sum() for k in (0, 1)]) ** (1 - balance)
    assert np.mean(class_of[windows[:, 0]] == 0) == pytest.approx(sizes[0] / sizes.sum(), abs=0.03)


def test_classes_with_few_clips_are_left_out(dataset: Dataset) -> None:
    kinds = ["common" if clip % 2 else "usual" for clip in range(len(dataset.names))]
    for clip, kind in zip(dataset.clips("training"), ("rare", "rare", "")):
        kinds[clip] = kind
    labelled = Dataset(
        dataclasses.replace(dataset.index, labels={"kind": tuple(kinds)}), dataset.frames, dataset.facing
    )
    for least, expected in ((2, ("common", "rare", "usual")), (3, ("common", "usual"))):
        names, class_of = classes_of(labelled, RecogniserSettings.build({"label": "kind", "least_clips": least}))
        assert names == expected
        assert [names[k] if k >= 0 else None for k in class_of] == [kind if kind in names else None for kind in kinds]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["data=null"], "data=FOLDER is missing"),
        (["data=nowhere"], "no such file"),
        (["label=knid"], "the dataset has no label 'knid'; did you mean 'kind'?"),
        (["least_clips=1000"], "label=kind has 0 classes with least_clips=1000"),
        (["label=number"], "has 0 classes"),
        (["pseudo_classes=9"], "pseudo_classes must be from 2 to 3"),
        (["iterations=0"], "iterations must be at least 1"),
        (["balance=2"], "balance must be at most 1"),
        (["channels=[8,0]"], "channels must be whole numbers from 1 on"),
        (["learning_rate=1e30"], "take a lower learning_rate"),
        (["iteration=5"], "did you mean 'iterations'?"),
    ],
)
def test_mistakes_cost_one_line_and_leave_nothing(
    settings: list[str], words: str, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*QUICK, f"data={data}", f"output={tmp_path / 'o'}", *settings]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_stays(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "notes.txt").write_text("mine")
    assert main([*QUICK, f"data={data}", f"output={tmp_path / 'o'}"]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "o").iterdir()] == ["notes.txt"]
