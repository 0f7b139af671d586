"""From the `constraints` of a composed configuration to constraints."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from motiongen import io
from motiongen.adapt import adapt
from motiongen.errors import MotionGenError, nearest_of
from motiongen.generators.constraints import (
    Constraint,
    Continuation,
    FixedJoints,
    InBetween,
    Keyframes,
    Loop,
    Parts,
    RootPath,
    Segment,
    Style,
)
from motiongen.motion import Motion


@dataclasses.dataclass(frozen=True)
class Material:
    """What settings refer to.

    Attributes:
        examples: the examples.
        frame_rate: of the result, in Hz.
        up: how clips are read that the settings name.
        unit: likewise.
    """

    examples: Sequence[Motion]
    frame_rate: float
    up: str | None = None
    unit: str | None = None

    def clip(self, path: Any) -> Motion:
        """The clip of a setting; null is the first example."""
        return self.examples[0] if path is None else io.load(str(path), up=self.up, unit=self.unit)

    def rigged(self, motion: Motion) -> tuple[Motion, tuple[str, ...] | None]:
        """A motion on the examples' skeleton, and the names of the joints that it knows; None: all."""
        skeleton = self.examples[0].skeleton
        if skeleton.same_tree(motion.skeleton):
            return motion, None
        adapted, joints = adapt(motion, skeleton)
        return adapted, tuple(skeleton.names[joint] for joint in joints)


def read_constraints(settings: Mapping[str, Mapping[str, Any]], material: Material) -> list[Constraint]:
    """The constraints that the settings describe.

    Args:
        settings: kind (as in `configs/constraint`) -> its settings.
        material: the clips that they refer to.

    Raises:
        MotionGenError: naming the constraint and the setting that is wrong.
    """
    made = []
    for kind, values in settings.items():
        if kind not in _READERS:
            raise MotionGenError(
                f"there is no constraint '{kind}'{nearest_of(kind, _READERS) or ';'} there are {', '.join(_READERS)}"
            )
        made.append(_READERS[kind](dict(values), material))
    return made


def _keyframes(values: dict[str, Any], material: Material) -> Constraint:
    clip = material.clip(values["clip"])
    motion, joints = material.rigged(clip)
    poses = _numbers("keyframes.poses", values["poses"], range(len(clip)))
    at_their_time = [round(pose / clip.frame_rate * material.frame_rate) for pose in poses]
    frames = _numbers("keyframes.frames", values["frames"], at_their_time)
    if len(frames) != len(poses):
        raise MotionGenError(f"keyframes.frames has {len(frames)} entries for {len(poses)} poses; give one for each")
    if len(set(frames)) != len(frames):
        raise MotionGenError("keyframes.frames names a frame twice; a frame can have one pose")
    held = None if joints is None else exactly(joints)
    return Keyframes({frame: motion[pose] for frame, pose in zip(frames, poses)}, held)


def _fixed_joints(values: dict[str, Any], material: Material) -> Constraint:
    motion, known = material.rigged(material.clip(values["clip"]))
    joints = tuple(str(pattern) for pattern in _list("fixed_joints.joints", values["joints"]))
    if not joints:
        raise MotionGenError("fixed_joints.joints is empty; name the joints that are given, such as ['*Leg*', Hips]")
    if known is not None:
        chosen = {motion.skeleton.names[j] for j in motion.skeleton.select(joints)}
        joints = exactly(tuple(name for name in known if name in chosen))
    return FixedJoints(motion, joints)


def _root_path(values: dict[str, Any], material: Material) -> Constraint:
    facing = values["facing_degrees"]
    points = _array("root_path.points", values["points"])
    return RootPath(points, None if facing is None else np.radians(_array("root_path.facing_degrees", facing)))


def _segment(values: dict[str, Any], material: Material) -> Constraint:
    return Segment(material.clip(values["clip"]), values["start"], values["stop"])


def _parts(values: dict[str, Any]) -> Constraint:
    joints, examples = (_mapping(f"parts.{name}", values[name] or {}) for name in ("joints", "examples"))
    for name, patterns in joints.items():
        _list(f"parts.joints.{name}", patterns)
    return Parts(joints, examples, values["preset"])


_READERS: dict[str, Callable[[dict[str, Any], Material], Constraint]] = {
    "keyframes": _keyframes,
    "loop": lambda values, material: Loop(**values),
    "fixed_joints": _fixed_joints,
    "root_path": _root_path,
    "segment": _segment,
    "continuation": lambda values, material: Continuation(material.clip(values["clip"])),
    "in_between": lambda values, material: InBetween(material.clip(values["before"]), material.clip(values["after"])),
    "style": lambda values, material: Style(material.clip(values["content"]), values["detail"]),
    "parts": lambda values, material: _parts(values),
}


def exactly(names: Sequence[str]) -> tuple[str, ...]:
    """Patterns that match these names and nothing else."""
    return tuple("".join(f"[{letter}]" if letter in "*?[" else letter for letter in name) for name in names)


def _numbers(name: str, value: Any, default: Sequence[int]) -> list[int]:
    numbers = list(default) if value is None else _list(name, value)
    if not all(isinstance(number, int) and not isinstance(number, bool) for number in numbers):
        raise MotionGenError(f"{name} must be a list of whole numbers, such as [0, 30, 90], not {value!r}")
    return numbers


def _mapping(name: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise MotionGenError(f"{name} must be names with what belongs to each, such as {{NAME: [...]}}, not {value!r}")
    return dict(value)


def _list(name: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise MotionGenError(f"{name} must be a list in brackets, not {value!r}")
    return value


def _array(name: str, value: Any) -> np.ndarray:
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise MotionGenError(f"{name} must be numbers in brackets, such as [[0, 0], [0, 300]], not {value!r}") from None
