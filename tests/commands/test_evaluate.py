"""`motiongen evaluate` from end to end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen.commands.evaluate import HELD_BACK, MADE, NOISE, SHUFFLED, TRAINING, run
from motiongen.datasets import Dataset, ImportSettings, import_clips
from motiongen.errors import MotionGenError
from motiongen.metrics.frechet import frechet_distance
from motiongen.metrics.physical import measure_physical
from motiongen.recognition import Recogniser
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import save_clips
from tests.recognition.kinds import FRAMES, clip_of, make_dataset, trained

COUNT = 40


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_dataset(tmp_path_factory.mktemp("kinds"), clips=9)


@pytest.fixture(scope="module")
def known(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recogniser."""
    folder = tmp_path_factory.mktemp("recognisers") / "kinds"
    trained(Dataset.open(data), iterations=15).save(folder)
    return folder


@pytest.fixture(scope="module")
def model(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint of MoDi that has learned nothing."""
    layout = Dataset.open(data).layout
    return random_checkpoint(tmp_path_factory.mktemp("checkpoints") / "modi", layout.skeleton, layout.feet)


@pytest.fixture(scope="module")
def settings(data: Path, known: Path, model: Path) -> list[str]:
    return [
        f"data={data}",
        f"recogniser={known}",
        f"generator.checkpoint={model}",
        f"count={COUNT}",
        "resamples=3",
        "generator.clean_feet=false",
    ]


def test_what_is_written_is_what_the_motions_are(
    settings: list[str], data: Path, known: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run([*settings, "seed=3", f"output={tmp_path / 'o'}"])
    assert sorted(path.name for path in (tmp_path / "o").iterdir()) == ["evaluation.json", "evaluation.md"]
    found = json.loads((tmp_path / "o" / "evaluation.json").read_text())
    assert list(found["comparisons"]) == [MADE, TRAINING, SHUFFLED, NOISE]
    assert (found["count"], found["frames"], found["seed"]) == (COUNT, FRAMES, 3)

    recogniser, dataset = Recogniser.load(known), Dataset.open(data)
    made = mg.create("modi", checkpoint=str(model), clean_feet=False).sample(FRAMES, COUNT, 3)
    real = dataset.draw("held_back", COUNT, np.random.default_rng([3, *HELD_BACK.encode()]))
    seen = [dataset.to_motion(window, standardised=False) for window in dataset.batch(real, standardised=False)]
    ours, theirs = (recogniser.features(recogniser.of_motions(motions)) for motions in (made, seen))
    distance = frechet_distance(theirs.astype(np.float64), ours.astype(np.float64))
    assert found["comparisons"][MADE]["fid"]["value"] == pytest.approx(distance, rel=1e-2)
    assert found["physical"] == {
        MADE: pytest.approx(measure_physical(made, dataset.layout.feet).to_dict(), abs=1e-9),
        HELD_BACK: pytest.approx(measure_physical(seen, dataset.layout.feet).to_dict(), abs=1e-9),
    }

    page, said = (tmp_path / "o" / "evaluation.md").read_text(), capsys.readouterr().out
    for name, each in found["comparisons"].items():
        for text in (page, said):
            assert name in text
            assert f"{each['fid']['value']:.3g} [" in text


def test_real_motions_are_nearest_and_the_same_seed_gives_the_same_figures(settings: list[str], tmp_path: Path) -> None:
    for name in "ab":
        run([*settings, f"output={tmp_path / name}"])
    a, b = (json.loads((tmp_path / name / "evaluation.json").read_text()) for name in "ab")
    assert a["comparisons"] == b["comparisons"]
    distances = {name: each["fid"]["value"] for name, each in a["comparisons"].items()}
    assert min(distances, key=lambda name: distances[name]) == TRAINING


def test_a_generator_that_works_from_examples(settings: list[str], tmp_path: Path) -> None:
    """On clips that are no part of the dataset, at twice its rate."""
    clip = clip_of("turn", 50, frames=60)
    clip.resample(60.0).save(tmp_path / "turn.bvh")
    given = [each for each in settings if not each.startswith("generator")]
    run([*given, "generator=genmm", f"input={tmp_path / 'turn.bvh'}", "count=10", f"output={tmp_path / 'o'}"])
    found = json.loads((tmp_path / "o" / "evaluation.json").read_text())
    assert (found["generator"], found["frames"], found["frame_rate_hz"]) == ("genmm", 2 * FRAMES, 60.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["data=null"], "data=FOLDER is missing"),
        (["data=nowhere"], "no such file"),
        (["recogniser=nowhere"], "no recogniser, for it holds no model.json"),
        (["generator.checkpoint=nowhere"], "no checkpoint of modi"),
        (["count=9"], "count must be a whole number of at least 10, not 9"),
        (["resamples=1"], "resamples must be a whole number of at least 2"),
        (["seed=-1"], "seed must be a whole number"),
        (["counts=9"], "did you mean 'count'"),
        (["generator=genmm"], "another skeleton than the dataset's"),
    ],
)
def test_mistakes_cost_one_line_and_leave_nothing(
    settings: list[str], changes: list[str], words: str, tmp_path: Path
) -> None:
    if "generator=genmm" in changes:
        settings = [each for each in settings if not each.startswith("generator")]
    with pytest.raises(MotionGenError, match=words) as caught:
        run([*settings, f"output={tmp_path / 'o'}", *changes])
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_data_of_which_nothing_was_held_back_is_refused(settings: list[str], tmp_path: Path) -> None:
    clips = {f"nod_{seed}.npz": clip_of("nod", seed) for seed in range(3)}
    whole = ImportSettings(frames=FRAMES, held_back=0.0)
    import_clips(save_clips(tmp_path / "clips", clips), tmp_path / "data", whole)
    with pytest.raises(MotionGenError, match="'held_back' has no clips"):
        run([*settings, f"data={tmp_path / 'data'}", f"output={tmp_path / 'o'}"])


def test_data_at_another_rate_than_the_recogniser_knows_is_refused(settings: list[str], tmp_path: Path) -> None:
    clips = {f"nod_{seed}.npz": clip_of("nod", seed) for seed in range(8)}
    slower = ImportSettings(frames=FRAMES // 2, held_back=0.5, frame_rate=15.0)
    import_clips(save_clips(tmp_path / "clips", clips), tmp_path / "data", slower)
    with pytest.raises(MotionGenError, match="it runs at 15 Hz and not at 30 Hz"):
        run([*settings, f"data={tmp_path / 'data'}", f"output={tmp_path / 'o'}"])
