"""Options of a generator: a frozen dataclass whose fields carry their own help and bounds.

Faces (command line, web page, Blender panel) build themselves from these fields, so a plug-in's options appear there
without further work.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping
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
) -> Any:
    """A dataclass field with a default, one line of help, and what it may be.

    Args:
        default: the value without a setting.
        help: one line on what the option does.
        minimum: the smallest number allowed.
        maximum: the largest number allowed.
        above: a number that the value must exceed.
        choices: the only words allowed.
    """
    bounds = {"minimum": minimum, "maximum": maximum, "above": above, "choices": choices}
    return dataclasses.field(default=default, metadata={"help": help, **bounds})


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
