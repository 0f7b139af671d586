"""The networks: shapes for any skeleton and every ablation, independence of motions, mixing, truncation, gradients."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from motiongen.errors import MotionGenError
from motiongen.generators.modi.hierarchy import Hierarchy, build_hierarchy
from motiongen.generators.modi.layers import SkeletalConvolution
from motiongen.generators.modi.networks import Discriminator, MappingNetwork, ModiGenerator, with_deviation
from motiongen.generators.modi.options import NetworkOptions
from tests.strategies import random_skeleton
from tools.bench_modi import biped

SMALL = {"channels": (6, 5, 4), "frames": 8, "latent_size": 7, "mapping_layers": 2}
ABLATIONS = {
    "final architecture": {},
    "one in-place convolution less": {"in_place": 1},
    "pooling": {"scaler": "pooling"},
    "without smoothing": {"smoothing": False},
    "held ends": {"held_ends": True},
    "joint positions": {"representation": "positions"},
    "not skeleton-aware": {"skeleton_aware": False},
    "longer": {"frames": 24},
    "without deviation": {"deviation_group": 1},
}
ablations = pytest.mark.parametrize("settings", ABLATIONS.values(), ids=ABLATIONS.keys())


def build(
    joints: int = 9, feet: int = 2, seed: int = 0, **changes: object
) -> tuple[ModiGenerator, Discriminator, Hierarchy]:
    """Small networks in double precision, for a random skeleton."""
    torch.manual_seed(seed)
    options = NetworkOptions.build(SMALL | changes)
    skeleton = random_skeleton(np.random.default_rng(seed), joints)
    hierarchy = build_hierarchy(skeleton, range(joints - feet, joints), options)
    return ModiGenerator(hierarchy, options).double(), Discriminator(hierarchy, options).double(), hierarchy


def noise(batch: int = 4, seed: int = 0) -> Tensor:
    return torch.randn(batch, 7, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@ablations
def test_motions_and_scores_have_their_shapes_and_all_weights_learn(settings: dict) -> None:
    for joints, feet in ((1, 0), (4, 3), (17, 2)):
        generator, discriminator, hierarchy = build(joints, feet, **settings)
        options = NetworkOptions.build(SMALL | settings)
        motions = generator(noise())
        assert motions.shape == (4, options.frames, joints + 1 + feet, options.features)
        assert hierarchy.entities[-1] <= joints + 1 + feet
        scores = discriminator(motions)
        assert scores.shape == (4,)
        scores.square().sum().backward()
        still = [name for network in (generator, discriminator) for name, weight in network.named_parameters()
                 if weight.grad is None or not weight.grad.any()]  # fmt: skip
        assert still == []


@ablations
def test_what_a_motion_becomes_does_not_depend_on_the_others(settings: dict) -> None:
    generator, discriminator, _ = build(**settings | {"deviation_group": 2})
    z = noise(6)
    motions = generator(z)
    torch.testing.assert_close(generator(z[2:3]), motions[2:3])
    scores = discriminator(motions)
    torch.testing.assert_close(torch.cat([discriminator(motions[:4]), discriminator(motions[4:])]), scores)
    alone, _, _ = torch.autograd.grad(scores[0], motions)[0].abs().sum(dim=(1, 2, 3)).split([2, 2, 2])
    assert (alone > 0).all()  # the two of a group know of each other
    assert not torch.autograd.grad(discriminator(motions)[0], motions)[0][2:].any()  # and of no one else


def test_deviation_is_that_within_each_group() -> None:
    x = torch.randn(3, 6, 4, 5, dtype=torch.float64)
    for group, size in ((2, 2), (3, 3), (4, 2), (6, 6), (5, 1)):
        seen = with_deviation(x, group)
        torch.testing.assert_close(seen[..., :-1], x)
        for b in range(6):
            mates = x[:, b // size * size : b // size * size + size].numpy()
            torch.testing.assert_close(
                seen[:, b, :, -1],
                torch.full((3, 4), mates.std(axis=1).mean(), dtype=torch.float64),
                rtol=1e-3,
                atol=1e-3,
            )


def test_every_layer_takes_its_own_code() -> None:
    generator, _, _ = build()
    assert generator.synthesis.layers == 2 + 3 + 3
    codes = generator.codes(noise()).detach().requires_grad_()
    (gradient,) = torch.autograd.grad(generator.synthesis(codes).square().sum(), codes)
    assert (gradient.abs().sum(dim=2) > 0).all()
    with pytest.raises(MotionGenError, match="takes 8 codes, one for each layer, not 7"):
        generator.synthesis(codes[:, :7])


def test_mixing_gives_the_first_code_to_the_layers_before_the_index() -> None:
    generator, _, _ = build()
    one, other = noise(seed=1), noise(seed=2)
    for index in (1, 5, 7):
        mixed = generator.codes((one, other), mixing_index=index)
        torch.testing.assert_close(mixed[:, :index], generator.codes(one)[:, :index])
        torch.testing.assert_close(mixed[:, index:], generator.codes(other)[:, index:])
    torch.testing.assert_close(generator((one, one), mixing_index=3), generator(one))


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda g, z: g(z, mixing_index=2), "one z, or two and a mixing_index; 1 came, and 2"),
        (lambda g, z: g([z, z]), "2 came, and None"),
        (lambda g, z: g([z, z], mixing_index=8), "mixing_index must be 1 to 7, not 8"),
        (lambda g, z: g(z, truncation=0.5), "measure_mean_code"),
    ],
)
def test_what_does_not_go_together_is_refused(ask: Callable[[ModiGenerator, Tensor], Tensor], said: str) -> None:
    generator, _, _ = build()
    with pytest.raises(MotionGenError, match=said):
        ask(generator, noise())


def test_truncation_goes_from_the_motion_to_the_mean_motion() -> None:
    generator, _, _ = build()
    generator.measure_mean_code(torch.Generator().manual_seed(0), samples=500)
    again = build()[0]
    again.load_state_dict(generator.state_dict())  # the mean travels with the weights
    z = noise()
    mean, codes = again.mean_code, again.codes(z)
    torch.testing.assert_close(mean, generator.mapping(noise(20_000, seed=3)).mean(dim=0), rtol=0.0, atol=0.2)
    for truncation in (0.0, 0.3, 1.0):
        torch.testing.assert_close(again.codes(z, truncation), mean + truncation * (codes - mean))


@given(st.integers(0, 2**31), st.floats(0.1, 10.0))
def test_the_length_of_noise_does_not_matter_to_the_mapping(seed: int, factor: float) -> None:
    torch.manual_seed(seed)
    mapping = MappingNetwork(NetworkOptions.build(SMALL)).double()
    assert len(list(mapping.parameters())) == 4
    torch.testing.assert_close(mapping(factor * noise(seed=seed)), mapping(noise(seed=seed)), rtol=1e-4, atol=1e-4)


@ablations
def test_r1_and_path_length_have_the_gradients_that_differences_give(settings: dict) -> None:
    generator, discriminator, _ = build(joints=5, **settings)

    def r1() -> Tensor:
        real = generator(noise(2)).detach().requires_grad_()
        (gradient,) = torch.autograd.grad(discriminator(real).sum(), real, create_graph=True)
        return gradient.square().sum()

    def path_length() -> Tensor:
        codes = generator.codes(noise(2))
        (gradient,) = torch.autograd.grad(generator.synthesis(codes).sum(), codes, create_graph=True)
        return gradient.square().sum()

    for penalty, network in ((r1, discriminator), (path_length, generator)):
        weights = [weight for weight in network.parameters() if weight.requires_grad]
        ways = [torch.randn_like(weight) for weight in weights]
        gradients = torch.autograd.grad(penalty(), weights, allow_unused=True, materialize_grads=True)
        along = sum(float((gradient * way).sum()) for gradient, way in zip(gradients, ways))
        values = []
        for step in (1e-6, -2e-6):
            with torch.no_grad():
                for moved in zip(weights, ways):
                    moved[0].add_(moved[1], alpha=step)
            values.append(penalty().item())
        assert along == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-3)


def test_the_defaults_are_the_papers_tables() -> None:
    options = NetworkOptions()
    hierarchy = build_hierarchy(*biped(), options)
    generator, discriminator = ModiGenerator(hierarchy, options), Discriminator(hierarchy, options)
    seen: dict[str, list[tuple[str, int, int, int]]] = {"generator": [], "discriminator": []}

    def note(name: str) -> Callable[[nn.Module, tuple[Tensor], Tensor], None]:
        def hook(layer: nn.Module, _: tuple[Tensor], y: Tensor) -> None:
            if isinstance(layer, SkeletalConvolution) and layer.width > 1:
                seen[name].append((layer.direction, y.shape[3], y.shape[0] - 3, y.shape[2]))

        return hook

    for name, network in (("generator", generator), ("discriminator", discriminator)):
        for layer in network.modules():
            layer.register_forward_hook(note(name))
    with torch.no_grad():
        discriminator(generator(torch.randn(2, 512)))
    sizes = [(256, 1, 4), (128, 2, 8), (64, 7, 16), (64, 12, 32), (32, 20, 64)]  # Table 3: channels, joints, frames
    expected = [("in place", *sizes[0])] * 2  # Table 4
    for size in sizes[1:]:
        expected += [("up", *size), ("in place", *size), ("in place", *size)]
    assert seen["generator"] == expected
    expected = []
    for size, below in zip(sizes[:0:-1], sizes[-2::-1]):
        expected += [("in place", *size), ("in place", *size), ("down", *below)]
    assert seen["discriminator"] == [*expected, ("in place", *sizes[0])]
    assert len(list(generator.mapping.parameters())) == 16
    assert generator.mapping.layers[0].gain == pytest.approx(0.01 * 2**0.5)


@settings(max_examples=5)
@given(st.integers(0, 1000))
def test_the_same_seed_gives_the_same_networks_and_other_levels_are_refused(seed: int) -> None:
    one, other = build(seed=seed), build(seed=seed)
    for mine, its in zip(one[0].state_dict().values(), other[0].state_dict().values()):
        assert torch.equal(mine, its)
    with pytest.raises(MotionGenError, match="2 levels of channels need as many of the skeleton, not 3"):
        Discriminator(one[2], NetworkOptions.build(SMALL | {"channels": (4, 4)}))
