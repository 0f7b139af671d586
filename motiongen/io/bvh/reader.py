"""A BVH file as a motion."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.files import open_to_read
from motiongen.io.bvh import angles, guess
from motiongen.io.bvh.header import Header, Node, read_header
from motiongen.io.bvh.layout import (
    POSITION_CHANNELS,
    ROTATION_CHANNELS,
    BvhLayout,
    EndSiteLayout,
    position_axes,
    rate_of,
    rotation_axes,
)
from motiongen.io.bvh.numbers import check_claim, read_numbers
from motiongen.io.bvh.source import Source
from motiongen.motion import Z_TO_Y_UP, Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

STILL = 5e-6
"""A position channel that varies by less, in skeleton heights, does not move: it is noise of the file's last digits."""

MOST_MEMORY = 256
"""Bytes of memory that a byte of the file may ask for. Ordinary files ask for 1 to 6."""


@dataclass
class Frames:
    """The numbers of a file, made into rotations and positions.

    Attributes:
        rotations: (T, J, 4) local rotations, signs continuous in time.
        positions: (T, P, 3) of the joints that have position channels; OFFSET along axes without one.
        placed: (P,) those joints.
        turning: (T,) how far the joints turn from the frame before, as the mean sine of half the angle; 0 at first.
    """

    rotations: Array
    positions: Array
    placed: list[int]
    turning: Array


def read_bvh(path: Path, up: str | None = None, unit: str | None = None) -> Motion:
    """Read a BVH file (see `motiongen.io.load`)."""
    with open_to_read(path) as file:
        size = os.fstat(file.fileno()).st_size
        source = Source(file, path)
        header = read_header(source)
        check_claim(source, header, size)
        frames = _read_frames(source, header, size)
    skeleton, translations, translating, notes = _fold(header, frames)
    rotations, turning = frames.rotations, frames.turning
    del frames  # the positions of joints that turned out still may be most of the memory
    rate = rate_of(header.frame_time)
    poses, names = guess.sample(skeleton, rotations, translations, translating)
    if up is None:
        up, note = guess.up_axis(poses, names)
        notes += note
    if up == "z":
        skeleton = _turn_to_y(skeleton, rotations, translations, translating)
    if unit is None:
        unit, note = guess.length_unit(skeleton, poses, up)
        notes += note
    notes += guess.odd_times(turning, rate)
    return Motion(
        skeleton, rotations, translations, translating, rate, unit, up, path.stem, tuple(notes), _layout(header, rate)
    )


def _read_frames(source: Source, header: Header, size: int) -> Frames:
    """The numbers as rotations and positions, each block turned into them before the next is read."""
    joints = header.joints
    placed = [j for j, joint in enumerate(joints) if position_axes(joint.channels or ())]
    needed = 8 * header.frames * (4 * len(joints) + 3 * len(placed))
    if needed > MOST_MEMORY * size:
        raise source.error(
            f"{header.frames:,} frames of {len(joints):,} joints need {needed / 1e9:.1f} GB, {needed // size} times "
            "the size of the file, because most joints have no channels; remove those joints"
        )
    try:
        rotations = np.empty((header.frames, len(joints), 4))
        positions = np.empty((header.frames, len(placed), 3))
    except MemoryError:
        raise source.error(
            f"{header.frames:,} frames need {needed / 1e9:.1f} GB of memory; cut the file in two"
        ) from None
    turning = np.zeros(header.frames)
    groups, columns, slots = _rotation_groups(header), *_position_columns(header, placed)
    positions.reshape(header.frames, -1)[:] = np.array([joints[j].offset for j in placed]).reshape(-1)
    start = 0
    for table in read_numbers(source, header):
        now = slice(start, start + len(table))
        for axes, members, their_columns in groups:
            parts = angles.to_quaternions(table[:, their_columns], axes)  # (4, n, members)
            for part in range(4):
                rotations[now, members, part] = parts[part]
        positions.reshape(header.frames, -1)[now, slots] = table[:, columns]
        turning[now] = _continue(rotations, now)
        start = now.stop
    return Frames(rotations, positions, placed, turning)


def _rotation_groups(header: Header) -> list[tuple[tuple[int, ...], slice | list[int], Array]]:
    """Joints that list the same rotation axes: the axes, the joints, and their columns (axes, joints)."""
    by_axes: dict[tuple[int, ...], list[int]] = {}
    for j, joint in enumerate(header.joints):
        by_axes.setdefault(rotation_axes(joint.channels or ()), []).append(j)
    groups: list[tuple[tuple[int, ...], slice | list[int], Array]] = []
    for axes, members in by_axes.items():
        columns = [_columns(header.joints[j], ROTATION_CHANNELS, axes) for j in members]
        run = list(range(members[0], members[-1] + 1))  # a slice is several times as fast as a list of indices
        which = slice(run[0], run[-1] + 1) if run == members else members
        groups.append((axes, which, np.array(columns, dtype=int).reshape(len(members), len(axes)).T))
    return groups


