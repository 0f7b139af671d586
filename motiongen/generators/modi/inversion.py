"""Motions to latent codes by gradient descent (section 4.3, Eq. 9; W and W+, appendix C.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from motiongen.errors import MotionGenError
from motiongen.generators.base import Progress
from motiongen.generators.modi.alignment import Floats, bring, motions_of, standardised
from motiongen.generators.modi.body import Body
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.likeness import MotionError, Seen, distances, errors, seen
from motiongen.generators.options import Options, option
from motiongen.motion import Motion

BATCH = 32
"""Motions that are descended at once, at most: more take memory and are no faster."""

LEAST_GAIN = 1e-3
"""A loss that falls by less than this share of itself stands still."""

RISE, FALL = 0.05, 0.75
"""Shares of the steps in which the learning rate rises at first and falls to zero at last."""


@dataclass(frozen=True)
class InversionOptions(Options):
    """How a clip's code is sought."""

    space: str = option(
        "W+", "Where codes are sought: W, one for all layers, or W+, one for each (appendix C.1).", choices=("W", "W+")
    )
    steps: int = option(150, "Steps of gradient descent.", minimum=1)
    starts: int = option(2, "Codes that a window's search starts from, side by side; the best one is kept.", minimum=1)
    candidates: int = option(64, "Random codes of which a window starts from the nearest.", minimum=1)
    learning_rate: float = option(0.2, "Of Adam, in deviations of the codes.", above=0.0)
    fk_weight: float = option(3.0, "Of joint positions, beside rotations (Eq. 9).", minimum=0.0)
    contact_weight: float = option(0.1, "Of contact labels, beside rotations.", minimum=0.0)
    mean_weight: float = option(
        0.01, "Of the code's distance from the mean code; it keeps codes where edits make sense.", minimum=0.0
    )
    patience: int = option(30, "Steps without a gain after which the search ends early.", minimum=1)
    windows: int | None = option(None, "At most so many windows of the clip, from its start; null: all.", minimum=1)
    seed: int = option(0, "Decides the random codes.", minimum=0)

    def __post_init__(self) -> None:
        """Check what depends on each other."""
        super().__post_init__()
        if self.starts > self.candidates:
            raise MotionGenError(f"starts must be at most candidates={self.candidates}, not {self.starts}")


@dataclass(frozen=True, eq=False)
class Inversion:
    """The codes of a clip, window by window.

    Attributes:
        codes: (N, L, S) in W+; from W, one repeated for all layers.
        motions: (N,) what the codes decode to.
        targets: (N,) the windows that they stand for, as the network sees them: on its skeleton, facing +z.
        errors: (N,) of what the network makes, before feet are cleaned.
        report: what was done to the clip, and how the codes were found.
    """

    codes: Floats
    motions: tuple[Motion, ...]
    targets: tuple[Motion, ...]
    errors: tuple[MotionError, ...]
    report: tuple[str, ...]

    def shortened(self, frames: int) -> Inversion:
        """The same with motions of at most so many frames."""
        return replace(self, motions=tuple(motion[:frames] for motion in self.motions))

    def to_dict(self) -> dict[str, Any]:
        """Errors and report, as JSON can hold them."""
        windows = [{"name": motion.name, **asdict(error)} for motion, error in zip(self.motions, self.errors)]
        return {"windows": windows, "report": list(self.report)}


def invert(
    generator: MoDi,
    motion: Motion,
    options: InversionOptions | None = None,
    progress: Progress | None = None,
    guess: NDArray[Any] | None = None,
) -> Inversion:
    """The codes whose motions come closest to a clip.

    The clip is brought to the checkpoint's skeleton and rate and cut into windows, each turned to face +z; `report`
    says so. The same seed gives the same codes on the same device.

    Args:
        generator: whose codes to find.
        motion: a clip on the checkpoint's skeleton, at least one window long.
        options: how to search.
        progress: called with the share done.
        guess: (N, S) or (N, L, S) codes to start from, one for each window, in place of random ones.

    Raises:
        MotionGenError: if the clip has another skeleton or is too short, or the guess does not fit.
    """
    options = InversionOptions() if options is None else options
    cut = bring(generator.card, motion).cut(options.windows)
    codes, steps = descend(generator, cut.windows, options, progress, guess)
    source = "the guess" if guess is not None else f"{options.starts} of {options.candidates} random codes"
    how = f"up to {steps} steps in {options.space} from {source}"
    return judged(generator, codes, cut.windows, cut.names, (*cut.report, how))


def judged(
    generator: MoDi, codes: Floats, windows: NDArray[np.floating], names: Sequence[str], report: Sequence[str]
) -> Inversion:
    """Codes (N, L, S) beside the windows (N, T, E, 4) of entities that they stand for, or the beginnings of these."""
    card, body = generator.card, body_of(generator)
    with torch.inference_mode():
        made = torch.cat([generator.network.synthesis(code) for code in on_device(generator, codes).split(1)])
        target = seen(body, on_device(generator, standardised(card, windows)))
        found = errors(card, seen(body, made[:, : windows.shape[1]]), target)
    motions = [generator.motion_of(each.cpu().numpy(), name) for each, name in zip(made, names)]
    return Inversion(codes, tuple(motions), motions_of(card, list(windows), names), found, tuple(report))


