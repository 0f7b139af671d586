"""What directions of MoDi's latent space change: `python -m tools.modi_directions OUT [--checkpoint FOLDER]`.

For every attribute a direction is learnt, and made orthogonal to those of other attributes; held-out samples and
inverted clips are moved along it. OUT gets the page directions.md with its tables as CSV and its pictures.
With --bundle the directions are written into the checkpoint's folder, where `motiongen edit` finds them. Needs
scikit-learn and matplotlib (extras `latent` and `plots`).
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import motiongen as mg
from motiongen.assets import BUNDLED_MODEL
from motiongen.attributes import Attribute, attribute_of, attributes_for
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.files import atomic_path, atomic_write
from motiongen.generators.modi.directions import (
    FOLDER,
    Direction,
    fit_direction,
    make_orthogonal,
    move,
    save_direction,
    scores_along,
    scores_of,
)
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.model_files import SUFFIX
from motiongen.motion import Motion
from motiongen.render import film_strip
from motiongen.report import markdown_table

Array = NDArray[np.float64]

STRENGTHS = (-2.0, -1.0, 0.0, 1.0, 2.0)
BELOW, ABOVE = STRENGTHS.index(-1.0), STRENGTHS.index(1.0)

SAME = 0.7
"""Attributes whose scores correlate by more than this are nearly one, and their directions not made orthogonal."""

SLACK = 0.1
"""A score that falls by less than this share of its deviation stays where it is: who stands, stands at any strength."""

PLAIN, ORTHOGONAL = "plain", "orthogonal"

SHOWN = ("gral", "hand_height", "speed")
"""The attributes that pictures are made of."""


@dataclass(frozen=True)
class Moved:
    """Scores of codes moved along one direction.

    Attributes:
        direction: which.
        kind: `PLAIN` or `ORTHOGONAL`.
        scores: (K, N, A) at each strength.
    """

    direction: Direction
    kind: str
    scores: Array

    def of(self, attribute: int) -> Array:
        """(K, N) the scores of one attribute."""
        return np.asarray(self.scores[:, :, attribute])

    def change(self, deviations: Array) -> Array:
        """(A,) mean change of each attribute for a step of strength 1, in the attribute's own deviations."""
        return np.asarray((self.scores[ABOVE] - self.scores[BELOW]).mean(axis=0) / 2 / deviations)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and write the page. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_directions", description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--checkpoint", help="folder of the model; the one that comes along by default")
    parser.add_argument("--data", type=Path, help="dataset whose held-back clips are inverted and moved")
    parser.add_argument("--samples", type=int, default=3000, help="from which directions are learnt")
    parser.add_argument("--moved", type=int, default=40, help="further samples that are moved along them")
    parser.add_argument("--clips", type=int, default=12, help="clips that are inverted")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bundle", action="store_true", help="keep the directions with the checkpoint")
    options = parser.parse_args(arguments)
    try:
        torch.set_num_threads(1)
        print(measure(options))
    except MotionGenError as error:
        print(f"modi_directions: {error}", file=sys.stderr)
        return 2
    return 0


def measure(options: argparse.Namespace) -> str:
    """Learn, move, write. Returns what to say."""
    begun = time.perf_counter()
    generator: Any = mg.create("modi", checkpoint=options.checkpoint)
    known = list(attributes_for(generator.decode(generator.latents(1, options.seed))[0]).values())
    codes = generator.latents(options.samples, options.seed)
    scores = scores_of(generator, codes, known, said("samples"))
    deviations = scores.std(axis=0)
    directions = learn(known, codes, scores, options.seed)
    others = generator.latents(options.moved, options.seed + 1)
    moved = [along(generator, each, kind, known, others) for kind, row in directions.items() for each in row]
    real = inverted(generator, options)
    clips = [] if real is None else [along(generator, each, PLAIN, known, real) for each in directions[PLAIN]]
    options.out.mkdir(parents=True, exist_ok=True)
    write_csv(options.out / "directions.csv", figures(moved, known, deviations))
    write_csv(options.out / "disentanglement.csv", disentanglement(moved, known, deviations))
    draw_matrices(options.out / "disentanglement.png", moved, known, deviations)
    shown = [name for name in SHOWN if name in [each.name for each in known]]
    for name in shown:
        draw_edit(options.out / f"edit_{name}.png", generator, name, moved, known, others)
    page = [
        *("# Directions of the latent space", ""),
        *written_by(options, generator, time.perf_counter() - begun),
        *tables(known, moved, clips, deviations),
        *pictures(shown, options.moved),
    ]
    with atomic_write(options.out / "directions.md") as file:
        file.write(("\n".join(page) + "\n").encode())
    if options.bundle:
        bundle(generator, moved, known, deviations)
    return f"{options.out / 'directions.md'}: {len(known)} attributes in {time.perf_counter() - begun:.0f} s"


