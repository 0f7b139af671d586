"""Steps of training: what they do to the weights, in every ablation, and that motions come nearer to real ones."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from motiongen.assets import config_folder
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.metrics.frechet import descriptors, frechet_distance
from tests.train.runs import ALONE, training_of
from train.draws import numpy_random, torch_random
from train.modi import ModiTraining
from train.watch import made_motions, real_motions
from train.workers import Workers


def weights(training: ModiTraining) -> list[Tensor]:
    networks = (training.generator, training.discriminator, training.mean_generator)
    return [weight.detach().clone() for network in networks for weight in network.parameters()]


def test_draws_depend_on_seed_iteration_and_purpose_alone() -> None:
    def draw(*which: object) -> tuple[int, float]:
        return int(numpy_random(*which).integers(2**62)), float(torch.rand((), generator=torch_random(*which)))

    first = draw(0, 1, "codes")
    torch.rand(100)
    np.random.default_rng().random(100)
    assert draw(0, 1, "codes") == first
    for other in (draw(1, 1, "codes"), draw(0, 2, "codes"), draw(0, 1, "data")):
        assert other[0] != first[0]
        assert other[1] != first[1]


def test_a_seed_is_a_training(dataset: Dataset) -> None:
    runs = [training_of(dataset, seed=seed) for seed in (0, 0, 1)]
    for training in runs:
        training.step()
        torch.rand(7)  # the global state is none of its concern
        training.step()
    one, same, other = map(weights, runs)
    assert all(torch.equal(a, b) for a, b in zip(one, same))
    assert not any(torch.equal(a, b) for a, b in zip(one, other) if a.any())


def test_the_running_mean_forgets_half_in_its_half_life(dataset: Dataset) -> None:
    """With weights that no longer move, what is left of the difference halves in so many samples."""
    training = training_of(dataset, mean_half_life=40.0, learning_rate=1e-30)
    with torch.no_grad():
        for weight in training.generator.parameters():
            weight.add_(1.0)
    before = [weight.clone() for weight in training.mean_generator.parameters()]
    for _ in range(10):  # of four samples each
        training.step()
    for mean, start, now in zip(training.mean_generator.parameters(), before, training.generator.parameters()):
        torch.testing.assert_close(mean, torch.lerp(start, now, 0.5))


def test_lazy_terms_come_when_they_are_due_and_zero_weight_leaves_them_out(dataset: Dataset) -> None:
    def due(**settings: float) -> list[set[str]]:
        training = training_of(dataset, **settings)
        return [{"loss/r1", "loss/path"} & set(training.step()) for _ in range(4)]

    both, path, none = {"loss/r1", "loss/path"}, {"loss/path"}, set[str]()
    assert due(r1_every=3, path_every=2) == [both, none, path, {"loss/r1"}]
    assert due(r1_weight=0.0, path_every=1) == [path] * 4
    assert due(r1_weight=0.0, path_weight=0.0) == [none] * 4


def test_the_mean_path_length_follows_the_lengths(dataset: Dataset) -> None:
    training = training_of(dataset, path_every=1, path_memory=1.0)
    figures = training.step()
    assert training.mean_path_length > 0
    torch.testing.assert_close(figures["path/length"], training.mean_path_length)
    slow = training_of(dataset, path_every=1, path_memory=0.25)
    slow.step()
    torch.testing.assert_close(slow.mean_path_length, 0.25 * figures["path/length"])


def test_every_step_moves_its_own_network_only(dataset: Dataset) -> None:
    training = training_of(dataset)
    for step, moving, still in (
        (training._discriminator_step, training.discriminator, training.generator),
        (training._r1_step, training.discriminator, training.generator),
        (training._generator_step, training.generator, training.discriminator),
        (training._path_step, training.generator, training.discriminator),
    ):
        before = copy.deepcopy(moving.state_dict()), copy.deepcopy(still.state_dict())
        step()
        assert any(not torch.equal(before[0][name], value) for name, value in moving.state_dict().items())
        assert all(torch.equal(before[1][name], value) for name, value in still.state_dict().items())


EXPERIMENTS = [path.stem for path in (config_folder() / "experiment").glob("*.yaml")]


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_trains_saves_and_goes_on(dataset: Dataset, tmp_path: Path, experiment: str) -> None:
    from omegaconf import OmegaConf

    changes = OmegaConf.to_container(OmegaConf.load(config_folder() / "experiment" / f"{experiment}.yaml"))
    assert isinstance(changes, dict)
    training, other = (training_of(dataset, changes, r1_every=2, path_every=2, seed=seed) for seed in (0, 1))
    before = weights(training)
    for _ in range(3):
        assert all(figure.isfinite() for figure in training.step().values())
    assert training.is_finite()
    assert not any(torch.equal(a, b) for a, b in zip(before, weights(training)) if a.any())
    training.save(tmp_path / "checkpoint", {"best_distance": 2.5})
    other.settings = training.settings
    assert other.load(tmp_path / "checkpoint")["best_distance"] == 2.5
    for each in (training, other):
        each.step()
    assert other.iteration == 4
    assert all(torch.equal(a, b) for a, b in zip(weights(training), weights(other)))
    with pytest.raises(MotionGenError, match="was trained with another network"):
        training_of(dataset).load(tmp_path / "checkpoint")


@pytest.mark.parametrize("part", ["mean_path_length", "generator.synthesis.constant"])
def test_a_checkpoint_that_lacks_something_costs_one_line(dataset: Dataset, tmp_path: Path, part: str) -> None:
    from safetensors.torch import load_file, save_file

    training = training_of(dataset)
    training.save(tmp_path / "checkpoint", {})
    tensors = load_file(tmp_path / "checkpoint" / "training.safetensors")
    del tensors[part]
    save_file(tensors, tmp_path / "checkpoint" / "training.safetensors")
    with pytest.raises(MotionGenError, match="training cannot go on from it") as raised:
        training.load(tmp_path / "checkpoint")
    assert "\n" not in str(raised.value)


def test_half_precision_stays_near(dataset: Dataset) -> None:
    """In bfloat16 the first losses are float32's but for its rounding; R1 and path lengths are float32's own."""
    exact, half = (training_of(dataset, precision=precision) for precision in ("float32", "bfloat16"))
    figures = half.step()
    for name, figure in exact.step().items():
        assert figures[name].isfinite()
        if name.startswith("loss/"):
            torch.testing.assert_close(figures[name], figure, rtol=0.05, atol=0.02, msg=lambda m, n=name: f"{n}: {m}")
    assert all(weight.dtype == torch.float32 for weight in weights(half))
    for _ in range(3):
        half.step()
    assert half.is_finite()


def test_training_brings_motions_nearer_to_real_ones(dataset: Dataset) -> None:
    training = training_of(dataset, batch=8, mean_half_life=100.0)
    real = descriptors(real_motions(training, 60))

    def distance() -> float:
        return frechet_distance(descriptors(made_motions(training, 60)), real)

    before = distance()
    for _ in range(120):
        training.step()
    assert distance() < 0.5 * before


@pytest.mark.parametrize(
    ("count", "batch", "group", "said"),
    [
        (1, 3, 4, "batch of 3 cannot be shared by 1 processes; take a multiple of 4"),
        (2, 6, 2, "take a multiple of 4"),
        (2, 6, 3, "take a multiple of 12"),
        (3, 16, 4, "take a multiple of 12"),
        (1, 6, 4, ""),
        (2, 16, 4, ""),
        (2, 12, 3, ""),
    ],
)
def test_batches_that_cannot_be_shared_are_refused(count: int, batch: int, group: int, said: str) -> None:
    workers = Workers(0, count, torch.device("cpu"))
    if not said:
        workers.check(batch, group)
        return
    with pytest.raises(MotionGenError, match=said):
        workers.check(batch, group)
    workers.check(int(said.rsplit(maxsplit=1)[-1]), group)


def test_shares_are_all_of_the_whole_in_order() -> None:
    whole = torch.arange(24).view(12, 2)
    for count in (1, 2, 3, 6):
        shares = [Workers(rank, count, torch.device("cpu")).share(whole) for rank in range(count)]
        assert torch.equal(torch.cat(shares), whole)
    assert ALONE.leads
