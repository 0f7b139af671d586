"""Curves of a training as one picture: `python -m tools.training_curves RUN OUT.png`, from the log in RUN/logs."""

from __future__ import annotations

import argparse
from pathlib import Path

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
    parser = argparse.ArgumentParser(prog="python -m tools.training_curves", description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    log = EventAccumulator(str(options.run / "logs"))
    log.Reload()
    known = log.Tags()["scalars"]
    figure = Figure(figsize=(11, 6), layout="constrained")
    for axes, (title, names) in zip(figure.subplots(2, 2).flat, PANELS.items()):
        for name in names:
            if name in known:
                points = log.Scalars(name)
                axes.plot([p.step for p in points], [p.value for p in points], ".-", label=name, linewidth=1)
        axes.set(title=title, xlabel="iterations")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    figure.savefig(options.out, dpi=100)


if __name__ == "__main__":
    main()
