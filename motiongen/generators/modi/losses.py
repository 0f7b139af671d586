"""The terms that MoDi is trained by (section 3.4): one function each, of scores, labels, velocities and gradients."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional


def generator_loss(fake_scores: Tensor) -> Tensor:
    """How little the discriminator takes the made motions for real ones (Eq. 2); scores (B,) are logits."""
    return functional.softplus(-fake_scores).mean()


def discriminator_loss(real_scores: Tensor, fake_scores: Tensor) -> Tensor:
    """How badly the discriminator tells real from made (Eq. 3); scores (B,) are logits."""
    return functional.softplus(-real_scores).mean() + functional.softplus(fake_scores).mean()


def contact_encouragement(contact_logits: Tensor) -> Tensor:
    """How little the feet touch the ground by their own labels (Eq. 4).

    Args:
        contact_logits: (B, T, C), see `Body.contact_logits`.
    """
    return -functional.logsigmoid(contact_logits).mean()


def contact_consistency(foot_velocities: Tensor, contact_logits: Tensor) -> Tensor:
    """How fast feet move while their labels say that they stand (Eq. 5).

    Args:
        foot_velocities: (B, T - 1, C, 3) by forward kinematics, from each frame to the next.
        contact_logits: (B, T, C); the label of the later frame counts.
    """
    squared_speeds = foot_velocities.square().sum(dim=-1)
    return (squared_speeds * torch.sigmoid(contact_logits[:, 1:])).mean()


def path_lengths(motions: Tensor, codes: Tensor, noise: Tensor) -> Tensor:
    """(B,) how far motions move with their codes, in the direction of `noise` (Eq. 6).

    Args:
        motions: (B, T, E, K) made from `codes`.
        codes: (B, N, latent size) in W+, one for each layer.
        noise: (B, T, E, K) unit Gaussian; normalised here by the number of joints and frames.
    """
    frames, entities = motions.shape[1:3]
    moved = (motions * noise).sum() / math.sqrt(frames * entities)
    (gradient,) = torch.autograd.grad(moved, codes, create_graph=True)
    # The norm has a gradient of zero at zero, where the root has none.
    return torch.linalg.vector_norm(gradient, dim=(1, 2)) / math.sqrt(codes.shape[1])


def path_length_penalty(lengths: Tensor, mean_length: Tensor) -> Tensor:
    """How uneven the lengths (B,) are, about their accumulated mean (Eq. 6)."""
    return (lengths - mean_length).square().mean()


def r1_penalty(real_scores: Tensor, real: Tensor) -> Tensor:
    """How steep the discriminator is at real motions (B, T, E, K), whose scores are (B,) (Eq. 7)."""
    (gradient,) = torch.autograd.grad(real_scores.sum(), real, create_graph=True)
    return gradient.square().flatten(1).sum(dim=1).mean()
