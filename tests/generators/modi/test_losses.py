"""The terms of the loss, against the paper's equations written out."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from motiongen.generators.modi import losses
from motiongen.generators.modi.hierarchy import build_hierarchy
from motiongen.generators.modi.networks import Discriminator, ModiGenerator
from motiongen.generators.modi.options import NetworkOptions
from tests.strategies import random_skeleton

TINY = {"channels": (3, 2), "frames": 4, "latent_size": 3, "mapping_layers": 1, "deviation_group": 1}
seeds = st.integers(0, 2**31)


def normal(seed: int, *shape: int) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def networks(seed: int) -> tuple[ModiGenerator, Discriminator]:
    torch.manual_seed(seed)
    options = NetworkOptions.build(TINY)
    hierarchy = build_hierarchy(random_skeleton(np.random.default_rng(seed), 3), [2], options)
    return ModiGenerator(hierarchy, options).double(), Discriminator(hierarchy, options).double()


def sigmoid(x: float) -> float:
    return 1 / (1 + math.exp(-x))


@given(seeds)
def test_adversarial_losses_are_equations_2_and_3(seed: int) -> None:
    real, fake = (3 * normal(seed + k, 5) for k in range(2))
    judged_real, judged_fake = ([sigmoid(score) for score in scores.tolist()] for scores in (real, fake))
    expected = -sum(math.log(d) for d in judged_fake) / 5
    assert losses.generator_loss(fake).item() == pytest.approx(expected)
    expected = -sum(math.log(d) for d in judged_real) / 5 - sum(math.log(1 - d) for d in judged_fake) / 5
    assert losses.discriminator_loss(real, fake).item() == pytest.approx(expected)


@given(seeds)
def test_contact_losses_are_equations_4_and_5(seed: int) -> None:
    logits, velocities = 4 * normal(seed, 2, 5, 3), normal(seed + 1, 2, 4, 3, 3)
    labels = [[[sigmoid(x) for x in row] for row in motion] for motion in logits.tolist()]
    touching = [-math.log(label) for motion in labels for row in motion for label in row]
    assert losses.contact_encouragement(logits).item() == pytest.approx(sum(touching) / len(touching))
    moving = [
        float(velocities[b, t, c].norm()) ** 2 * labels[b][t + 1][c]
        for b in range(2) for t in range(4) for c in range(3)
    ]  # fmt: skip
    assert losses.contact_consistency(velocities, logits).item() == pytest.approx(sum(moving) / len(moving))


@pytest.mark.parametrize("score", [-1e4, -100.0, 100.0, 1e4])
def test_sure_scores_have_finite_losses_and_gradients(score: float) -> None:
    terms: tuple[Callable[[Tensor], Tensor], ...] = (
        losses.generator_loss,
        losses.contact_encouragement,
        lambda x: losses.discriminator_loss(x, x),
    )
    for term in terms:
        scores = torch.full((2,), score, requires_grad=True)
        loss = term(scores)
        loss.backward()
        assert loss.isfinite()
        assert scores.grad is not None
        assert scores.grad.isfinite().all()


@pytest.mark.parametrize("seed", range(3))
def test_path_lengths_are_those_of_the_whole_jacobian(seed: int) -> None:
    generator, _ = networks(seed)
    codes = generator.codes(normal(seed, 2, 3)).detach().requires_grad_()
    motions = generator.synthesis(codes)
    noise = normal(seed + 1, *motions.shape)
    found = losses.path_lengths(motions, codes, noise)
    frames, entities = motions.shape[1:3]
    for b in range(2):
        jacobian = torch.autograd.functional.jacobian(lambda w: generator.synthesis(w[None])[0], codes[b].detach())
        step = noise[b] / math.sqrt(frames * entities)  # Eq. 6: Gaussian, normalised by the joints and frames
        # J^T y, a row for each layer's code: a step in all of W+ at once goes as far as their mean square says.
        rows = torch.einsum("tek,teknl->nl", step, jacobian)
        assert found[b].item() == pytest.approx(rows.square().sum(dim=1).mean().sqrt().item())
    mean = torch.tensor(0.7, dtype=torch.float64)
    expected = sum((length - 0.7) ** 2 for length in found.tolist()) / 2
    assert losses.path_length_penalty(found, mean).item() == pytest.approx(expected)


def test_paths_of_no_length_have_finite_gradients() -> None:
    generator, _ = networks(0)
    for level in generator.synthesis.levels:
        torch.nn.init.zeros_(level.output.convolution.weight)  # every motion is the same
    codes = generator.codes(normal(0, 2, 3))
    motions = generator.synthesis(codes)
    lengths = losses.path_lengths(motions, codes, torch.ones_like(motions))
    losses.path_length_penalty(lengths, torch.tensor(1.0)).backward()
    assert not lengths.any()
    assert all(weight.grad is None or weight.grad.isfinite().all() for weight in generator.parameters())


@pytest.mark.parametrize("seed", range(3))
def test_r1_is_the_slope_that_differences_give(seed: int) -> None:
    _, discriminator = networks(seed)
    real = normal(seed, 2, 4, 5, 4).requires_grad_()
    found = losses.r1_penalty(discriminator(real), real).item()
    total, step = 0.0, 1e-5
    with torch.no_grad():
        for place in np.ndindex(*real.shape):
            ahead, behind = real.clone(), real.clone()
            ahead[place] += step
            behind[place] -= step
            slope = (discriminator(ahead) - discriminator(behind))[place[0]] / (2 * step)
            total += slope.item() ** 2
    assert found == pytest.approx(total / 2, rel=1e-5)
