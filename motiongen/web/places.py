"""A place in a latent space, as the sliders of the page say it, and its code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.generators.base import LatentGenerator

if TYPE_CHECKING:
    from motiongen.generators.modi.directions import Direction

STARTS = ("a seed", "the clip", "the mean motion")


@dataclass(frozen=True)
class Place:
    """Where in the latent space a motion is.

    Attributes:
        start: one of `STARTS`.
        seed: of the start.
        end_seed: of the motion that it goes towards.
        share: how far it goes there, 0 to 1.
        detail_seed: of the motion that its detail is taken from.
        coarse_layers: how many layers keep their own code; all: no detail is taken.
        truncation: how far it is from the mean: 1 as far as it came, 0 the mean itself (section 4.2).
        strengths: name of a direction -> how far along it, in deviations (section 4.4).
    """

    start: str = STARTS[0]
    seed: int = 0
    end_seed: int = 1
    share: float = 0.0
    detail_seed: int = 2
    coarse_layers: int | None = None
    truncation: float = 1.0
    strengths: Mapping[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """What to call its motion."""
        words = {STARTS[0]: f"seed {self.seed}", STARTS[1]: "clip", STARTS[2]: "mean"}[self.start]
        if self.share > 0:
            words += f" → {self.end_seed} ({self.share:.0%})"
        moved = [f"{name} {strength:+.1f}" for name, strength in self.strengths.items() if strength]
        return ", ".join([words, *moved])


@dataclass(frozen=True)
class Space:
    """What a generator's latent space has besides codes.

    Attributes:
        layers: how many layers of a code can be taken from another one; 0 where codes have none.
        directions: those that can be gone along, by name.
    """

    layers: int = 0
    directions: Mapping[str, Direction] = field(default_factory=dict)


def space_of(generator: LatentGenerator) -> Space:
    """MoDi's layers, and the directions that came with its weights; of other generators only the codes are known."""
    from motiongen.generators.modi.directions import kept_directions, load_direction
    from motiongen.generators.modi.generator import MoDi

    if not isinstance(generator, MoDi):
        return Space()
    kept = kept_directions(generator)
    return Space(generator.latent_layers, {name: load_direction(path, generator) for name, path in kept.items()})


def code_of(
    generator: LatentGenerator, place: Place, inverted: NDArray[Any] | None, space: Space
) -> NDArray[np.float32]:
    """The code of a place: the way first, then the mix, the truncation and the directions.

    Args:
        generator: whose latent space it is.
        place: where.
        inverted: the code of the clip, or None where it is not known.
        space: what can be mixed and gone along.

    Returns:
        (L, S) in W+ for MoDi, else one of the generator's own codes.

    Raises:
        MotionGenError: if the clip's code is needed and not known.
    """
    from motiongen.generators.modi.directions import move
    from motiongen.generators.modi.latent import mix

    mean = _full(generator, generator.mean_latent())
    if place.start == STARTS[1] and inverted is None:
        raise MotionGenError("the clip's place in the latent space is not known; press 'Invert the clip' first")
    code = {STARTS[1]: inverted, STARTS[2]: mean}.get(place.start)
    if code is None:
        code = _random(generator, place.seed)
    if place.share > 0:
        code = (1 - place.share) * code + place.share * _random(generator, place.end_seed)
    if place.coarse_layers is not None and place.coarse_layers < space.layers:
        code = mix(code, _random(generator, place.detail_seed), place.coarse_layers)
    code = mean + place.truncation * (code - mean)
    for name, strength in place.strengths.items():
        if strength:
            code = move(code[None], space.directions[name], [strength])[0, 0]
    return np.asarray(code, dtype=np.float32)


def _random(generator: LatentGenerator, seed: int) -> NDArray[np.float32]:
    """The code of the motion that `sample` makes with this seed."""
    return _full(generator, generator.latents(1, seed)[0])


def _full(generator: LatentGenerator, code: NDArray[Any]) -> NDArray[np.float32]:
    """A code as all of its motion is made of: MoDi's in W+, (L, S)."""
    from motiongen.generators.modi.generator import MoDi

    return generator.check_latents(code[None])[0] if isinstance(generator, MoDi) else code
