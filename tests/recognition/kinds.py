"""A dataset of figures that move in ways that are easily told apart, for recognisers to learn in seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.datasets import Dataset, ImportSettings, import_clips
from motiongen.motion import Motion
from motiongen.recognition import Recogniser
from tests.datasets.clips import FIGURE, save_clips
from train.recogniser import RecogniserSettings, train

FRAMES, RATE = 32, 30.0

KINDS = ("nod", "kick", "turn")

UP, ACROSS = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def clip_of(kind: str, seed: int, frames: int = 48) -> Motion:
    """The figure nods, kicks with its left leg, or turns about and walks."""
    random = np.random.default_rng([KINDS.index(kind), seed])
    time = np.arange(frames) / RATE
    swing = random.uniform(0.6, 1.0) * np.sin(2 * np.pi * random.uniform(0.8, 1.2) * time + random.uniform(0, 6))
    rotations = np.tile(rot.IDENTITY, (frames, len(FIGURE), 1))
    places = np.zeros((frames, 1, 3))
    for joint in range(1, len(FIGURE)):  # nobody stands quite still
        rotations[:, joint] = rot.from_axis_angle(ACROSS, random.normal(scale=0.05) + 0.02 * np.sin(3 * time))
    if kind == "turn":
        rotations[:, 0] = rot.from_axis_angle(UP, time * random.uniform(1, 2))
        places[:, 0, 2] = time * random.uniform(0.5, 1.0)
    else:
        joint = FIGURE.index("Spine" if kind == "nod" else "LeftLeg")
        rotations[:, joint] = rot.from_axis_angle(ACROSS, swing)
    motion = Motion(FIGURE, rotations, places, (0,), RATE, "m", name=f"{kind}_{seed:02d}")
    return motion.transform(rot.from_axis_angle(UP, np.array(random.uniform(-3, 3))), random.normal(size=3) * (1, 0, 1))


def make_dataset(folder: Path, clips: int = 24) -> Path:
    """Clips of all kinds, a quarter of them held back, labelled `kind` and `number` by their names."""
    motions = {f"{kind}_{seed:02d}.npz": clip_of(kind, seed) for kind in KINDS for seed in range(clips)}
    settings = ImportSettings(frames=FRAMES, stride=8, held_back=0.25, labels="{kind}_{number}")
    import_clips(save_clips(folder / "clips", motions), folder / "data", settings)
    return folder / "data"


def trained(dataset: Dataset, **settings: Any) -> Recogniser:
    """A small recogniser of the kinds."""
    given = {"label": "kind", "channels": [8, 16, 16], "iterations": 80, "batch": 32, **settings}
    return train(dataset, RecogniserSettings.build(given), lambda share: None)


def windows_of(dataset: Dataset, split: str, count: int, seed: int = 0) -> NDArray[np.float32]:
    """(count, T, E, 4) windows of a part."""
    return dataset.batch(dataset.draw(split, count, np.random.default_rng(seed)), standardised=False)
