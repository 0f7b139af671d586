"""Table 2 of the MoDi paper, and the mixing rows of its Table 1: every architecture trained for the same small budget.

Each is trained by `python -m train` itself, into a folder of its own, so that a measurement that was stopped goes on
where it was.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import motiongen as mg
from motiongen.assets import BUNDLED_RECOGNISER
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.modi.body import Body
from motiongen.generators.modi.checkpoint import load_model
from motiongen.generators.modi.generator import build_network
from motiongen.metrics.distribution import Comparison, compare
from motiongen.recognition import Recogniser
from motiongen.recognition.positions import window_positions
from motiongen.report import markdown_table
from tools.paper_tables.cells import machine, versions
from train.draws import numpy_random
from train.loop import CHECKPOINTS, newest
from train.watch import network_positions

ROOT = Path(__file__).resolve().parents[2]

FIGURES = tuple(field.name for field in dataclasses.fields(Comparison))

BUDGET = {
    "network.channels": "[48,32,24,16,16]",
    "network.latent_size": "256",
    "trainer.iterations": "600",
    "trainer.batch": "8",
    "trainer.mean_half_life": "1000",
    "trainer.checkpoint_every": "200",
    "trainer.keep": "1",
    "trainer.picture_every": "600",
    "trainer.measured": "300",
    "trainer.contact_consistency": "0",
    "trainer.contact_encouragement": "0",
}
"""What a training may cost: two to three minutes on one core, 4,800 motions seen where the paper sees 1,280,000.

The foot terms are off: at the beginning they reward figures that stand still, and a short training would measure little
else.
"""


@dataclass(frozen=True)
class Architecture:
    """A row of the table.

    Attributes:
        name: of its runs' folders.
        title: what the row is called.
        settings: in which it differs from the full architecture.
        paper: FID, KID, precision, recall, diversity as published (on another data set).
    """

    name: str
    title: str
    settings: tuple[str, ...]
    paper: tuple[float, float, float, float, float]


ARCHITECTURES = (
    Architecture(
        "not_skeleton_aware", "not skeleton-aware", ("experiment=not_skeleton_aware",), (23.0, 0.17, 0.46, 0.41, 13.0)
    ),
    Architecture(
        "positions", "joint positions, not rotations", ("experiment=positions",), (17.3, 0.2, 0.46, 0.58, 14.0)
    ),
    Architecture("pooling", "pooling, not scaler", ("experiment=pooling",), (14.9, 0.16, 0.49, 0.58, 15.3)),
    Architecture(
        "one_convolution", "one convolution less", ("experiment=one_convolution",), (14.1, 0.15, 0.46, 0.66, 15.4)
    ),
    Architecture("full", "full architecture", (), (11.5, 0.1, 0.46, 0.69, 15.4)),
    Architecture("no_mixing", "full, without mixing", ("trainer.mixing=0",), (13.03, 0.12, 0.71, 0.81, 17.57)),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `python -m tools.paper_tables modi` takes."""
    parser.add_argument("--data", type=Path, required=True, help="the dataset's folder (`motiongen data import`)")
    parser.add_argument("--recogniser", type=Path, default=BUNDLED_RECOGNISER, help="whose features are compared")
    parser.add_argument("--seeds", type=int, default=2, help="trainings of each architecture")
    parser.add_argument("--count", type=int, default=1000, help="motions that are made and compared")
    parser.add_argument("--only", help=f"by commas: {', '.join(each.name for each in ARCHITECTURES)}; default: all")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "tables", help="where the trainings are kept")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "modi", help="where to write")


def run(options: argparse.Namespace, command: str) -> Path:
    """Train what has not been trained, measure, and write. Returns the page's path.

    Raises:
        MotionGenError: if a name is unknown, the data cannot be read, or a training fails.
    """
    options.data, options.runs = options.data.resolve(), options.runs.resolve()  # trainings run elsewhere
    names = options.only.split(",") if options.only else [each.name for each in ARCHITECTURES]
    known = {each.name: each for each in ARCHITECTURES}
    for name in names:
        if name not in known:
            raise MotionGenError(f"there is no architecture '{name}'; there are {', '.join(known)}")
    dataset, recogniser = Dataset.open(options.data), Recogniser.load(options.recogniser)
    training, held_back = (
        recogniser.features(real_positions(dataset, split, options.count)) for split in ("training", "held_back")
    )
    records = [record("real", "real motions for training", 0, compare(held_back, training))]
    for name in names:
        for seed in range(options.seeds):
            checkpoint = trained(known[name], seed, options)
            made = recogniser.features(made_positions(checkpoint, options.count))
            records.append(record(name, known[name].title, seed, compare(held_back, made)))
            print(json.dumps(records[-1]), file=sys.stderr)
    return write(options.out, records, command, options)


