"""Generators by name: the built-in ones, and those that other packages bring.

A package adds a generator with an entry point in the group `motiongen.generators`, whose object is a `GeneratorSpec`.
The module that holds the spec should import nothing heavy: listing loads it. The generator itself is imported when it
is created.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from motiongen.errors import MotionGenError, nearest_of
from motiongen.generators.base import Capabilities, Generator
from motiongen.generators.options import Options

ENTRY_POINT_GROUP = "motiongen.generators"


@dataclass(frozen=True)
class GeneratorSpec:
    """What the registry knows of a generator without importing it.

    Attributes:
        name: what it is called on the command line.
        description: one line.
        options: "module:class" of its `Options` dataclass.
        factory: "module:callable" that takes the options and returns a `Generator`.
        error: why it cannot be loaded; None for one that can.
    """

    name: str
    description: str
    options: str
    factory: str
    error: str | None = None

    def options_type(self) -> type[Options]:
        """The options dataclass."""
        kind: type[Options] = self._resolve(self.options)
        return kind

    def generator_type(self) -> Any:
        """The factory; for most generators their class, which knows its capabilities."""
        return self._resolve(self.factory)

    @property
    def capabilities(self) -> Capabilities:
        """What it can do; nothing in particular where its factory does not say."""
        found: Capabilities = getattr(self.generator_type(), "capabilities", None) or Capabilities()
        return found

    def create(self, options: Options) -> Generator:
        """A new generator with `options`."""
        generator: Generator = self.generator_type()(options)
        return generator

    def _resolve(self, target: str) -> Any:
        if self.error is not None:
            raise MotionGenError(f"generator '{self.name}' cannot be loaded: {self.error}")
        module, _, attribute = target.partition(":")
        try:
            return getattr(importlib.import_module(module), attribute)
        except (ImportError, AttributeError) as error:
            raise MotionGenError(f"generator '{self.name}' cannot be loaded: {error}") from error


BUILT_IN = (
    GeneratorSpec(
        name="genmm",
        description="Generative motion matching: new motion from one or a few clips of any skeleton, without training.",
        options="motiongen.generators.genmm.options:GenMMOptions",
        factory="motiongen.generators.genmm.generator:GenMM",
    ),
    GeneratorSpec(
        name="modi",
        description="MoDi: motions like those of a whole data set, from a trained network with a latent space.",
        options="motiongen.generators.modi.options:ModiOptions",
        factory="motiongen.generators.modi.generator:MoDi",
    ),
)


def specs() -> Mapping[str, GeneratorSpec]:
    """Every known generator by name, built-in ones first. One that cannot be loaded carries its error."""
    found = {spec.name: spec for spec in BUILT_IN}
    for entry in sorted(entry_points(group=ENTRY_POINT_GROUP), key=lambda e: e.name):
        spec = _load(entry)
        if spec.name in found:
            spec = _broken(f"{spec.name} ({entry.value})", f"the name '{spec.name}' is taken; rename it")
        found[spec.name] = spec
    return found


def _load(entry: Any) -> GeneratorSpec:
    try:
        spec = entry.load()
    except Exception as error:  # whatever a plug-in does wrong must not take the others down
        return _broken(entry.name, f"{type(error).__name__}: {error}".splitlines()[0])
    if not isinstance(spec, GeneratorSpec):
        return _broken(entry.name, f"'{entry.value}' is no GeneratorSpec but a {type(spec).__name__}")
    return spec


def _broken(name: str, error: str) -> GeneratorSpec:
    return GeneratorSpec(name, "(broken)", "", "", error)


def spec_of(name: str) -> GeneratorSpec:
    """The spec of the generator called `name`.

    Raises:
        MotionGenError: if there is none; the message lists those there are.
    """
    known = specs()
    if name not in known:
        raise MotionGenError(
            f"there is no generator '{name}'{nearest_of(name, known) or ';'} the generators are {', '.join(known)}"
        )
    return known[name]


def create(name: str, **options: Any) -> Generator:
    """A generator by its registry name, with its own options.

    Raises:
        MotionGenError: if the name or an option is unknown, an option is out of range, or the generator cannot load.
    """
    spec = spec_of(name)
    return spec.create(spec.options_type().build(options))
