"""A motion as a BVH file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.io.bvh import angles
from motiongen.io.bvh.header import BLANKS, DEEPEST, LARGEST, shown
from motiongen.io.bvh.layout import (
    DEFAULT_ROOT,
    DEFAULT_ROTATION,
    POSITION_CHANNELS,
    ROTATION_CHANNELS,
    BvhLayout,
    EndSiteLayout,
    position_axes,
    rotation_axes,
    spelled,
)
from motiongen.motion import Z_TO_Y_UP, Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

ANGLE_DECIMALS = 6
FEWEST_DECIMALS, MOST_DECIMALS = 6, 20

FINEST = 4.7e-8
"""What a length's last decimal may stand for, in skeleton heights; joints far down a chain add up their roundings."""

DEEPEST_INDENT = 100
"""Where indenting stops; the tabs of a chain of thousands of joints would fill a hundred megabytes."""

MISFIT = 10.0
"""By how many millionths of a degree a rotation may differ from what a joint's one or two rotation channels can say."""

NUMBERS_AT_ONCE = 1 << 17


@dataclass(frozen=True)
class Turned:
    """A motion as it stands in the file's own world, where y or z may be up.

    Only joint 0 differs from the motion; the arrays are made some frames at a time.
    """

    motion: Motion
    offsets: Array  # (J, 3)

    @classmethod
    def of(cls, motion: Motion) -> Turned:
        """Turn the offset of joint 0 to the up axis of the file."""
        offsets = motion.skeleton.offsets.copy()
        if motion.up == "z":
            offsets[0] = rot.rotate(rot.inverse(Z_TO_Y_UP), offsets[0])
        return cls(motion, offsets)

    def rotations(self, frames: slice) -> Array:
        """(n, J, 4) local rotations."""
        rotations = self.motion.rotations[frames]
        if self.motion.up == "z":
            rotations = rotations.copy()
            rotations[:, 0] = rot.multiply(rot.inverse(Z_TO_Y_UP), rotations[:, 0])
        return rotations

    def translations(self, frames: slice) -> Array:
        """(n, M, 3) positions of the translating joints in their parents' frames."""
        translations = self.motion.translations[frames]
        if self.motion.up == "z" and 0 in self.motion.translating:
            translations = translations.copy()
            translations[:, 0] = rot.rotate(rot.inverse(Z_TO_Y_UP), translations[:, 0])
        return translations

    def blocks(self, columns: int) -> Iterator[slice]:
        """All frames, so many at a time that their numbers are few."""
        step = max(1, NUMBERS_AT_ONCE // columns)
        for start in range(0, len(self.motion), step):
            yield slice(start, min(start + step, len(self.motion)))


def write_bvh(motion: Motion, path: Path) -> None:
    """Write a BVH file (see `motiongen.io.save`), laid out as the file the motion came from where it came from one.

    Joints are written depth first. Lengths have as many decimals as keep joints within a millionth of the height, and
    angles six, chosen so that their curves do not jump. Channels are added where a joint's own cannot say its motion.

    Raises:
        MotionGenError: if a name, a length or the frame rate cannot be said in a BVH file, or it cannot be written.
    """
    skeleton, layout = motion.skeleton, motion.file_layout if isinstance(motion.file_layout, BvhLayout) else None
    turned = Turned.of(motion)
    lengths = (skeleton.offsets, skeleton.end_site_offsets, motion.translations)
    if any(np.abs(values).max(initial=0.0) >= LARGEST for values in lengths):
        raise MotionGenError(f"lengths of {LARGEST:g} and more have no place in a BVH file; scale the motion")
    rate_kept = layout is not None and layout.frame_rate == motion.frame_rate
    frame_time = layout.frame_time if layout and rate_kept else spelled(motion.frame_rate)
    decimals = math.ceil(-math.log10(max(FINEST * skeleton.height, 10.0**-MOST_DECIMALS)))
    decimals = max(decimals, FEWEST_DECIMALS)
    channels = _channels(turned, layout, decimals)
    order, hierarchy = _hierarchy(turned, layout, channels, decimals)
    with atomic_write(path) as file:
        file.write(hierarchy.encode("utf-8", "surrogateescape"))
        file.write(f"MOTION\nFrames: {len(motion)}\nFrame Time: {frame_time}\n".encode())
        for text in _lines(turned, order, channels, decimals):
            file.write(text.encode())


def _channels(turned: Turned, layout: BvhLayout | None, decimals: int) -> list[tuple[str, ...]]:
    """(J,) the channels of each joint: the file's or else the usual ones, and what this motion needs besides."""
    motion, known = turned.motion, layout.channels if layout else {}
    moves = np.zeros((len(motion.skeleton), 3), dtype=bool)
    for frames in turned.blocks(3 * len(motion.translating) + 1):
        away = np.abs(turned.translations(frames) - turned.offsets[list(motion.translating)])
        moves[list(motion.translating)] |= (away >= 0.5 * 10.0**-decimals).any(axis=0)
    channels: list[tuple[str, ...]] = []
    for j, name in enumerate(motion.skeleton.names):
        usual = DEFAULT_ROOT if j == 0 or j in motion.translating else DEFAULT_ROTATION
        listed = known.get(name, usual)
        missing = [POSITION_CHANNELS[axis] for axis in np.flatnonzero(moves[j])]
        behind = max((i + 1 for i, channel in enumerate(listed) if channel in POSITION_CHANNELS), default=0)
        channels.append((*listed[:behind], *(c for c in missing if c not in listed), *listed[behind:]))
    if not any(channels):  # there is no motion in a file without any
        channels[0] = DEFAULT_ROOT
    for (axes, count), joints in _groups(channels).items():
        if count == 3:
            continue
        worst = np.zeros(len(joints))
        for frames in turned.blocks(4 * len(joints)):
            lost = angles.misfit(angles.from_quaternions(turned.rotations(frames)[:, joints], axes)[0], count)
            worst = np.maximum(worst, lost.max(axis=0))
        for j in np.array(joints)[worst > MISFIT]:
            channels[j] += tuple(ROTATION_CHANNELS[axis] for axis in axes[count:])
    return channels


def _groups(channels: list[tuple[str, ...]]) -> dict[tuple[tuple[int, int, int], int], list[int]]:
    """Joints that list the same rotation axes, by those axes, filled up to three, and how many are listed."""
    groups: dict[tuple[tuple[int, int, int], int], list[int]] = {}
    for j, listed in enumerate(channels):
        axes = rotation_axes(listed)
        i, k, m = (*axes, *(axis for axis in rotation_axes(DEFAULT_ROTATION) if axis not in axes))
        groups.setdefault(((i, k, m), len(axes)), []).append(j)
    return groups


def _end_sites(skeleton: Skeleton, layout: BvhLayout | None) -> dict[int, list[tuple[EndSiteLayout, Array]]]:
    """Layouts and offsets of each joint's end sites: as in the file, or nameless after all child joints."""
    known: dict[str, list[EndSiteLayout]] = {}
    for site in layout.end_sites if layout else ():
        known.setdefault(site.joint, []).append(site)
    offsets: dict[int, list[Array]] = {}
    for joint, offset in zip(skeleton.end_sites, skeleton.end_site_offsets):
        offsets.setdefault(joint, []).append(offset)
    sites: dict[int, list[tuple[EndSiteLayout, Array]]] = {}
    for joint, tips in offsets.items():
        name = skeleton.names[joint]
        laid = known.get(name, [])
        if len(laid) != len(tips):
            laid = [EndSiteLayout(name, len(skeleton.children[joint]))] * len(tips)
        sites[joint] = list(zip(laid, tips))
    return sites


def _hierarchy(
    turned: Turned, layout: BvhLayout | None, channels: list[tuple[str, ...]], decimals: int
) -> tuple[list[int], str]:
    """The joints depth first, and the text of the hierarchy."""
    skeleton = turned.motion.skeleton
    sites = _end_sites(skeleton, layout)
    order: list[int] = []
    lines = ["HIERARCHY"]
    ahead: list[tuple[int, int] | str] = [(0, 0)]  # joints with their depth, and text that is ready
    while ahead:
        item = ahead.pop()
        if isinstance(item, str):
            lines.append(item)
            continue
        joint, depth = item
        if depth >= DEEPEST:
            raise MotionGenError(f"joints are nested more than {DEEPEST:,} deep; no BVH file holds such a tree")
        order.append(joint)
        tab = "\t" * min(depth, DEEPEST_INDENT)
        lines += [
            f"{tab}{'JOINT' if depth else 'ROOT'} {_checked(skeleton.names[joint])}",
            f"{tab}{{",
            f"{tab}\tOFFSET {_triple(turned.offsets[joint], decimals)}",
            f"{tab}\tCHANNELS {' '.join([str(len(channels[joint])), *channels[joint]])}",
        ]
        # An end site with as many children before it as a child has stands before that child.
        inside: list[tuple[int, int, tuple[int, int] | str]] = [
            (site.children_before, 0, _end_site(f"{tab}\t", site.name, offset, decimals))
            for site, offset in sites.get(joint, [])
        ] + [(n, 1, (child, depth + 1)) for n, child in enumerate(skeleton.children[joint])]
        inside.sort(key=lambda item: item[:2])
        ahead += [f"{tab}}}", *(item for _, _, item in reversed(inside))]
    return order, "\n".join(lines) + "\n"


def _end_site(tab: str, name: str, offset: Array, decimals: int) -> str:
    title = f"End Site {_checked(name)}" if name else "End Site"
    return f"{tab}{title}\n{tab}{{\n{tab}\tOFFSET {_triple(offset, decimals)}\n{tab}}}"


def _checked(name: str) -> str:
    """A name that comes back as it is when the file is read.

    Raises:
        MotionGenError: if it would not.
    """
    try:
        fine = name.encode("utf-8", "surrogateescape").decode("utf-8", "surrogateescape") == name
    except UnicodeEncodeError:
        fine = False
    if not fine or not name or name.strip(BLANKS) != name or len(name) > 1000 or set(name) & set("{\r\n\0"):
        raise MotionGenError(
            f"the name '{shown(name)}' cannot be written to a BVH file; rename it, without braces, line ends "
            "and blanks around it, to 1 to 1,000 characters"
        )
    return name


def _triple(lengths: Array, decimals: int) -> str:
    return " ".join(f"{value:.{decimals}f}" for value in np.round(lengths, decimals) + 0.0)  # the sum has no -0


def _lines(turned: Turned, order: list[int], channels: list[tuple[str, ...]], decimals: int) -> Iterator[str]:
    """The numbers, some frames at a time."""
    motion = turned.motion
    listed = [(joint, channel) for joint in order for channel in channels[joint]]
    column = {key: c for c, key in enumerate(listed)}
    places = [c for c, (_, channel) in enumerate(listed) if channel in POSITION_CHANNELS]
    rest = np.zeros(len(listed))
    rest[places] = [turned.offsets[listed[c][0], POSITION_CHANNELS.index(listed[c][1])] for c in places]
    digits = [decimals if channel in POSITION_CHANNELS else ANGLE_DECIMALS for _, channel in listed]
    line = " ".join(f"%.{count}f" for count in digits) + "\n"
    groups = _groups(channels)
    latest: dict[object, Array | None] = dict.fromkeys(groups)
    for frames in turned.blocks(len(listed)):
        rotations, translations = turned.rotations(frames), turned.translations(frames)
        table = np.tile(rest, (len(rotations), 1))
        for m, joint in enumerate(motion.translating):
            for axis in position_axes(channels[joint]):
                table[:, column[joint, POSITION_CHANNELS[axis]]] = translations[:, m, axis]
        table[:, places] = np.round(table[:, places], decimals)
        for (axes, count), joints in groups.items():
            euler = angles.unroll(*angles.from_quaternions(rotations[:, joints], axes), latest[axes, count], count)
            latest[axes, count] = euler[:, -1]
            for turn in range(count):
                columns = [column[joint, ROTATION_CHANNELS[axes[turn]]] for joint in joints]
                table[:, columns] = euler[turn] / angles.DEGREE
        table += 0.0  # no -0
        yield line * len(table) % tuple(table.ravel().tolist())
