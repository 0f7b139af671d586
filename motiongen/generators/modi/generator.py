"""MoDi as a `Generator`: motions from a trained checkpoint."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.assets import BUNDLED_MODEL
from motiongen.datasets import from_entities
from motiongen.errors import MotionGenError
from motiongen.generators.base import Capabilities, LatentGenerator, Progress, sample_seed
from motiongen.generators.constraints import Constraint
from motiongen.generators.devices import torch_device
from motiongen.generators.modi.checkpoint import Card, Tensors, load_model
from motiongen.generators.modi.hierarchy import build_hierarchy
from motiongen.generators.modi.networks import ModiGenerator
from motiongen.generators.modi.options import ModiOptions
from motiongen.ik import clean_feet
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton


class MoDi(LatentGenerator):
    """A generator of motions like those of the data set that its checkpoint was trained on, on that one's skeleton.

    It needs no examples; given to `fit`, they must have the checkpoint's skeleton. Motions longer than those in
    training come from a learned constant stretched in time, for the networks are convolutions.

    Its latent codes are arrays of float32: (N, S) in W, or (N, L, S) in W+, one code for each of the L layers of the
    synthesis network (appendix C.1).

    Attributes:
        card: what the checkpoint says of itself.
        network: mapping and synthesis.
        device: where it computes.
    """

    capabilities: ClassVar[Capabilities] = Capabilities(needs_training=True, has_latent_space=True)
    options: ModiOptions

    def __init__(self, options: ModiOptions) -> None:
        """Load the checkpoint.

        Raises:
            MotionGenError: if it cannot be read, or motions cannot be made from it.
        """
        super().__init__(options)
        folder = BUNDLED_MODEL if options.checkpoint is None else options.checkpoint
        self.card, weights = load_model(folder)
        if self.card.network.representation != "rotations":
            raise MotionGenError(
                f"{folder}: this network makes joint {self.card.network.representation}, of which no rig's "
                "motion can be made; take a checkpoint that was trained with network.representation=rotations"
            )
        try:
            self.network = build_network(self.card, weights)
        except RuntimeError as error:
            reason = str(error).splitlines()[-1].strip()
            raise MotionGenError(f"{folder}: the weights are not the model's ({reason})") from error
        self.device = torch_device(options.device)
        self.network.eval().requires_grad_(False).to(self.device)

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton that it was trained on."""
        return self.card.layout.skeleton

    @property
    def frame_rate(self) -> float:
        """That of the training data."""
        return self.card.frame_rate

    @property
    def credit(self) -> str:
        """That of the training data."""
        return self.card.credit

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

    # -- the latent space

    @property
    def latent_size(self) -> int:
        """S, the numbers in a code."""
        return self.card.network.latent_size

    @property
    def latent_layers(self) -> int:
        """L, how many codes make one in W+."""
        return self.network.synthesis.layers

    @torch.inference_mode()
    def latents(self, count: int, seed: int = 0) -> NDArray[np.float32]:
        """(count, S) random codes in W, truncated as the options say: those that `sample` decodes with that seed."""
        return np.stack([self._code(seed, index)[0].cpu().numpy() for index in range(count)])

    def mean_latent(self) -> NDArray[np.float32]:
        """(S,) the mean code, whose motion is the mean motion (section 4.2)."""
        mean: NDArray[np.float32] = self.network.mean_code.cpu().numpy()
        return mean.copy()

    def decode(self, latents: NDArray[Any], frames: int | None = None) -> list[Motion]:
        """The motions of codes.

        Args:
            latents: (N, S) in W, or (N, L, S) in W+.
            frames: length of each motion; `usual_frames` by default.

        Raises:
            MotionGenError: if the shape is another, or a number is not finite.
        """
        codes = self.check_latents(latents)
        length = self.usual_frames if frames is None else frames
        # One at a time, so that a motion cannot depend on its neighbours' rounding.
        return [self._decoded(code, length, f"latent_{index:04d}") for index, code in enumerate(codes)]

    def check_latents(self, latents: NDArray[Any]) -> NDArray[np.float32]:
        """(N, L, S) the codes in W+, whether they came in W or W+.

        Raises:
            MotionGenError: if the shape is neither, or a number is not finite.
        """
        codes = np.asarray(latents, dtype=np.float32)
        layers, size = self.latent_layers, self.latent_size
        if codes.ndim not in (2, 3) or codes.shape[1:] not in ((size,), (layers, size)):
            raise MotionGenError(f"latents must have the shape (N, {size}) or (N, {layers}, {size}), not {codes.shape}")
        if not np.isfinite(codes).all():
            raise MotionGenError("a latent holds numbers that are not finite; take codes of this checkpoint")
        return np.repeat(codes[:, None], layers, axis=1) if codes.ndim == 2 else codes

    def invert(self, motion: Motion, seed: int = 0, progress: Progress | None = None) -> NDArray[np.float32]:
        """(L, S) the code in W+ whose motion comes closest to `motion`; see `inversion` for more to choose and know.

        Raises:
            MotionGenError: if the motion has another skeleton or is shorter than a window of the network.
        """
        from motiongen.generators.modi.inversion import InversionOptions, invert

        options = InversionOptions(seed=seed, windows=1)
        codes: NDArray[np.float32] = invert(self, motion, options, progress).codes[0]
        return codes

    # -- samples

    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[Constraint, ...], progress: Progress
    ) -> list[Motion]:
        motions = []
        for index in range(count):
            motions.append(self._decoded(self._code(seed, index).cpu().numpy(), frames, f"sample_{index:04d}"))
            progress((index + 1) / count)
        return motions

    @torch.inference_mode()
    def _code(self, seed: int, index: int) -> torch.Tensor:
        """(1, S) code of motion `index` of a call with `seed`."""
        random = torch.Generator().manual_seed(sample_seed(seed, index))
        z = torch.randn(1, self.latent_size, generator=random).to(self.device)
        return self.network.codes(z, self.options.truncation)[:, 0]

    @torch.inference_mode()
    def _decoded(self, code: NDArray[np.float32], frames: int, name: str) -> Motion:
        """The motion of a code (1, S) or (L, S)."""
        codes = torch.from_numpy(code).to(self.device).expand(1, self.latent_layers, -1)
        made = self.network.synthesis(codes, frames)[0].cpu().numpy()
        return self.motion_of(made[:frames], name)

    def motion_of(self, made: NDArray[Any], name: str) -> Motion:
        """The motion of (T, E, 4) standardised entities, with its feet cleaned if the options say so."""
        entities = made * self.card.deviation + self.card.mean
        layout = self.card.layout
        motion = from_entities(entities, layout, self.frame_rate, self.card.unit, name)
        if not self.options.clean_feet or not layout.feet:
            return motion
        return clean_feet(motion, layout.feet, entities[:, layout.contacts, 0] > 0.5)


def build_network(card: Card, weights: Tensors) -> ModiGenerator:
    """The networks of a checkpoint, as `load_model` reads it.

    Raises:
        RuntimeError: if the weights are not those of such networks.
    """
    network = ModiGenerator(build_hierarchy(card.layout.skeleton, card.layout.feet, card.network), card.network)
    network.load_state_dict(weights)
    return network
