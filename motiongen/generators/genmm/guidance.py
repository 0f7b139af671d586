"""What a synthesis is held to while it grows: fixed frames and columns, a circle in time, a first guess.

Everything is at the working rate and full length; `at` brings it to the length of a stage.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor


@dataclass(frozen=True)
class Hold:
    """Features that keep their values through all stages (section 5: key frames, completion).

    Attributes:
        times: (n,) ascending frames of the full-length synthesis.
        values: (n, C) their features.
        columns: (C,) which features; None: all.
    """

    times: Tensor
    values: Tensor
    columns: Tensor | None = None

    def at(self, length: int, full: int, circular: bool = False) -> tuple[Tensor, Tensor]:
        """The frames (m,) of a stage of `length` that are held, and their values (m, C).

        A stage frame that falls between two held neighbours takes their mixture, which keeps long holds smooth; a lone
        key goes to the stage frame nearest to it.
        """
        step = full / length if circular else (full - 1) / max(length - 1, 1)
        places = torch.arange(length, dtype=torch.float64) * step  # of the stage's frames, in full-length frames
        times = self.times.double().cpu()
        after = torch.searchsorted(times, places).clamp_max(len(times) - 1)
        before = (after - 1).clamp_min(0)
        gap = times[after] - times[before]
        to_after = (times[after] - places).abs() <= (times[before] - places).abs()
        weight = torch.where(gap == 1, (places - times[before]).clamp(0, 1), to_after.double())
        apart = (times[before] * (1 - weight) + times[after] * weight - places).abs()
        held = torch.nonzero(apart <= step / 2 + 1e-9)[:, 0]
        mix = weight[held, None].to(self.values)
        values = self.values[before[held]] * (1 - mix) + self.values[after[held]] * mix
        return held.to(values.device), values


@dataclass(frozen=True)
class Guidance:
    """All that a synthesis is held to.

    Attributes:
        holds: features with fixed values.
        circular: the end leads into the beginning: patches run over it, and there is no first or last frame.
        guess: (F, D) weighted features to begin with in place of noise.
        detail: scale at which to begin with `guess`: coarser movement is taken from it, finer from the examples.
        noise: share of the usual noise that is added to `guess`.
    """

    holds: tuple[Hold, ...] = field(default_factory=tuple)
    circular: bool = False
    guess: Tensor | None = None
    detail: float = 0.0
    noise: float = 1.0

    def apply(self, frames: Tensor, full: int) -> Tensor:
        """(B, F, D) with all holds put in."""
        for hold in self.holds:
            places, values = hold.at(frames.shape[1], full, self.circular)
            frames = frames.clone()
            if hold.columns is None:
                frames[:, places] = values.to(frames)
            else:
                frames[:, places[:, None], hold.columns] = values.to(frames)
        return frames


FREE = Guidance()
"""No guidance at all."""
