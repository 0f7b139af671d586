"""What `motiongen worker` reads and writes, as values of JSON; `docs/protocol.md` is its manual.

Every size is checked before anything is made of what came, and nothing that comes is the name of a file.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen.commands.constraint_settings import Material
from motiongen.commands.settings import whole
from motiongen.errors import MotionGenError, nearest_of
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

PROTOCOL = 1
"""Grows when a client of an older one would no longer be understood."""

LIMITS = {
    "line_bytes": 256 * 2**20,
    "joints": 1000,
    "frames": 200_000,
    "motions": 100,
    "waiting": 32,
}
"""Bytes of a request; joints of a motion; frames of a motion, and of all that a request makes; motions in a request,
and made by one; requests that wait."""

REQUESTS: dict[str, dict[str, Any]] = {
    "generators": {},
    "cancel": {"target": ...},
    "sample": {
        "generator": "genmm",
        "options": {},
        "examples": [],
        "clips": {},
        "frames": None,
        "count": 1,
        "seed": 0,
        "constraints": {},
    },
}
"""Type of a request -> its fields besides `id` and `type`, with what they are where they do not come; ...: needed."""

CONSTRAINT_SETTINGS: dict[str, dict[str, Any]] = {
    "keyframes": {"clip": None, "poses": None, "frames": None},
    "loop": {"in_place": None},
    "fixed_joints": {"clip": None, "joints": []},
    "root_path": {"points": ..., "facing_degrees": None},
    "segment": {"clip": None, "start": ..., "stop": ...},
    "continuation": {"clip": None},
    "in_between": {"before": ..., "after": ...},
    "style": {"content": ..., "detail": 0.25},
    "parts": {"joints": None, "preset": "auto", "examples": None},
}
"""Likewise of the constraints, as in `configs/constraint`."""

_MOTION_FIELDS: dict[str, Any] = {
    "names": ...,
    "parents": ...,
    "offsets": ...,
    "end_sites": [],
    "end_site_offsets": None,
    "rotations": ...,
    "translating": [],
    "translations": None,
    "frame_rate": ...,
    "unit": None,
    "name": "motion",
    "notes": [],
}

_DTYPES: dict[str, np.dtype[Any]] = {"<f4": np.dtype("<f4"), "<f8": np.dtype("<f8")}


# -- lines


def parse_line(line: bytes) -> dict[str, Any]:
    """The object of a line.

    Raises:
        MotionGenError: if the line is no JSON object, or holds a number that is not finite.
    """
    try:
        parsed = json.loads(line, parse_constant=_refuse_constant)
    except MotionGenError:
        raise
    except (ValueError, RecursionError) as error:
        raise MotionGenError(f"a request must be one line of JSON, but this is none: {error}") from None
    if not isinstance(parsed, dict):
        raise MotionGenError(f"a request must be a JSON object in braces, not {type(parsed).__name__}")
    return parsed


def _refuse_constant(word: str) -> NoReturn:
    raise MotionGenError(f"a request holds {word}; send finite numbers")


def filled(what: str, given: Any, fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an object, with what they are where they do not come.

    Raises:
        MotionGenError: if it is no object, one that is needed is missing, or there is no such field.
    """
    if not isinstance(given, dict):
        raise MotionGenError(f"{what} must be a JSON object, not {_short(given)}")
    for name in given:
        if name not in fields:
            raise MotionGenError(
                f"{what} has no field '{_short(name)}'{nearest_of(name, fields) or ';'} its fields are "
                f"{', '.join(fields) or 'none'}"
            )
    values = {**fields, **given}
    for name, value in values.items():
        if value is ...:
            raise MotionGenError(f"{what} needs the field '{name}'")
    return values


# -- arrays and motions


def encode_array(values: ArrayLike) -> dict[str, Any]:
    """An array as JSON, to the last bit."""
    array = np.ascontiguousarray(values, dtype="<f8")
    return {"dtype": "<f8", "shape": list(array.shape), "data": base64.b64encode(array.tobytes()).decode("ascii")}


def decode_array(what: str, given: Any) -> NDArray[np.float64]:
    """The array of `encode_array`, or of nested lists of numbers.

    Raises:
        MotionGenError: if it is neither, or the number of bytes is not that of its shape.
    """
    if isinstance(given, list):
        try:
            return np.array(given, dtype=np.float64)
        except (TypeError, ValueError):
            raise MotionGenError(f"{what} must be numbers in brackets, all rows of one length") from None
    fields = filled(what, given, {"dtype": ..., "shape": ..., "data": ...})
    shape, dtype = fields["shape"], _DTYPES.get(fields["dtype"]) if isinstance(fields["dtype"], str) else None
    if dtype is None:
        raise MotionGenError(f"the dtype of {what} must be one of {', '.join(_DTYPES)}, not {_short(fields['dtype'])}")
    if not isinstance(shape, list) or not all(_is_whole(size) and size >= 0 for size in shape):
        raise MotionGenError(f"the shape of {what} must be whole numbers in brackets, not {_short(shape)}")
    if not isinstance(fields["data"], str):
        raise MotionGenError(f"the data of {what} must be text in base64, not {_short(fields['data'])}")
    try:
        data = base64.b64decode(fields["data"], validate=True)
    except (binascii.Error, ValueError) as error:
        raise MotionGenError(f"the data of {what} are not base64: {error}") from None
    if len(data) != math.prod(shape) * dtype.itemsize:
        raise MotionGenError(f"{what} of shape {shape} in {dtype.str} cannot have {len(data)} bytes")
    return np.frombuffer(data, dtype).reshape(shape).astype(np.float64)


