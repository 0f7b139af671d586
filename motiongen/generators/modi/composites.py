"""Motions put together of others, or with parts missing: what an encoder is to make whole.

All are windows (T, E, 4) of entities that face +z in their first frame, not standardised.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.datasets import EntityLayout
from motiongen.datasets.entities import heading_radians, turn_about_up
from motiongen.generators.modi.alignment import Floats
from motiongen.generators.modi.checkpoint import Card


def spliced(layout: EntityLayout, first: Floats, second: Floats, at: int) -> Floats:
    """(T, E, 4) the frames of `first` before `at`, and from there on those of `second`, turned to go on ahead."""
    before, there = (each[at - 1].astype(np.float64) for each in (first, second))
    turn = rot.heading(rot.multiply(before[0], rot.inverse(there[0])))
    rest = second[None, at:].copy()
    turn_about_up(rest, layout, heading_radians(turn)[None])
    alike = np.einsum("jc,jc->j", before[layout.joints], rest[0, 0, layout.joints])
    rest[:, :, layout.joints] *= np.where(alike < 0, -1, 1).astype(rest.dtype)[:, None]
    return np.concatenate([first[:at], rest[0]])


def with_joints(layout: EntityLayout, motion: Floats, source: Floats, joints: Sequence[int]) -> Floats:
    """(T, E, 4) `motion` with the rotations of some joints from `source`.

    The root brings its steps along, and feet their contact labels.
    """
    moved = [layout.root] if 0 in joints else []
    labels = [layout.contacts.start + place for place, foot in enumerate(layout.feet) if foot in joints]
    changed, taken = motion.copy(), [*joints, *moved, *labels]
    changed[:, taken] = source[:, taken]
    return changed


def cut_off(card: Card, motion: Floats, frames: int) -> Floats:
    """(T, E, 4) a motion whose frames from `frames` on are not known: the mean of the data, zero to the network."""
    known = np.broadcast_to(card.mean, motion.shape).copy()
    known[:frames] = motion[:frames]
    return known


def noised(card: Card, motion: Floats, random: np.random.Generator, size: float) -> Floats:
    """(T, E, 4) a motion with Gaussian noise of `size` deviations on everything but the contact labels."""
    noise: NDArray[np.float64] = random.normal(size=motion.shape) * size * card.deviation
    noise[:, card.layout.contacts] = 0.0
    return (motion + noise).astype(np.float32)
