"""A slow reader of BVH files that follows the definition to the letter and shares no code with the library.

Matrices instead of quaternions, every line split and every word converted by itself, nothing folded, guessed or turned.
It takes correct files only.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class SlowJoint:
    name: str
    parent: int
    offset: list[float] = field(default_factory=list)
    channels: list[str] = field(default_factory=list)


@dataclass
class SlowBvh:
    joints: list[SlowJoint]
    tips: list[tuple[int, list[float]]]  # the joint and the offset of each end site
    frame_time: float
    numbers: list[list[float]]

    def positions(self) -> tuple[Array, Array]:
        """World positions of the joints (T, J, 3) and of the end sites (T, S, 3), as the file's axes have them."""
        frames = len(self.numbers)
        values = np.array(self.numbers)
        rotations: list[Array] = []  # (T, 3, 3) each
        places: list[Array] = []  # (T, 3) each
        column = 0
        for joint in self.joints:
            local = np.tile(joint.offset, (frames, 1))
            turn = np.tile(np.eye(3), (frames, 1, 1))
            for channel in joint.channels:
                value = values[:, column]
                column += 1
                axis = "xyz".index(channel[0].lower())
                if channel[1:].lower() == "position":
                    local[:, axis] = value
                else:
                    turn = turn @ elementary(axis, np.radians(value))
            if joint.parent == -1:
                rotations.append(turn)
                places.append(local)
            else:
                rotations.append(rotations[joint.parent] @ turn)
                places.append(places[joint.parent] + (rotations[joint.parent] @ local[..., None])[..., 0])
        tips = [places[joint] + rotations[joint] @ np.array(offset) for joint, offset in self.tips]
        return np.stack(places, axis=1), np.stack(tips, axis=1) if tips else np.zeros((frames, 0, 3))


def elementary(axis: int, angles: Array) -> Array:
    """The matrices (T, 3, 3) of right-handed turns about an axis."""
    c, s, one, no = np.cos(angles), np.sin(angles), np.ones_like(angles), np.zeros_like(angles)
    about_x = [[one, no, no], [no, c, -s], [no, s, c]]
    about_y = [[c, no, s], [no, one, no], [-s, no, c]]
    about_z = [[c, -s, no], [s, c, no], [no, no, one]]
    return np.moveaxis(np.array([about_x, about_y, about_z][axis]), -1, 0)


def read_slowly(path: Path) -> SlowBvh:
    text = path.read_bytes().decode("utf-8", "surrogateescape").removeprefix("\ufeff")
    lines = [line.strip(" \t") for line in re.split(r"\r\n|\r|\n", text)]
    lines = [line for line in lines if line]
    start = next(i for i, line in enumerate(lines) if line.lower() == "motion")
    frame_time = float(lines[start + 2].split(":")[-1])
    numbers = [[float(word) for word in line.split()] for line in lines[start + 3 :]]
    assert len(numbers) == int(lines[start + 1].split(":")[-1])
    return SlowBvh(*_joints(lines[1:start]), frame_time, numbers)


def _joints(lines: list[str]) -> tuple[list[SlowJoint], list[tuple[int, list[float]]]]:
    joints: list[SlowJoint] = []
    tips: list[tuple[int, list[float]]] = []
    stack: list[int | str] = []
    coming: int | str = ""
    for line in lines:
        rest = line
        while rest:
            if found := re.match(r"(root|joint)\s+([^{]*)", rest, re.IGNORECASE):
                parent = stack[-1] if stack else -1
                assert isinstance(parent, int)
                joints.append(SlowJoint(found[2].strip(" \t"), parent))
                coming = len(joints) - 1
            elif found := re.match(r"end\s*site[^{]*", rest, re.IGNORECASE):
                coming = "tip"
            elif found := re.match(r"offset\s+(\S+)\s+(\S+)\s+([^\s}]+)", rest, re.IGNORECASE):
                offset = [float(found[i]) for i in (1, 2, 3)]
                if stack[-1] == "tip":
                    assert isinstance(stack[-2], int)
                    tips.append((stack[-2], offset))
                else:
                    assert isinstance(stack[-1], int)
                    joints[stack[-1]].offset = offset
            elif found := re.match(r"channels\s+\d((\s+\w+(position|rotation))*)", rest, re.IGNORECASE):
                assert isinstance(stack[-1], int)
                joints[stack[-1]].channels = found[1].split()
            elif found := re.match(r"{", rest):
                stack.append(coming)
            else:
                found = re.match(r"}", rest)
                assert found, line
                stack.pop()
            rest = rest[found.end() :].strip(" \t")
    return joints, tips
