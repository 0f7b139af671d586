"""Motions from a checkpoint: what is MoDi's own beside the contract of all generators."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import motiongen as mg
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.networks import ModiGenerator
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE, stride
from tests.strategies import random_motion, random_skeleton

FEET = (4, 6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_checkpoint(tmp_path_factory.mktemp("modi") / "checkpoint", FIGURE, FEET, "m")


def modi(folder: Path, **options: Any) -> MoDi:
    made = mg.create("modi", checkpoint=str(folder), **options)
    assert isinstance(made, MoDi)
    return made


def test_it_needs_no_examples_and_takes_those_of_its_skeleton(folder: Path) -> None:
    generator = modi(folder)
    assert (generator.skeleton, generator.frame_rate) == (FIGURE, 30.0)
    motion = generator.sample(frames=16, seed=3)[0]
    assert (motion.skeleton, motion.unit, motion.up, motion.frame_rate) == (FIGURE, "m", "y", 30.0)
    assert generator.fit([stride(0), stride(1, frame_rate=60.0)]).sample(frames=16, seed=3)[0] == motion
    rng = np.random.default_rng(0)
    stranger = random_motion(rng, random_skeleton(rng, 4), frames=50, name="stranger")
    with pytest.raises(MotionGenError, match=r"'stranger' has another skeleton than the checkpoint: .*trained on only"):
        modi(folder).fit([stranger])


@pytest.mark.parametrize("frames", [1, 15, 16, 17, 50])
def test_motions_are_as_long_as_asked_for_and_no_still_longer(folder: Path, frames: int) -> None:
    motion = modi(folder).sample(frames=frames)[0]
    assert len(motion) == frames
    if frames > 16:
        moving = rot.angle_between(motion.rotations[1:], motion.rotations[:-1]).max(axis=1)
        assert (moving > 1e-4).all(), "it moves to its end"


def test_shorter_motions_are_the_beginning_of_those_trained(folder: Path) -> None:
    generator = modi(folder, clean_feet=False)
    long, short = (generator.sample(frames=frames, seed=1)[0] for frames in (16, 9))
    np.testing.assert_array_equal(short.rotations, long.rotations[:9])


def test_what_is_made_is_what_the_network_says(folder: Path) -> None:
    """The path from noise to motion, step by step."""
    from motiongen.datasets import from_entities
    from motiongen.generators.base import sample_seed
    from motiongen.generators.modi.checkpoint import load_model
    from motiongen.generators.modi.hierarchy import build_hierarchy

    card, weights = load_model(folder)
    network = ModiGenerator(build_hierarchy(FIGURE, FEET, card.network), card.network)
    network.load_state_dict(weights)
    z = torch.randn(1, 8, generator=torch.Generator().manual_seed(sample_seed(5, 2)))
    for truncation in (1.0, 0.3):
        with torch.no_grad():
            made = network(z, truncation)[0].numpy() * card.deviation + card.mean
        expected = from_entities(made, card.layout, 30.0, "m", "sample_0002")
        found = modi(folder, clean_feet=False, truncation=truncation).sample(frames=16, count=3, seed=5)[2]
        np.testing.assert_allclose(found.rotations, expected.rotations, atol=1e-6)
        np.testing.assert_allclose(found.translations, expected.translations, atol=1e-6)
        assert found.name == "sample_0002"


def test_truncation_takes_motions_nearer_to_each_other(folder: Path) -> None:
    def spread(truncation: float) -> float:
        motions = modi(folder, truncation=truncation, clean_feet=False).sample(frames=16, count=6)
        return float(np.std([motion.rotations for motion in motions], axis=0).mean())

    spreads = [spread(truncation) for truncation in (0.0, 0.3, 1.0)]
    assert spreads[0] == pytest.approx(0, abs=1e-6)
    assert spreads == sorted(spreads)
    assert spreads[2] > 1e-4


def test_feet_that_stand_are_kept_from_sliding(tmp_path: Path) -> None:
    names = ("Hips", *(f"{side}{part}" for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Foot")))
    offsets = np.array([[0, 1, 0], *(row for side in (0.1, -0.1) for row in
                        ([side, 0, 0], [0, -0.5, 0.02], [0, -0.45, -0.02]))], dtype=float)  # fmt: skip
    toes = np.array([[0, -0.05, 0.15]] * 2)
    folder = random_checkpoint(
        tmp_path / "legs", Skeleton(names, (-1, 0, 1, 2, 0, 4, 5), offsets, (3, 6), toes), (3, 6)
    )
    cleaned, slid = (modi(folder, clean_feet=clean).sample(frames=60, count=4) for clean in (True, False))

    def slide(motions: list[Motion]) -> float:
        steps = [np.diff(motion.positions[:, [3, 6]][..., [0, 2]], axis=0) for motion in motions]
        return float(np.linalg.norm(steps, axis=-1).mean())

    assert slide(cleaned) < 0.3 * slide(slid)


def test_without_feet_there_is_nothing_to_clean(tmp_path: Path) -> None:
    folder = random_checkpoint(tmp_path / "checkpoint", FIGURE)
    assert modi(folder).sample(frames=20) == modi(folder, clean_feet=False).sample(frames=20)


def test_checkpoints_that_cannot_be_sampled_from_are_refused(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(MotionGenError, match="nowhere: this is no checkpoint of modi"):
        modi(tmp_path / "nowhere")
    positions = random_checkpoint(tmp_path / "positions", FIGURE, FEET, representation="positions")
    with pytest.raises(MotionGenError, match="makes joint positions, of which no rig's motion can be made"):
        modi(positions)
    with pytest.raises(MotionGenError, match="device 'abacus' cannot be used"):
        modi(folder, device="abacus")
