"""MoDi as a `Generator`: motions from a trained checkpoint."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch

from motiongen.datasets import from_entities
from motiongen.errors import MotionGenError
from motiongen.generators.base import Capabilities, Generator, Progress, sample_seed
from motiongen.generators.constraints import Constraint
from motiongen.generators.devices import torch_device
from motiongen.generators.modi.checkpoint import load_model
from motiongen.generators.modi.hierarchy import build_hierarchy
from motiongen.generators.modi.networks import ModiGenerator
from motiongen.generators.modi.options import ModiOptions
from motiongen.ik import clean_feet
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton


class MoDi(Generator):
    """A generator of motions like those of the data set that its checkpoint was trained on, on that one's skeleton.

    It needs no examples; given to `fit`, they must have the checkpoint's skeleton. Motions longer than those in
    training come from a learned constant stretched in time, for the networks are convolutions.
    """

    capabilities: ClassVar[Capabilities] = Capabilities(needs_training=True)
    options: ModiOptions

    def __init__(self, options: ModiOptions) -> None:
        """Load the checkpoint.

        Raises:
            MotionGenError: if none is named, it cannot be read, or motions cannot be made from it.
        """
        super().__init__(options)
        if options.checkpoint is None:
            raise MotionGenError(
                "modi makes motions from a trained checkpoint; name one with checkpoint=FOLDER, or train one with "
                "python -m train generator=modi data=FOLDER"
            )
        self.card, weights = load_model(options.checkpoint)
        if self.card.network.representation != "rotations":
            raise MotionGenError(
                f"{options.checkpoint}: this network makes joint {self.card.network.representation}, of which no rig's "
                "motion can be made; take a checkpoint that was trained with network.representation=rotations"
            )
        hierarchy = build_hierarchy(self.card.layout.skeleton, self.card.layout.feet, self.card.network)
        self._network = ModiGenerator(hierarchy, self.card.network)
        try:
            self._network.load_state_dict(weights)
        except RuntimeError as error:
            reason = str(error).splitlines()[-1].strip()
            raise MotionGenError(f"{options.checkpoint}: the weights are not the model's ({reason})") from error
        self.device = torch_device(options.device)
        self._network.eval().to(self.device)

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton that it was trained on."""
        return self.card.layout.skeleton

    @property
    def frame_rate(self) -> float:
        """That of the training data."""
        return self.card.frame_rate

    @property
    def usual_frames(self) -> int:
        """As many as a motion had in training."""
        return self.card.network.frames

    def _fit(self, motions: tuple[Motion, ...]) -> None:
        motion = motions[0]
        if found := self.skeleton.difference(motion.skeleton, ignoring=motion.translating):
            raise MotionGenError(
                f"'{motion.name}' has another skeleton than the checkpoint: {found}; modi makes motions on the "
                "skeleton that it was trained on only"
            )

    @torch.inference_mode()
    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[Constraint, ...], progress: Progress
    ) -> list[Motion]:
        motions = []
        for index in range(count):
            # One at a time, so that a motion cannot depend on its neighbours' rounding.
            random = torch.Generator().manual_seed(sample_seed(seed, index))
            z = torch.randn(1, self.card.network.latent_size, generator=random).to(self.device)
            codes = self._network.codes(z, self.options.truncation)
            made = self._network.synthesis(codes, frames)[0].cpu().numpy()
            motions.append(self._motion(made[:frames], f"sample_{index:04d}"))
            progress((index + 1) / count)
        return motions

    def _motion(self, made: np.ndarray, name: str) -> Motion:
        """The motion of (T, E, 4) standardised entities."""
        entities = made * self.card.deviation + self.card.mean
        layout = self.card.layout
        motion = from_entities(entities, layout, self.frame_rate, self.card.unit, name)
        if not self.options.clean_feet or not layout.feet:
            return motion
        return clean_feet(motion, layout.feet, entities[:, layout.contacts, 0] > 0.5)
