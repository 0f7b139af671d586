"""What gradients see of a motion is what the motion itself says."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from motiongen import rotations as rot
from motiongen.datasets import Dataset
from motiongen.generators.modi.body import LABEL_SLOPE, Body, multiply, rotate
from motiongen.generators.modi.options import NetworkOptions
from tests.train.runs import FRAMES
from train.sources import source_of

seeds = st.integers(0, 2**31)


@given(seeds)
def test_joints_and_feet_are_where_the_motion_has_them(dataset: Dataset, seed: int) -> None:
    rng = np.random.default_rng(seed)
    windows = dataset.draw("training", 3, rng)
    height = dataset.skeleton.height
    for representation in ("rotations", "positions"):
        options = NetworkOptions.build({"frames": FRAMES, "channels": [8, 8], "representation": representation})
        source = source_of(dataset, options)
        body = Body(dataset.layout, *source.scale, dataset.frame_rate)
        motions = source.motions(windows)
        velocities = source.foot_velocities(body, motions)
        logits = body.contact_logits(motions)
        raw = dataset.batch(windows, standardised=False)
        for b, window in enumerate(raw):
            motion = dataset.to_motion(window, standardised=False)
            expected = motion.positions / height
            expected -= expected[0, 0]
            if representation == "rotations":
                found = body.positions(motions)[b]
            else:
                found = body.entities(motions)[b, :, dataset.layout.joints]
            np.testing.assert_allclose(found, expected, atol=2e-5)
            feet = np.diff(motion.positions[:, list(dataset.layout.feet)], axis=0) * motion.frame_rate / height
            np.testing.assert_allclose(velocities[b], feet, atol=2e-3)
            labels = window[:, dataset.layout.contacts, 0]
            np.testing.assert_allclose(logits[b], LABEL_SLOPE * (labels - 0.5), atol=1e-3)


@given(seeds)
def test_made_rotations_need_not_be_of_unit_length(dataset: Dataset, seed: int) -> None:
    made = torch.randn(1, 5, *dataset.mean.shape, generator=torch.Generator().manual_seed(seed))
    found = Body(dataset.layout, dataset.mean, dataset.deviation, dataset.frame_rate).positions(made)[0]
    motion = dataset.to_motion(made[0].numpy())
    expected = (motion.positions - motion.positions[0, 0]) / dataset.skeleton.height
    np.testing.assert_allclose(found, expected, atol=1e-4)


@given(seeds)
def test_turns_are_those_of_the_core(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in rng.normal(size=(2, 6, 4)))
    vectors = rng.normal(size=(6, 3))
    np.testing.assert_allclose(multiply(torch.tensor(a), torch.tensor(b)), rot.multiply(a, b), atol=1e-12)
    np.testing.assert_allclose(rotate(torch.tensor(a), torch.tensor(vectors)), rot.rotate(a, vectors), atol=1e-12)


def test_a_body_without_feet_has_none_that_move(dataset: Dataset) -> None:
    body = Body(dataset.layout, dataset.mean, dataset.deviation, dataset.frame_rate)
    assert body.positions(torch.zeros(2, 5, *dataset.mean.shape), ()).shape == (2, 5, 0, 3)