def trained(architecture: Architecture, seed: int, options: argparse.Namespace) -> Path:
    """The last checkpoint of its training, which goes on or begins if it has not ended.

    Raises:
        MotionGenError: if it fails.
    """
    folder = options.runs / f"{architecture.name}-{seed}"
    last = newest(folder / CHECKPOINTS)
    if last is None or int(last.name) < int(BUDGET["trainer.iterations"]):
        budget = [f"{name}={value}" for name, value in BUDGET.items()]
        given = [f"data={options.data}", f"output={folder}", f"trainer.seed={seed}", *architecture.settings, *budget]
        ended = subprocess.run([sys.executable, "-m", "train", "generator=modi", *given], check=False, cwd=ROOT)
        if ended.returncode:
            raise MotionGenError(f"the training of {folder} failed; what it said stands above")
        last = newest(folder / CHECKPOINTS)
    if last is None:
        raise MotionGenError(f"{folder}: the training left no checkpoint")
    return last


def real_positions(dataset: Dataset, split: str, count: int) -> NDArray[np.float32]:
    """(N, T, J, 3) positions of windows, in skeleton heights; the same at every call."""
    windows = dataset.draw(split, count, numpy_random(0, 0, f"real {split}"))
    return window_positions(dataset, windows)


def made_positions(checkpoint: Path, count: int) -> NDArray[np.float32]:
    """(N, T, J, 3) positions of motions of seeds, in skeleton heights."""
    card, weights = load_model(checkpoint)
    body = Body(card.layout, card.mean, card.deviation, card.frame_rate)
    z = torch.randn(count, card.network.latent_size, generator=torch.Generator().manual_seed(0))
    return network_positions(build_network(card, weights), body, card.network, z)


def record(name: str, title: str, seed: int, found: Comparison) -> dict[str, Any]:
    """A row of the CSV file."""
    return {"name": name, "title": title, "seed": seed, **{key: getattr(found, key).value for key in FIGURES}}


def write(out: Path, records: Sequence[Mapping[str, Any]], command: str, options: argparse.Namespace) -> Path:
    """`architectures.md` and `architectures.csv`."""
    out.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(records[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    with atomic_write(out / "architectures.csv") as file:
        file.write(text.getvalue().encode())
    paper = {each.name: each.paper for each in ARCHITECTURES}
    rows = [["architecture", *(f"{name} (paper)" for name in FIGURES)]]
    for name in dict.fromkeys(each["name"] for each in records):
        found = [each for each in records if each["name"] == name]
        cells = [_cell([each[figure] for each in found]) for figure in FIGURES]
        if name in paper:
            cells = [f"{cell} ({value:g})" for cell, value in zip(cells, paper[name])]
        rows.append([found[0]["title"], *cells])
    budget = ", ".join(f"`{name}={value}`" for name, value in BUDGET.items())
    threads = os.environ.get("OMP_NUM_THREADS", str(torch.get_num_threads()))
    lines = [
        "# MoDi's architectures, each trained for the same small budget",
        "",
        f"- Command: `{command}`",
        f"- Machine: {machine()}, {threads} threads",
        f"- Versions: motiongen {mg.__version__}, " + ", ".join(f"{k} {v}" for k, v in versions().items()),
        f"- Budget: {budget}",
        f"- {options.count} motions of each training against {options.count} held-back windows, as joint positions, "
        "by the features of the recogniser; mean and deviation over "
        f"{options.seeds} seeds. In brackets the paper's figures, of the full schedule on Mixamo (the last row: on "
        "HumanAct12) with another recogniser: compare the order, not the numbers.",
        "",
        *markdown_table(rows),
    ]
    page = out / "architectures.md"
    with atomic_write(page) as file:
        file.write(("\n".join(lines) + "\n").encode())
    return page


def _cell(values: Sequence[float]) -> str:
    mean = f"{np.mean(values):.3g}"
    return mean if len(values) == 1 else f"{mean} ± {np.std(values):.2g}"
