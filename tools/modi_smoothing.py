"""What smoothing after the scalers does: `python -m tools.modi_smoothing CHECKPOINT --data DATASET`.

The same weights make motions with and without it (`network.smoothing`), beside held-back real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.datasets import Dataset
from motiongen.generators.modi.checkpoint import load_model
from motiongen.generators.modi.generator import build_network
from motiongen.metrics.frechet import descriptors, frechet_distance
from motiongen.quality import jitter

COUNT = 300

JITTERED = 100
"""Motions whose jitter is measured."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_smoothing", description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--data", type=Path, required=True)
    options = parser.parse_args(arguments)
    dataset = Dataset.open(options.data)
    real = dataset.batch(dataset.draw("held_back", COUNT, np.random.default_rng(0)), standardised=False)
    known = [dataset.to_motion(window, standardised=False) for window in real]
    yardstick, fastest = descriptors(known), highest_frequency(real, dataset)
    print(f"{'':<18}{'distance':>10}{'jitter':>10}{'energy at the highest frequency, real = 1':>44}")
    print(f"{'real, held back':<18}{'':>10}{np.mean([jitter(m) or 0.0 for m in known[:JITTERED]]):>10.1f}{1:>44}")
    for smoothing in (False, True):
        made = sampled(options.checkpoint, smoothing)
        motions = [dataset.to_motion(window, standardised=False) for window in made]
        distance = frechet_distance(descriptors(motions), yardstick)
        shaking = np.mean([jitter(motion) or 0.0 for motion in motions[:JITTERED]])
        share = highest_frequency(made, dataset) / fastest
        name = "with smoothing" if smoothing else "without smoothing"
        print(f"{name:<18}{distance:>10.3f}{shaking:>10.1f}{share:>44.3g}")


@torch.inference_mode()
def sampled(checkpoint: Path, smoothing: bool) -> NDArray[np.float32]:
    """(N, T, E, 4) entities of motions of seeds."""
    card, weights = load_model(checkpoint)
    options = replace(card.network, smoothing=smoothing)
    network = build_network(replace(card, network=options), weights)
    z = torch.randn(COUNT, options.latent_size, generator=torch.Generator().manual_seed(0))
    made = torch.cat([network(some) for some in z.split(50)]).numpy()
    entities: NDArray[np.float32] = made * card.deviation + card.mean
    return entities


def highest_frequency(windows: NDArray[np.float32], dataset: Dataset) -> float:
    """Mean energy of the joints' rotations from frame to frame where their sign changes with every frame."""
    steps = np.diff(windows[:, :, dataset.layout.joints], axis=1)
    faded = steps * np.hanning(steps.shape[1])[None, :, None, None]
    return float((np.abs(np.fft.rfft(faded, axis=1)[:, -1]) ** 2).mean())


if __name__ == "__main__":
    main()
