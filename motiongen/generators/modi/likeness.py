"""How far motions are from others: the terms of an inversion (Eq. 9), and the figures that a person reads."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from motiongen.generators.modi.body import Body
from motiongen.generators.modi.checkpoint import Card
from motiongen.motion import METRES_PER_UNIT


class Seen(NamedTuple):
    """What is compared of motions.

    Attributes:
        rotations: (B, T, J, 4) unit quaternions xyzw.
        positions: (B, T, J, 3) in the world, in skeleton heights; the root starts at the origin.
        contacts: (B, T, C) labels.
    """

    rotations: Tensor
    positions: Tensor
    contacts: Tensor

    def rows(self, index: Tensor | slice) -> Seen:
        """Those of some motions."""
        return Seen(*(each[index] for each in self))


class Distances(NamedTuple):
    """(B,) each: mean squares over frames and joints of angles in radians, of ways in heights, and of labels."""

    rotation: Tensor
    position: Tensor
    contact: Tensor

    def weighted(self, fk: float, contact: float) -> Tensor:
        """(B,) Eq. 9, with contact labels."""
        return self.rotation + fk * self.position + contact * self.contact


@dataclass(frozen=True)
class MotionError:
    """How far a motion is from its target; means over frames and joints.

    Attributes:
        rotation_degrees: angle between a joint's rotations in its parent's frame.
        position_heights: distance between a joint's places in the world, both roots starting at the origin.
        position_cm: the same in centimetres on the checkpoint's skeleton, where its unit is known.
        contact_disagreement: share of the contact labels that say otherwise.
    """

    rotation_degrees: float
    position_heights: float
    position_cm: float | None
    contact_disagreement: float

    def __str__(self) -> str:
        """A short line."""
        cm = "" if self.position_cm is None else f" ({self.position_cm:.1f} cm)"
        return (
            f"{self.rotation_degrees:.1f} degrees, {self.position_heights:.2%} of the height{cm}, contacts differ in "
            f"{self.contact_disagreement:.1%}"
        )


def seen(body: Body, motions: Tensor) -> Seen:
    """What is compared of standardised motions (B, T, E, 4)."""
    entities = body.entities(motions)
    rotations = functional.normalize(entities[:, :, body.layout.joints], dim=-1)
    return Seen(rotations, body.positions(motions), entities[:, :, body.layout.contacts, 0])


def distances(made: Seen, target: Seen) -> Distances:
    """How far each motion is from its target; one target serves for all motions.

    For the angle θ between rotations stands 2 sin(θ/2), which is θ where they are near, is the same for a quaternion
    and its negative, and has a gradient everywhere.
    """
    alike = (made.rotations * target.rotations).sum(dim=-1).square()
    apart = (made.positions - target.positions).square().sum(dim=-1)
    return Distances(
        4 * (1 - alike).flatten(1).mean(dim=1),
        apart.flatten(1).mean(dim=1),
        _mean((made.contacts - target.contacts).square()),
    )


def errors(card: Card, made: Seen, target: Seen) -> tuple[MotionError, ...]:
    """The figures of each motion of a checkpoint's network."""
    nearer = torch.where((made.rotations * target.rotations).sum(dim=-1, keepdim=True) < 0, -1.0, 1.0)
    chords = (made.rotations - nearer * target.rotations).norm(dim=-1)
    degrees = torch.rad2deg(4 * torch.asin((chords / 2).clamp(max=1.0))).flatten(1).mean(dim=1)
    heights = (made.positions - target.positions).norm(dim=-1).flatten(1).mean(dim=1)
    wrong = _mean(((made.contacts > 0.5) != (target.contacts > 0.5)).float())
    cm = None if card.unit is None else 100 * METRES_PER_UNIT[card.unit] * card.layout.skeleton.height
    return tuple(
        MotionError(turn, way, None if cm is None else way * cm, share)
        for turn, way, share in zip(degrees.tolist(), heights.tolist(), wrong.tolist())
    )


def mean_error(found: Sequence[MotionError]) -> MotionError:
    """The mean of each figure."""
    centimetres = [error.position_cm for error in found if error.position_cm is not None]
    return MotionError(
        statistics.fmean(error.rotation_degrees for error in found),
        statistics.fmean(error.position_heights for error in found),
        statistics.fmean(centimetres) if centimetres else None,
        statistics.fmean(error.contact_disagreement for error in found),
    )


def _mean(labels: Tensor) -> Tensor:
    """(B,) means over frames and feet (B, T, C); zero where there are no feet."""
    return labels.flatten(1).sum(dim=1) / max(1, labels[0].numel())