def _position_columns(header: Header, placed: list[int]) -> tuple[list[int], list[int]]:
    """The columns of all position channels, and where each goes in a frame's (P, 3) positions, counted flat."""
    columns: list[int] = []
    slots: list[int] = []
    for p, j in enumerate(placed):
        axes = position_axes(header.joints[j].channels or ())
        columns += _columns(header.joints[j], POSITION_CHANNELS, axes)
        slots += [3 * p + axis for axis in axes]
    return columns, slots


def _columns(joint: Node, names: tuple[str, ...], axes: tuple[int, ...]) -> list[int]:
    channels = joint.channels or ()
    return [joint.first_column + channels.index(names[axis]) for axis in axes]


def _continue(rotations: Array, now: slice) -> Array:
    """Choose the signs of the frames `now` to follow those before, in place; how far the joints turn in each, (n,)."""
    first = max(now.start, 1)
    fresh, before = rotations[first : now.stop], rotations[first - 1 : now.stop - 1]
    dots = np.einsum("tjc,tjc->tj", fresh, before)
    turning = np.zeros(now.stop - now.start)
    turning[first - now.start :] = np.sqrt(np.maximum(1 - dots * dots, 0.0)).mean(axis=1)
    flips = dots < 0
    if flips.any():
        fresh *= np.where(np.cumsum(flips, axis=0) % 2 == 1, -1.0, 1.0)[..., None]
    return turning


def _fold(header: Header, frames: Frames) -> tuple[Skeleton, Array, tuple[int, ...], list[str]]:
    """Tell joints that move in their parent's frame from those that only stand elsewhere than their OFFSET says.

    Returns:
        The skeleton, with the position channels that stand still as offsets; the translations (T, M, 3) of the joints
        that move; those joints; and notes.
    """
    placed, positions = np.array(frames.placed, dtype=int), frames.positions
    low, high = positions.min(axis=0), positions.max(axis=0)
    middle, spread = low + (high - low) / 2, (high - low).max(axis=-1, initial=0.0)  # (P, 3), (P,)
    moves = placed == 0
    # How small is still depends on the size of the skeleton, which depends on the offsets. Twice round is enough: at
    # first a joint that wanders far makes it too large, and then stands at its OFFSET.
    for _ in range(2):
        skeleton = _skeleton(header, placed[~moves], middle[~moves])
        if len(positions) > 1:
            moves = (spread > STILL * skeleton.height) | (placed == 0)
    still_root = len(placed) > 0 and placed[0] == 0 and spread[0] <= STILL * skeleton.height
    carrier = _carrier(skeleton, placed[moves & (placed != 0)]) if still_root else None
    notes: list[str] = []
    if carrier is not None:
        moves[0] = False
        notes.append(guess.still_root(skeleton, carrier))
    skeleton = _skeleton(header, placed[~moves], middle[~moves])
    translating = tuple(int(j) for j in placed[moves])
    notes += guess.odd_places(skeleton, _offsets(header), [j for j in translating if j not in (0, carrier)])
    return skeleton, positions[:, moves], translating, notes


def _carrier(skeleton: Skeleton, moving: Array) -> int | None:
    """The moving joint with the most joints below it, if that is at least half of the skeleton."""
    sizes = [1] * len(skeleton)
    for joint in range(len(skeleton) - 1, 0, -1):
        sizes[skeleton.parents[joint]] += sizes[joint]
    best = max((int(j) for j in moving), key=lambda j: sizes[j], default=None)
    return best if best is not None and 2 * sizes[best] >= len(skeleton) else None


def _offsets(header: Header) -> Array:
    return np.array([joint.offset for joint in header.joints], dtype=np.float64)


def _skeleton(header: Header, moved: Array, places: Array) -> Skeleton:
    """The skeleton of the file with the joints `moved` at `places` instead of their OFFSET."""
    offsets = _offsets(header)
    offsets[moved] = places
    tips = np.array([site.offset for site in header.end_sites], dtype=np.float64).reshape(-1, 3)
    names, parents = [joint.name for joint in header.joints], [joint.parent for joint in header.joints]
    return Skeleton(tuple(names), tuple(parents), offsets, tuple(site.parent for site in header.end_sites), tips)


def _turn_to_y(skeleton: Skeleton, rotations: Array, translations: Array, translating: tuple[int, ...]) -> Skeleton:
    """What `Motion.turn_up` does, in place, because the arrays may be most of the memory there is."""
    rotations[:, 0] = rot.multiply(Z_TO_Y_UP, rotations[:, 0])
    if 0 in translating:
        translations[:, 0] = rot.rotate(Z_TO_Y_UP, translations[:, 0])
    offsets = skeleton.offsets.copy()
    offsets[0] = rot.rotate(Z_TO_Y_UP, offsets[0])
    return dataclasses.replace(skeleton, offsets=offsets)


def _layout(header: Header, rate: float) -> BvhLayout:
    channels = {joint.name: joint.channels or () for joint in header.joints}
    sites = tuple(
        EndSiteLayout(header.joints[site.parent].name, site.children_before, site.name) for site in header.end_sites
    )
    return BvhLayout(channels, sites, header.frame_time, rate)
