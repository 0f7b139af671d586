"""Random BVH files: any tree, any channels in any order, any way of writing them down."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.strategies import generators, random_parents

Array = NDArray[np.float64]

CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")
NAMES = (
    "joint{}",
    "mixamorig:Bone_{}",
    "Bip01 L  Bone{}",
    "Gelenk\tä{}",
    "b}}{}",
    "End Site {}",
    "Offset{}",
    "latin\udce9{}",
)


@dataclass
class Style:
    """How a text is written down."""

    newline: str = "\n"
    indent: str = "\t"
    blank: str = " "
    brace: str = "\n"  # what stands before one
    case: Callable[[str], str] = str
    number: str = "%.6f"
    mark: str = ""  # of the byte order
    colon: str = ": "
    end: str = "\n"


PLAIN = Style()


@dataclass
class Joint:
    name: str
    parent: int
    offset: Sequence[float] = (0.0, 1.0, 0.0)
    channels: Sequence[str] = ("Zrotation", "Yrotation", "Xrotation")
    tips: list[tuple[int, str, Sequence[float]]] = field(default_factory=list)  # children before, name, offset


def bvh_text(joints: Sequence[Joint], numbers: Array, frame_time: str = "0.033333", style: Style = PLAIN) -> str:
    """The text of a file, with LF for line ends. `joints` come depth first, `numbers` are (T, columns)."""
    case, blank = style.case, style.blank

    def triple(values: Sequence[float]) -> str:
        return blank.join(style.number % value for value in values)

    def block(j: int, depth: int) -> str:
        tab, joint = style.indent * depth, joints[j]
        children = [k for k, other in enumerate(joints) if other.parent == j]
        parts = [
            f"{tab}{case('JOINT' if depth else 'ROOT')} {joint.name}{style.brace}{{",
            f"{tab}{case('OFFSET')}{blank}{triple(joint.offset)}",
            f"{tab}{case('CHANNELS')}{blank}{blank.join([str(len(joint.channels)), *map(case, joint.channels)])}",
        ]
        for n in range(len(children) + 1):
            for before, name, offset in joint.tips:
                if before == n:
                    title = f"{case('End Site')} {name}".rstrip(" ")
                    parts.append(f"{tab}{title}{style.brace}{{{blank}{case('OFFSET')} {triple(offset)} }}")
            if n < len(children):
                parts.append(block(children[n], depth + 1))
        return "\n".join([*parts, f"{tab}}}"])

    rows = [blank.join(style.number % value for value in row) for row in numbers]
    head = [case("HIERARCHY"), block(0, 0), case("MOTION")]
    motion = [f"{case('Frames')}{style.colon}{len(rows)}", f"{case('Frame Time')}{style.colon}{frame_time}"]
    return style.mark + "\n".join([*head, *motion, *rows]) + style.end


def write_text(path: Path, text: str, newline: str = "\n") -> Path:
    path.write_bytes(text.replace("\n", newline).encode("utf-8", "surrogateescape"))
    return path


def random_style(rng: np.random.Generator) -> Style:
    """Any mixture of ways of writing."""

    def choose(*options: Any) -> Any:
        return options[int(rng.integers(len(options)))]

    return Style(
        newline=choose("\n", "\r\n", "\r"),
        indent=choose("\t", "  ", ""),
        blank=choose(" ", "\t", "  "),
        brace=choose("\n", "\n\t", " ", "", "\n\n"),
        case=choose(str, str.upper, str.lower, str.swapcase),
        number=choose("%.6f", "%.9g", "%+.8f", "%.10e"),
        mark=choose("", "\ufeff"),
        colon=choose(": ", ":", " : ", ":\t"),
        end=choose("", "\n", "\n\n \t\n"),
    )


def random_joints(rng: np.random.Generator, count: int, scale: float, names: str) -> list[Joint]:
    """A random tree with end sites anywhere and any channels, at least one in all."""
    parents = random_parents(rng, count, depth_first=True)
    joints = []
    for j, parent in enumerate(parents):
        channels = rng.permutation(CHANNELS)[: int(rng.integers(0, 7))].tolist()
        if rng.uniform() < 0.4:
            channels = rng.permutation(CHANNELS[3:]).tolist()
        children = parents.count(j)
        tips = [
            (
                int(rng.integers(0, children + 1)),
                str(rng.choice(["", "tip of it"])),
                (scale * rng.normal(size=3) * rng.integers(0, 2)).tolist(),
            )
            for _ in range(int(rng.choice([0, 0, 1, 2])))
        ]
        joints.append(Joint(names.format(j), parent, (scale * rng.normal(size=3)).tolist(), channels, tips))
    if not any(joint.channels for joint in joints):
        joints[0].channels = list(CHANNELS)
    return joints


def random_numbers(rng: np.random.Generator, joints: Sequence[Joint], frames: int, scale: float) -> Array:
    """Values for all channels: angles of several turns, often at poles and half turns; positions that move or not."""
    columns = []
    for joint in joints:
        still = rng.uniform() < 0.5
        for channel in joint.channels:
            if channel in CHANNELS[:3]:
                values = scale * rng.normal(size=1 if still else frames)
            else:
                values = rng.uniform(-400, 400, size=frames)
                right = rng.uniform(size=frames) < 0.25
                values[right] = 90 * np.round(values[right] / 90)
            columns.append(np.broadcast_to(values, frames))
    return np.stack(columns, axis=1)


@st.composite
def bvh_files(draw: Callable[..., Any]) -> tuple[str, str]:
    """Texts of random files, with LF for line ends, and the line end to write them with."""
    rng = draw(generators())
    scale = draw(st.sampled_from([1.0, 0.01, 40.0]))
    joints = random_joints(rng, draw(st.integers(1, 9)), scale, draw(st.sampled_from(NAMES)))
    numbers = random_numbers(rng, joints, draw(st.integers(1, 6)), scale)
    time = draw(st.sampled_from(["0.0333", "0.016667", ".0083333", "0.0333667", "1", "0.0417", "0.0123456789"]))
    style = random_style(rng) if draw(st.booleans()) else PLAIN
    return bvh_text(joints, numbers, time, style), style.newline


def walker(**changes: Any) -> str:
    """The text of a small correct file: a root with positions, two legs and a head, three frames."""
    joints = [
        Joint("Hips", -1, (0.0, 1.0, 0.0), CHANNELS),
        Joint("LeftFoot", 0, (0.1, -1.0, 0.0), tips=[(0, "", (0.0, 0.0, 0.2))]),
        Joint("RightFoot", 0, (-0.1, -1.0, 0.0), tips=[(0, "", (0.0, 0.0, 0.2))]),
        Joint("Head", 0, (0.0, 0.7, 0.0)),
    ]
    numbers = np.arange(3)[:, None] * np.linspace(0.5, 2.0, 15)
    return bvh_text(joints, numbers, **changes)