def descend(
    generator: MoDi,
    windows: NDArray[np.floating],
    options: InversionOptions,
    progress: Progress | None = None,
    guess: NDArray[Any] | None = None,
) -> tuple[Floats, int]:
    """(N, L, S) the codes of windows (N, T, E, 4) of entities, and the steps that the longest search took.

    All windows with all of their starts go down together, up to `BATCH` at a time.

    Raises:
        MotionGenError: if the guess does not fit.
    """
    target = seen(body_of(generator), on_device(generator, standardised(generator.card, windows)))
    starts = _starts(generator, target, options) if guess is None else _guessed(generator, len(windows), guess)
    if options.space == "W":
        starts = starts.mean(dim=2, keepdim=True)
    size = max(1, BATCH // starts.shape[1])
    found, steps, chunks = [], 0, range(0, len(windows), size)
    for number, first in enumerate(chunks):

        def advance(share: float, number: int = number) -> None:
            if progress is not None:
                progress((number + share) / len(chunks))

        some = slice(first, first + size)
        codes, taken = _descend(generator, target.rows(some), starts[some], options, advance)
        found.append(codes.expand(-1, generator.latent_layers, -1))
        steps = max(steps, taken)
    return torch.cat(found).cpu().numpy(), steps


def body_of(generator: MoDi) -> Body:
    """What the numbers of a generator's network mean."""
    card = generator.card
    return Body(card.layout, card.mean, card.deviation, card.frame_rate).to(generator.device)


def on_device(generator: MoDi, array: NDArray[np.floating]) -> Tensor:
    """An array as the generator's network takes it."""
    return torch.from_numpy(np.asarray(array, dtype=np.float32)).to(generator.device)


@torch.no_grad()
def deviation_of_codes(generator: MoDi) -> Tensor:
    """() how far random codes are from the mean code, root mean square over them and their numbers."""
    random = torch.Generator().manual_seed(0)
    z = torch.randn(1000, generator.latent_size, generator=random).to(generator.device)
    return (generator.network.mapping(z) - generator.network.mean_code).square().mean().sqrt()


@torch.no_grad()
def _starts(generator: MoDi, target: Seen, options: InversionOptions) -> Tensor:
    """(N, starts, L, S) the random codes whose motions are nearest to each target."""
    random, body = torch.Generator().manual_seed(options.seed), body_of(generator)
    z = torch.randn(options.candidates, generator.latent_size, generator=random).to(generator.device)
    codes = generator.network.codes(z)  # (candidates, L, S)
    parts = [seen(body, generator.network.synthesis(some)) for some in codes.split(BATCH)]
    made = Seen(*map(torch.cat, zip(*parts)))
    losses = torch.stack(
        [
            distances(made, target.rows(slice(window, window + 1))).weighted(options.fk_weight, options.contact_weight)
            for window in range(len(target.rotations))
        ]
    )  # (N, candidates)
    return codes[losses.argsort(dim=1, stable=True)[:, : options.starts]]


def _guessed(generator: MoDi, count: int, guess: NDArray[Any]) -> Tensor:
    """(N, 1, L, S) one start for each window."""
    codes = generator.check_latents(guess)
    if len(codes) != count:
        raise MotionGenError(f"{count} windows need as many guessed codes, not {len(codes)}")
    return on_device(generator, codes)[:, None]


def _descend(
    generator: MoDi, target: Seen, starts: Tensor, options: InversionOptions, progress: Progress
) -> tuple[Tensor, int]:
    """(n, 1 or L, S) the best codes of n targets from starts (n, starts, 1 or L, S), and the steps taken."""
    body, layers, scale = body_of(generator), generator.latent_layers, deviation_of_codes(generator)
    count, each = starts.shape[:2]
    targets = target.rows(torch.arange(count, device=starts.device).repeat_interleave(each))
    begun = starts.flatten(0, 1)  # (B, 1 or L, S)
    moved = torch.zeros_like(begun, requires_grad=True)  # in deviations of the codes
    optimiser = torch.optim.Adam([moved])
    best, best_losses = begun, torch.full((count * each,), math.inf, device=begun.device)
    waited = 0
    for step in range(options.steps + 1):
        codes = begun + scale * moved
        made = seen(body, generator.network.synthesis(codes.expand(-1, layers, -1)))
        away = (codes - generator.network.mean_code).square().flatten(1).mean(dim=1) / scale.square()
        losses = distances(made, targets).weighted(options.fk_weight, options.contact_weight)
        losses = losses + options.mean_weight * away
        with torch.no_grad():
            gained = losses < best_losses * (1 - LEAST_GAIN)
            better = losses < best_losses
            best = torch.where(better[:, None, None], codes, best)
            best_losses = torch.where(better, losses, best_losses)
        waited = 0 if bool(gained.any()) else waited + 1
        progress(step / options.steps)
        if step == options.steps or waited == options.patience:
            break
        optimiser.param_groups[0]["lr"] = options.learning_rate * _ramp(step / options.steps)
        optimiser.zero_grad()
        losses.sum().backward()
        optimiser.step()
    chosen = best_losses.view(count, each).argmin(dim=1) + each * torch.arange(count, device=begun.device)
    progress(1.0)
    return best[chosen].detach(), step


def _ramp(share: float) -> float:
    """The learning rate at a share of the steps: up at first, down a half cosine at last (Karras et al. 2020)."""
    up = min(1.0, (share + 0.01) / RISE)
    return up * (0.5 - 0.5 * math.cos(math.pi * min(1.0, (1 - share) / FALL)))
