"""How chains swing: rows of points under gravity, drag and springs, step by step through a clip.

Position-based dynamics (Müller et al. 2007): points fly freely, obstacles push them, damped springs pull each bone
towards its rest direction, and lengths are kept from the anchor outwards. Springs, dampers and drag are solved
implicitly: no stiffness makes them unstable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.motion import METRES_PER_UNIT, Motion
from motiongen.secondary.chains import Capsule, Chain

Array = NDArray[np.float64]

GRAVITY = 9.81
"""In metres per second squared."""

STATURE = 1.75
"""How tall a figure is taken to be, in metres, where the unit of its clip is not known."""

STEPS_PER_SECOND = 120.0
"""At least so many steps are simulated a second."""

PUSH = 40.0
"""How much a second of its way out of a capsule or the ground a point is pushed; all at once would make points jump."""

FOLD = math.radians(80)
"""How far a bone bends from the line of the one above, at most. One folded right over could flip from side to side."""

WARM_UP_SECONDS = 3.0
"""How long before the first frame the simulation begins."""


@dataclass
class World:
    """C chains of up to N bones, the longest first, the shorter ones filled up with bones of no length."""

    motion: Motion
    chains: list[Chain]
    capsules: tuple[Capsule, ...]
    ground: float
    warm_up_seconds: float
    steps_per_second: float
    bones: Array = field(init=False)  # (N, C, 3)

    def __post_init__(self) -> None:
        """Sort and fill up."""
        self.chains = sorted(self.chains, key=lambda chain: -len(chain.bones))
        self.bones = np.zeros((len(self.chains[0].bones), len(self.chains), 3))
        for c, chain in enumerate(self.chains):
            self.bones[: len(chain.bones), c] = chain.bones

    def directions(self) -> Array:
        """(T, N, C, 3) unit vectors along the bones at every frame, in the world."""
        table = self._drivers()
        steps = math.ceil(0.99 * self.steps_per_second / self.motion.frame_rate)  # at 29.97 Hz as many as at 30
        weights = _spline(np.arange(1, steps + 1) / steps)  # (steps, 4)
        lead = len(table) - len(self.motion)
        solver = _Solver(self, 1.0 / (steps * self.motion.frame_rate), table[0])
        padded = np.concatenate([table[:1], table, table[-1:]])
        found = np.empty((len(self.motion), *self.bones.shape))
        for frame in range(len(table)):
            if frame > 0:
                for row in weights @ padded[frame - 1 : frame + 3]:
                    solver.step(row)
            if frame >= lead:
                found[frame - lead] = solver.along
        return found

    def _drivers(self) -> Array:
        """(K + T, columns) what moves the chains: their first joints, rest directions, and the ends of the capsules.

        K frames lead into the first one.
        """
        motion, skeleton = self.motion, self.motion.skeleton
        anchors = [skeleton.index(chain.anchor) for chain in self.chains]
        turned = motion.world_rotations[:, anchors]  # (T, C, 4)
        offsets = np.stack([chain.offset for chain in self.chains])
        bases = motion.positions[:, anchors] + rot.rotate(turned, offsets)
        drives = [rot.IDENTITY if chain.drive is None else chain.drive for chain in self.chains]
        turned = rot.multiply(turned, np.stack([np.broadcast_to(d, (len(motion), 4)) for d in drives], axis=1))
        ends = [skeleton.index(end) for capsule in self.capsules for end in (capsule.start, capsule.end)]
        points = np.concatenate([bases, motion.positions[:, ends]], axis=1)  # (T, C + 2K, 3)
        # Led on backwards, as a point reflection leads a curve on: x(-t) = 2 x(0) - x(t), and so for rotations.
        back = np.minimum(np.arange(math.ceil(self.warm_up_seconds * motion.frame_rate), 0, -1), len(motion) - 1)
        points = np.concatenate([2 * points[0] - points[back], points])
        before = rot.multiply(turned[:1], rot.multiply(rot.inverse(turned[back]), turned[:1]))
        turned = np.concatenate([before, turned])
        rest = rot.rotate(turned[:, None], unit(self.bones))  # (K + T, N, C, 3)
        flat = [points[:, : len(self.chains)], rest, points[:, len(self.chains) :]]
        return np.concatenate([values.reshape(len(points), -1) for values in flat], axis=1)


class _Solver:
    """The chains' points at one moment, and the step to the next."""

    def __init__(self, world: World, seconds: float, row: Array) -> None:
        """Begin in the rest shape, without speed, at the first row of drivers."""
        chains, motion = world.chains, world.motion
        count, columns = len(world.bones), len(chains)
        self.shape, self.radii = (count, columns, 3), np.array([capsule.radius for capsule in world.capsules])
        metre = METRES_PER_UNIT[motion.unit] if motion.unit else STATURE / motion.skeleton.height
        omega = np.array([chain.radians_per_second for chain in chains])
        damping = np.array([chain.damping for chain in chains])
        self.spring = ((omega * seconds) ** 2)[:, None]
        self.damper = (2 * damping * omega * seconds)[:, None]
        self.drag = (seconds * np.array([chain.drag for chain in chains]))[:, None]
        self.total = 1 + self.spring + self.damper + self.drag
        self.woven = _weaving(chains)  # (C, C)
        self.bend = np.array([chain.bend for chain in chains])[:, None] * (1 - self.woven.sum(axis=1, keepdims=True))
        self.fall = np.zeros((columns, 3))
        self.fall[:, 1] = -GRAVITY / metre * seconds**2 * np.array([chain.weight for chain in chains])
        self.ground, self.push = world.ground, 1 - math.exp(-PUSH * seconds)
        self.lengths = np.linalg.norm(world.bones, axis=-1)[..., None]  # (N, C, 1)
        self.collides = (self.lengths[..., 0] > 0) & np.array([chain.collides for chain in chains])  # (N, C)
        self.counts = (self.lengths[..., 0] > 0).sum(axis=1).tolist()  # (N,) of chains with so many bones
        base, rest, _ = self._split(row)
        self.along = rest.copy()  # (N, C, 3) unit vectors
        self.points = base + np.cumsum(self.lengths * rest, axis=0)  # (N, C, 3) the far ends of the bones
        self.speeds = np.zeros(self.shape)  # way in a step
        self.base = base

    def _split(self, row: Array) -> tuple[Array, Array, Array]:
        columns, bones = self.shape[1], math.prod(self.shape)
        base, rest, ends = np.split(row, [3 * columns, 3 * columns + bones])
        return base.reshape(columns, 3), rest.reshape(self.shape), ends.reshape(-1, 2, 3)

    def step(self, row: Array) -> None:
        """One step: free flight, obstacles, then from the anchor outwards springs, drag and lengths."""
        base, rest, ends = self._split(row)
        free = self.points + self.speeds + self.fall
        pushes = self._pushes(free, ends)
        against = unit(pushes)
        free += pushes - np.minimum(np.einsum("ncx,ncx->nc", free - self.points, against), 0.0)[..., None] * against
        aside = self.woven @ (self.along - rest)  # (N, C, 3)
        above, bent = base, np.zeros_like(base)
        points = self.points.copy()
        for n, k in enumerate(self.counts):  # the first k chains have a bone n
            above, bent = above[:k], bent[:k]
            target = above + self.lengths[n, :k] * unit(rest[n, :k] + self.bend[:k] * bent + aside[n, :k])
            # Implicit Euler for the spring, for its damper, which slows down turning, and for drag.
            before = self.points[n - 1, :k] if n else self.base
            pulled = free[n, :k] + self.spring[:k] * target + self.drag[:k] * self.points[n, :k]
            pulled += self.damper[:k] * (self.points[n, :k] + above - before)
            pulled /= self.total[:k]
            self.along[n, :k] = along = _kept_within(FOLD, unit(pulled - above), rest[n, :k] + bent)
            bent = along - rest[n, :k]
            points[n, :k] = above = above + self.lengths[n, :k] * along
        # What pushes a point moves it without giving it speed, or it would bounce.
        self.speeds, self.points, self.base = points - self.points - pushes / self.total, points, base

    def _pushes(self, free: Array, ends: Array) -> Array:
        """(N, C, 3) how far points are pushed out of capsules with ends (K, 2, 3) and out of the ground."""
        pushes = np.zeros(self.shape)
        if len(ends) and self.collides.any():
            pushes[self.collides] = _push(free[self.collides], ends, self.radii)
        pushes[..., 1] += np.maximum(self.ground - free[..., 1], 0.0)
        return self.push * pushes


