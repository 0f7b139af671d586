"""One body for every registered generator: what the contract promises."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import motiongen as mg
from motiongen import Motion, MotionGenError
from motiongen.generators.base import Generator, LatentGenerator
from motiongen.generators.constraints import CONSTRAINTS, Constraint
from motiongen.generators.registry import specs
from tests.strategies import random_motion, random_skeleton

NAMES = [name for name, spec in specs().items() if spec.error is None]


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def clip() -> Motion:
    rng = np.random.default_rng(11)
    skeleton = random_skeleton(rng, 6)
    return random_motion(rng, skeleton, frames=100, translating=(0,), smooth=True, unit="cm", up="z", name="clip")


@pytest.fixture
def generator(name: str, clip: Motion) -> Generator:
    return mg.create(name).fit([clip])


def test_motions_are_as_many_and_as_long_as_asked_for(generator: Generator, clip: Motion) -> None:
    for frames, count in ((1, 1), (64, 3), (101, 2)):
        motions = generator.sample(frames=frames, count=count)
        assert [len(motion) for motion in motions] == [frames] * count
        for motion in motions:
            assert motion.skeleton == clip.skeleton
            assert (motion.unit, motion.up) == (clip.unit, clip.up)
            assert motion.frame_rate == pytest.approx(generator.frame_rate)


def test_the_seed_decides_everything_and_the_batch_nothing(generator: Generator, name: str, clip: Motion) -> None:
    batch = generator.sample(frames=60, count=3, seed=4)
    again = mg.create(name).fit([clip]).sample(frames=60, count=3, seed=4)
    alone = generator.sample(frames=60, count=1, seed=4)
    assert batch == again
    assert batch[0] == alone[0]
    assert batch[0] != batch[1]
    assert generator.sample(frames=60, seed=5)[0] != alone[0]


def test_a_torch_generator_serves_as_seed(generator: Generator) -> None:
    torch_generator = torch.Generator().manual_seed(3)
    first, second = (generator.sample(frames=40, seed=torch_generator)[0] for _ in range(2))
    assert first != second  # its state has moved on
    assert first == generator.sample(frames=40, seed=torch.Generator().manual_seed(3))[0]


def test_sampling_does_not_touch_the_global_random_state(generator: Generator) -> None:
    torch.manual_seed(0)
    before = torch.get_rng_state()
    generator.sample(frames=20)
    assert torch.equal(before, torch.get_rng_state())


def test_unsupported_constraints_are_refused_with_those_that_are_not(generator: Generator, clip: Motion) -> None:
    examples: dict[str, Constraint] = {
        "Keyframes": mg.Keyframes({0: clip[0]}),
        "Loop": mg.Loop(),
        "FixedJoints": mg.FixedJoints(clip, ("*",)),
        "RootPath": mg.RootPath(np.zeros((2, 2))),
        "Segment": mg.Segment(clip, 10, 20),
        "Parts": mg.Parts(),
    }
    assert set(examples) == {kind.__name__ for kind in CONSTRAINTS}
    supported = {kind.__name__ for kind in generator.capabilities.constraints}
    for kind, constraint in examples.items():
        if kind not in supported:
            with pytest.raises(MotionGenError, match=f"does not take the constraint {kind}; it takes") as raised:
                generator.sample(frames=20, constraints=[constraint])
            assert all(word in str(raised.value) for word in supported or {"none"})


def test_progress_rises_to_one(generator: Generator) -> None:
    shares: list[float] = []
    generator.sample(frames=50, count=2, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frames": 0}, "frames must be a whole number of at least 1, not 0"),
        ({"frames": 2.5}, "frames must be a whole number"),
        ({"frames": True}, "frames must be a whole number"),
        ({"frames": 5, "count": 0}, "count must be a whole number of at least 1"),
        ({"frames": 5, "seed": -1}, "seed must not be negative"),
        ({"frames": 5, "seed": "x"}, "seed must be a whole number or a torch.Generator, not 'x'"),
    ],
)
def test_numbers_out_of_range_are_refused(generator: Generator, arguments: dict, message: str) -> None:
    with pytest.raises(MotionGenError, match=message):
        generator.sample(**arguments)


def test_sampling_before_fitting_is_refused(name: str) -> None:
    if not specs()[name].generator_type().capabilities.needs_training:
        with pytest.raises(MotionGenError, match="call fit"):
            mg.create(name).sample(frames=10)


def test_examples_of_different_skeletons_are_refused(name: str, clip: Motion) -> None:
    rng = np.random.default_rng(0)
    stranger = random_motion(rng, random_skeleton(rng, 4), frames=50, name="stranger")
    with pytest.raises(MotionGenError, match="'stranger' has another skeleton"):
        mg.create(name).fit([clip, stranger])


def test_capabilities_are_true(generator: Generator) -> None:
    assert set(generator.capabilities.constraints) <= set(CONSTRAINTS)
    assert generator.capabilities.has_latent_space == isinstance(generator, LatentGenerator)


def test_options_are_explained_and_have_a_configuration(name: str) -> None:
    """Each option has help, and the Hydra file of a built-in generator holds just its options with their defaults."""
    import dataclasses

    from omegaconf import OmegaConf

    from motiongen.assets import config_folder

    spec = specs()[name]
    fields = dataclasses.fields(spec.options_type())
    assert all(field.metadata.get("help") for field in fields)
    config = OmegaConf.to_container(OmegaConf.load(config_folder() / "generator" / f"{name}.yaml"))
    assert config == {"name": name, **spec.options_type()().to_dict()}
