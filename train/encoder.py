"""Train an encoder for a checkpoint of MoDi: `python -m train.encoder checkpoint=FOLDER data=FOLDER output=FOLDER`."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import json
import math
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from motiongen.console import progress_bar
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.modi.alignment import standardised
from motiongen.generators.modi.composites import cut_off, noised, spliced, with_joints
from motiongen.generators.modi.encoder import FORMAT, WEIGHTS, Encoder, new_network, read_tensors, save_tensors
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import body_of, on_device
from motiongen.generators.modi.likeness import MotionError, distances, errors, mean_error, seen
from motiongen.generators.modi.model_files import fingerprint
from motiongen.generators.modi.options import ModiOptions
from motiongen.generators.options import Options, option
from train.application import run_training
from train.draws import numpy_random, torch_random
from train.loop import versions
from train.memory import below, memory_of, remember

TRAINING, RECORD = "training.safetensors", "encoder.json"

CORRUPTIONS = ("noise", "cut", "splice", "joints")

LEAST_KNOWN = 8
"""Frames, or as many as there are, that a cut or a splice leaves on either side."""

MEASURED = 200
"""Held-back windows that an encoder is measured by."""

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class EncoderSettings(Options):
    """How an encoder is trained."""

    iterations: int = option(20_000, "Steps of training; the learning rate falls to zero over them.", minimum=1)
    batch: int = option(16, "Real motions in a step, and as many made ones.", minimum=1)
    seed: int = option(0, "Decides the first weights and everything that is drawn.", minimum=0)
    learning_rate: float = option(0.002, "The highest of the run, of Adam.", above=0.0)
    fk_weight: float = option(3.0, "Of joint positions, beside rotations.", minimum=0.0)
    contact_weight: float = option(0.1, "Of contact labels, beside rotations.", minimum=0.0)
    code_weight: float = option(0.05, "Of codes of made motions, which are known, beside rotations.", minimum=0.0)
    mixing: float = option(0.5, "Share of the made motions whose codes are mixed of two.", minimum=0.0, maximum=1.0)
    corrupted: float = option(
        0.6, "Share of the real motions that come noisy, cut off, spliced or with joints of another.", minimum=0.0,
        maximum=1.0,
    )  # fmt: skip
    noise: float = option(0.5, "The largest noise, in deviations of the data.", minimum=0.0)
    device: str = option("cpu", "Where to compute: cpu, or a torch device such as cuda.")
    log_every: int = option(50, "Steps from one line of figures in the log to the next.", minimum=1)
    checkpoint_every: int = option(500, "Steps from one checkpoint to the next.", minimum=1)


class EncoderTraining:
    """An encoder's network and its optimiser.

    What an iteration draws depends on the seed and its number alone, so that a run goes on as if it had never stopped.

    Attributes:
        iteration: steps done.
    """

    def __init__(self, generator: MoDi, dataset: Dataset, settings: EncoderSettings) -> None:
        """Draw the first weights.

        Raises:
            MotionGenError: if the data does not go with the generator.
        """
        _check(generator, dataset)
        self.generator, self.dataset, self.settings = generator, dataset, settings
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            self.network = new_network(generator)
        self.body = body_of(generator)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=settings.learning_rate, betas=(0.9, 0.99))
        self.iteration = 0

    def step(self) -> dict[str, Tensor]:
        """One iteration; what it found."""
        settings = self.settings
        given, wanted = self._real()
        codes = self._codes()
        with torch.no_grad():
            made = self.generator.network.synthesis(codes)
            target = seen(self.body, torch.cat([wanted, made]))
        found = self.network(torch.cat([given, made]))
        apart = distances(seen(self.body, self.generator.network.synthesis(found)), target)
        code_loss = (found[len(given) :] - codes).square().mean() / self.network.deviation.square()
        loss = apart.weighted(settings.fk_weight, settings.contact_weight).mean() + settings.code_weight * code_loss
        self.optimiser.param_groups[0]["lr"] = settings.learning_rate * self._rate()
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        self.iteration += 1
        halves = {"real": slice(0, len(given)), "made": slice(len(given), None)}
        return {
            "loss/all": loss.detach(),
            "loss/code": code_loss.detach(),
            **{
                f"{name}/{half}": values.detach()[rows].mean()
                for name, values in apart._asdict().items()
                for half, rows in halves.items()
            },
        }

    def _rate(self) -> float:
        """The learning rate's share: a half cosine from one to nearly zero."""
        return 0.5 + 0.5 * math.cos(math.pi * self.iteration / self.settings.iterations)

    def _real(self) -> tuple[Tensor, Tensor]:
        """(B, T, E, 4) real motions as the network is given them, and as it should make them."""
        random = numpy_random(self.settings.seed, self.iteration, "real")
        windows = self.dataset.draw("training", 2 * self.settings.batch, random)
        entities = self.dataset.batch(windows, standardised=False)
        pairs = [self._pair(one, other, random) for one, other in zip(*np.split(entities, 2))]
        given, wanted = (on_device(self.generator, standardised(self.generator.card, np.stack(p))) for p in zip(*pairs))
        return given, wanted

    def _pair(self, one: Floats, other: Floats, random: np.random.Generator) -> tuple[Floats, Floats]:
        """(T, E, 4) what the network is given of one motion, or two, and what it should make of it."""
        card = self.generator.card
        kind = str(random.choice(CORRUPTIONS)) if random.random() < self.settings.corrupted else "none"
        least = min(LEAST_KNOWN, len(one) // 2)
        at = int(random.integers(least, len(one) - least + 1))
        if kind == "noise":
            return noised(card, one, random, self.settings.noise * random.random()), one
        if kind == "cut":
            return cut_off(card, one, at), one
        if kind == "splice":
            one = spliced(card.layout, one, other, at)
        if kind == "joints":
            joints = card.layout.skeleton.subtree(int(random.integers(1, len(card.layout.skeleton))))
            one = with_joints(card.layout, one, other, joints)
        return one, one

    @torch.no_grad()
    def _codes(self) -> Tensor:
        """(B, L, S) codes of made motions, some mixed of two."""
        random = torch_random(self.settings.seed, self.iteration, "codes")
        layers, shape = self.generator.latent_layers, (self.settings.batch, self.generator.latent_size)
        noises = [torch.randn(shape, generator=random).to(self.generator.device) for _ in range(2)]
        first, second = (self.generator.network.codes(noise) for noise in noises)
        index = torch.randint(1, layers, (len(first),), generator=random) if layers > 1 else torch.ones(len(first))
        index[torch.rand(len(first), generator=random) >= self.settings.mixing] = layers
        own = torch.arange(layers) < index[:, None]  # (B, L)
        return torch.where(own[..., None].to(first.device), first, second)

    @torch.inference_mode()
    def measure(self) -> MotionError:
        """How far motions of the codes of held-back windows are from these, on average."""
        split = "held_back" if len(self.dataset.clips("held_back")) else "training"
        windows = self.dataset.draw(split, MEASURED, numpy_random(0, 0, "measured"))
        real = on_device(
            self.generator, standardised(self.generator.card, self.dataset.batch(windows, standardised=False))
        )
        found: list[MotionError] = []
        for some in real.split(2 * self.settings.batch):
            made = self.generator.network.synthesis(self.network(some))
            found += errors(self.generator.card, seen(self.body, made), seen(self.body, some))
        return mean_error(found)

    # -- state

    def save(self, folder: Path, record: dict[str, Any]) -> None:
        """Keep the encoder, and what is needed to go on; each file is whole at any time.

        Raises:
            MotionGenError: if they cannot be written.
        """
        notes = {"format": FORMAT, "model": fingerprint(self.generator), "data": self.dataset.fingerprint,
                 "iteration": self.iteration, "settings": self.settings.to_dict()}  # fmt: skip
        weights = self.network.state_dict()
        memory = memory_of(self.optimiser, "adam")
        folder.mkdir(parents=True, exist_ok=True)
        save_tensors(folder / TRAINING, notes, memory | {f"network.{name}": value for name, value in weights.items()})
        save_tensors(folder / WEIGHTS, notes, weights)
        with atomic_write(folder / RECORD) as file:
            file.write(json.dumps(notes | record, indent=1).encode())

    def load(self, folder: Path) -> None:
        """Go on from what `save` has kept.

        Raises:
            MotionGenError: if it is another training's, or damaged.
        """
        notes, tensors = read_tensors(folder / TRAINING)
        ours = {"model": fingerprint(self.generator), "data": self.dataset.fingerprint, **self.settings.to_dict()}
        theirs = {"model": notes["model"], "data": notes.get("data"), **notes.get("settings", {})}
        for name in ("device", "log_every", "checkpoint_every"):
            theirs[name] = ours[name]  # these may change on the way
        if changed := sorted(name for name in ours if theirs.get(name) != ours[name]):
            raise MotionGenError(
                f"{folder}: was trained with {changed[0]}={theirs.get(changed[0])}, not {ours[changed[0]]}; give the "
                "same, or another output"
            )
        try:
            self.network.load_state_dict(below(tensors, "network."))
            remember(self.optimiser, tensors, "adam")
            self.iteration = int(notes["iteration"])
        except (KeyError, RuntimeError, ValueError) as error:
            reason = str(error).splitlines()[-1].strip()
            raise MotionGenError(f"{folder}: training cannot go on from it ({reason}); take another output") from error


def run(training: EncoderTraining, folder: Path, record: dict[str, Any]) -> MotionError:
    """Train to the last iteration, from where the folder's training is; the encoder's error on held-back motions.

    Raises:
        MotionGenError: if the folder holds another training, a loss is not finite, or something cannot be written.
    """
    from torch.utils.tensorboard import SummaryWriter

    settings = training.settings
    if (folder / TRAINING).exists():
        training.load(folder)
    log = SummaryWriter(str(folder / "logs"), purge_step=training.iteration + 1)
    try:
        with progress_bar("training") as advance:
            while training.iteration < settings.iterations:
                figures = training.step()
                done, last = training.iteration, training.iteration == settings.iterations
                if last or done % settings.log_every == 0 or done % settings.checkpoint_every == 0:
                    values = {name: float(value) for name, value in figures.items()}
                    if not math.isfinite(values["loss/all"]):
                        raise MotionGenError(
                            f"training stopped at iteration {done}, for the loss is {values['loss/all']}; try a lower "
                            "learning_rate"
                        )
                    for name, value in values.items():
                        log.add_scalar(name, value, done)
                if not last and done % settings.checkpoint_every == 0:
                    training.save(folder, record)
                advance(done / settings.iterations)
    finally:
        log.close()
    found = training.measure()
    training.save(folder, record | {"held_back": asdict(found)})
    return found


def main() -> int:
    """Run the Hydra application; the exit code."""
    return run_training(
        _train, "encoder", "train.encoder", sys.argv[1:], "the same command goes on from the last checkpoint"
    )


def _train(values: dict[str, Any], folder: Path) -> None:
    checkpoint, data = values.pop("checkpoint"), values.pop("data")
    values.pop("output")
    settings = EncoderSettings.build(values)
    if data is None:
        raise MotionGenError("data=FOLDER is missing; make one with `motiongen data import CLIPS FOLDER`")
    generator = MoDi(ModiOptions(checkpoint=checkpoint, device=settings.device))
    training = EncoderTraining(generator, Dataset.open(data), settings)
    begun = time.perf_counter()
    found = run(training, folder, {"checkpoint": checkpoint, "versions": versions()})
    Encoder.load(folder, generator)  # what was written can be read
    print(f"{training.iteration} iterations in {time.perf_counter() - begun:.0f} s; held-back motions: {found}")
    print(f"  motiongen invert method=encoder encoder={folder} input=CLIP")


def _check(generator: MoDi, dataset: Dataset) -> None:
    card = generator.card
    if found := generator.skeleton.difference(dataset.skeleton):
        raise MotionGenError(
            f"the dataset's skeleton is not the checkpoint's: {found}; take the data it was trained on"
        )
    for what, theirs, ours in (
        ("frame rate", dataset.frame_rate, card.frame_rate),
        ("window", dataset.window_frames, card.network.frames),
        ("feet", dataset.layout.feet, card.layout.feet),
    ):
        if theirs != ours:
            raise MotionGenError(f"the dataset's {what} is {theirs}, the checkpoint's {ours}; import the clips alike")


if __name__ == "__main__":
    sys.exit(main())
