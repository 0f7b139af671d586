"""Options of a generator: a frozen dataclass whose fields carry their own help and bounds.

Faces (command line, web page, Blender panel) build themselves from these fields, so a plug-in's options appear there
without further work.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from motiongen.errors import MotionGenError, nearest_of

T = TypeVar("T", bound="Options")


def option(
    default: Any,
    help: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    choices: tuple[str, ...] | None = None,
    file: bool = False,
) -> Any:
    """A dataclass field with a default, one line of help, and what it may be.

    Args:
        default: the value without a setting.
        help: one line on what the option does.
        minimum: the smallest number allowed.
        maximum: the largest number allowed.
        above: a number that the value must exceed.
        choices: the only words allowed.
        file: whether the value names a file or a folder; those who are served from afar may not set it.
    """
    bounds = {"minimum": minimum, "maximum": maximum, "above": above, "choices": choices}
    return dataclasses.field(default=default, metadata={"help": help, "file": file, **bounds})


@dataclass(frozen=True)
class Described:
    """An option as a face offers it.

    Attributes:
        name: of the field.
        types: what it may be: "bool", "int", "float", "str", "tuple", and "null" for None.
        default: its value without a setting.
        help: one line on what it does, or None; so are the following where the option does not say.
        minimum: the smallest number allowed.
        maximum: the largest number allowed.
        above: a number that the value must exceed.
        choices: the only words allowed.
    """

    name: str
    types: tuple[str, ...]
    default: Any
    help: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    choices: tuple[str, ...] | None = None


def offered(kind: type[Options]) -> list[Described]:
    """The options that a face offers to those it serves: all but names of files."""
    hints = typing.get_type_hints(kind)
    described = []
    for field in dataclasses.fields(kind):
        if field.metadata.get("file"):
            continue
        types = typing.get_args(hints[field.name]) or (hints[field.name],)
        words = tuple("null" if each is type(None) else each.__name__ for each in types)
        given = {key: field.metadata.get(key) for key in ("help", "minimum", "maximum", "above", "choices")}
        described.append(Described(field.name, words, field.default, **given))
    return described


def check_offered(kind: type[Options], names: Iterable[str]) -> None:
    """Raise MotionGenError if one of `names` is an option that names a file."""
    files = {field.name for field in dataclasses.fields(kind) if field.metadata.get("file")}
    for name in names:
        if name in files:
            raise MotionGenError(f"the option '{name}' names a file, and a client may name none; leave it out")


@dataclass(frozen=True)
class Options:
    """Base of every generator's options; checks types and bounds when built.

    Raises:
        MotionGenError: if a value has the wrong type or lies out of bounds.
    """

    def __post_init__(self) -> None:
        """Check each field against its type and bounds; whole numbers serve as floats."""
        hints = typing.get_type_hints(type(self))
        for field in dataclasses.fields(self):
            value = _converted(field.name, getattr(self, field.name), hints[field.name])
            _check_bounds(field, value)
            object.__setattr__(self, field.name, value)

    @classmethod
    def build(cls: type[T], values: Mapping[str, Any]) -> T:
        """Options from a mapping.

        Raises:
            MotionGenError: if a key is no option of this generator; the message names the nearest one.
        """
        names = [field.name for field in dataclasses.fields(cls)]
        if not isinstance(values, Mapping):
            raise MotionGenError(
                f"options must be names with values, not {values!r}; the options are {', '.join(names)}"
            )
        for key in values:
            if key not in names:
                raise MotionGenError(
                    f"unknown option '{key}'{nearest_of(key, names) or ';'} the options are {', '.join(names)}"
                )
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """The options as plain data."""
        return dataclasses.asdict(self)


def _converted(name: str, value: Any, hint: Any) -> Any:
    """`value` as the type that the field is annotated with."""
    allowed = typing.get_args(hint) or (hint,)
    if value is None and type(None) in allowed:
        return None
    for kind in allowed:
        if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool):
            if not math.isfinite(value):
                raise MotionGenError(f"{name} must be a finite number, not {value}")
            return float(value)
        if type(value) is kind:
            return value
    words = " or ".join("none" if kind is type(None) else kind.__name__ for kind in allowed)
    raise MotionGenError(f"{name} must be of type {words}, not {value!r}")


def _check_bounds(field: dataclasses.Field[Any], value: Any) -> None:
    bounds = field.metadata
    if value is None or not bounds:
        return
    if bounds["choices"] is not None and value not in bounds["choices"]:
        near = nearest_of(str(value), bounds["choices"])
        raise MotionGenError(f"{field.name} must be one of {', '.join(bounds['choices'])}, not '{value}'{near}")
    for word, broken in (
        ("at least", bounds["minimum"] is not None and value < bounds["minimum"]),
        ("at most", bounds["maximum"] is not None and value > bounds["maximum"]),
        ("more than", bounds["above"] is not None and value <= bounds["above"]),
    ):
        if broken:
            limit = bounds[{"at least": "minimum", "at most": "maximum", "more than": "above"}[word]]
            raise MotionGenError(f"{field.name} must be {word} {limit:g}, not {value:g}")
