"""Train a recogniser of motions: `python -m train.recogniser data=FOLDER output=FOLDER`."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import dataclasses
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.console import progress_bar
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError, nearest_of
from motiongen.generators.options import Options, option
from motiongen.recognition import Card, Recogniser
from motiongen.recognition.positions import first_poses, placed, window_positions
from motiongen.recognition.pseudo_labels import pseudo_labels
from train.application import run_training
from train.draws import numpy_random

NAME = "name"
"""The label that every dataset has: the clips' names."""

REFERENCE_WINDOWS = 2000
"""From so many the usual first pose is taken."""

SMOOTHING = 0.1
"""Share of each target that goes to all classes: a window may show little of what its clip is called."""


@dataclass(frozen=True)
class RecogniserSettings(Options):
    """How a recogniser is trained."""

    label: str = option("content", "The label whose values it learns to tell apart, or name for the clips' names.")
    pseudo_classes: int | None = option(None, "Make so many classes of values of near meaning.", minimum=2)
    least_clips: int = option(5, "Classes with fewer training clips are left out.", minimum=1)
    balance: float = option(
        0.5, "How much rare classes are favoured: 0 clips as they come, 1 all classes alike.", minimum=0.0, maximum=1.0
    )
    channels: tuple = option((16, 32, 64, 64, 128), "Channels of each block; where they grow, time is halved.")
    iterations: int = option(1500, "Steps of training.", minimum=1)
    batch: int = option(64, "Motions in a step.", minimum=2)
    learning_rate: float = option(0.005, "The highest of the run, of AdamW.", above=0.0)
    dropout: float = option(0.2, "Share of the features that are left out in a step.", minimum=0.0, maximum=0.9)
    seed: int = option(0, "Decides the first weights and everything that is drawn.", minimum=0)

    def __post_init__(self) -> None:
        """Take a list as a tuple, as configuration files give it."""
        if isinstance(given := cast(Any, self.channels), list):
            object.__setattr__(self, "channels", tuple(given))
        super().__post_init__()
        if not self.channels or any(type(size) is not int or size < 1 for size in self.channels):
            raise MotionGenError(f"channels must be whole numbers from 1 on, one for each block, not {self.channels}")


def main(arguments: Sequence[str]) -> int:
    """Run the Hydra application with its overrides; the exit code."""
    return run_training(_train, "recogniser", "train.recogniser", arguments, "nothing is kept")


def _train(values: dict[str, Any], folder: Path) -> None:
    del values["output"]
    data = values.pop("data")
    settings = RecogniserSettings.build(values)
    if data is None:
        raise MotionGenError("data=FOLDER is missing; make one with `motiongen data import CLIPS FOLDER`")
    if any(folder.iterdir()):
        raise MotionGenError(f"output={folder} is not empty; remove it, or choose another place")
    with progress_bar("training") as progress:
        recogniser = train(Dataset.open(data), settings, progress)
    recogniser.save(folder)
    print("\n".join([*summary(recogniser.card), f"recogniser: {folder}"]))


def train(dataset: Dataset, settings: RecogniserSettings, progress: Callable[[float], None]) -> Recogniser:
    """A recogniser that has learned the dataset's training part, measured on what is held back.

    Raises:
        MotionGenError: if there is no such label, or fewer than two classes.
    """
    classes, class_of = classes_of(dataset, settings)
    draws = Draws(dataset, class_of, settings.balance)
    random = numpy_random(settings.seed, 0, "usual first pose")
    usual = window_positions(dataset, draws.windows(REFERENCE_WINDOWS, random))
    card = Card(
        skeleton=dataset.skeleton,
        frame_rate=dataset.frame_rate,
        frames=dataset.window_frames,
        classes=classes,
        channels=settings.channels,
        reference=first_poses(usual).mean(axis=0).astype(np.float32),
        data_fingerprint=dataset.fingerprint,
        label=settings.label,
    )
    recogniser = Recogniser(card, _learned(dataset, draws, card, settings, progress))
    # The weights are rounded by now as they are kept, so what is measured is what will be loaded.
    return measured(recogniser, dataset, class_of)


def classes_of(dataset: Dataset, settings: RecogniserSettings) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """The classes' names, and (n,) the class of each clip; -1 for one that is in none.

    Raises:
        MotionGenError: if there is no such label, or fewer than two classes.
    """
    labels = {NAME: dataset.names, **dataset.labels}
    if settings.label not in labels:
        raise MotionGenError(
            f"the dataset has no label '{settings.label}'{nearest_of(settings.label, labels) or ';'} its labels are "
            f"{', '.join(labels)}"
        )
    values: Sequence[str] = labels[settings.label]
    if settings.pseudo_classes is not None:
        values = pseudo_labels(values, settings.pseudo_classes, settings.seed)
    counts = Counter(values[clip] for clip in dataset.clips("training"))
    names = tuple(sorted(name for name, count in counts.items() if name and count >= settings.least_clips))
    if len(names) < 2:
        raise MotionGenError(
            f"label={settings.label} has {len(names)} classes with least_clips={settings.least_clips} training clips "
            "or more, and it takes two to tell apart; take another label, or fewer least_clips"
        )
    number = {name: k for k, name in enumerate(names)}
    return names, np.array([number.get(value, -1) for value in values], dtype=np.int64)


