"""Input fields for a generator's options, built from its options dataclass alone."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import viser

from motiongen.errors import MotionGenError
from motiongen.generators.options import Described, Options, offered

_LONGEST_HELP = 220


class OptionFields:
    """Fields for the options of one generator, in the container that is open when they are built."""

    def __init__(self, gui: viser.GuiApi, kind: type[Options]) -> None:
        """Build a field for each option that does not name a file."""
        self._kind = kind
        self._fields = {option.name: (option, _field(gui, option)) for option in offered(kind)}

    @property
    def fields(self) -> dict[str, Any]:
        """Name of an option -> its field."""
        return {name: field for name, (_, field) in self._fields.items()}

    def options(self) -> Options:
        """The options as the fields say.

        Raises:
            MotionGenError: if a field holds what its option cannot be.
        """
        return self._kind.build({name: _value(option, field.value) for name, (option, field) in self._fields.items()})

    def remove(self) -> None:
        """Take the fields away."""
        for _, field in self._fields.values():
            field.remove()


def put(field: Any, value: Any) -> None:
    """Set what a field shows; viser's types call its value read-only, but it is made to be set."""
    field.value = value


def spoken(name: str) -> str:
    """The name of an option as people write it: `patch_size` is "Patch size", `memory_mb` is "Memory (MB)"."""
    words = re.sub(r" mb$", " (MB)", name.replace("_", " ").strip())
    return words[:1].upper() + words[1:]


def _field(gui: viser.GuiApi, option: Described) -> Any:
    label, hint, default = spoken(option.name), _hint(option), option.default
    if option.choices is not None and "null" not in option.types:
        return gui.add_dropdown(label, option.choices, initial_value=default, hint=hint)
    if option.types == ("bool",):
        return gui.add_checkbox(label, default, hint=hint)
    if option.types in (("int",), ("float",)):
        number = int if option.types == ("int",) else float
        bounds = (None if bound is None else number(bound) for bound in (option.minimum, option.maximum))
        least, most = bounds
        # The step says how many decimals are shown: enough for any default that people write.
        return gui.add_number(
            label, number(default), min=least, max=most, step=1 if number is int else 0.001, hint=hint
        )
    return gui.add_text(label, _text(default), hint=hint)


def _hint(option: Described) -> str | None:
    """What the option does, cut at a word where it is long, and how to leave it open."""
    text = option.help or ""
    if len(text) > _LONGEST_HELP:
        text = text[:_LONGEST_HELP].rsplit(" ", 1)[0] + " ..."
    if "null" in option.types:
        text = f"{text} Empty: null.".strip()
    return text or None


def _text(value: Any) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value)


def _value(option: Described, given: Any) -> Any:
    """What a field holds, as a value of the option."""
    if given == _text(option.default):
        return option.default  # nobody touched it
    if not isinstance(given, str) or option.types == ("str",) or option.choices is not None:
        return given if given != "" or "null" not in option.types else None
    text = given.strip()
    if not text:
        if "null" in option.types:
            return None
        raise MotionGenError(f"{option.name} is empty; give {_words(option.types)}")
    if "str" in option.types:
        return text
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):  # the latter of brackets without end
        shown = " ".join(text[:60].split())
        raise MotionGenError(f"{option.name} must be {_words(option.types)}, not '{shown}'") from None
    return tuple(value) if isinstance(value, list) else value


def _words(types: Sequence[str]) -> str:
    names = {"int": "a whole number", "float": "a number", "null": "nothing", "tuple": "numbers in brackets"}
    return " or ".join(names.get(each, each) for each in types)
