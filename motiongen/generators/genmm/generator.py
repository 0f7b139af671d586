"""GenMM as a `Generator`: motions in, motions out."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motiongen.errors import MotionGenError
from motiongen.features import FeatureLayout, from_features, layout_of, rotation_features, to_features
from motiongen.generators.base import Capabilities, Generator, Progress, sample_seed
from motiongen.generators.constraints import Constraint
from motiongen.generators.genmm.blending import blend
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import Pyramid
from motiongen.generators.genmm.synthesis import build_pyramid, synthesise
from motiongen.motion import Motion


class GenMM(Generator):
    """Generative motion matching: mines new motions from the patches of one or a few examples, without training.

    Patches are matched at the working rate (30 Hz by default). The result is blended from frames at the examples' own
    rate by the same choice of patches, so that a 60 Hz clip gives 60 Hz detail.
    """

    capabilities: ClassVar[Capabilities] = Capabilities()
    options: GenMMOptions

    def __init__(self, options: GenMMOptions) -> None:
        """Take the options; refuses a device that torch does not have."""
        super().__init__(options)
        self.device = _device(options.device)
        self._layout: FeatureLayout
        self._pyramid: Pyramid
        self._native: Tensor
        self._like: Motion
        self._stride: int

    @property
    def frame_rate(self) -> float:
        """The output rate where one is set, else the rate of the first example."""
        return self.options.output_rate or self.examples[0].frame_rate

    def _fit(self, motions: tuple[Motion, ...]) -> None:
        self._like = motions[0]
        self._stride = max(1, round(self._like.frame_rate / self.options.working_rate))
        self._layout = layout_of(motions, contacts=self.options.contacts)
        native = [self._example_features(motion) for motion in motions]
        working = [features[:: self._stride] for features in native]
        for motion, features in zip(motions, working):
            if len(features) < self.options.patch_size:
                raise MotionGenError(
                    f"'{motion.name}' has {len(features)} frames at {self._like.frame_rate / self._stride:g} Hz, fewer "
                    f"than a patch of {self.options.patch_size}; give a longer clip or a smaller patch_size"
                )
        # Native frames end to end, each example padded so that working frame j starts at native frame j * stride.
        padded = [np.pad(f, ((0, -len(f) % self._stride), (0, 0)), mode="edge") for f in native]
        self._native = torch.from_numpy(np.concatenate(padded)).to(self.device)
        weights = torch.from_numpy(self._feature_weights())
        examples = [(torch.from_numpy(f[:: self._stride]) * weights).to(self.device) for f in native]
        self._pyramid = build_pyramid(examples, self.options)

    def _example_features(self, motion: Motion) -> np.ndarray:
        if not math.isclose(motion.frame_rate, self._like.frame_rate, rel_tol=1e-6):
            motion = motion.resample(self._like.frame_rate)
        return to_features(motion, self._layout)

    def _feature_weights(self) -> np.ndarray:
        """(D,) what each feature is multiplied with for matching."""
        weights = np.ones(self._layout.size)
        weights[rotation_features(self._layout.root)] = self.options.root_rotation_weight
        # Steps are per native frame; the weight is meant for steps per working frame.
        weights[self._layout.root_steps] = self.options.root_motion_weight * self._stride
        weights[self._layout.root_height] = self.options.root_motion_weight
        return weights

    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[Constraint, ...], progress: Progress
    ) -> list[Motion]:
        native_frames = self._native_frames(frames)
        working_frames = max(self.options.patch_size, math.ceil((native_frames - 1) / self._stride) + 1)
        steps, total = 0, count * len(self._pyramid.stages)

        def advance() -> None:
            nonlocal steps
            steps += 1
            progress(steps / total)

        motions = []
        for index in range(count):
            # One at a time: on the CPU a batch is no faster, and a motion cannot depend on its neighbours' rounding.
            nearest = synthesise(self._pyramid, working_frames, [sample_seed(seed, index)], self.options, advance)
            features = blend(nearest, self._native, self.options.patch_size, self._stride, native_frames)[0]
            motions.append(self._motion(features, index, frames))
        return motions

    def _native_frames(self, frames: int) -> int:
        """Frames needed at the examples' rate for `frames` at the output rate."""
        ratio = self._like.frame_rate / self.frame_rate
        return math.ceil((frames - 1) * ratio - 1e-6) + 1

    def _motion(self, features: Tensor, index: int, frames: int) -> Motion:
        motion = from_features(features.cpu().numpy(), self._layout, self._like).replace(name=f"sample_{index:04d}")
        if not math.isclose(motion.frame_rate, self.frame_rate, rel_tol=1e-6):
            motion = motion.resample(self.frame_rate)[:frames]
        return motion


def _device(name: str) -> torch.device:
    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise MotionGenError(f"device '{name}' cannot be used: {reason}; use cpu") from error
    return device