class Draws:
    """Windows of the training part, rare classes favoured.

    Args:
        dataset: where from.
        class_of: (n,) the class of each clip; those of none (-1) are never drawn.
        balance: 0: each place is as likely as any other; 1: each class is.
    """

    def __init__(self, dataset: Dataset, class_of: NDArray[np.int64], balance: float) -> None:
        """Work out how likely each clip is."""
        self.class_of = class_of
        clips = dataset.clips("training")
        self.clips = clips[class_of[clips] >= 0]
        self.places = dataset.index.lengths[self.clips] - dataset.window_frames + 1
        of_class = np.bincount(class_of[self.clips], self.places)
        weights = self.places * of_class[class_of[self.clips]] ** -balance
        self.chances = weights / weights.sum()

    def windows(self, count: int, random: np.random.Generator) -> NDArray[np.int64]:
        """(count, 2) clips and first frames."""
        chosen = random.choice(len(self.clips), count, p=self.chances)
        return np.stack([self.clips[chosen], random.integers(0, self.places[chosen])], axis=1)


def _learned(
    dataset: Dataset, draws: Draws, card: Card, settings: RecogniserSettings, progress: Callable[[float], None]
) -> dict[str, torch.Tensor]:
    """The weights after training."""
    with torch.random.fork_rng(devices=[]):  # of the first weights, and of dropout
        torch.manual_seed(settings.seed)
        network = card.network(settings.dropout)
        optimiser = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate, weight_decay=0.01)
        rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, settings.iterations)
        for iteration in range(settings.iterations):
            windows = draws.windows(settings.batch, numpy_random(settings.seed, iteration, "recogniser"))
            logits = network(torch.from_numpy(_placed_windows(dataset, windows, card)))
            targets = torch.from_numpy(draws.class_of[windows[:, 0]])
            loss = torch.nn.functional.cross_entropy(logits, targets, label_smoothing=SMOOTHING)
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            rate.step()
            progress((iteration + 1) / settings.iterations)
        if not torch.isfinite(loss):
            raise MotionGenError(
                f"training came to a loss of {loss.item()}; take a lower learning_rate than {settings.learning_rate:g}"
            )
        return network.state_dict()


def _placed_windows(dataset: Dataset, windows: NDArray[np.int64], card: Card) -> NDArray[np.float32]:
    positions = window_positions(dataset, windows)
    return placed(positions, card.reference)


def measured(recogniser: Recogniser, dataset: Dataset, class_of: NDArray[np.int64]) -> Recogniser:
    """The same recogniser, with what it finds in the held-back windows of the classes that it knows on its card."""
    windows = dataset.windows("held_back")
    windows = windows[class_of[windows[:, 0]] >= 0]
    if not len(windows):
        return recogniser
    guesses = np.concatenate(
        [
            recogniser.probabilities(window_positions(dataset, some)).argmax(1)
            for some in np.split(windows, range(256, len(windows), 256))
        ]
    )
    confusion = np.zeros((len(recogniser.card.classes),) * 2, dtype=np.int64)
    np.add.at(confusion, (class_of[windows[:, 0]], guesses), 1)
    there = confusion.sum(axis=1) > 0
    card = dataclasses.replace(
        recogniser.card,
        accuracy=float(confusion.trace() / confusion.sum()),
        balanced_accuracy=float((confusion.diagonal()[there] / confusion[there].sum(axis=1)).mean()),
        confusion=confusion,
    )
    return Recogniser(card, recogniser.network.state_dict())


def summary(card: Card) -> list[str]:
    """Lines on how well it recognises what it has not seen."""
    if card.confusion is None or card.accuracy is None:
        return ["nothing was held back, so how well it recognises motions is not known"]
    lines = [
        f"recognised {card.accuracy:.1%} of {card.confusion.sum()} held-back windows, "
        f"{card.balanced_accuracy:.1%} on average over the classes"
    ]
    for name, row in zip(card.classes, card.confusion):
        if row.sum():
            taken = Counter(dict(zip(card.classes, row.tolist()))).most_common(4)
            found = ", ".join(f"{other} {count}" for other, count in taken if count)
            lines.append(f"  {name} ({row.sum()}): {found}")
    return lines


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
