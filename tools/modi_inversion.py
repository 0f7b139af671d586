"""How well motions are inverted: `python -m tools.modi_inversion --checkpoint FOLDER --encoder FOLDER --data FOLDER`.

Windows of clips that the model was trained on, of clips that were held back, and of held-back clips mirrored, which no
clip of the data is, are brought to codes by gradient descent in W and in W+, by the encoder, and by gradient descent
from the encoder's codes. Written to OUT: `errors.csv`, `time.csv`, `time.png`, film strips of targets beside what their
codes decode to, and `inversion.md` with the tables. Without --encoder what needs one is left out. Seconds are processor
seconds on one core, for each window. Feet are not cleaned.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

import motiongen as mg
from motiongen.assets import BUNDLED_MODEL
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.files import atomic_path
from motiongen.generators.modi.alignment import bring
from motiongen.generators.modi.encoder import Encoder
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import Inversion, InversionOptions, descend, deviation_of_codes, judged
from motiongen.generators.modi.likeness import MotionError, mean_error
from motiongen.render import film_strip
from motiongen.report import markdown_table

Floats = NDArray[np.float32]

KINDS = ("training", "held_back", "mirrored")

STEPS = (10, 25, 50, 100, 200)
"""Of the searches whose quality is put against their time."""

FROM_GUESS = (5, 10, 25, 50, 100)
"""Likewise, of those that start from the encoder's codes."""

SHOWN = 4
"""Windows of a kind that are drawn."""

CREDIT = "Bandai-Namco-Research-Motiondataset, (c) Bandai Namco Research Inc., CC BY-NC 4.0"


@dataclass(frozen=True)
class Row:
    """A way to invert some windows, and what came of it.

    Attributes:
        motions: which windows.
        method: how they were inverted.
        steps: of gradient descent, at most.
        seconds: of processor time for each window.
        distance: of the codes from the mean code, in deviations of random codes.
        error: mean over the windows.
    """

    motions: str
    method: str
    steps: int
    seconds: float
    distance: float
    error: MotionError

    def cells(self) -> list[str]:
        """For a table."""
        cm = "" if self.error.position_cm is None else f"{self.error.position_cm:.1f}"
        return [
            self.motions.replace("_", "-"),
            self.method,
            f"{self.error.rotation_degrees:.2f}",
            f"{self.error.position_heights:.2%}",
            cm,
            f"{self.error.contact_disagreement:.1%}",
            f"{self.distance:.2f}",
            f"{self.seconds:.2f}",
        ]


HEADINGS = ["motions", "method", "rotation, degrees", "position, of the height", "position, cm", "contacts that differ",
            "code from the mean", "seconds a window"]  # fmt: skip


class Measure:
    """The model, its encoder if there is one, and how codes of windows are found and judged."""

    def __init__(self, generator: MoDi, encoder: Encoder | None, options: InversionOptions) -> None:
        """Take what is measured."""
        self.generator, self.encoder, self.options = generator, encoder, options
        self.deviation = float(deviation_of_codes(generator))
        self.found: dict[tuple[str, str], Floats] = {}  # the codes of each kind and method

    def row(self, kind: str, method: str, windows: Floats, find: Callable[[], Floats], steps: int = 0) -> Row:
        """One way to invert, timed and judged."""
        begun = time.process_time()
        codes = self.found[kind, method] = find()
        seconds = (time.process_time() - begun) / len(windows)
        away = float(np.sqrt(np.square(codes - self.generator.mean_latent()).mean())) / self.deviation
        row = Row(kind, method, steps, seconds, away, mean_error(self.judge(codes, windows).errors))
        print("  ".join(row.cells()), flush=True)
        return row

    def judge(self, codes: Floats, windows: Floats, name: str = "window") -> Inversion:
        """Codes beside what they stand for."""
        return judged(self.generator, codes, windows, [f"{name}_{k}" for k in range(len(windows))], ())

    def search(self, windows: Floats, guess: Floats | None = None, **changes: object) -> Floats:
        """Codes by gradient descent."""
        options = InversionOptions.build(self.options.to_dict() | changes)
        return descend(self.generator, windows, options, guess=guess)[0]

    def refine(self, windows: Floats, **changes: object) -> Floats:
        """Codes by gradient descent from the encoder's."""
        return self.search(windows, None if self.encoder is None else self.encoder.codes(windows), **changes)

    def mean(self, windows: Floats) -> Floats:
        """The mean code for each, which does not look at them."""
        return np.tile(self.generator.mean_latent(), (len(windows), self.generator.latent_layers, 1))

    def errors(self, kind: str, windows: Floats) -> list[Row]:
        """All methods on windows of a kind."""
        steps = self.options.steps
        steps, search = self.options.steps, partial(self.search, windows)
        rows = [
            self.row(kind, "mean code", windows, partial(self.mean, windows)),
            self.row(kind, "optimiser, W", windows, partial(search, space="W"), steps),
            self.row(kind, "optimiser, W+", windows, search, steps),
        ]
        if self.encoder is not None:
            rows += [
                self.row(kind, "encoder", windows, partial(self.encoder.codes, windows)),
                self.row(kind, "both, W+", windows, partial(self.refine, windows), steps),
            ]
        return rows

    def times(self, kind: str, windows: Floats) -> list[Row]:
        """Quality against time."""
        rows = [
            self.row(kind, "optimiser", windows, partial(self.search, windows, steps=steps), steps) for steps in STEPS
        ]
        if self.encoder is not None:
            rows.append(self.row(kind, "encoder", windows, partial(self.encoder.codes, windows)))
            rows += [
                self.row(kind, "both", windows, partial(self.refine, windows, steps=steps), steps)
                for steps in FROM_GUESS
            ]
        return rows


