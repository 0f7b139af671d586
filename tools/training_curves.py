"""Curves of a training as one picture: `python -m tools.training_curves RUN... OUT.png`, from the logs in RUN/logs.

Several runs are stages of one training, each begun from the one before.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

PANELS = {
    "losses": ("loss/generator", "loss/discriminator"),
    "scores": ("score/real", "score/fake"),
    "contacts": ("contact/ratio", "loss/contact_consistency"),
    "distance to held-back motions": ("distance/held_back",),
}


def main() -> None:
    """Read the log and draw."""
    parser = argparse.ArgumentParser(prog="python -m tools.training_curves", description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    logs = [EventAccumulator(str(run / "logs")) for run in options.runs]
    for log in logs:
        log.Reload()
    figure = Figure(figsize=(11, 6), layout="constrained")
    for axes, (title, names) in zip(figure.subplots(2, 2).flat, PANELS.items()):
        for name in names:
            if points := _joined([log.Scalars(name) for log in logs if name in log.Tags()["scalars"]]):
                axes.plot([p.step for p in points], [p.value for p in points], ".-", label=name, linewidth=1)
        axes.set(title=title, xlabel="iterations")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    figure.savefig(options.out, dpi=100)


def _joined(stages: Sequence[Sequence[Any]]) -> list[Any]:
    """The points of all stages; what a stage did after the next one had begun is no part of the training."""
    ends = [*(stage[0].step for stage in stages[1:]), math.inf]
    return [point for stage, end in zip(stages, ends) for point in stage if point.step < end]


if __name__ == "__main__":
    main()
