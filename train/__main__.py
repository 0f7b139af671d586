"""Train a generator: `python -m train generator=modi data=FOLDER`; also under `torchrun`."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import math
import sys
from pathlib import Path
from typing import Any

from motiongen.errors import MotionGenError
from train.application import run_training


def main() -> int:
    """Run the Hydra application; the exit code."""
    return run_training(_train, "train", "train", sys.argv[1:], "the same command goes on from the last checkpoint")


def _train(values: dict[str, Any], folder: Path) -> None:
    from motiongen.datasets import Dataset
    from motiongen.generators.modi.options import NetworkOptions
    from train.loop import run
    from train.modi import ModiTraining
    from train.settings import TrainerSettings
    from train.workers import Workers

    name = values["generator"]["name"]
    if name != "modi":
        raise MotionGenError(f"generator={name} is not trained; generator=modi is")
    if values["data"] is None:
        raise MotionGenError("data=FOLDER is missing; make one with `motiongen data import CLIPS FOLDER`")
    dataset = Dataset.open(values["data"])
    network = NetworkOptions.build({"frames": dataset.window_frames, **values["network"]})
    settings = TrainerSettings.build(values["trainer"])
    if network.frames != dataset.window_frames:
        raise MotionGenError(
            f"network.frames={network.frames}, but the windows of {values['data']} have {dataset.window_frames}; "
            "import the clips with --frames of that length, or leave network.frames out"
        )
    workers = Workers.join(settings.device)
    try:
        training = ModiTraining(dataset, network, settings, workers)
        start = None if values["start"] is None else Path(str(values["start"]))
        result = run(training, folder, {**values, "generator": name}, start)
    finally:
        workers.leave()
    if workers.leads:
        _summarise(result)


def _summarise(result: dict[str, Any]) -> None:
    print(f"{result['iterations']} iterations in {result['seconds']:.0f} s; checkpoint: {result['checkpoint']}")
    if math.isfinite(result["best_distance"]):
        print(
            f"distance to held-back motions {result['best_distance']:.4f}\n"
            f"  motiongen sample generator=modi generator.checkpoint={result['checkpoint']}"
        )


if __name__ == "__main__":
    sys.exit(main())
