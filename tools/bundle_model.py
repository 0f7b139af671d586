"""Makes a training's checkpoint into the model that comes with the project: half precision, with a model card.

python -m tools.bundle_model runs/bandai/best --credit "..." [--evaluation evaluation.json] [--faults faults.md]

The checkpoint loses what only training needs. Its weights are halved, and the card says what that changes in motions.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import motiongen as mg
from motiongen import rotations as rot
from motiongen.assets import BUNDLED_MODEL
from motiongen.errors import MotionGenError
from motiongen.files import new_folder
from motiongen.generators.modi.checkpoint import Card, load_model, save_checkpoint
from motiongen.report import markdown_table
from train.loop import MAY_CHANGE

COMPARED = 50
"""Motions that tell what halving costs."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the model. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.bundle_model", description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path, help="a checkpoint of a training, such as runs/bandai/best")
    parser.add_argument("--credit", required=True, help="whose data it was trained on, and what that allows")
    parser.add_argument("--evaluation", type=Path, help="evaluation.json of `motiongen evaluate`, for the card")
    parser.add_argument("--faults", type=Path, help="Markdown that ends the card: what is not good yet")
    parser.add_argument("--out", type=Path, default=BUNDLED_MODEL, help="the folder to write")
    options = parser.parse_args(arguments)
    try:
        print(bundle(options))
    except (MotionGenError, OSError) as error:
        print(f"bundle_model: {error}", file=sys.stderr)
        return 2
    return 0


def bundle(options: argparse.Namespace) -> str:
    """Write the model and put it in the place of the one before. Returns what to say.

    Raises:
        MotionGenError: if the checkpoint cannot be read or the model not be written.
        OSError: if a file for the card cannot be read.
    """
    card, weights = load_model(options.checkpoint)
    card = replace(card, credit=options.credit)
    evaluation = json.loads(options.evaluation.read_text()) if options.evaluation else None
    faults = options.faults.read_text() if options.faults else ""
    run = options.checkpoint.parent / "run.json"
    schedule = json.loads(run.read_text()) if run.is_file() else None
    with new_folder(options.out, replacing=True) as fresh:
        save_checkpoint(fresh, card, {name: weight.half() for name, weight in weights.items()})
        lost = _lost(options.checkpoint, fresh)
        size = (fresh / "model.safetensors").stat().st_size
        (fresh / "README.md").write_text(_model_card(card, size, lost, schedule, evaluation, faults))
        (fresh / "model.safetensors").chmod(0o644)
    return f"{options.out}: {size / 1e6:.1f} MB, {card.iteration:,} iterations; halving changes {lost}"


def _lost(whole: Path, half: Path) -> str:
    """What halving the weights changes in motions of the same seeds."""
    first, second = (
        mg.create("modi", checkpoint=str(folder), clean_feet=False).sample(64, COMPARED) for folder in (whole, half)
    )
    angles = [rot.angle_between(a.rotations, b.rotations) for a, b in zip(first, second)]
    away = [np.linalg.norm(a.positions - b.positions, axis=-1) / a.skeleton.height for a, b in zip(first, second)]
    return (
        f"{np.degrees(np.mean(angles)):.3f} degrees and {np.mean(away):.5f} skeleton heights on average "
        f"(worst {np.degrees(np.max(angles)):.2f} and {np.max(away):.4f}) over {COMPARED} motions"
    )


def _model_card(
    card: Card,
    size: int,
    lost: str,
    schedule: dict[str, Any] | None,
    evaluation: dict[str, Any] | None,
    faults: str,
) -> str:
    lines = [
        "# Model card: MoDi",
        "",
        f"- **Makes** motions of {card.network.frames} frames (and longer) at {card.frame_rate:g} Hz on a skeleton of "
        f"{len(card.layout.skeleton)} joints.",
        f"- **Data and licence** {card.credit} The code of the project stays Apache-2.0.",
        f"- **Weights** the running mean of the generator's after {card.iteration:,} iterations ({card.samples:,} "
        f"motions seen), in half precision, {size / 1e6:.1f} MB; only weights that the skeleton leaves are stored.",
        f"- **Halving** them changes {lost}.",
        f"- **Trained on** the dataset with the fingerprint `{card.data_fingerprint[:16]}`.",
    ]
    if schedule is not None:
        lines += ["", "## Schedule", "", "| setting | value |", "| --- | --- |"]
        settings = {**schedule["network"], **schedule["trainer"]}
        lines += [f"| {name} | {value} |" for name, value in settings.items() if name not in MAY_CHANGE]
        versions = ", ".join(f"{name} {number}" for name, number in schedule["versions"].items())
        lines += ["", f"Versions: {versions}."]
    if evaluation is not None:
        lines += ["", "## Figures", "", *_figures(evaluation)]
    if faults:
        lines += ["", faults.strip()]
    return "\n".join(lines) + "\n"


def _figures(evaluation: dict[str, Any]) -> list[str]:
    """The tables of `motiongen evaluate`."""
    names = list(next(iter(evaluation["comparisons"].values())))
    rows = [["beside held-back motions", *names]]
    for who, found in evaluation["comparisons"].items():
        rows.append([who, *("{value:.3g} [{low:.3g}, {high:.3g}]".format(**found[name]) for name in names)])
    measured = list(next(iter(evaluation["physical"].values())))
    bodies = [["", *(name.replace("_", " ") for name in measured)]]
    for who, physical in evaluation["physical"].items():
        bodies.append([who, *("" if physical[name] is None else f"{physical[name]:.3g}" for name in measured)])
    return [*markdown_table(rows), "", *markdown_table(bodies)]


if __name__ == "__main__":
    sys.exit(main())
