"""How fast motions are at their ends beside their middle: `python -m tools.modi_ends CHECKPOINT ... [--data FOLDER]`.

Convolutions that see zeros beyond the ends know where these are; see `network.held_ends`. Prints Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

import motiongen as mg
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.report import markdown_table
from train.draws import numpy_random

SHOWN = (0, 1, 2, 5)
"""Steps from either end that are shown."""
MIDDLE = 10
"""Steps from either end that do not count as the middle."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_ends", description=__doc__)
    parser.add_argument("checkpoints", nargs="+")
    parser.add_argument("--data", help="a dataset, whose held-back windows are shown beside them")
    parser.add_argument("--count", type=int, default=200)
    options = parser.parse_args()
    rows = [["motions", *(f"step {step}" for step in SHOWN), *(f"step -{step + 1}" for step in reversed(SHOWN))]]
    for path in options.checkpoints:
        model = mg.create("modi", checkpoint=path, clean_feet=False)
        rows.append([path, *shares(model.decode(model.latents(options.count, seed=0)))])
    if options.data:
        dataset = Dataset.open(options.data)
        windows = dataset.batch(
            dataset.draw("held_back", options.count, numpy_random(0, 0, "ends")), standardised=False
        )
        rows.append(
            ["real, held back", *shares(dataset.to_motion(w, standardised=False, name="real") for w in windows)]
        )
    print("\n".join(markdown_table(rows)))


def shares(motions: Iterable[mg.Motion]) -> list[str]:
    """Mean speed of the joints at steps near either end, over that in the middle, as the table says it."""
    speeds = np.mean([speed(motion) for motion in motions], axis=0)
    relative = speeds / speeds[MIDDLE:-MIDDLE].mean()
    return [f"{relative[step]:.2f}" for step in (*SHOWN, *(-1 - step for step in reversed(SHOWN)))]


def speed(motion: mg.Motion) -> NDArray[np.float64]:
    """(T - 1,) mean speed of the joints at each step."""
    steps: NDArray[np.float64] = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1).mean(axis=1)
    return steps


if __name__ == "__main__":
    try:
        main()
    except MotionGenError as error:
        sys.exit(f"modi_ends: {error}")
