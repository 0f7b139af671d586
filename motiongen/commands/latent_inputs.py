"""What a setting can name as a point of a latent space: a seed, a clip, a file of latents, or `mean`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import io
from motiongen.commands.settings import chosen_generator, whole
from motiongen.errors import MotionGenError

MEAN = "mean"


@dataclass(frozen=True)
class Point:
    """A point of a latent space.

    Attributes:
        code: (L, S) in W+.
        name: what to call its motion.
    """

    code: NDArray[np.float32]
    name: str


def latent_generator(settings: dict[str, Any]) -> Any:
    """The generator that the setting `generator` describes.

    Raises:
        MotionGenError: if it has no latent space, or one of another kind than MoDi's.
    """
    spec, options = chosen_generator(settings)
    if not spec.capabilities.has_latent_space:
        raise MotionGenError(f"generator={spec.name} has no latent space; generator=modi does")
    generator = spec.create(spec.options_type().build(options))
    from motiongen.generators.modi.generator import MoDi

    if not isinstance(generator, MoDi):
        raise MotionGenError(
            f"generator={spec.name} has latent codes of its own kind, and this command moves the layers of MoDi's; "
            "take its latents, decode and invert from Python, or generator=modi"
        )
    return generator


def points(generator: Any, given: Any, name: str) -> list[Point]:
    """The points that a setting names.

    Args:
        generator: whose latent space it is.
        given: a seed, `mean`, the path of a clip or of a file of latents, or a list of these.
        name: of the setting, for messages.

    Raises:
        MotionGenError: if it names none, or a file cannot be read.
    """
    if given is None or given == []:
        raise MotionGenError(f"{name} is missing; give a seed, a clip, a file of latents, or {MEAN}")
    entries: Sequence[Any] = given if isinstance(given, list) else [given]
    return [point for entry in entries for point in _points(generator, entry, name)]


def _points(generator: Any, entry: Any, name: str) -> list[Point]:
    if isinstance(entry, int):
        code = generator.latents(1, whole(name, entry, 0))
        return [Point(generator.check_latents(code)[0], f"seed_{entry}")]
    if entry == MEAN:
        return [Point(generator.check_latents(generator.mean_latent()[None])[0], MEAN)]
    path = Path(str(entry)).expanduser()
    if path.suffix == ".safetensors":
        from motiongen.generators.modi.latents import load_latents

        kept = load_latents(path, generator)
        return [Point(code, each) for code, each in zip(generator.check_latents(kept.codes), kept.names)]
    if path.suffix.lower() not in io.formats():
        raise MotionGenError(
            f"{name}={entry} is no seed, clip, file of latents or {MEAN}; clips end in {', '.join(io.formats())}, "
            "latents in .safetensors"
        )
    clip = io.load(path)
    return [Point(generator.invert(clip), clip.name)]