def _kept_within(angle: float, along: Array, middle: Array) -> Array:
    """(C, 3) unit vectors brought within an angle of others, which may be a little shorter or longer."""
    if np.einsum("cx,cx->c", along, middle).min() >= math.cos(angle):
        return along
    middle = unit(middle)
    cosine = np.einsum("cx,cx->c", along, middle)[:, None]
    aside = unit(along - cosine * middle)
    return np.where(cosine < math.cos(angle), math.cos(angle) * middle + math.sin(angle) * aside, along)


def _weaving(chains: Sequence[Chain]) -> Array:
    """(C, C) how far each chain's bones follow the bends of the others in its cloth."""
    column = {chain.name: c for c, chain in enumerate(chains)}
    woven = np.zeros((len(chains), len(chains)))
    for c, chain in enumerate(chains):
        beside = [column[name] for name in chain.beside if name in column]
        for other in beside:
            woven[c, other] += chain.cloth / len(beside)
    return woven


def _push(points: Array, ends: Array, radii: Array) -> Array:
    """(P, 3) the way of points (P, 3) out of capsules with ends (K, 2, 3)."""
    start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    squared = np.maximum(np.einsum("kx,kx->k", way, way), 1e-12)
    along = points @ way.T - np.einsum("kx,kx->k", start, way)  # (P, K)
    place = np.clip(along / squared, 0.0, 1.0)
    apart = np.einsum("px,px->p", points, points)[:, None] - 2 * points @ start.T + np.einsum("kx,kx->k", start, start)
    inside = apart + place * (place * squared - 2 * along) < radii**2
    push = np.zeros(points.shape)
    if inside.any():
        point, k = np.nonzero(inside)
        off = points[point] - start[k] - place[point, k, None] * way[k]
        distance = np.maximum(np.sqrt(np.einsum("nx,nx->n", off, off)), 1e-9)
        np.add.at(push, point, off * np.maximum(radii[k] / distance - 1, 0.0)[:, None])
    return push


def _spline(between: Array) -> Array:
    """(n, 4) weights of the points at -1, 0, 1 and 2 for places (n,) from 0 to 1 (Catmull and Rom 1974)."""
    t = between
    return np.stack([-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2], axis=-1) / 2


def unit(vectors: Array) -> Array:
    """(..., 3) vectors of length one; those of no length stay as they are."""
    lengths = np.sqrt(np.einsum("...x,...x->...", vectors, vectors))
    return vectors / np.maximum(lengths, 1e-12)[..., None]
