"""One step of MoDi's training after the other, and its state (section 3.4, appendix D.2)."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.generators.modi import losses
from motiongen.generators.modi.body import Body
from motiongen.generators.modi.checkpoint import Card, load_model, load_training, save_checkpoint
from motiongen.generators.modi.hierarchy import build_hierarchy
from motiongen.generators.modi.networks import Discriminator, ModiGenerator
from motiongen.generators.modi.options import NetworkOptions
from train.draws import numpy_random, torch_random
from train.memory import below, memory_of, remember
from train.settings import TrainerSettings
from train.sources import source_of
from train.workers import Workers

Figures = dict[str, Tensor]


class ModiTraining:
    """Generator, discriminator, the running mean of the generator, and their optimisers.

    What an iteration draws depends on the seed and its number alone, so that nothing but weights, optimisers, the mean
    path length and the number has to be kept for a run to go on as if it had never stopped.

    Attributes:
        iteration: steps done.
        mean_generator: the running mean of the generator's weights, which motions are to be made from.
    """

    def __init__(self, dataset: Dataset, network: NetworkOptions, settings: TrainerSettings, workers: Workers) -> None:
        """Draw the first weights.

        Raises:
            MotionGenError: if the settings do not fit together or the data.
        """
        workers.check(settings.batch, network.deviation_group)
        self.dataset, self.network, self.settings, self.workers = dataset, network, settings, workers
        hierarchy = build_hierarchy(dataset.skeleton, dataset.layout.feet, network)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            self.generator = ModiGenerator(hierarchy, network).to(workers.device)
            self.discriminator = Discriminator(hierarchy, network).to(workers.device)
        self.mean_generator = copy.deepcopy(self.generator).requires_grad_(False)
        self.source = source_of(dataset, network)
        self.body = Body(dataset.layout, *self.source.scale, dataset.frame_rate).to(workers.device)
        self.optimisers = {"generator": self._adam(self.generator), "discriminator": self._adam(self.discriminator)}
        self.mean_path_length = torch.zeros((), device=workers.device)
        self.iteration = 0

    def _adam(self, network: nn.Module) -> torch.optim.Optimizer:
        settings = self.settings
        return torch.optim.Adam(
            network.parameters(), lr=settings.learning_rate, betas=(0.0, settings.beta2), fused=True
        )

    # -- a step

    def step(self) -> Figures:
        """One iteration; what it found, as tensors that need not be waited for."""
        figures = self._discriminator_step()
        if self.iteration % self.settings.r1_every == 0 and self.settings.r1_weight:
            figures |= self._r1_step()
        figures |= self._generator_step()
        if self.iteration % self.settings.path_every == 0 and self.settings.path_weight:
            figures |= self._path_step()
        self._follow()
        self.iteration += 1
        return figures

    def _discriminator_step(self) -> Figures:
        with torch.no_grad(), self._precision():
            fake = self.generator.synthesis(self._codes("discriminator", self.settings.batch))
        with self._precision():
            fake_scores, real_scores = self.discriminator(fake), self.discriminator(self._real())
        loss = losses.discriminator_loss(real_scores.float(), fake_scores.float())
        gradient = self._descend("discriminator", loss)
        return {
            "loss/discriminator": loss.detach(),
            "score/real": real_scores.detach().float().mean(),
            "score/fake": fake_scores.detach().float().mean(),
            "gradient/discriminator": gradient,
        }

    def _r1_step(self) -> Figures:
        real = self._real().requires_grad_()
        penalty = losses.r1_penalty(self.discriminator(real), real)
        self._descend("discriminator", self.settings.r1_weight / 2 * self.settings.r1_every * penalty)
        return {"loss/r1": penalty.detach()}

    def _generator_step(self) -> Figures:
        with self._precision():
            fake = self.generator.synthesis(self._codes("generator", self.settings.batch))
            scores = self.discriminator(fake)
        fake = fake.float()
        adversarial = losses.generator_loss(scores.float())
        figures = {"loss/generator": adversarial.detach(), "spread/fake": fake.detach().std(dim=0).mean()}
        loss = adversarial
        if self.dataset.layout.feet:
            logits = self.body.contact_logits(fake)
            touch = losses.contact_encouragement(logits)
            velocities = self.source.foot_velocities(self.body, fake)
            consistency = losses.contact_consistency(velocities, logits)
            loss = loss + self.settings.contact_encouragement * touch + self.settings.contact_consistency * consistency
            figures |= {
                "loss/contact_encouragement": touch.detach(),
                "loss/contact_consistency": consistency.detach(),
                "contact/ratio": (logits.detach() > 0).float().mean(),
            }
        return figures | {"gradient/generator": self._descend("generator", loss)}

    def _path_step(self) -> Figures:
        codes = self._codes("path", self.settings.batch // 2)
        motions = self.generator.synthesis(codes)
        shape = (self.settings.batch // 2, *motions.shape[1:])
        noise = self._shared(torch.randn(shape, generator=self._random("path noise")))
        lengths = losses.path_lengths(motions, codes, noise)
        mean = lengths.detach().mean()
        self.workers.average([mean])
        self.mean_path_length.lerp_(mean, self.settings.path_memory)
        penalty = losses.path_length_penalty(lengths, self.mean_path_length)
        self._descend("generator", self.settings.path_weight * self.settings.path_every * penalty)
        return {"loss/path": penalty.detach(), "path/length": self.mean_path_length.clone()}

    def _descend(self, name: str, loss: Tensor) -> Tensor:
        """Take a step down the loss; the norm of the gradient."""
        optimiser = self.optimisers[name]
        parameters = [p for group in optimiser.param_groups for p in group["params"]]
        optimiser.zero_grad(set_to_none=True)
        loss.backward(inputs=parameters)
        gradients = [p.grad for p in parameters if p.grad is not None]
        self.workers.average(gradients)
        optimiser.step()
        return torch.stack(torch._foreach_norm(gradients)).norm()

    @torch.no_grad()
    def _follow(self) -> None:
        """Let the running mean follow the weights, by samples seen."""
        kept = 0.5 ** (self.settings.batch / self.settings.mean_half_life)
        means: list[Tensor] = list(self.mean_generator.parameters())
        now: list[Tensor] = list(self.generator.parameters())
        torch._foreach_lerp_(means, now, 1 - kept)

    # -- what a step draws

    def _random(self, purpose: str) -> torch.Generator:
        return torch_random(self.settings.seed, self.iteration, purpose)

    def _shared(self, whole: Tensor) -> Tensor:
        return self.workers.share(whole)

    def _real(self) -> Tensor:
        """(B, T, E, K) real motions, the same ones however often an iteration asks."""
        random = numpy_random(self.settings.seed, self.iteration, "data")
        windows = self.dataset.draw("training", self.settings.batch, random)
        size = len(windows) // self.workers.count
        own = windows[self.workers.rank * size : (self.workers.rank + 1) * size]
        return self.source.motions(own).to(self.workers.device, non_blocking=True)

    def _codes(self, purpose: str, batch: int) -> Tensor:
        """(B, N, latent size) codes of one or, for a share of the steps, two z each."""
        random = self._random(purpose)
        noises = [self._shared(torch.randn(batch, self.network.latent_size, generator=random)) for _ in range(2)]
        layers = self.generator.synthesis.layers
        mixes = layers > 1 and float(torch.rand((), generator=random)) < self.settings.mixing
        if not mixes:
            return self.generator.codes(noises[0])
        index = int(torch.randint(1, layers, (), generator=random))
        return self.generator.codes(noises, mixing_index=index)

    def _precision(self) -> AbstractContextManager[Any]:
        half = self.settings.precision == "bfloat16"
        return torch.autocast(self.workers.device.type, dtype=torch.bfloat16, enabled=half)

    # -- state

    def is_finite(self) -> bool:
        """Whether all weights are."""
        networks = (self.generator, self.discriminator, self.mean_generator)
        weights = [weight.detach() for network in networks for weight in network.parameters()]
        return bool(torch.stack(torch._foreach_norm(weights, math.inf)).isfinite().all())

    def card(self) -> Card:
        """What the networks are by now."""
        dataset, (mean, deviation) = self.dataset, self.source.scale
        return Card(
            network=self.network,
            layout=dataset.layout,
            mean=mean,
            deviation=deviation,
            frame_rate=dataset.frame_rate,
            unit=dataset.index.unit,
            data_fingerprint=dataset.fingerprint,
            iteration=self.iteration,
            samples=self.iteration * self.settings.batch,
        )

    def save(self, folder: Path, record: Mapping[str, Any]) -> None:
        """Write a checkpoint that `load` goes on from.

        Args:
            folder: where; nothing may be there.
            record: plain data to be kept with it.
        """
        self.mean_generator.measure_mean_code(torch.Generator().manual_seed(self.settings.seed))
        tensors = {"mean_path_length": self.mean_path_length}
        for name, network in self._networks().items():
            tensors |= {f"{name}.{key}": value for key, value in network.state_dict().items()}
        for name, optimiser in self.optimisers.items():
            tensors |= memory_of(optimiser, f"adam.{name}")
        state = {"iteration": self.iteration, "settings": self.settings.to_dict(), **record}
        save_checkpoint(folder, self.card(), self.mean_generator.state_dict(), (state, tensors))

    def load(self, folder: Path, own: bool = True) -> dict[str, Any]:
        """Go on from a checkpoint; returns the record that was kept with it.

        Args:
            folder: the checkpoint.
            own: whether it must be of this very training. Another one's needs only weights of the same shapes, so that
                it can go on with other settings or other data.

        Raises:
            MotionGenError: if it is another network's, of other data, or damaged.
        """
        card, mean_weights = load_model(folder)
        for what, theirs, ours in (
            ("network", card.network, self.network),
            ("data", card.data_fingerprint, self.dataset.fingerprint),
        ):
            if own and theirs != ours:
                raise MotionGenError(f"{folder}: was trained with another {what}; give the same, or another output")
        state, tensors = load_training(folder)
        try:
            self.mean_generator.load_state_dict(mean_weights)
            for name, network in self._networks().items():
                network.load_state_dict(below(tensors, f"{name}."))
            for name, optimiser in self.optimisers.items():
                remember(optimiser, tensors, f"adam.{name}")
            self.mean_path_length.copy_(tensors["mean_path_length"])
            self.iteration = int(state["iteration"])
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            reason = str(error).splitlines()[-1].strip()
            raise MotionGenError(f"{folder}: training cannot go on from it ({reason}); take another one") from error
        return state

    def _networks(self) -> dict[str, nn.Module]:
        return {"generator": self.generator, "discriminator": self.discriminator}
