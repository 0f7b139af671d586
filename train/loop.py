"""A run of training from its first step, or its last checkpoint, to its end, with everything that is kept of it."""

from __future__ import annotations

import json
import math
import platform
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from motiongen.console import progress_bar
from motiongen.errors import MotionGenError
from motiongen.files import TEMPORARY, atomic_write, new_folder
from train.modi import Figures, ModiTraining
from train.settings import TrainerSettings
from train.watch import Watch

CHECKPOINTS, BEST = "checkpoints", "best"

COLLAPSED = 0.02
"""Made motions that differ from each other less than this share of what real ones do have become one."""

MAY_CHANGE = (
    *("iterations", "device", "log_every", "picture_every", "checkpoint_every", "keep", "measured"),
    *("recogniser", "evaluate_every"),
)
"""Settings that a run may go on with another value of; its model card leaves them out."""

COLLAPSE_PATIENCE = 5
"""So many looks in a row must find them so."""


def run(training: ModiTraining, folder: Path, record: Mapping[str, Any], start: Path | None = None) -> dict[str, Any]:
    """Train to the last iteration; goes on from the newest checkpoint in the folder, if there is one.

    Args:
        training: networks and data.
        folder: for checkpoints, logs, pictures and clips.
        record: the composed configuration; kept, with the data's fingerprint and versions.
        start: another training's checkpoint, to begin from where the folder has none yet.

    Returns:
        What came of it: iterations, seconds, the best distance, and where its checkpoint, or else the last one, is.

    Raises:
        MotionGenError: if the folder holds another training, numbers are no longer finite, the motions have become one,
            or something cannot be written.
    """
    settings, workers = training.settings, training.workers
    best = float(_resume(training, folder / CHECKPOINTS, start).get("best_distance", math.inf))
    if workers.leads:
        record = {**record, "data_fingerprint": training.dataset.fingerprint, "versions": versions()}
        _begin(folder, record)
    begun, first = time.perf_counter(), training.iteration
    with _watched(training, folder) as watch, _progress(training) as advance:
        watch.describe(record)
        figures: Figures = {}  # of the last step, and of terms that not every step has, the last there were
        alike = 0
        while training.iteration < settings.iterations:
            figures |= training.step()
            done = training.iteration
            log, look, keep, judge = _due(settings, done)
            if log or look or keep:
                values = checked(figures, training, folder)
            if log:
                alike = alike + 1 if values["spread/fake"] < COLLAPSED else 0
                if alike == COLLAPSE_PATIENCE:
                    raise _stopped(training, folder, "all motions have become one")
                speed = (done - first) / (time.perf_counter() - begun)
                watch.figures(done, values | {"speed/iterations_per_second": speed})
            if look and (distance := watch.look(training)) < best:
                best = distance
                _save_best(training, folder, {"best_distance": best})
            if judge:
                watch.judge(training)
            if keep:
                _save(training, folder / CHECKPOINTS, {"best_distance": best})
            advance(done / settings.iterations)
    workers.wait()
    return {
        "iterations": training.iteration,
        "seconds": time.perf_counter() - begun,
        "best_distance": best,
        "checkpoint": str(folder / BEST if (folder / BEST).exists() else newest(folder / CHECKPOINTS)),
    }


def _due(settings: TrainerSettings, done: int) -> tuple[bool, ...]:
    """Whether to log, to look, to keep a checkpoint and to judge after so many iterations: after the last, all."""
    intervals = settings.log_every, settings.picture_every, settings.checkpoint_every, settings.evaluate_every
    return tuple(done == settings.iterations or done % every == 0 for every in intervals)


def checked(figures: Figures, training: ModiTraining, folder: Path) -> dict[str, float]:
    """The figures as numbers, means over all processes.

    Raises:
        MotionGenError: in all processes, if one of them or a weight is not finite.
    """
    numbers = torch.stack([figure.float() for figure in figures.values()])
    training.workers.average([numbers])
    values = dict(zip(figures, numbers.tolist()))
    for name, value in values.items():
        if not math.isfinite(value):
            raise _stopped(training, folder, f"{name} is {value}")
    if not training.is_finite():
        raise _stopped(training, folder, "a weight is not finite")
    return values


def versions() -> dict[str, str]:
    """Of what the numbers depend on."""
    packages = ("motiongen", "torch", "numpy")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def newest(checkpoints: Path) -> Path | None:
    """The checkpoint with the highest iteration."""
    found = sorted(checkpoints.glob("[0-9]*")) if checkpoints.is_dir() else []
    return found[-1] if found else None


def _stopped(training: ModiTraining, folder: Path, why: str) -> MotionGenError:
    last = newest(folder / CHECKPOINTS)
    good = "there is no checkpoint before it" if last is None else f"the last good checkpoint is {last}"
    return MotionGenError(
        f"training stopped at iteration {training.iteration}, for {why}; {good}; try a lower learning rate"
    )


def _begin(folder: Path, record: Mapping[str, Any]) -> None:
    """Keep what the run is, and clear away what a killed one has left half-written."""
    folder.mkdir(parents=True, exist_ok=True)
    for left in (*folder.glob(f"{TEMPORARY}*"), *(folder / CHECKPOINTS).glob(f"{TEMPORARY}*")):
        shutil.rmtree(left, ignore_errors=True)
    with atomic_write(folder / "run.json") as file:
        file.write(json.dumps(record, indent=1).encode())


def _resume(training: ModiTraining, checkpoints: Path, start: Path | None) -> dict[str, Any]:
    last = newest(checkpoints)
    if last is None:
        if start is not None:
            training.load(start, own=False)
        return {}
    kept = training.load(last)
    before, now = dict(kept["settings"]), training.settings.to_dict()
    for name in MAY_CHANGE:
        before[name] = now[name]
    if changed := sorted(name for name in now if before.get(name) != now[name]):
        raise MotionGenError(
            f"{last}: was trained with {changed[0]}={before.get(changed[0])}, not {now[changed[0]]}; give the same, or "
            "another output"
        )
    return kept


def _save(training: ModiTraining, checkpoints: Path, record: Mapping[str, Any]) -> None:
    if training.workers.leads:
        checkpoints.mkdir(parents=True, exist_ok=True)
        target = checkpoints / f"{training.iteration:08d}"
        if not target.exists():
            training.save(target, record)
        for old in sorted(checkpoints.glob("[0-9]*"))[: -training.settings.keep]:
            shutil.rmtree(old)
    training.workers.wait()


def _save_best(training: ModiTraining, folder: Path, record: Mapping[str, Any]) -> None:
    """Put the best so far in the place of the one before it."""
    if training.workers.leads:
        with new_folder(folder / BEST, replacing=True) as fresh:
            training.save(fresh, record)
    training.workers.wait()


@contextmanager
def _watched(training: ModiTraining, folder: Path) -> Iterator[Watch]:
    watch = Watch(folder, training)
    try:
        yield watch
    finally:
        watch.close()


@contextmanager
def _progress(training: ModiTraining) -> Iterator[Any]:
    if not training.workers.leads:
        yield lambda share: None
        return
    with progress_bar("training") as advance:
        yield advance