def learn(known: Sequence[Attribute], codes: Any, scores: Array, seed: int) -> dict[str, list[Direction]]:
    """The direction of each attribute, and the same orthogonal to those of the attributes that are not nearly it."""
    plain = [fit_direction(each.name, codes, column, seed) for each, column in zip(known, scores.T)]
    alike = np.abs(np.corrcoef(scores, rowvar=False)) > SAME  # (A, A)
    orthogonal = []
    for index, each in enumerate(plain):
        others = [other for other, same in zip(plain, alike[index]) if not same]
        orthogonal.append(make_orthogonal(each, others, codes, scores[:, index], seed) if others else each)
    return {PLAIN: plain, ORTHOGONAL: orthogonal}


def along(generator: MoDi, direction: Direction, kind: str, known: Sequence[Attribute], codes: Any) -> Moved:
    """Move codes and score the motions."""
    progress = said(f"{direction.name}, {kind}")
    return Moved(direction, kind, scores_along(generator, direction, known, codes, STRENGTHS, progress=progress))


def inverted(generator: MoDi, options: argparse.Namespace) -> Any:
    """(N, L, S) the codes of held-back windows, or None without data."""
    if options.data is None or options.clips == 0:
        return None
    dataset = Dataset.open(options.data)
    windows = dataset.draw("held_back", options.clips, np.random.default_rng(options.seed))
    codes, progress = [], said("inversion")
    for index, window in enumerate(dataset.batch(windows, standardised=False)):
        motion = dataset.to_motion(window, standardised=False)
        codes.append(generator.invert(motion, options.seed))
        progress((index + 1) / len(windows))
    return np.stack(codes)


def bundle(generator: MoDi, moved: Sequence[Moved], known: Sequence[Attribute], deviations: Array) -> None:
    """Write the plain directions where `kept_direction` looks for them."""
    folder = Path(generator.options.checkpoint or BUNDLED_MODEL) / FOLDER
    folder.mkdir(exist_ok=True)
    for index, each in enumerate(moved[: len(known)]):
        measured = dataclasses.replace(each.direction, change=float(each.change(deviations)[index]))
        save_direction(folder / f"{each.direction.name}{SUFFIX}", generator, measured)


def said(what: str) -> Any:
    """A progress function that says what is being done, once, on standard error."""
    print(what, file=sys.stderr)
    return lambda share: None


# -- figures


def rising(scores: Array, deviation: float) -> tuple[float, float]:
    """How scores (K, N) go from strength to strength.

    Returns:
        The share of codes whose score ends higher and never falls by more than `SLACK` of the deviation, and the share
        of those that end higher.
    """
    higher = scores[-1] > scores[0]
    never_falls = (np.diff(scores, axis=0) >= -SLACK * deviation).all(axis=0)
    return float((higher & never_falls).mean()), float(higher.mean())


def figures(moved: Sequence[Moved], known: Sequence[Attribute], deviations: Array) -> list[dict[str, Any]]:
    """A row for each direction."""
    names = [each.name for each in known]
    rows = []
    for each in moved:
        index = names.index(each.direction.name)
        change = each.change(deviations)
        monotone, higher = rising(each.of(index), deviations[index])
        rows.append(
            {
                "direction": each.direction.name,
                "kind": each.kind,
                "accuracy": each.direction.accuracy,
                "spread": each.direction.spread,
                "monotone": monotone,
                "higher": higher,
                "change": change[index],
                "others": np.abs(np.delete(change, index)).mean(),
                "others_most": np.abs(np.delete(change, index)).max(),
                "others_most_name": names[int(np.argmax(np.where(np.arange(len(names)) == index, 0, np.abs(change))))],
                "score_mean": each.direction.score_mean,
                "score_deviation": each.direction.score_deviation,
            }
        )
    return rows


def disentanglement(moved: Sequence[Moved], known: Sequence[Attribute], deviations: Array) -> list[dict[str, Any]]:
    """A row for each direction, a column for each attribute: `Moved.change`."""
    return [
        {"direction": each.direction.name, "kind": each.kind}
        | {attribute.name: change for attribute, change in zip(known, each.change(deviations))}
        for each in moved
    ]


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: f"{value:.4f}" if isinstance(value, float) else value for name, value in row.items()})
    with atomic_write(path) as file:
        file.write(text.getvalue().encode())


# -- the page


def written_by(options: argparse.Namespace, generator: MoDi, seconds: float) -> list[str]:
    """How the page came about."""
    data = "" if options.data is None else " --data DATASET"
    checkpoint = "" if options.checkpoint is None else " --checkpoint FOLDER"
    command = f"python -m tools.modi_directions OUT{checkpoint}{data} --samples {options.samples}"
    return [
        f"Made by `{command}` in {seconds:.0f} s on one core, with a model of {generator.card.iteration:,} iterations. "
        f"Directions are learnt from {options.samples:,} random motions and judged on {options.moved} others, moved by "
        "-2 to 2 deviations of random codes along the direction, before feet are cleaned.",
        "",
        "*Accuracy*: held-out samples of the upper and lower third on their side of the boundary (chance: 50%). "
        f"*Monotone*: moved motions whose score ends higher and, from each of the five strengths to the next, never "
        f"falls by more than {SLACK:g} of its deviations; *higher*: those that end higher. *Change*: of the score for "
        "a step of one, in its deviations. *Others*: the mean size of what it changes of the other attributes, in "
        "theirs, and the largest.",
        "",
        "Orthogonal directions are the plain ones without their parts along those of the other attributes, but for "
        f"attributes whose scores correlate by more than {SAME:g}: these are nearly one.",
        "",
    ]


