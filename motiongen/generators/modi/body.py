"""What a motion's numbers mean, for gradients: from standardised entities to feet in the world."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from motiongen.datasets import EntityLayout

LABEL_SLOPE = 12.0
"""How sharply a contact label around one half becomes a probability."""


class Body(nn.Module):
    """The body that standardised motions (B, T, E, K) belong to.

    Args:
        layout: which entity is what.
        mean: (E, K) of the data.
        deviation: (E, K) of the data.
        frame_rate: in Hz.
    """

    mean: Tensor
    deviation: Tensor
    offsets: Tensor

    def __init__(
        self, layout: EntityLayout, mean: NDArray[np.float32], deviation: NDArray[np.float32], frame_rate: float
    ) -> None:
        """Keep what is constant."""
        super().__init__()
        self.layout, self.frame_rate = layout, frame_rate
        skeleton = layout.skeleton
        offsets = torch.tensor(skeleton.offsets / skeleton.height, dtype=torch.float32)
        for name, value in (("mean", torch.tensor(mean)), ("deviation", torch.tensor(deviation)), ("offsets", offsets)):
            self.register_buffer(name, value, persistent=False)

    def entities(self, motions: Tensor) -> Tensor:
        """Motions (B, T, E, K) as the data has them, no longer standardised."""
        return motions * self.deviation + self.mean

    def contact_logits(self, motions: Tensor) -> Tensor:
        """(B, T, C) contact labels as logits: label one half is probability one half."""
        return LABEL_SLOPE * (self.entities(motions)[:, :, self.layout.contacts, 0] - 0.5)

    def foot_velocities(self, motions: Tensor) -> Tensor:
        """(B, T - 1, C, 3) velocities of the foot joints in the world, in skeleton heights per second."""
        return self.positions(motions, self.layout.feet).diff(dim=1) * self.frame_rate

    def positions(self, motions: Tensor, joints: tuple[int, ...] | None = None) -> Tensor:
        """(B, T, J, 3) positions of joints in the world, in skeleton heights; the root starts at the origin.

        Args:
            motions: (B, T, E, 4) standardised.
            joints: which; None: all.
        """
        skeleton = self.layout.skeleton
        chosen = tuple(range(len(skeleton))) if joints is None else joints
        if not chosen:
            return motions.new_zeros(*motions.shape[:2], 0, 3)
        needed = sorted({joint for each in chosen for joint in (each, *skeleton.ancestors(each))})
        entities = self.entities(motions)
        rotations = nn.functional.normalize(entities[:, :, self.layout.joints], dim=-1)
        steps = entities[:, :, self.layout.root, :3]
        world: dict[int, tuple[Tensor, Tensor]] = {}
        for joint in needed:  # parents come before children
            if (parent := skeleton.parents[joint]) < 0:
                start = torch.zeros_like(steps[:, :1])
                world[joint] = rotations[:, :, joint], torch.cat([start, steps[:, 1:]], dim=1).cumsum(dim=1)
            else:
                turned, moved = world[parent]
                world[joint] = (
                    multiply(turned, rotations[:, :, joint]),
                    moved + rotate(turned, self.offsets[joint].expand_as(moved)),
                )
        return torch.stack([world[joint][1] for joint in chosen], dim=2)


def multiply(a: Tensor, b: Tensor) -> Tensor:
    """(..., 4) the turn b and then a, quaternions xyzw."""
    v, w, u, s = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    return torch.cat([w * u + s * v + torch.linalg.cross(v, u), w * s - (v * u).sum(dim=-1, keepdim=True)], dim=-1)


def rotate(q: Tensor, vectors: Tensor) -> Tensor:
    """(..., 3) vectors turned by unit quaternions (..., 4)."""
    v, w = q[..., :3], q[..., 3:]
    across = 2 * torch.linalg.cross(v, vectors)
    return vectors + w * across + torch.linalg.cross(v, across)
