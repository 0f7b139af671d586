"""The graph of a skeleton, and the network over it."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from motiongen.recognition.graph import INWARD, ITSELF, OUTWARD, partitioned_adjacency
from motiongen.recognition.network import GraphConvolution, GraphNetwork
from motiongen.recognition.recogniser import Recogniser
from tests.strategies import generators, random_skeleton


@given(generators())
def test_each_joint_reads_itself_its_parent_and_the_mean_of_its_children(rng: np.random.Generator) -> None:
    skeleton = random_skeleton(rng)
    adjacency, values = partitioned_adjacency(skeleton.parents), rng.normal(size=len(skeleton))
    read = values @ adjacency  # (3, J)
    for joint, parent in enumerate(skeleton.parents):
        children = list(skeleton.children[joint])
        np.testing.assert_allclose(read[ITSELF, joint], values[joint], atol=1e-6)
        np.testing.assert_allclose(read[INWARD, joint], values[parent] if parent >= 0 else 0, atol=1e-6)
        np.testing.assert_allclose(read[OUTWARD, joint], values[children].mean() if children else 0, atol=1e-6)


@given(generators())
def test_a_graph_convolution_is_its_sum(rng: np.random.Generator) -> None:
    """Written out: every joint, every neighbour, every part."""
    adjacency = torch.from_numpy(partitioned_adjacency(random_skeleton(rng).parents))
    layer = GraphConvolution(adjacency, 2, 4)
    torch.nn.init.uniform_(layer.importance)
    x = torch.from_numpy(rng.normal(size=(2, 2, 3, adjacency.shape[1])).astype(np.float32))
    found = layer(x)
    weight, bias = layer.channels.weight[:, :, 0, 0].reshape(3, 4, 2), layer.channels.bias.reshape(3, 4)
    for joint in range(adjacency.shape[1]):
        total = torch.zeros(2, 4, 3)
        for part in range(3):
            for other in range(adjacency.shape[1]):
                seen = torch.einsum("oc,bct->bot", weight[part], x[..., other]) + bias[part][:, None]
                total += adjacency[part, other, joint] * layer.importance[part, other, joint] * seen
        torch.testing.assert_close(found[..., joint], total, atol=1e-5, rtol=1e-5)


@given(generators(), st.integers(1, 40))
def test_any_skeleton_and_any_length_will_do(rng: np.random.Generator, frames: int) -> None:
    skeleton = random_skeleton(rng)
    network = GraphNetwork(skeleton.parents, classes=5, channels=(4, 8, 8)).eval()
    positions = torch.from_numpy(rng.normal(size=(2, frames, len(skeleton), 3)).astype(np.float32))
    assert network.features(positions).shape == (2, 8)
    assert network(positions).shape == (2, 5)


def test_a_joint_is_told_from_another(recogniser: Recogniser) -> None:
    """Channels run through one layer for all joints, but where in the body something moves must count."""
    rng = np.random.default_rng(0)
    positions = torch.from_numpy(rng.normal(size=(1, 32, len(recogniser.card.skeleton), 3)).astype(np.float32))
    swapped = positions[:, :, torch.tensor([0, 1, 2, 5, 6, 3, 4])]
    assert not torch.allclose(recogniser.network(positions), recogniser.network(swapped), atol=1e-3)