def encode_motion(motion: Motion) -> dict[str, Any]:
    """A motion as JSON, to the last bit; its file layout and up axis do not travel."""
    skeleton = motion.skeleton
    return {
        "name": motion.name,
        "unit": motion.unit,
        "frame_rate": motion.frame_rate,
        "names": list(skeleton.names),
        "parents": list(skeleton.parents),
        "offsets": encode_array(skeleton.offsets),
        "end_sites": list(skeleton.end_sites),
        "end_site_offsets": encode_array(skeleton.end_site_offsets),
        "rotations": encode_array(motion.rotations),
        "translating": list(motion.translating),
        "translations": encode_array(motion.translations),
        "notes": list(motion.notes),
    }


def decode_motion(what: str, given: Any) -> Motion:
    """The motion of `encode_motion`.

    Raises:
        MotionGenError: if it is none, or too large.
    """
    fields = filled(what, given, _MOTION_FIELDS)
    names = _texts(f"names of {what}", fields["names"])
    if len(names) > LIMITS["joints"]:
        raise MotionGenError(f"{what} has {len(names)} joints; at most {LIMITS['joints']} are taken")
    end_sites = _wholes(f"end_sites of {what}", fields["end_sites"])
    skeleton = Skeleton(
        names=names,
        parents=_wholes(f"parents of {what}", fields["parents"]),
        offsets=decode_array(f"offsets of {what}", fields["offsets"]),
        end_sites=end_sites,
        end_site_offsets=decode_array(f"end_site_offsets of {what}", fields["end_site_offsets"] or []),
    )
    rotations = decode_array(f"rotations of {what}", fields["rotations"])
    if rotations.ndim and len(rotations) > LIMITS["frames"]:
        raise MotionGenError(f"{what} has {len(rotations)} frames; at most {LIMITS['frames']} are taken")
    rate, unit, name = fields["frame_rate"], fields["unit"], fields["name"]
    if not isinstance(rate, (int, float)) or isinstance(rate, bool):
        raise MotionGenError(f"the frame_rate of {what} must be a number of Hz, not {_short(rate)}")
    if not (unit is None or isinstance(unit, str)) or not isinstance(name, str):
        raise MotionGenError(f"the unit and the name of {what} must be text, not {_short([unit, name])}")
    return Motion(
        skeleton=skeleton,
        rotations=rotations,
        translations=decode_array(f"translations of {what}", fields["translations"] or []),
        translating=_wholes(f"translating of {what}", fields["translating"]),
        frame_rate=float(rate),
        unit=unit,
        name=name,
        notes=_texts(f"notes of {what}", fields["notes"]),
    )


# -- what constraints refer to


@dataclass(frozen=True)
class SentMotions(Material):
    """The motions that came with a request: settings name them where those of the command line name files.

    Attributes:
        clips: by the names that the client gave them.
    """

    clips: Mapping[str, Motion] | None = None

    def clip(self, path: Any) -> Motion:
        """The clip of that name; null is the first example.

        Raises:
            MotionGenError: if there is none.
        """
        known = self.clips or {}
        if path is None and self.examples:
            return self.examples[0]
        if not isinstance(path, str) or path not in known:
            raise MotionGenError(
                f"there is no clip {_short(path)}; the request's clips are {', '.join(known) or 'none'}"
            )
        return known[path]


def constraint_settings(given: Any) -> dict[str, dict[str, Any]]:
    """The settings of all constraints of a request, with those that did not come.

    Raises:
        MotionGenError: if there is no such constraint or setting, or one is missing.
    """
    kinds = filled("constraints", given, dict.fromkeys(CONSTRAINT_SETTINGS))
    return {kind: filled(f"constraint {kind}", kinds[kind], CONSTRAINT_SETTINGS[kind]) for kind in given}


def size_of_result(frames: Any, count: Any) -> tuple[int, int]:
    """Frames and count of what is to be made.

    Raises:
        MotionGenError: if one is no whole number, or that is too much.
    """
    frames, count = whole("frames", frames, 1), whole("count", count, 1)
    if count > LIMITS["motions"]:
        raise MotionGenError(f"count is {count}; at most {LIMITS['motions']} motions are made for one request")
    if frames * count > LIMITS["frames"]:
        raise MotionGenError(f"{count} x {frames} frames are asked for; at most {LIMITS['frames']} in all are made")
    return frames, count


def _texts(what: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise MotionGenError(f"{what} must be texts in brackets, not {_short(value)}")
    return tuple(value)


def _wholes(what: str, value: Any) -> tuple[int, ...]:
    if not isinstance(value, list) or not all(_is_whole(number) for number in value):
        raise MotionGenError(f"{what} must be whole numbers in brackets, not {_short(value)}")
    return tuple(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _short(value: Any) -> str:
    """What came, cut where it is long, for a message of one line."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
