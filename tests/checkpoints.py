"""Checkpoints with random weights, for what only needs one to be there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from motiongen.datasets import EntityLayout
from motiongen.generators.modi.checkpoint import Card, save_checkpoint
from motiongen.generators.modi.hierarchy import build_hierarchy
from motiongen.generators.modi.networks import ModiGenerator
from motiongen.generators.modi.options import NetworkOptions
from motiongen.skeleton import Skeleton

SMALL = {"frames": 16, "channels": [8, 8], "latent_size": 8, "mapping_layers": 2, "deviation_group": 2}


def random_checkpoint(
    folder: Path, skeleton: Skeleton, feet: tuple[int, ...] = (), unit: str | None = None, **network: Any
) -> Path:
    """A checkpoint of MoDi whose motions are noise around the rest pose, at 30 Hz."""
    options = NetworkOptions.build(SMALL | network)
    layout = EntityLayout(skeleton, feet)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        generator = ModiGenerator(build_hierarchy(skeleton, feet, options), options)
    generator.measure_mean_code(torch.Generator().manual_seed(0), samples=100)
    mean = np.zeros((layout.count, options.features), dtype=np.float32)
    mean[layout.joints, -1] = 1.0  # no rotation
    deviation = np.full_like(mean, 0.01)
    mean[layout.contacts, 0] = 1.0  # always on the ground
    deviation[layout.root] = 0.001
    save_checkpoint(folder, Card(options, layout, mean, deviation, 30.0, unit, "none"), generator.state_dict())
    return folder
