"""The runs of a sweep: every combination of the values given, each under a name that a person can read."""

from __future__ import annotations

import glob
import itertools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydra.core.override_parser.types import Override, Quote, QuotedString

from motiongen import io
from motiongen.commands.inputs import is_pattern
from motiongen.errors import MotionGenError

LABEL_LENGTH = 80  # of one value in a folder's name; file systems take 255 bytes in all


@dataclass(frozen=True)
class Run:
    """One run of a sweep.

    Attributes:
        name: of its folder, such as `walk_01,seed=0`.
        clip: what `input` is, for messages.
        overrides: the settings, as `key=value`.
        values: of the same settings, by key.
    """

    name: str
    clip: str
    overrides: tuple[str, ...]
    values: Mapping[str, Any] = field(compare=False)


@dataclass(frozen=True)
class _Setting:
    """The values of one key: what to write after `key=`, what each is, and how it shows in a folder's name."""

    key: str
    texts: tuple[str, ...]
    values: tuple[Any, ...]
    swept: bool


def plan_runs(overrides: Sequence[Override]) -> list[Run]:
    """Every combination of values, the last setting varying fastest.

    A pattern such as `clips/*.bvh` as `input` stands for each clip that fits it. Only settings that vary show in names.

    Raises:
        MotionGenError: if no clip fits a pattern, or a setting varies over an interval.
    """
    settings = list({setting.key: setting for setting in map(_read, overrides)}.values())
    swept = [setting for setting in settings if setting.swept]
    labels = {setting.key: _labels(setting, swept) for setting in swept}
    runs = []
    for choice in itertools.product(*(range(len(setting.texts)) for setting in settings)):
        chosen = list(zip(settings, choice))
        runs.append(
            Run(
                name=",".join(labels[s.key][i] for s, i in chosen if s.swept) or "run",
                clip=next((str(s.values[i]) for s, i in chosen if s.key == "input"), "the bundled clip"),
                overrides=tuple(f"{s.key}={s.texts[i]}" for s, i in chosen),
                values={s.key: s.values[i] for s, i in chosen},
            )
        )
    return runs


def _read(override: Override) -> _Setting:
    key = override.get_key_element()
    if not override.is_sweep_override():
        found = [(override.get_value_element_as_str(), override.value())]
    elif override.is_discrete_sweep():
        found = list(zip(override.sweep_string_iterator(), map(_plain, override.sweep_iterator())))
    else:
        raise MotionGenError(f"cannot sweep over '{override.input_line}'; list the values, or write range(0,10)")
    swept = override.is_sweep_override()
    if key == "input" and any(is_pattern(value) for _, value in found):
        found = [entry for text, value in found for entry in _each_clip(text, value)]
        swept = True
    unique = dict(found)
    return _Setting(key, tuple(unique), tuple(unique.values()), swept)


def _plain(element: Any) -> Any:
    if isinstance(element, QuotedString):
        return element.text
    return [_plain(entry) for entry in element] if isinstance(element, list) else element


def _each_clip(text: str, value: Any) -> list[tuple[str, Any]]:
    if not is_pattern(value):
        return [(text, value)]
    fitting = sorted(glob.glob(os.path.expanduser(value), recursive=True))
    clips = [path for path in fitting if Path(path).suffix.lower() in io.formats() and os.path.isfile(path)]
    if not clips:
        raise MotionGenError(f"no clip fits input={value}; the formats are {', '.join(io.formats())}")
    return [(QuotedString(path, Quote.single).with_quotes(), path) for path in clips]


def _labels(setting: _Setting, swept: Sequence[_Setting]) -> list[str]:
    """What the values are called in folder names: clips by their names, others as `seed=0`; no two alike."""
    if setting.key == "input":
        return _distinct(setting.values, (_stem, _file_name, _whole_path))
    short = setting.key.rpartition(".")[2]
    if sum(other.key.rpartition(".")[2] == short for other in swept) > 1:
        short = setting.key
    return _distinct(setting.texts, (lambda text: f"{short}={text}",))


def _distinct(values: Sequence[Any], ways: Sequence[Callable[[Any], str]]) -> list[str]:
    """The first way to call the values that tells them apart, also where case does not count; else numbered."""
    labels: list[str] = []
    for way in ways:
        labels = [re.sub(r"[^\w.=+-]+", "_", way(value))[:LABEL_LENGTH].strip(".") or "_" for value in values]
        if len({label.casefold() for label in labels}) == len(labels):
            return labels
    return [f"{number}-{label}" for number, label in enumerate(labels)]


def _stem(given: Any) -> str:
    return "+".join(path.name if path.is_dir() else path.stem for path in _paths(given))


def _file_name(given: Any) -> str:
    return "+".join(path.name for path in _paths(given))


def _whole_path(given: Any) -> str:
    return "+".join(os.path.relpath(path) for path in _paths(given))


def _paths(given: Any) -> list[Path]:
    if given is None:
        return [Path("example")]
    return [Path(os.path.abspath(str(entry))) for entry in (given if isinstance(given, list) else [given])]
