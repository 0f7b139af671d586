"""`python -m train` from end to end: it goes on where it was killed, is shared by processes, and stops when it must."""

from __future__ import annotations

import json
import random
import sys
import time
from pathlib import Path

import pytest
import torch

import motiongen as mg
import train.loop
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.generators.modi.checkpoint import load_training
from tests.train.runs import arguments, finish, make_dataset, start, training_of, weights_of
from train.__main__ import main

pytestmark = pytest.mark.xdist_group("training runs")  # one worker makes the unbroken run for all

ITERATIONS = 40
OFTEN = {"iterations": ITERATIONS, "checkpoint_every": 2, "keep": ITERATIONS, "log_every": 10}


def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], given: list[str]) -> tuple[int, str, str]:
    """The command in this process: exit code, output and errors."""
    monkeypatch.setattr(sys, "argv", ["train", *given])
    code = main()
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def checkpoints(output: Path) -> list[str]:
    return sorted(path.name for path in (output / "checkpoints").glob("*"))


@pytest.fixture(scope="module")
def unbroken(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("unbroken") / "out"
    finish(start(arguments(data, output, **OFTEN)))
    return output


def test_a_run_keeps_all_that_it_should(unbroken: Path, data: Path) -> None:
    assert checkpoints(unbroken) == [f"{i:08d}" for i in range(2, ITERATIONS + 1, 2)]
    record = json.loads((unbroken / "run.json").read_text())
    assert record["generator"] == "modi"
    assert record["trainer"]["iterations"] == ITERATIONS
    assert record["data_fingerprint"] == Dataset.open(data).fingerprint
    assert record["versions"]["torch"] == torch.__version__
    shown = unbroken / "motions" / f"{ITERATIONS:08d}"
    assert len(list(shown.glob("*.bvh"))) == 16
    assert {path.stem for path in shown.glob("*.png")} == {"made_0", "made_8", "real"}
    motion = mg.create("modi", checkpoint=str(unbroken / "best")).sample(frames=30)[0]
    assert motion.skeleton == Dataset.open(data).skeleton


def test_all_figures_are_logged_those_of_rare_terms_too(unbroken: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    log = EventAccumulator(str(unbroken / "logs")).Reload()
    names = {"loss/generator", "loss/discriminator", "loss/r1", "loss/path", "path/length", "contact/ratio",
             "loss/contact_consistency", "loss/contact_encouragement", "gradient/generator", "gradient/discriminator",
             "score/real", "score/fake", "spread/fake", "speed/iterations_per_second"}  # fmt: skip
    assert names | {"distance/held_back"} == set(log.Tags()["scalars"])
    for name in names:
        assert [event.step for event in log.Scalars(name)] == list(range(10, ITERATIONS + 1, 10)), name
    assert set(log.Tags()["images"]) == {"made 0", "made 8", "real"}


def test_a_killed_run_goes_on_as_if_nothing_had_happened(unbroken: Path, data: Path, tmp_path: Path) -> None:
    given = arguments(data, tmp_path, **OFTEN)
    process = start(given)
    least = random.randrange(1, ITERATIONS // 4)
    while len(checkpoints(tmp_path)) < least and process.poll() is None:
        time.sleep(0.01)
    time.sleep(random.uniform(0.0, 0.2))
    process.kill()
    process.communicate()
    assert process.returncode == -9, "it was faster than the one that should kill it"
    left = tmp_path / "checkpoints" / f"{train.loop.TEMPORARY}half-written"
    left.mkdir()
    finish(start(given))
    assert not left.exists()
    last = f"checkpoints/{ITERATIONS:08d}"
    ours, theirs = weights_of(tmp_path / last), weights_of(unbroken / last)
    assert ours.keys() == theirs.keys()
    assert [name for name in ours if not torch.equal(ours[name], theirs[name])] == []
    assert load_training(tmp_path / last)[0] == load_training(unbroken / last)[0]
    assert checkpoints(tmp_path) == checkpoints(unbroken)


def test_two_processes_make_the_weights_of_one(unbroken: Path, data: Path, tmp_path: Path) -> None:
    """But for the rounding of sums in another order: less than a thousandth of the way that each tensor has gone."""
    iterations = 4
    out = finish(start(arguments(data, tmp_path, **OFTEN | {"iterations": iterations}), processes=2))
    assert out.count(f"{iterations} iterations in") == 1, "one of them speaks"
    name = f"checkpoints/{iterations:08d}"
    ours, theirs = weights_of(tmp_path / name), weights_of(unbroken / name)
    begun = training_of(Dataset.open(data))
    assert ours.keys() == theirs.keys()
    for network in ("generator", "discriminator"):
        for key, weight in getattr(begun, network).named_parameters():
            one, two = theirs[f"training.{network}.{key}"], ours[f"training.{network}.{key}"]
            assert (one - weight).norm() > 1e-3
            assert (two - one).norm() < 1e-3 * (one - weight).norm(), f"{network}: {key}"
    for key, one in theirs.items():  # the optimisers' memory, the running mean and the mean path length too
        torch.testing.assert_close(ours[key], one, rtol=1e-3, atol=1e-3 * float(one.abs().max()))


def test_as_many_checkpoints_are_kept_as_asked_for_and_the_best(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distances = iter([5.0, 3.0, 4.0, 2.0, 6.0])
    monkeypatch.setattr("train.watch.Watch.look", lambda self, training: next(distances))
    training = training_of(Dataset.open(data), iterations=10, picture_every=2, checkpoint_every=3, keep=2)
    result = train.loop.run(training, tmp_path / "out", {})
    assert result["best_distance"] == 2.0
    assert result["checkpoint"] == str(tmp_path / "out" / "best")
    assert load_training(tmp_path / "out" / "best")[0]["iteration"] == 8
    assert checkpoints(tmp_path / "out") == ["00000009", "00000010"]
    assert load_training(tmp_path / "out" / "checkpoints" / "00000009")[0]["best_distance"] == 2.0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"best", "checkpoints", "logs", "run.json"}


def test_positions_have_no_best_and_say_where_the_last_is(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [*arguments(data, tmp_path / "out", iterations=2), "experiment=positions"]
    code, out, err = run(monkeypatch, capsys, given)
    assert (code, err) == (0, "")
    assert str(tmp_path / "out" / "checkpoints" / "00000002") in out
    assert "motiongen sample" not in out


# -- stopping


def finite(checkpoint: Path) -> bool:
    return all(bool(tensor.isfinite().all()) for tensor in weights_of(checkpoint).values())


def test_numbers_that_are_no_longer_finite_stop_it(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = arguments(data, tmp_path / "out", learning_rate=1e30, checkpoint_every=1)
    code, _, err = run(monkeypatch, capsys, given)
    assert code == 2
    assert err.count("\n") == 1
    assert "train: training stopped at iteration" in err
    last = train.loop.newest(tmp_path / "out" / "checkpoints")
    assert (str(last) if last else "there is no checkpoint before it") in err
    assert all(map(finite, (tmp_path / "out" / "checkpoints").iterdir() if last else []))
    assert not (tmp_path / "out" / "best").exists()


@pytest.mark.parametrize("network", ["generator", "discriminator", "mean_generator"])
def test_no_checkpoint_holds_weights_that_are_not_finite(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, network: str
) -> None:
    """Even where nothing else shows it yet: the last step of a term may be what breaks a weight."""
    training = training_of(Dataset.open(data), iterations=20, checkpoint_every=3, picture_every=4)
    step = training.step

    def poisoned() -> train.loop.Figures:
        figures = step()
        if training.iteration == 4:
            next(getattr(training, network).parameters()).data.view(-1)[0] = float("nan")
        return figures

    monkeypatch.setattr(training, "step", poisoned)
    with pytest.raises(MotionGenError, match=r"stopped at iteration 4, for a weight is not finite; .*00000003; try"):
        train.loop.run(training, tmp_path, {})
    assert checkpoints(tmp_path) == ["00000003"]
    assert finite(tmp_path / "checkpoints" / "00000003")
    assert not (tmp_path / "best").exists()


def test_motions_that_have_all_become_one_stop_it(data: Path, tmp_path: Path) -> None:
    training = training_of(
        Dataset.open(data), iterations=100, learning_rate=1e-30, log_every=1, checkpoint_every=3, path_weight=0.0
    )
    for level in training.generator.synthesis.levels:
        torch.nn.init.zeros_(level.output.convolution.weight)
    with pytest.raises(MotionGenError, match=r"stopped at iteration 5, for all motions have become one; .*00000003"):
        train.loop.run(training, tmp_path, {})


# -- mistakes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("network.channels=[8,4]", "was trained with another network; give the same, or another output"),
        (
            "trainer.learning_rate=0.1",
            "was trained with learning_rate=0.002, not 0.1; give the same, or",
        ),
        ("trainer.seed=1", "was trained with seed=0, not 1"),
        ("data", "was trained with another data"),
    ],
)
def test_another_training_in_the_same_output_is_refused(
    unbroken: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    change: str, words: str,
) -> None:  # fmt: skip
    before = {path: path.read_bytes() for path in unbroken.rglob("*") if path.is_file()}
    if change == "data":
        given = arguments(make_dataset(tmp_path, clips=5), unbroken, **OFTEN)
    else:
        given = [*arguments(data, unbroken, **OFTEN), change]
    code, out, err = run(monkeypatch, capsys, given)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert words in err
    assert {path: path.read_bytes() for path in unbroken.rglob("*") if path.is_file()} == before


def test_a_run_can_begin_from_another_ones_checkpoint(
    unbroken: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the same settings it becomes the same; others may change, but for the sizes of the networks."""
    begun = f"start={unbroken / 'checkpoints' / '00000036'}"
    given = arguments(data, tmp_path / "same", **OFTEN)
    assert run(monkeypatch, capsys, [*given, begun])[0] == 0
    assert checkpoints(tmp_path / "same") == ["00000038", "00000040"]
    for name in ("model.safetensors", "training.safetensors"):
        ours, theirs = (folder / "checkpoints" / "00000040" / name for folder in (tmp_path / "same", unbroken))
        assert ours.read_bytes() == theirs.read_bytes()
    changed = [*arguments(data, tmp_path / "other", **OFTEN), begun, "trainer.learning_rate=0.1"]
    assert run(monkeypatch, capsys, [*changed, "network.smoothing=false"])[0] == 0
    code, _, err = run(
        monkeypatch, capsys, [*arguments(data, tmp_path / "wide", **OFTEN), begun, "network.channels=[9,8]"]
    )
    assert code == 2
    assert "training cannot go on from it" in err
    assert not (tmp_path / "wide" / "checkpoints").exists()


def test_a_run_that_has_ended_can_be_made_longer(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for iterations, expected in ((2, ["00000002"]), (2, ["00000002"]), (3, ["00000002", "00000003"])):
        code, out, _ = run(monkeypatch, capsys, arguments(data, tmp_path / "out", iterations=iterations))
        assert code == 0
        assert f"{iterations} iterations in" in out
        assert checkpoints(tmp_path / "out") == expected


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["data=null"], "data=FOLDER is missing"),
        (["data=/nowhere/at/all"], "/nowhere/at/all"),
        (["generator=genmm"], "generator=genmm is not trained; generator=modi is"),
        (["generator=mody"], "did you mean 'modi'"),
        (["trainer.bach=3"], "unknown setting 'trainer.bach'; did you mean 'trainer.batch'"),
        (["trainer.batch=5"], "a batch of 5 cannot be shared by 1 processes"),
        (["trainer.iterations=many"], "iterations must be of type int, not 'many'"),
        (["trainer.precision=float16"], "precision must be one of float32, bfloat16"),
        (["trainer.device=abacus"], "device 'abacus' cannot be used"),
        (["network.channels=[8,8,8,8,8,8]"], "frames must be a multiple of 32"),
        (["+network.frames=32"], "network.frames=32, but the windows"),
        (["experiment=poolin"], "did you mean 'pooling'"),
        (["--iterations=3"], "key=value"),
    ],
)
def test_a_mistake_costs_one_line_and_leaves_nothing(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    changes: list[str], words: str,
) -> None:  # fmt: skip
    code, out, err = run(monkeypatch, capsys, [*arguments(data, tmp_path / "out"), *changes])
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith("train: ")
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_is_no_traceback(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(train.loop, "run", interrupted)
    code, _, err = run(monkeypatch, capsys, arguments(data, tmp_path / "out"))
    assert (code, err) == (130, "train: stopped; the same command goes on from the last checkpoint\n")


def test_help_shows_the_settings(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(monkeypatch, capsys, ["--help"])
    assert code == 0
    for word in ("learning_rate: 0.002", "scaler: convolution", "torchrun", "data: null"):
        assert word in out
