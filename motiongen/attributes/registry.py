"""Attributes by name: those that come along, and those that a user defines."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, ModuleType

from motiongen.errors import MotionGenError, nearest_of
from motiongen.motion import Motion

Score = Callable[[Motion], float]

_BUILT_IN = "motiongen.attributes.scores"

_registered: dict[str, Attribute] = {}


@dataclass(frozen=True)
class Attribute:
    """Something that a motion has more or less of.

    Attributes:
        name: what it is called.
        summary: one line, with the unit.
        function: gives the score.
    """

    name: str
    summary: str
    function: Score

    def score(self, motion: Motion) -> float:
        """How much the motion has of it.

        Raises:
            MotionGenError: if the skeleton lacks a joint that it needs, the clip is too short, the function fails, or
                the score is no finite number.
        """
        try:
            value = float(self.function(motion))
        except MotionGenError:
            raise
        except Exception as error:  # of somebody's own function
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise MotionGenError(f"attribute '{self.name}' fails for '{motion.name}' ({reason})") from error
        if not math.isfinite(value):
            raise MotionGenError(f"attribute '{self.name}' gives {value} for '{motion.name}'; scores must be finite")
        return value


def attribute(name: str, summary: str) -> Callable[[Score], Score]:
    """A decorator that registers a function of a motion as an attribute, and leaves the function as it is.

    Args:
        name: what to call it; names of files are made from it.
        summary: one line, with the unit of the score.

    Raises:
        MotionGenError: if another function has the name, or it cannot be one.
    """
    if not name.isidentifier():
        raise MotionGenError(f"an attribute's name must be letters, digits and _, not '{name}'")

    def register(function: Score) -> Score:
        taken = attributes().get(name) if function.__module__ != _BUILT_IN else None
        if taken is not None and _origin(taken.function) != _origin(function):
            raise MotionGenError(f"there is an attribute '{name}' already ({taken.summary}); choose another name")
        _registered[name] = Attribute(name, summary, function)
        return function

    return register


def attributes() -> Mapping[str, Attribute]:
    """Every known attribute by name, those that come along first."""
    importlib.import_module(_BUILT_IN)  # registers them
    return MappingProxyType(_registered)


def attributes_for(motion: Motion) -> dict[str, Attribute]:
    """The attributes that motions like this one have: those that its skeleton has the joints for."""
    found = {}
    for name, each in attributes().items():
        try:
            each.score(motion)
        except MotionGenError:
            continue
        found[name] = each
    return found


def attribute_of(name: str) -> Attribute:
    """The attribute of a name, or of a function in a Python file that the user names as `path/to/file.py:function`.

    The file is run. A function in it that is no registered attribute becomes one under its own name.

    Raises:
        MotionGenError: if there is none.
    """
    path, colon, function = name.rpartition(":")
    if colon and path.endswith(".py"):
        return _from_file(Path(path).expanduser(), function)
    known = attributes()
    if name not in known:
        near = nearest_of(name, known) or ";"
        raise MotionGenError(
            f"there is no attribute '{name}'{near} there are {', '.join(known)}, and your own as "
            "path/to/file.py:function"
        )
    return known[name]


def _from_file(path: Path, name: str) -> Attribute:
    function = getattr(_run(path), name, None)
    if not inspect.isfunction(function):
        raise MotionGenError(f"{path}: there is no function '{name}' in it; define one of a motion that gives a number")
    for known in attributes().values():
        if known.function is function:
            return known
    summary = (inspect.getdoc(function) or f"{name} in {path.name}").splitlines()[0]
    attribute(name, summary)(function)
    return attributes()[name]


def _run(path: Path) -> ModuleType:
    """The user's file as a module."""
    if not path.is_file():
        raise MotionGenError(f"{path}: there is no such file; name one as path/to/file.py:function")
    name = f"motiongen_user_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise MotionGenError(f"{path}: this is no Python file; name one as path/to/file.py:function")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses and pickles of the file look for it
    try:
        spec.loader.exec_module(module)
    except MotionGenError:
        raise
    except Exception as error:  # whatever the user's own code raises
        raise MotionGenError(f"{path}: running it failed ({type(error).__name__}: {error}); mend the file") from error
    return module


def _origin(function: Score) -> tuple[str, str]:
    """Where a function was defined; a file that is run again defines the same ones."""
    return inspect.getfile(function), function.__qualname__
