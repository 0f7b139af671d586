"""`motiongen evaluate`: made motions beside real ones, as a Hydra application over `configs/evaluate.yaml`."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motiongen.assets import BUNDLED_RECOGNISER
from motiongen.commands.hydra_app import run_command
from motiongen.commands.inputs import Inputs, load_examples, read_input
from motiongen.commands.settings import chosen_generator, up_and_unit, whole
from motiongen.console import progress_bar
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.options import Options
from motiongen.generators.registry import GeneratorSpec
from motiongen.metrics.distribution import Comparison, compare
from motiongen.metrics.physical import Physical, measure_physical

if TYPE_CHECKING:
    from motiongen.generators.base import Generator
    from motiongen.recognition import Recogniser

LEAST = 10
"""Fewer motions than this tell nothing."""

PHYSICAL = 200
"""Motions of which the physical figures are taken; their means vary little."""

MADE, HELD_BACK = "generator", "real, held back"

TRAINING = "real, training"
"""The floor: as near as motions come that are not the held-back ones themselves."""

SHUFFLED, NOISE = "real, frames shuffled", "noise"
"""The ceiling: poses without movement, and the mean and deviation of each number of a motion without anything else."""

FIGURES = {"fid": "FID ↓", "kid": "KID ↓", "precision": "precision ↑", "recall": "recall ↑", "diversity": "diversity"}

PHYSICAL_FIGURES = {
    "foot_skate_heights_per_second": "foot skate (heights/s)",
    "jitter_heights_per_second_cubed": "jitter (heights/s³)",
    "penetration_heights": "ground penetration (heights)",
    "bone_stretch": "bone stretch",
}


@dataclass(frozen=True)
class Request:
    """A composed configuration, checked."""

    data: str
    recogniser: Path
    spec: GeneratorSpec
    options: Options
    inputs: Inputs
    up: str | None
    unit: str | None
    count: int
    resamples: int
    seed: int


@dataclass(frozen=True)
class Evaluation:
    """What came of it.

    Attributes:
        run: what was evaluated, and by what.
        comparisons: each set beside held-back motions.
        physical: of made and held-back motions.
    """

    run: dict[str, Any]
    comparisons: dict[str, Comparison]
    physical: dict[str, Physical]

    def save(self, folder: Path) -> list[Path]:
        """Write `evaluation.json` and `evaluation.md` into a folder; their paths."""
        data = {
            **self.run,
            "comparisons": {name: each.to_dict() for name, each in self.comparisons.items()},
            "physical": {name: each.to_dict() for name, each in self.physical.items()},
        }
        texts = {"evaluation.json": json.dumps(data, indent=1, ensure_ascii=False) + "\n", "evaluation.md": self.page()}
        for name, text in texts.items():
            with atomic_write(folder / name) as file:
                file.write(text.encode())
        return [folder / name for name in texts]

    def tables(self) -> list[list[list[str]]]:
        """Rows of cells of the two tables, headings first."""
        compared = [["beside held-back motions", *FIGURES.values()]]
        compared += [
            [name, *(str(getattr(each, figure)) for figure in FIGURES)] for name, each in self.comparisons.items()
        ]
        measured = [["what a body cannot do", *PHYSICAL_FIGURES.values()]]
        measured += [[name, *map(_figure, each.to_dict().values())] for name, each in self.physical.items()]
        return [compared, measured]

    def page(self) -> str:
        """The evaluation in Markdown."""
        run, known = self.run, self.run["recogniser"]
        accuracy = "of unknown accuracy" if known["accuracy"] is None else f"{known['accuracy']:.1%} accurate"
        lines = [
            f"# Evaluation of {run['generator']}",
            "",
            f"{run['count']} motions of {run['frames']} frames, seed {run['seed']}, beside as many real ones that "
            f"training has not seen, by the features of a recogniser of {known['classes']} classes of "
            f"`{known['label']}` ({accuracy} on what it has not seen). In brackets: where 95 of 100 others from as "
            "many motions would lie.",
        ]
        for table in self.tables():
            head, *rows = ["| " + " | ".join(row) + " |" for row in table]
            lines += ["", head, "|" + " --- |" * len(table[0]), *rows]
        lines += ["", "Options:", "", *(f"- `{name}`: {value}" for name, value in run["options"].items())]
        return "\n".join(lines) + "\n"


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_command(_evaluate, "evaluate", arguments)


def _evaluate(values: dict[str, Any], folder: Path) -> None:
    evaluation = evaluate(_request(values))
    files = evaluation.save(folder)
    for table in evaluation.tables():
        print("\n".join(_aligned(table)), end="\n\n")
    print(f"in {folder}: {', '.join(path.name for path in files)}")


def _request(values: Mapping[str, Any]) -> Request:
    spec, options = chosen_generator(values["generator"])
    if values["data"] is None:
        raise MotionGenError("data=FOLDER is missing; make one with `motiongen data import CLIPS FOLDER`")
    up, unit = up_and_unit(values)
    return Request(
        data=str(values["data"]),
        recogniser=BUNDLED_RECOGNISER if values["recogniser"] is None else Path(str(values["recogniser"])),
        spec=spec,
        options=spec.options_type().build(options),
        inputs=read_input(values["input"], needed=not spec.capabilities.needs_training),
        up=up,
        unit=unit,
        count=whole("count", values["count"], LEAST),
        resamples=whole("resamples", values["resamples"], 2),
        seed=whole("seed", values["seed"], 0),
    )


def evaluate(request: Request) -> Evaluation:
    """Make motions and compare them with real ones.

    Raises:
        MotionGenError: if dataset, recogniser and generator do not fit together, or nothing was held back.
    """
    from motiongen.recognition import Recogniser
    from motiongen.recognition.positions import window_positions

    begun = time.perf_counter()
    dataset, recogniser = Dataset.open(request.data), Recogniser.load(request.recogniser)
    _check_recogniser(recogniser, dataset)
    real = dataset.draw("held_back", request.count, _random(request, HELD_BACK))
    generator = _fitted(request, dataset)
    frames = round(dataset.window_frames * generator.frame_rate / dataset.frame_rate)
    with progress_bar("sampling") as progress:
        made = generator.sample(frames, request.count, request.seed, progress=progress)
    features = {MADE: recogniser.features(recogniser.of_motions(made)), **_yardsticks(request, dataset, recogniser)}
    seen = recogniser.features(window_positions(dataset, real))
    with progress_bar("comparing") as progress:
        comparisons = {}
        for name, each in features.items():
            comparisons[name] = compare(seen, each, request.resamples, request.seed)
            progress(len(comparisons) / len(features))
    windows = dataset.batch(real[:PHYSICAL], standardised=False)
    shown = {MADE: made[:PHYSICAL], HELD_BACK: [dataset.to_motion(window, standardised=False) for window in windows]}
    card = recogniser.card
    record = {
        "generator": request.spec.name,
        "options": request.options.to_dict(),
        "examples": [str(path) for path in request.inputs.clips],
        "data_fingerprint": dataset.fingerprint,
        "recogniser": {
            "label": card.label,
            "classes": len(card.classes),
            "accuracy": card.accuracy,
            "data_fingerprint": card.data_fingerprint,
        },
        "count": request.count,
        "frames": frames,
        "frame_rate_hz": generator.frame_rate,
        "resamples": request.resamples,
        "seed": request.seed,
        "seconds": time.perf_counter() - begun,
    }
    feet = dataset.layout.feet
    return Evaluation(record, comparisons, {name: measure_physical(each, feet) for name, each in shown.items()})


def _check_recogniser(recogniser: Recogniser, dataset: Dataset) -> None:
    card = recogniser.card
    found = card.skeleton.difference(dataset.skeleton)
    if found is None and card.frame_rate != dataset.frame_rate:
        found = f"it runs at {dataset.frame_rate:g} Hz and not at {card.frame_rate:g} Hz"
    if found is not None:
        raise MotionGenError(
            f"the dataset is not of the kind that the recogniser knows: {found}; train one on it with "
            "`python -m train.recogniser` and name it as recogniser=FOLDER"
        )


def _fitted(request: Request, dataset: Dataset) -> Generator:
    """The generator, if it makes motions on the dataset's skeleton."""
    given = load_examples(request.inputs, request.up, request.unit)
    generator = request.spec.create(request.options)
    if given.clips:
        generator.fit(given.clips)
    ignoring = given.clips[0].translating if given.clips else ()
    if found := dataset.skeleton.difference(generator.skeleton, ignoring):
        cure = "name clips of the dataset's skeleton as input" if given.clips else "take a checkpoint trained on it"
        raise MotionGenError(
            f"generator={request.spec.name} makes motions on another skeleton than the dataset's: {found}; {cure}"
        )
    return generator


def _yardsticks(request: Request, dataset: Dataset, recogniser: Recogniser) -> dict[str, NDArray[np.float32]]:
    """Features of the floor and of the ceiling."""
    from motiongen.recognition.positions import positions_of, window_positions

    real = window_positions(dataset, dataset.draw("training", request.count, _random(request, TRAINING)))
    shuffled = _random(request, SHUFFLED).permuted(np.arange(real.shape[1])[None].repeat(len(real), axis=0), axis=1)
    noise = _random(request, NOISE).standard_normal((request.count, dataset.window_frames, *dataset.mean.shape))
    noise = noise * dataset.deviation + dataset.mean
    return {
        TRAINING: recogniser.features(real),
        SHUFFLED: recogniser.features(np.take_along_axis(real, shuffled[:, :, None, None], axis=1)),
        NOISE: recogniser.features(positions_of(noise, dataset.layout)),
    }


def _random(request: Request, purpose: str) -> np.random.Generator:
    """Random numbers of one set; nothing else changes them."""
    return np.random.default_rng([request.seed, *purpose.encode()])


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _aligned(table: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table for the terminal."""
    widths = [max(map(len, column)) for column in zip(*table)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in table]
