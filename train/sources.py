"""Real motions as the networks see them: rotations as in the paper, or joint positions for its ablation (Table 2)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from motiongen.datasets import Dataset
from motiongen.generators.modi.body import Body
from motiongen.generators.modi.options import NetworkOptions
from train.draws import numpy_random

Scale = tuple[NDArray[np.float32], NDArray[np.float32]]

LEAST_DEVIATION = 0.01
"""What hardly varies, such as the side of a knee's hinge, is divided by this: noise there is not to be learned."""

MEASURED = 2000
"""Windows from which the mean and the deviation of positions are taken."""


class Source(Protocol):
    """Where real motions come from.

    Attributes:
        scale: (E, K) mean and deviation that motions are standardised by.
    """

    scale: Scale

    def motions(self, windows: NDArray[np.int64]) -> Tensor:
        """(B, T, E, K) standardised motions of (B, 2) windows."""

    def foot_velocities(self, body: Body, motions: Tensor) -> Tensor:
        """(B, T - 1, C, 3) in skeleton heights per second."""


class Rotations:
    """Entities as the dataset has them: joint rotations, root steps, contact labels."""

    def __init__(self, dataset: Dataset) -> None:
        """Take the dataset's own mean and deviation."""
        self.dataset = dataset
        self.scale: Scale = dataset.mean, np.maximum(dataset.deviation, np.float32(LEAST_DEVIATION))

    def motions(self, windows: NDArray[np.int64]) -> Tensor:
        """(B, T, E, 4)."""
        mean, deviation = self.scale
        return torch.from_numpy((self.dataset.batch(windows, standardised=False) - mean) / deviation)

    def foot_velocities(self, body: Body, motions: Tensor) -> Tensor:
        """By forward kinematics."""
        return body.foot_velocities(motions)


class Positions:
    """Joint positions in place of rotations; root steps and contact labels as they are."""

    def __init__(self, dataset: Dataset) -> None:
        """Measure mean and deviation over windows of the training part."""
        self.dataset = dataset
        flat = np.zeros((dataset.layout.count, 4), dtype=np.float32)
        self._raw = Body(dataset.layout, flat, flat + 1, dataset.frame_rate)
        random = numpy_random(0, 0, "mean and deviation of positions")
        some = self._positions(dataset.draw("training", MEASURED, random)).flatten(0, 1)
        self.scale = some.mean(dim=0).numpy(), some.std(dim=0).clamp_min(LEAST_DEVIATION).numpy()

    def _positions(self, windows: NDArray[np.int64]) -> Tensor:
        entities = torch.from_numpy(self.dataset.batch(windows, standardised=False))
        placed = entities[..., :3].clone()
        placed[:, :, self.dataset.layout.joints] = self._raw.positions(entities)
        return placed

    def motions(self, windows: NDArray[np.int64]) -> Tensor:
        """(B, T, E, 3)."""
        mean, deviation = map(torch.from_numpy, self.scale)
        return (self._positions(windows) - mean) / deviation

    def foot_velocities(self, body: Body, motions: Tensor) -> Tensor:
        """From the positions themselves."""
        feet = body.entities(motions)[:, :, list(self.dataset.layout.feet)]
        return feet.diff(dim=1) * self.dataset.frame_rate


def source_of(dataset: Dataset, network: NetworkOptions) -> Source:
    """Where the motions that the networks are to learn come from."""
    return Rotations(dataset) if network.representation == "rotations" else Positions(dataset)
