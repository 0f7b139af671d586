"""The fast layers do what the paper's definitions do, in value, gradient and gradient of the gradient."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn import functional

from motiongen.generators.modi.hierarchy import Hierarchy, build_hierarchy
from motiongen.generators.modi.layers import (
    ActivatedConvolution,
    Direction,
    EqualisedLinear,
    ModulatedConvolution,
    SkeletalConvolution,
    SkeletalPooling,
    SkeletalUnpooling,
    smoothed,
)
from motiongen.generators.modi.options import NetworkOptions
from tests.generators.modi.plain_layers import applied, demodulated, filter_of, modulated
from tests.strategies import generators, random_skeleton

LATENT = 5


@st.composite
def hierarchies(draw: st.DrawFn, image: bool | None = None) -> Hierarchy:
    """Two levels of a random skeleton, or of an image."""
    rng = draw(generators())
    skeleton = random_skeleton(rng, draw(st.integers(1, 9)))
    feet = rng.permutation(len(skeleton))[: draw(st.integers(0, min(3, len(skeleton))))].tolist()
    as_image = draw(st.booleans()) if image is None else image
    return build_hierarchy(skeleton, feet, NetworkOptions(channels=(1, 1), frames=2, skeleton_aware=not as_image))


@st.composite
def convolutions(draw: st.DrawFn) -> tuple[SkeletalConvolution, Tensor]:
    """A convolution of any direction and size, and something to convolve, both in double precision."""
    hierarchy = draw(hierarchies())
    direction: Direction = draw(st.sampled_from(["in place", "up", "down"]))
    if direction == "in place":
        links, width = hierarchy.in_place_links(1, draw(st.integers(0, 2))), draw(st.sampled_from([1, 3, 5]))
    else:
        links = hierarchy.up_links(1) if direction == "up" else hierarchy.down_links(1)
        width = draw(st.sampled_from([2, 4, 6]))
    torch.manual_seed(draw(st.integers(0, 2**31)))
    inputs, outputs = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    convolution = SkeletalConvolution(links, inputs, outputs, width, direction).double()
    x = torch.randn(links.shape[1], draw(st.integers(1, 3)), 2 * draw(st.integers(1, 3)), inputs, dtype=torch.float64)
    return convolution, x.requires_grad_()


def derivatives(y: Tensor, inputs: list[Tensor]) -> list[Tensor]:
    """The output, its gradients, and the gradients of those, as R1 and path length take them, along random ways."""
    random = torch.Generator().manual_seed(0)

    def along(x: Tensor) -> Tensor:
        return (x * torch.randn(x.shape, generator=random, dtype=x.dtype)).sum()

    first = torch.autograd.grad(along(y), inputs, create_graph=True)
    together = torch.stack([along(gradient) for gradient in first]).sum()
    second = torch.autograd.grad(together, inputs, allow_unused=True, materialize_grads=True)
    return [y, *first, *second]


def assert_same(fast: list[Tensor], slow: list[Tensor]) -> None:
    for one, other in zip(fast, slow):
        torch.testing.assert_close(one, other, rtol=1e-6, atol=1e-9)


@given(convolutions())
def test_the_fast_convolution_is_the_three_dimensional_one(case: tuple[SkeletalConvolution, Tensor]) -> None:
    convolution, x = case
    inputs = [x, convolution.weight]
    slow = applied(convolution, x, filter_of(convolution))
    assert_same(derivatives(convolution(x), inputs), derivatives(slow, inputs))


@given(convolutions(), st.booleans())
def test_modulating_activations_is_modulating_the_weights_of_each_motion(
    case: tuple[SkeletalConvolution, Tensor], output: bool
) -> None:
    convolution, x = case
    layer = ModulatedConvolution(convolution, LATENT, output).double()
    with torch.no_grad():
        layer.bias.normal_()
    code = torch.randn(x.shape[1], LATENT, dtype=torch.float64, requires_grad=True)

    def literal() -> Tensor:
        motions = []
        for b, style in enumerate(layer.style(code)):
            whole = modulated(filter_of(convolution), style)
            if not output:
                whole = demodulated(whole, convolution.direction == "up")
            y = applied(convolution, x[:, b : b + 1], whole)
            if output:
                motions.append(y * convolution.scale + layer.bias)
            else:
                motions.append(math.sqrt(2) * functional.leaky_relu(y + layer.bias, 0.2))
        return torch.cat(motions, dim=1)

    inputs = [x, code, *layer.parameters()]
    assert_same(derivatives(layer(x, code), inputs), derivatives(literal(), inputs))


@given(convolutions())
def test_an_activated_convolution_has_scaled_weights(case: tuple[SkeletalConvolution, Tensor]) -> None:
    convolution, x = case
    layer = ActivatedConvolution(convolution).double()
    with torch.no_grad():
        layer.bias.normal_()
    y = applied(convolution, x, filter_of(convolution)) * convolution.scale + layer.bias
    slow = math.sqrt(2) * functional.leaky_relu(y, 0.2)
    inputs = [x, *layer.parameters()]
    assert_same(derivatives(layer(x), inputs), derivatives(slow, inputs))


@given(convolutions())
def test_held_ends_are_those_of_a_motion_that_stays_as_it_is_there(case: tuple[SkeletalConvolution, Tensor]) -> None:
    """The same convolution of a motion that is longer at both ends, so that its zeros are out of sight."""
    convolution, x = case
    before, after = (end.expand(-1, -1, 8, -1) for end in (x[:, :, :1], x[:, :, -1:]))
    slow = applied(convolution, torch.cat([before, x, after], dim=2), filter_of(convolution))
    cut = {"in place": 8, "up": 16, "down": 4}[convolution.direction]
    weights = [x, convolution.weight]
    slow_derivatives = derivatives(slow[:, :, cut:-cut], weights)
    convolution.held_ends = True
    assert_same(derivatives(convolution(x), weights), slow_derivatives)
    still = x[:, :, :1].expand(-1, -1, x.shape[2], -1)
    made = convolution(still)
    if convolution.direction != "up":  # even and odd frames have weights of their own there
        torch.testing.assert_close(made, made[:, :, :1].expand_as(made))


@given(convolutions())
def test_only_weights_that_the_mask_keeps_are_stored(case: tuple[SkeletalConvolution, Tensor]) -> None:
    convolution, _ = case
    width, inputs, outputs = convolution.weight.shape[1:]
    kept = len(set(convolution.links.blocks)) if convolution.links.shared else convolution.links.mask.sum()
    assert convolution.weight.numel() == kept * width * inputs * outputs
    assert [name for name, _ in convolution.named_parameters()] == ["weight"]
    assert list(convolution.state_dict()) == ["weight"]


@given(hierarchies(image=True), st.integers(1, 3), st.integers(1, 3), st.integers(0, 2**31))
def test_on_an_image_it_is_two_dimensional_convolution(image: Hierarchy, inputs: int, outputs: int, seed: int) -> None:
    torch.manual_seed(seed)
    if image.entities[1] % 2:  # an odd last row has no partner, which a two-dimensional stride does not know
        return
    if image.entities[1] >= 2:
        plane = SkeletalConvolution(image.in_place_links(1, 1), inputs, outputs, 3)
        x = torch.randn(image.entities[1], 2, 6, inputs)
        kernel = plane.weight.permute(3, 2, 0, 1)  # (K', K, entities, frames)
        expected = functional.conv2d(x.permute(1, 3, 0, 2), kernel, padding=1).permute(2, 0, 3, 1)
        torch.testing.assert_close(plane(x), expected, rtol=1e-4, atol=1e-4)
    down = SkeletalConvolution(image.down_links(1), inputs, outputs, 4, "down")
    x = torch.randn(image.entities[1], 2, 6, inputs)
    kernel = down.weight.permute(3, 2, 0, 1)
    expected = functional.conv2d(x.permute(1, 3, 0, 2), kernel, stride=2, padding=(0, 1)).permute(2, 0, 3, 1)
    torch.testing.assert_close(down(x), expected, rtol=1e-4, atol=1e-4)
    up = SkeletalConvolution(image.up_links(1), inputs, outputs, 4, "up")
    x = torch.randn(image.entities[0], 2, 3, inputs)
    kernel = up.weight.permute(2, 3, 0, 1)
    expected = functional.conv_transpose2d(x.permute(1, 3, 0, 2), kernel, stride=2, padding=(0, 1)).permute(2, 0, 3, 1)
    torch.testing.assert_close(up(x), expected, rtol=1e-4, atol=1e-4)


@given(hierarchies(), st.integers(1, 3), st.integers(0, 2**31))
def test_pooling_is_a_scaler_whose_weights_are_shares(hierarchy: Hierarchy, channels: int, seed: int) -> None:
    torch.manual_seed(seed)
    x = torch.randn(hierarchy.entities[1], 2, 4, channels, dtype=torch.float64)
    down = hierarchy.down_links(1)
    whole = torch.tensor(down.mask / down.mask.sum(axis=1, keepdims=True) / 2)
    whole = (torch.eye(channels)[:, :, None, None, None] * whole[:, :, None]).expand(-1, -1, -1, -1, 2)
    scaler = SkeletalConvolution(down, channels, channels, 2, "down")
    torch.testing.assert_close(SkeletalPooling(down).double()(x), applied(scaler, x, whole))


@given(hierarchies(), st.integers(0, 2**31))
def test_unpooling_copies_entities_and_pooling_undoes_it_where_nothing_moves(hierarchy: Hierarchy, seed: int) -> None:
    torch.manual_seed(seed)
    x = torch.randn(hierarchy.entities[0], 2, 4, 3)
    up = SkeletalUnpooling(hierarchy.up_links(1))
    expected = functional.interpolate(x.permute(0, 1, 3, 2).flatten(0, 1), scale_factor=2, mode="linear")
    expected = expected.unflatten(0, x.shape[:2]).permute(0, 1, 3, 2)
    torch.testing.assert_close(up(x), expected[list(hierarchy.owners[0])])
    still = x[:, :, :1].expand(-1, -1, 4, -1)
    torch.testing.assert_close(SkeletalPooling(hierarchy.down_links(1))(up(still)), still)


@given(st.integers(1, 3), st.integers(1, 12), st.integers(1, 3), st.integers(0, 2**31))
def test_smoothing_is_a_short_filter_along_time(entities: int, frames: int, channels: int, seed: int) -> None:
    torch.manual_seed(seed)
    x = torch.randn(entities, 2, frames, channels, dtype=torch.float64)
    lines = functional.pad(x.permute(0, 1, 3, 2).flatten(0, 2)[:, None], (1, 1), mode="replicate")
    expected = functional.conv1d(lines, torch.tensor([[[0.25, 0.5, 0.25]]], dtype=x.dtype))
    torch.testing.assert_close(smoothed(x), expected.view(entities, 2, channels, frames).permute(0, 1, 3, 2))


def test_smoothing_removes_what_alternates_and_keeps_what_changes_evenly() -> None:
    alternating = torch.tensor([1.0, -1.0] * 8).view(1, 1, -1, 1)
    assert smoothed(alternating)[:, :, 1:-1].abs().max() == 0
    even = torch.arange(16.0).view(1, 1, -1, 1)
    torch.testing.assert_close(smoothed(even)[:, :, 1:-1], even[:, :, 1:-1])


@pytest.mark.parametrize("direction", ["in place", "up", "down"])
@pytest.mark.parametrize("kind", ["modulated", "activated"])
def test_activations_keep_their_size(direction: Direction, kind: str) -> None:
    """Equalised weights and demodulation keep outputs before the rectifier at unit variance, for every entity."""
    torch.manual_seed(0)
    hierarchy = build_hierarchy(
        random_skeleton(np.random.default_rng(0), 12), (2, 3), NetworkOptions(channels=(1, 1), frames=2)
    )
    links = {
        "in place": hierarchy.in_place_links(1, 1),
        "up": hierarchy.up_links(1),
        "down": hierarchy.down_links(1),
    }[direction]
    convolution = SkeletalConvolution(links, 32, 64, 3 if direction == "in place" else 4, direction)
    x = torch.randn(links.shape[1], 16, 64, 32)
    if kind == "modulated":
        style = torch.rand(16, 32) + 0.5
        y = convolution(x * style[:, None, :]) * convolution.energy(style).rsqrt().unsqueeze(2)
    else:
        y = convolution(x) * convolution.scale
    torch.testing.assert_close(y.std(dim=(1, 2, 3)), torch.ones(links.shape[0]), rtol=0.05, atol=0.05)


@given(st.integers(1, 6), st.integers(1, 6), st.sampled_from([1.0, 0.01]), st.booleans(), st.integers(0, 2**31))
def test_an_equalised_layer_is_a_linear_one_whose_weights_are_scaled(
    inputs: int, outputs: int, rate: float, activate: bool, seed: int
) -> None:
    torch.manual_seed(seed)
    layer = EqualisedLinear(inputs, outputs, bias=1.0, rate=rate, activate=activate).double()
    x = torch.randn(3, inputs, dtype=torch.float64)
    slow = functional.linear(x, layer.weight.T * rate / math.sqrt(inputs), layer.bias * rate)
    if activate:
        slow = math.sqrt(2) * functional.leaky_relu(slow, 0.2)
    torch.testing.assert_close(layer(x), slow)
    torch.testing.assert_close(layer.bias * rate, torch.ones(outputs, dtype=torch.float64))
