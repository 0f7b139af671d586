"""A spatio-temporal graph network that tells what a motion is (Yan, Xiong, Lin 2018: ST-GCN), kept small."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from motiongen.recognition.graph import PARTS, partitioned_adjacency

KERNEL = 5
"""Frames that a temporal convolution sees."""


class GraphConvolution(nn.Module):
    """Each joint reads its neighbours' channels, with other weights for each part of the neighbourhood.

    Args:
        adjacency: (3, J, J).
        inputs: channels.
        outputs: channels.
    """

    adjacency: Tensor

    def __init__(self, adjacency: Tensor, inputs: int, outputs: int) -> None:
        """Begin with every edge equally important."""
        super().__init__()
        self.register_buffer("adjacency", adjacency, persistent=False)
        self.importance = nn.Parameter(torch.ones_like(adjacency))
        self.channels = nn.Conv2d(inputs, PARTS * outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, T, J) to (B, C', T, J)."""
        parts = self.channels(x).chunk(PARTS, dim=1)
        edges = self.adjacency * self.importance
        return torch.stack([part @ edge for part, edge in zip(parts, edges)]).sum(dim=0)


class Block(nn.Module):
    """A graph convolution, a convolution over time, and a way past both."""

    def __init__(self, adjacency: Tensor, inputs: int, outputs: int, stride: int) -> None:
        """Make a block that keeps each `stride`-th frame."""
        super().__init__()
        self.main = nn.Sequential(
            GraphConvolution(adjacency, inputs, outputs),
            nn.BatchNorm2d(outputs),
            nn.ReLU(),
            nn.Conv2d(outputs, outputs, (KERNEL, 1), stride=(stride, 1), padding=(KERNEL // 2, 0)),
            nn.BatchNorm2d(outputs),
        )
        same = inputs == outputs and stride == 1
        past = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride=(stride, 1)), nn.BatchNorm2d(outputs))
        self.past: nn.Module = nn.Identity() if same else past

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, T, J) to (B, C', T', J)."""
        return torch.relu(self.main(x) + self.past(x))


class GraphNetwork(nn.Module):
    """Joint positions to what the motion is.

    Time is halved by each block that has more channels than the one before it, the first one among them.

    Args:
        parents: (J,) the tree.
        classes: how many kinds of motion there are.
        channels: of each block.
        dropout: of features, in training.
    """

    def __init__(self, parents: Sequence[int], classes: int, channels: Sequence[int], dropout: float = 0.0) -> None:
        """Make the blocks, with random weights."""
        super().__init__()
        adjacency = torch.from_numpy(partitioned_adjacency(parents))
        self.scale = nn.BatchNorm1d(len(parents) * 3)
        before = (3, *channels)
        self.blocks = nn.Sequential(
            *(
                Block(adjacency, inputs, outputs, stride=2 if outputs > inputs else 1)
                for inputs, outputs in zip(before, channels)
            )
        )
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Linear(channels[-1], classes)

    def features(self, positions: Tensor) -> Tensor:
        """(B, D) features of (B, T, J, 3) positions: what the last layer decides by, means over time and joints."""
        scaled = self.scale(positions.flatten(2).transpose(1, 2))  # (B, 3 J, T)
        x = scaled.unflatten(1, (-1, 3)).permute(0, 2, 3, 1)  # (B, 3, T, J)
        features: Tensor = self.blocks(x).mean(dim=(2, 3))
        return features

    def forward(self, positions: Tensor) -> Tensor:
        """(B, classes) logits of (B, T, J, 3) positions."""
        logits: Tensor = self.head(self.dropout(self.features(positions)))
        return logits
