"""One body for every registered generator: what the contract promises."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

import motiongen as mg
from motiongen import Motion, MotionGenError
from motiongen import rotations as rot
from motiongen.generators.base import Generator, LatentGenerator
from motiongen.generators.constraints import CONSTRAINTS, Constraint
from motiongen.generators.registry import specs
from tests.checkpoints import random_checkpoint
from tests.strategies import random_motion, random_skeleton

NAMES = [name for name, spec in specs().items() if spec.error is None]


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def clip() -> Motion:
    rng = np.random.default_rng(11)
    skeleton = random_skeleton(rng, 6)
    clip = random_motion(rng, skeleton, frames=100, translating=(0,), smooth=True, unit="cm", up="z", name="clip")
    travel = np.linspace(0.0, 4.0, len(clip))[:, None] * [0.0, 0.0, skeleton.height]  # so that it can follow a path
    return clip.replace(translations=clip.translations + travel[:, None])


@pytest.fixture
def create(name: str, clip: Motion, tmp_path: Path) -> Callable[[], Generator]:
    """A new generator; one that needs training has a checkpoint on the clip's skeleton, whose weights are random."""
    if not specs()[name].generator_type().capabilities.needs_training:
        return lambda: mg.create(name)
    leaves = tuple(joint for joint in range(len(clip.skeleton)) if joint not in clip.skeleton.parents)
    checkpoint = random_checkpoint(tmp_path / "checkpoint", clip.skeleton, leaves, clip.unit)
    return lambda: mg.create(name, checkpoint=str(checkpoint))


@pytest.fixture
def generator(create: Callable[[], Generator], clip: Motion) -> Generator:
    return create().fit([clip])


def test_motions_are_as_many_and_as_long_as_asked_for(generator: Generator, clip: Motion) -> None:
    for frames, count in ((1, 1), (64, 3), (101, 2)):
        motions = generator.sample(frames=frames, count=count)
        assert [len(motion) for motion in motions] == [frames] * count
        for motion in motions:
            assert motion.skeleton == clip.skeleton
            assert motion.unit == clip.unit
            assert motion.up == ("y" if generator.capabilities.needs_training else clip.up)  # data is brought to y up
            assert motion.frame_rate == pytest.approx(generator.frame_rate)


def test_the_seed_decides_everything_and_the_batch_nothing(
    generator: Generator, create: Callable[[], Generator], clip: Motion
) -> None:
    batch = generator.sample(frames=60, count=3, seed=4)
    again = create().fit([clip]).sample(frames=60, count=3, seed=4)
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


def examples_of_constraints(clip: Motion) -> dict[str, Constraint]:
    """One of each kind, for a synthesis of 60 frames."""
    return {
        "Keyframes": mg.Keyframes({0: clip[30], 25: clip[80], 59: clip[3]}),
        "Loop": mg.Loop(),
        "FixedJoints": mg.FixedJoints(clip, (clip.skeleton.names[-1],)),
        "RootPath": mg.RootPath(np.array([[0.0, 0.0], [1.0, 2.0], [4.0, 2.0]])),
        "Segment": mg.Segment(clip[:60], 20, 40),
        "Continuation": mg.Continuation(clip[:70]),
        "InBetween": mg.InBetween(clip[:30], clip[60:]),
        "Style": mg.Style(clip),
        "Parts": mg.Parts(),
    }


def test_unsupported_constraints_are_refused_with_those_that_are_not(generator: Generator, clip: Motion) -> None:
    examples = examples_of_constraints(clip)
    assert set(examples) == {kind.__name__ for kind in CONSTRAINTS}
    supported = {kind.__name__ for kind in generator.capabilities.constraints}
    for kind, constraint in examples.items():
        if kind not in supported:
            with pytest.raises(MotionGenError, match=f"does not take the constraint {kind}; it takes") as raised:
                generator.sample(frames=20, constraints=[constraint])
            assert all(word in str(raised.value) for word in supported or {"none"})


