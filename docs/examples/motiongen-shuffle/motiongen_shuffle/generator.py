"""Play a piece, jump to another whose beginning looks alike, ease out the difference, and so on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import motiongen as mg
from motiongen.features import from_features, layout_of, to_features
from motiongen.generators.base import Progress, sample_seed


@dataclass(frozen=True)
class ShuffleOptions(mg.Options):
    """Settings, help and bounds: the command line makes `generator.piece_seconds=1.5` and the like of these."""

    piece_seconds: float = mg.option(2.0, "Seconds that are played before a jump, at least.", above=0.0)
    choices: int = mg.option(8, "Of how many good moments one is drawn to jump to; 1 is always the best.", minimum=1)
    ease_seconds: float = mg.option(0.3, "Seconds in which the difference at a jump fades out.", minimum=0.0)


class Shuffle(mg.Generator):
    """Plays pieces of the examples, one after the other."""

    capabilities = mg.Capabilities()  # no constraints, no training, no latent space
    options: ShuffleOptions

    @property
    def frame_rate(self) -> float:
        """That of the first example."""
        return self.examples[0].frame_rate

    def _fit(self, motions: tuple[mg.Motion, ...]) -> None:
        rate = motions[0].frame_rate
        self._piece = max(2, round(self.options.piece_seconds * rate))
        self._layout = layout_of(motions)
        clips = [to_features(motion.resample(rate), self._layout) for motion in motions]
        for motion, clip in zip(motions, clips):
            if len(clip) <= self._piece:
                raise mg.MotionGenError(
                    f"'{motion.name}' has {len(clip)} frames, no more than a piece of {self._piece}; "
                    "give a longer clip or a smaller piece_seconds"
                )
        self._frames = np.concatenate(clips)  # (T, D), the examples end to end
        ends = np.cumsum([len(clip) for clip in clips])
        # A jump leads to a frame that has one before it, to compare, and a whole piece after it.
        spans = [np.arange(end - len(clip) + 1, end - self._piece + 1) for clip, end in zip(clips, ends)]
        self._entries = np.concatenate(spans)  # (N,)

    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[mg.Constraint, ...], progress: Progress
    ) -> list[mg.Motion]:
        motions = []
        for number in range(count):
            features = self._features(frames, np.random.default_rng(sample_seed(seed, number)))
            motion = from_features(features, self._layout, self.examples[0])
            motions.append(motion.replace(name=f"sample_{number:04d}"))
            progress((number + 1) / count)
        return motions

    def _features(self, frames: int, rng: np.random.Generator) -> np.ndarray:
        """(frames, D) pieces from random moments on, each eased into from the one before."""
        start = int(rng.choice(self._entries))
        made = self._frames[start : start + self._piece]
        while len(made) < frames:
            last = start + self._piece - 1
            start = self._jump(last, rng)
            piece = self._frames[start : start + self._piece]
            seam = made[-1] - self._frames[start - 1]  # what the old piece has that the new one would not have had
            made = np.concatenate([made, piece + self._fading(len(piece))[:, None] * seam])
        return made[:frames]

    def _jump(self, last: int, rng: np.random.Generator) -> int:
        """The first frame of the next piece: one of those whose frame before looks most like frame `last`."""
        away = self._entries[abs(self._entries - 1 - last) >= self._piece // 2]  # elsewhere, where there is elsewhere
        entries = away if len(away) else self._entries
        distances = np.linalg.norm(self._frames[entries - 1] - self._frames[last], axis=1)
        best = entries[np.argsort(distances, kind="stable")[: self.options.choices]]
        return int(rng.choice(best))

    def _fading(self, frames: int) -> np.ndarray:
        """(frames,) from nearly 1 to 0 within `ease_seconds`, level at both ends."""
        length = max(1.0, min(self.options.ease_seconds * self.frame_rate, frames))
        share = np.minimum(np.arange(1, frames + 1) / length, 1.0)
        return 0.5 * (1 + np.cos(np.pi * share))
