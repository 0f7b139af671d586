"""The contract: what every generator promises, and the checks that all of them share."""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from motiongen.errors import MotionGenError
from motiongen.features import layout_of
from motiongen.generators.constraints import Constraint
from motiongen.generators.options import Options
from motiongen.motion import MOST_FRAMES, Motion
from motiongen.skeleton import Skeleton

if TYPE_CHECKING:
    import torch

Progress = Callable[[float], None]
"""Called with the share of the work that is done, 0 to 1."""


@dataclass(frozen=True)
class Capabilities:
    """What a generator can do.

    Attributes:
        constraints: the constraint types that it takes.
        needs_training: whether it works from a trained checkpoint, without examples; if not, `fit` is all it needs.
        has_latent_space: whether it is a `LatentGenerator`.
    """

    constraints: tuple[type[Constraint], ...] = ()
    needs_training: bool = False
    has_latent_space: bool = False


class Generator(abc.ABC):
    """Makes new motions like the examples, on the examples' skeleton.

    Subclasses implement `_fit` and `_sample`; the public methods check what comes in and what goes out.

    Promises, held by one test body over every registered generator:
        - `sample` returns `count` motions of exactly `frames` frames, on the examples' skeleton;
        - the same seed on the same device gives the same motions, bit for bit, and motion k of a call does not
          depend on how many others are made with it;
        - a constraint that is not in `capabilities` is refused before any work is done.
    """

    capabilities: ClassVar[Capabilities]

    def __init__(self, options: Options) -> None:
        """Take the options; build nothing yet."""
        self.options = options
        self._examples: tuple[Motion, ...] = ()

    @property
    def examples(self) -> tuple[Motion, ...]:
        """The clips given to `fit`.

        Raises:
            MotionGenError: if `fit` has not been called.
        """
        if not self._examples:
            raise MotionGenError("this generator has no examples yet; call fit([clip, ...]) first")
        return self._examples

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton of what `sample` returns: that of the examples, or one that the generator was trained on.

        Raises:
            MotionGenError: if it takes examples and has none yet.
        """
        return self.examples[0].skeleton

    @property
    @abc.abstractmethod
    def frame_rate(self) -> float:
        """Frame rate in Hz of what `sample` returns; known after `fit`, or from the start for a trained generator."""

    @property
    def credit(self) -> str:
        """Whom users of its motions must name, and what they may not do with them; empty where nothing is known."""
        return ""

    @property
    def usual_frames(self) -> int:
        """How many frames a motion has where nobody says: twice the examples' length, at this generator's rate."""
        return round(2 * sum(len(clip) * self.frame_rate / clip.frame_rate for clip in self.examples))

    def fit(self, motions: Sequence[Motion]) -> Generator:
        """Take the examples: clips of one skeleton. Returns self.

        Raises:
            MotionGenError: if there is none, their skeletons differ, or the generator cannot work with them.
        """
        layout_of(motions)  # refuses clips whose skeletons differ
        self._fit(tuple(motions))
        self._examples = tuple(motions)
        return self

    def sample(
        self,
        frames: int,
        count: int = 1,
        seed: int | torch.Generator = 0,
        constraints: Sequence[Constraint] = (),
        progress: Progress | None = None,
    ) -> list[Motion]:
        """Make `count` new motions of exactly `frames` frames.

        Args:
            frames: length of each motion, at this generator's `frame_rate`.
            count: how many motions.
            seed: a number, or a torch generator to draw one from.
            constraints: what the motions must keep to.
            progress: called with the share done.

        Raises:
            MotionGenError: if a number is out of range, or a constraint is not supported or does not fit.
        """
        skeleton = self.skeleton
        for name, value, least in (("frames", frames, 1), ("count", count, 1)):
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
                raise MotionGenError(f"{name} must be a whole number of at least {least}, not {value!r}")
        if frames > MOST_FRAMES:
            raise MotionGenError(f"{frames} frames are more than a motion can have, {MOST_FRAMES}; `stream` has no end")
        self.check_constraints(constraints)
        for constraint in constraints:
            constraint.check(skeleton, frames)
        number = seed_number(seed)
        motions = self._sample(int(frames), int(count), number, tuple(constraints), progress or (lambda share: None))
        lengths = [len(motion) for motion in motions]
        if lengths != [frames] * count:
            raise RuntimeError(f"{type(self).__name__} made motions of {lengths} frames, not {count} of {frames}")
        return motions

    @classmethod
    def check_constraints(cls, constraints: Sequence[Constraint]) -> None:
        """Raise MotionGenError unless this generator takes every one of `constraints`."""
        supported = cls.capabilities.constraints
        for constraint in constraints:
            if not isinstance(constraint, supported):
                names = ", ".join(kind.__name__ for kind in supported) or "none"
                raise MotionGenError(
                    f"{cls.__name__} does not take the constraint {type(constraint).__name__}; it takes {names}"
                )

    @abc.abstractmethod
    def _fit(self, motions: tuple[Motion, ...]) -> None:
        """Prepare for `motions`, which are of one skeleton."""

    @abc.abstractmethod
    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[Constraint, ...], progress: Progress
    ) -> list[Motion]:
        """Make the motions; everything has been checked."""


class LatentGenerator(Generator):
    """A generator whose motions are points of a latent space.

    Promises, besides those of all generators:
        - `sample` with a seed makes the motions of `latents` with that seed;
        - what `invert` and `mean_latent` return, `decode` takes.
    """

    @abc.abstractmethod
    def latents(self, count: int, seed: int = 0) -> np.ndarray:
        """(count, ...) random codes: those of the motions that `sample` makes with `seed`."""

    @abc.abstractmethod
    def mean_latent(self) -> np.ndarray:
        """The mean code, whose motion is the mean motion."""

    @abc.abstractmethod
    def decode(self, latents: np.ndarray, frames: int | None = None) -> list[Motion]:
        """The motions of codes (N, ...), of `frames` frames each; of `usual_frames` where nobody says."""

    @abc.abstractmethod
    def invert(self, motion: Motion, seed: int = 0, progress: Progress | None = None) -> np.ndarray:
        """The code whose motion comes closest to `motion`; `progress` is called with the share done."""


def seed_number(seed: int | torch.Generator) -> int:
    """`seed` itself, or a number drawn from a torch generator.

    Raises:
        MotionGenError: if it is neither, or negative.
    """
    if isinstance(seed, (int, np.integer)) and not isinstance(seed, bool):
        if seed < 0:
            raise MotionGenError(f"seed must not be negative, but is {seed}")
        return int(seed)
    import torch

    if isinstance(seed, torch.Generator):
        return int(torch.randint(2**62, (), generator=seed, device=seed.device).item())
    raise MotionGenError(f"seed must be a whole number or a torch.Generator, not {seed!r}")


def sample_seed(seed: int, index: int) -> int:
    """The seed of motion `index` of a call with `seed`: independent of how many motions the call makes."""
    state = np.random.SeedSequence(entropy=seed, spawn_key=(index,)).generate_state(2, np.uint32)
    return int(state[0]) << 31 ^ int(state[1])