@pytest.mark.parametrize("kind", CONSTRAINTS, ids=lambda kind: kind.__name__)
def test_supported_constraints_are_kept(generator: Generator, clip: Motion, kind: type[Constraint]) -> None:
    if kind not in generator.capabilities.constraints:
        pytest.skip(f"this generator does not take {kind.__name__}")
    constraint = examples_of_constraints(clip)[kind.__name__]
    motions = generator.sample(frames=60, count=2, seed=1, constraints=[constraint])
    assert [len(motion) for motion in motions] == [60, 60]
    largest = rot.angle_between(clip.rotations[1:], clip.rotations[:-1]).max()
    for motion in motions:
        if isinstance(constraint, mg.Keyframes):
            for frame, pose in constraint.poses.items():
                np.testing.assert_array_equal(motion.rotations[frame], pose.rotations[0])
                assert motion.root_positions[frame, 1] == pytest.approx(pose.root_positions[0, 1])
        elif isinstance(constraint, mg.Loop):
            assert rot.angle_between(motion.rotations[-1], motion.rotations[0]).max() <= largest
        elif isinstance(constraint, mg.FixedJoints):
            joint = clip.skeleton.index(constraint.joints[0])
            np.testing.assert_array_equal(motion.rotations[:, joint], clip.rotations[:60, joint])
        elif isinstance(constraint, mg.Segment):
            kept = [*range(20), *range(40, 60)]
            np.testing.assert_array_equal(motion.rotations[kept], clip.rotations[kept])
            np.testing.assert_array_equal(motion.translations[kept], clip.translations[kept])
        elif isinstance(constraint, mg.Continuation):
            seam = rot.angle_between(motion.rotations[0], constraint.motion.rotations[-1]).max()
            assert seam <= 1.5 * largest
            step = np.linalg.norm(motion.root_positions[0] - constraint.motion.root_positions[-1])
            assert step <= 2 * np.linalg.norm(np.diff(clip.root_positions, axis=0), axis=-1).max()
        elif isinstance(constraint, mg.InBetween):
            for mine, theirs in ((0, constraint.before[-1]), (-1, constraint.after[0])):
                assert rot.angle_between(motion.rotations[mine], theirs.rotations[0]).max() <= 1.5 * largest
        turns = rot.angle_between(motion.rotations[1:], motion.rotations[:-1])
        assert turns.max() <= 4 * largest
    if not isinstance(constraint, (mg.Segment, mg.FixedJoints, mg.Style)):  # what is given may say it all
        assert motions[0] != motions[1]


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


def test_only_a_trained_generator_samples_before_it_is_fitted(create: Callable[[], Generator], clip: Motion) -> None:
    generator = create()
    if generator.capabilities.needs_training:
        assert generator.skeleton == clip.skeleton
        assert generator.sample(frames=10) == create().fit([clip]).sample(frames=10)
    else:
        with pytest.raises(MotionGenError, match="call fit"):
            generator.sample(frames=10)


def test_examples_of_different_skeletons_are_refused(create: Callable[[], Generator], clip: Motion) -> None:
    rng = np.random.default_rng(0)
    stranger = random_motion(rng, random_skeleton(rng, 4), frames=50, name="stranger")
    with pytest.raises(MotionGenError, match="'stranger' has another skeleton"):
        create().fit([clip, stranger])


def test_capabilities_are_true(generator: Generator) -> None:
    assert set(generator.capabilities.constraints) <= set(CONSTRAINTS)
    assert generator.capabilities.has_latent_space == isinstance(generator, LatentGenerator)


def test_samples_are_the_motions_of_their_latents(generator: Generator) -> None:
    if not isinstance(generator, LatentGenerator):
        pytest.skip("has no latent space")
    codes = generator.latents(3, seed=5)
    sampled = generator.sample(frames=20, count=3, seed=5)
    for one, other in zip(sampled, generator.decode(codes, frames=20)):
        assert (one.rotations == other.rotations).all()
        assert (one.translations == other.translations).all()
    usual = generator.decode(generator.mean_latent()[None])
    assert [len(motion) for motion in usual] == [generator.usual_frames]
    with pytest.raises(MotionGenError, match="latents must have the shape"):
        generator.decode(codes[..., :-1])
    with pytest.raises(MotionGenError, match="not finite"):
        generator.decode(np.full_like(codes, np.nan))


def test_an_inverted_motion_comes_back_nearer_than_the_mean_motion(generator: Generator) -> None:
    if not isinstance(generator, LatentGenerator):
        pytest.skip("has no latent space")
    target = generator.sample(frames=generator.usual_frames, seed=3)[0]
    (found,), (mean,) = (generator.decode(code[None]) for code in (generator.invert(target), generator.mean_latent()))

    def away(motion: Motion) -> float:
        return float(np.mean(rot.angle_between(motion.rotations, target.rotations)))

    assert away(found) < 0.8 * away(mean)


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
