"""Trainings so small that a step takes a few milliseconds."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file
from torch import Tensor

from motiongen.datasets import Dataset, ImportSettings, import_clips
from motiongen.generators.modi.options import NetworkOptions
from tests.conftest import ROOT
from tests.datasets.clips import save_clips, stride
from train.modi import ModiTraining
from train.settings import TrainerSettings
from train.workers import Workers

FRAMES = 16
NETWORK = {"channels": [8, 8], "latent_size": 8, "mapping_layers": 2, "deviation_group": 2}
ALONE = Workers(0, 1, torch.device("cpu"))


def make_dataset(folder: Path, clips: int = 8) -> Path:
    """A dataset of clips of one figure that strides about."""
    motions = {f"clip_{i}.npz": stride(i, frames=FRAMES + 4 * i) for i in range(clips)}
    import_clips(save_clips(folder / "clips", motions), folder / "data", ImportSettings(frames=FRAMES, held_back=0.3))
    return folder / "data"


def training_of(dataset: Dataset, network: dict[str, Any] | None = None, **settings: Any) -> ModiTraining:
    """A training in this process."""
    options = NetworkOptions.build({"frames": FRAMES, **NETWORK, **(network or {})})
    return ModiTraining(dataset, options, TrainerSettings.build({"batch": 4, **settings}), ALONE)


def arguments(data: Path, output: Path, **settings: Any) -> list[str]:
    """Of `python -m train` for a tiny training; `settings` are the trainer's."""
    trainer = {"batch": 4, "iterations": 6, "measured": 50, **settings}
    return [
        f"data={data}",
        f"output={output}",
        *(f"network.{name}={str(value).replace(' ', '')}" for name, value in NETWORK.items()),
        *(f"trainer.{name}={value}" for name, value in trainer.items()),
    ]


def command(given: list[str], processes: int = 1) -> list[str]:
    """The whole command, on one or on several processes."""
    torchrun = ["-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={processes}"]
    return [sys.executable, *(torchrun if processes > 1 else []), "-m", "train", *given]


def start(given: list[str], processes: int = 1) -> subprocess.Popen[str]:
    """Start a training in processes of their own, each on one thread."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    pipe = subprocess.PIPE
    return subprocess.Popen(command(given, processes), cwd=ROOT, env=environment, stdout=pipe, stderr=pipe, text=True)


def finish(process: subprocess.Popen[str]) -> str:
    """Wait for a training that should end well; what it said."""
    out, err = process.communicate(timeout=200)
    assert process.returncode == 0, err
    return out


def weights_of(checkpoint: Path) -> dict[str, Tensor]:
    """All tensors of a checkpoint."""
    return {
        f"{part}.{name}": tensor
        for part in ("model", "training")
        for name, tensor in load_file(checkpoint / f"{part}.safetensors").items()
    }
