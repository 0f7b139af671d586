"""What a person sees of a training: curves, film strips and clips of fixed seeds beside real ones (TensorBoard)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from motiongen.errors import MotionGenError
from motiongen.generators.modi.body import Body
from motiongen.generators.modi.options import NetworkOptions
from motiongen.metrics.distribution import kernel_distance
from motiongen.metrics.frechet import descriptors, frechet_distance
from motiongen.motion import Motion
from motiongen.recognition import Recogniser
from motiongen.recognition.positions import window_positions
from train.draws import numpy_random, torch_random
from train.modi import ModiTraining

SHOWN = 16
"""Motions of fixed seeds that are drawn, in two pictures of eight."""

ROWS = 8


class Watch:
    """Writes logs, pictures and clips of a run; silent in all processes but the leading one.

    Args:
        folder: of the run.
        training: networks and data.
    """

    def __init__(self, folder: Path, training: ModiTraining) -> None:
        """Open the log; what was logged after the checkpoint that the run goes on from is dropped.

        Raises:
            MotionGenError: if there is a recogniser to be, and it cannot be read or knows another skeleton.
        """
        self.folder, self.leads = folder, training.workers.leads
        self.writer: Any = None
        self._real: NDArray[np.float64] | None = None
        self._recogniser = _recogniser_of(training)
        self._real_features: NDArray[np.float32] | None = None
        if self.leads:
            from torch.utils.tensorboard import SummaryWriter

            self.writer = SummaryWriter(str(folder / "logs"), purge_step=training.iteration + 1)

    def describe(self, record: Mapping[str, Any]) -> None:
        """Keep the composed configuration and the versions in the log."""
        if self.leads:
            self.writer.add_text("configuration", f"```\n{json.dumps(record, indent=1, default=str)}\n```", 0)

    def figures(self, iteration: int, values: Mapping[str, float]) -> None:
        """Curves."""
        if self.leads:
            for name, value in values.items():
                self.writer.add_scalar(name, value, iteration)

    def look(self, training: ModiTraining) -> float:
        """Draw motions of fixed seeds, keep them as clips, and measure how far made ones are from real ones.

        Returns:
            The distance (`metrics.frechet`) of motions from the running mean of the weights to held-back ones; the same
            in all processes. Infinity where the networks make positions, of which there is no motion.
        """
        if training.network.representation != "rotations":
            return float("inf")
        distance = 0.0
        if self.leads:
            made = made_motions(training, SHOWN)
            self._draw(training, made)
            if self._real is None:
                self._real = descriptors(real_motions(training, training.settings.measured))
            distance = frechet_distance(descriptors(made_motions(training, training.settings.measured)), self._real)
            self.writer.add_scalar("distance/held_back", distance, training.iteration)
            self.writer.flush()
        shared = torch.tensor(distance, dtype=torch.float64, device=training.workers.device)
        training.workers.average([shared])
        return float(shared) * training.workers.count

    def judge(self, training: ModiTraining) -> None:
        """Log FID and KID of motions from the running mean of the weights beside held-back ones, by the recogniser."""
        if not self.leads or self._recogniser is None:
            return
        count = training.settings.measured
        if self._real_features is None:
            self._real_features = self._recogniser.features(real_positions(training, count))
        made = self._recogniser.features(
            network_positions(training.mean_generator, training.body, training.network, _shown_z(training, count))
        )
        for name, distance in (("fid", frechet_distance), ("kid", kernel_distance)):
            self.writer.add_scalar(f"recogniser/{name}", distance(self._real_features, made), training.iteration)
        self.writer.flush()

    def _draw(self, training: ModiTraining, made: list[Motion]) -> None:
        from motiongen.render import film_strip

        place = self.folder / "motions" / f"{training.iteration:08d}"
        place.mkdir(parents=True, exist_ok=True)
        for motion in made:
            motion.save(place / f"{motion.name}.bvh")
        pictures = {f"made {start}": made[start : start + ROWS] for start in range(0, SHOWN, ROWS)}
        if training.iteration <= training.settings.picture_every:
            pictures["real"] = real_motions(training, ROWS)
        for name, motions in pictures.items():
            picture = film_strip(motions, [motion.name for motion in motions])
            picture.save(place / f"{name.replace(' ', '_')}.png")
            self.writer.add_image(name, np.asarray(picture.convert("RGB")), training.iteration, dataformats="HWC")

    def close(self) -> None:
        """Finish the log."""
        if self.leads:
            self.writer.close()


@torch.no_grad()
def made_motions(training: ModiTraining, count: int) -> list[Motion]:
    """Motions of the running mean of the weights, from the same seeds at every call."""
    motions: list[Motion] = []
    mean, deviation = training.source.scale
    for some in _shown_z(training, count).split(64):
        made = training.mean_generator(some.to(training.workers.device)).float().cpu().numpy()
        motions += [
            training.dataset.to_motion(each * deviation + mean, standardised=False, name=f"made_{len(motions) + k:04d}")
            for k, each in enumerate(made)
        ]
    return motions


def real_motions(training: ModiTraining, count: int) -> list[Motion]:
    """Held-back windows, or training ones where none are held back; the same at every call."""
    dataset, windows = training.dataset, _real_windows(training, count)
    return [
        dataset.to_motion(window, standardised=False, name=dataset.names[clip])
        for (clip, _), window in zip(windows, dataset.batch(windows, standardised=False))
    ]


@torch.no_grad()
def network_positions(network: nn.Module, body: Body, options: NetworkOptions, z: Tensor) -> NDArray[np.float32]:
    """(B, T, J, 3) joint positions, in skeleton heights, that a network makes of z (B, S), as it makes them.

    Positions, not motions: one architecture makes nothing else, and no feet are cleaned up.
    """
    made = [network(some.to(body.mean.device)).float() for some in z.split(64)]
    joints, rotations = body.layout.joints, options.representation == "rotations"
    rows = [body.positions(each) if rotations else body.entities(each)[:, :, joints] for each in made]
    positions: NDArray[np.float32] = torch.cat(rows).cpu().numpy()
    return positions


def real_positions(training: ModiTraining, count: int) -> NDArray[np.float32]:
    """(count, T, J, 3) the same of what `real_motions` gives."""
    dataset = training.dataset
    return window_positions(dataset, _real_windows(training, count))


def _shown_z(training: ModiTraining, count: int) -> Tensor:
    return torch.randn(count, training.network.latent_size, generator=torch_random(training.settings.seed, 0, "shown"))


def _real_windows(training: ModiTraining, count: int) -> NDArray[np.int64]:
    dataset = training.dataset
    split = "held_back" if len(dataset.clips("held_back")) else "training"
    return dataset.draw(split, count, numpy_random(training.settings.seed, 0, "real motions"))


def _recogniser_of(training: ModiTraining) -> Recogniser | None:
    folder = training.settings.recogniser
    if folder is None:
        return None
    recogniser = Recogniser.load(folder)
    if found := recogniser.card.skeleton.difference(training.dataset.skeleton):
        raise MotionGenError(
            f"trainer.recogniser={folder} knows another skeleton than the dataset's: {found}; train one on the dataset "
            "with `python -m train.recogniser`"
        )
    return recogniser