def windows_of(generator: MoDi, dataset: Dataset, kind: str, count: int) -> Floats:
    """(N, T, E, 4) windows of entities of a kind; the mirrored ones are those held back, in a mirror."""
    chosen = dataset.draw("training" if kind == "training" else "held_back", count, np.random.default_rng(0))
    if kind != "mirrored":
        return dataset.batch(chosen, standardised=False)
    frames = dataset.window_frames
    tracks = {clip: bring(generator.card, dataset.clip(clip).mirror()) for clip in np.unique(chosen[:, 0]).tolist()}
    return np.stack([tracks[clip].window(start, frames) for clip, start in chosen.tolist()])


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """The figures of all rows."""
    with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        plain = [asdict(row) for row in rows]
        flat = [{**{k: v for k, v in row.items() if k != "error"}, **row["error"]} for row in plain]
        writer.writerow(flat[0])
        writer.writerows(
            [f"{value:.6g}" if isinstance(value, float) else value for value in row.values()] for row in flat
        )


def draw_times(path: Path, rows: Sequence[Row]) -> None:
    """Rotation and position error against time."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for method in dict.fromkeys(row.method for row in rows):
        some = [row for row in rows if row.method == method]
        seconds = [row.seconds for row in some]
        left.plot(seconds, [row.error.rotation_degrees for row in some], "o-", label=method)
        right.plot(seconds, [100 * row.error.position_heights for row in some], "o-", label=method)
    for axes, what in ((left, "rotation error, degrees"), (right, "position error, % of the height")):
        axes.set(xlabel="processor seconds a window", ylabel=what, xscale="log", yscale="log")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize="small")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=100)


def draw_pairs(path: Path, found: Inversion) -> None:
    """Targets beside what their codes decode to."""
    pairs = list(zip(found.targets, found.motions))[:SHOWN]
    motions = [motion for pair in pairs for motion in pair]
    with atomic_path(path) as temporary:
        film_strip(motions, [label for _ in pairs for label in ("target", "decoded")], size=(1400, 2000)).save(
            temporary
        )


def page(command: str, measure: Measure, errors: Sequence[Row], times: Sequence[Row], count: int, foreign: str) -> str:
    """The results as Markdown."""
    card, options = measure.generator.card, measure.options
    kinds = list(dict.fromkeys(row.motions for row in errors))
    table = [HEADINGS, *(row.cells() for row in errors)]
    timed = [["method", "steps", *HEADINGS[2:6], HEADINGS[7]]]
    timed += [[row.method, str(row.steps), *row.cells()[2:6], row.cells()[7]] for row in times]
    lines = [
        "# MoDi: inversion",
        "",
        f"Written by `{command}`. Checkpoint of {card.iteration} iterations; {count} windows of {card.network.frames} "
        f"frames of each kind; {options.steps} steps from {options.starts} of {options.candidates} random codes. Means "
        "over frames, joints and windows, both roots starting at the origin; feet are not cleaned. Processor seconds "
        "on one core. Mirrored: held-back windows in a mirror, which no clip of the data is.",
        "",
        *([foreign, ""] if foreign else []),
        *markdown_table(table),
        "",
        "## Quality against time",
        "",
        f"{count} held-back windows, W+. Both: gradient descent from the encoder's codes, whose time is in it.",
        "",
        *markdown_table(timed),
        "",
        "![quality against time](time.png)",
        "",
        "## Targets and what their codes decode to",
        "",
        f"Optimiser, W+. {CREDIT}.",
        "",
    ]
    lines += [line for kind in kinds for line in (f"![{kind}]({kind}.png)", "")]
    return "\n".join(lines)


def refusal(generator: MoDi, path: Path | None) -> str:
    """What becomes of a clip of another source."""
    if path is None:
        return ""
    try:
        bring(generator.card, mg.load(path))
    except MotionGenError as error:
        return f"A clip of another source is refused: {error}."
    return f"The clip '{path.stem}' of another source has the checkpoint's skeleton."


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_inversion", description=__doc__)
    parser.add_argument("--checkpoint", type=Path, default=BUNDLED_MODEL)
    parser.add_argument("--encoder", type=Path)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--foreign", type=Path, help="a clip of another source, to see whether it can be brought over")
    parser.add_argument("--out", type=Path, default=Path("docs/results/modi/inversion"))
    parser.add_argument("--windows", type=int, default=8)
    parser.add_argument("--steps", type=int, default=InversionOptions().steps)
    given = parser.parse_args()
    torch.set_num_threads(1)
    generator = mg.create("modi", checkpoint=str(given.checkpoint), clean_feet=False)
    assert isinstance(generator, MoDi)
    encoder = None if given.encoder is None else Encoder.load(given.encoder, generator)
    measure = Measure(generator, encoder, InversionOptions(steps=given.steps))
    dataset = Dataset.open(given.data)
    given.out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for kind in KINDS:
        windows = windows_of(generator, dataset, kind, given.windows)
        rows += measure.errors(kind, windows)
        draw_pairs(given.out / f"{kind}.png", measure.judge(measure.found[kind, "optimiser, W+"], windows, kind))
    times = measure.times("held_back", windows_of(generator, dataset, "held_back", given.windows))
    write_csv(given.out / "errors.csv", rows)
    write_csv(given.out / "time.csv", times)
    draw_times(given.out / "time.png", times)
    command = "python -m tools.modi_inversion --checkpoint FOLDER --data FOLDER" + (
        " --encoder FOLDER" if encoder else ""
    )
    text = page(command, measure, rows, times, given.windows, refusal(generator, given.foreign))
    with atomic_path(given.out / "inversion.md") as temporary:
        temporary.write_text(text)


if __name__ == "__main__":
    main()