def tables(known: Sequence[Attribute], moved: Sequence[Moved], clips: Sequence[Moved], deviations: Array) -> list[str]:
    """The tables, with their headings."""
    meanings = [["attribute", "mean", "deviation", "what it is"]]
    by_name = {row["direction"]: row for row in figures(moved[: len(known)], known, deviations)}
    for each in known:
        row = by_name[each.name]
        meanings.append([each.name, f"{row['score_mean']:.3f}", f"{row['score_deviation']:.3f}", each.summary])
    lines = ["## Attributes", "", *markdown_table(meanings), ""]
    for kind in (PLAIN, ORTHOGONAL):
        part = [each for each in moved if each.kind == kind]
        lines += [f"## {kind.capitalize()} directions", "", *direction_table(part, known, deviations), ""]
        lines += ["What a step of one changes of every attribute, in its deviations:", ""]
        lines += [*change_table(part, known, deviations), ""]
    if clips:
        count = clips[0].scores.shape[1]
        lines += [f"## Inverted clips ({count} held-back ones, plain directions)", ""]
        lines += [*direction_table(clips, known, deviations), ""]
    return lines


def direction_table(moved: Sequence[Moved], known: Sequence[Attribute], deviations: Array) -> list[str]:
    head = ["direction", "accuracy", "monotone", "higher", "change", "others", "largest of them"]
    rows = [
        [
            row["direction"],
            *(f"{row[name]:.0%}" for name in ("accuracy", "monotone", "higher")),
            f"{row['change']:+.2f}",
            f"{row['others']:.2f}",
            f"{row['others_most']:.2f} {row['others_most_name']}",
        ]
        for row in figures(moved, known, deviations)
    ]
    return markdown_table([head, *rows])


def change_table(moved: Sequence[Moved], known: Sequence[Attribute], deviations: Array) -> list[str]:
    head = ["direction", *(each.name for each in known)]
    rows = [[each.direction.name, *(f"{change:+.2f}" for change in each.change(deviations))] for each in moved]
    return markdown_table([head, *rows])


def pictures(shown: Sequence[str], count: int) -> list[str]:
    """The lines that show the pictures."""
    lines = ["## Pictures", "", "![What each direction changes](disentanglement.png)"]
    for name in shown:
        lines += [
            "",
            f"The one of the {count} moved motions whose {name} changes by the median, from strength -2 to 2, with its "
            "score:",
            "",
            f"![Along {name}](edit_{name}.png)",
        ]
    return lines


def draw_matrices(path: Path, moved: Sequence[Moved], known: Sequence[Attribute], deviations: Array) -> None:
    """What a step along each direction changes, as two heat maps."""
    from matplotlib.figure import Figure

    names = [each.name for each in known]
    figure = Figure(figsize=(15, 7), layout="constrained")
    for axes, kind in zip(figure.subplots(1, 2, sharey=True), (PLAIN, ORTHOGONAL)):
        values = np.stack([each.change(deviations) for each in moved if each.kind == kind])
        image = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
        axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
        axes.set_yticks(range(len(names)), names)
        axes.set(title=f"{kind} directions", xlabel="what changes, in its deviations", ylabel="direction")
        for (row, column), value in np.ndenumerate(values):
            colour = "white" if abs(value) > 0.6 else "black"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7, color=colour)
    figure.colorbar(image, ax=figure.axes, shrink=0.8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=70)


def draw_edit(
    path: Path, generator: MoDi, name: str, moved: Sequence[Moved], known: Sequence[Attribute], codes: Any
) -> None:
    """The motion of median change along a direction, one strength a row."""
    along = next(each for each in moved if each.direction.name == name and each.kind == PLAIN)
    scores = along.of([each.name for each in known].index(name))
    chosen = int(np.argsort(scores[-1] - scores[0])[scores.shape[1] // 2])
    motions: list[Motion] = generator.decode(move(codes[chosen : chosen + 1], along.direction, STRENGTHS)[:, 0])
    attribute = attribute_of(name)
    labels = [f"{strength:+g}: {attribute.score(motion):.2f}" for strength, motion in zip(STRENGTHS, motions)]
    with atomic_path(path) as temporary:
        film_strip(motions, labels, poses=8, size=(1400, 900)).save(temporary)


if __name__ == "__main__":
    sys.exit(main())
