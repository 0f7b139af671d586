"""From folders and archives of clips to a dataset on disk, on several processes and within bounded memory."""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from motiongen.datasets.dataset import Dataset
from motiongen.datasets.entities import CHANNELS
from motiongen.datasets.labels import SPLITS, TRAINING, LabelPattern, split_of
from motiongen.datasets.parallel import in_order
from motiongen.datasets.preparing import Prepared, load_item, prepare
from motiongen.datasets.report import DUPLICATE, Dropped, ImportReport, Kept
from motiongen.datasets.rig import Rig, choose_rig
from motiongen.datasets.settings import ImportSettings
from motiongen.datasets.sources import Item, walk
from motiongen.datasets.statistics import with_statistics
from motiongen.datasets.store import Index, Writer, map_arrays
from motiongen.errors import MotionGenError
from motiongen.files import new_folder
from motiongen.motion import Motion

PROBED = 8
"""Clips that are looked at before the work begins, to choose the rig and find its feet."""

REPORT = "report.json"


def import_clips(
    sources: str | Path | Sequence[str | Path],
    out: str | Path,
    settings: ImportSettings | None = None,
    *,
    workers: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> ImportReport:
    """Make a dataset of the clips in folders and archives.

    The first clip that can be read gives the skeleton. Clips of the same tree with other bones are brought to it, by
    their rotations and by their root's path in heights; clips of another tree are dropped, as are those too short for a
    window. Every clip is either wholly for training or wholly held back, by its name; a file that repeats another's
    content is dropped, so that none is in both.

    Args:
        sources: folders, searched with all that is below them, and archives (`sources.ARCHIVES`).
        out: the folder to make; it appears when it is complete.
        settings: joints, rate, windows, labels.
        workers: processes to read with. Above 1 they are spawned, so scripts need their `__main__` guard.
        progress: called with the share done, 0 to 1.

    Raises:
        MotionGenError: if a source cannot be read, `out` exists, or no clip is left for training.
    """
    begun = time.monotonic()
    settings = ImportSettings() if settings is None else settings
    if workers < 1:
        raise MotionGenError(f"workers must be a whole number of at least 1, not {workers}")
    paths = [Path(source) for source in ([sources] if isinstance(sources, (str, Path)) else sources)]
    if not paths:
        raise MotionGenError("an import needs at least one folder or archive; none came")
    with new_folder(out) as folder:
        rig, items = _probe(walk(paths, progress), settings)
        with contextlib.closing(Writer(folder, rig.layout)) as writer:
            work = functools.partial(prepare, rig=rig, settings=settings)
            kept, dropped = _collect(in_order(work, items, workers), writer)
        index = _index(folder, kept, dropped, rig, settings)
        fingerprint = writer.finish(index)
        dataset = Dataset.open(folder)
        windows = {split: len(dataset.windows(split)) for split in SPLITS}
        report = ImportReport.of(index, fingerprint, kept, dropped, windows, time.monotonic() - begun)
        (folder / REPORT).write_text(json.dumps(report.to_dict(), indent=2), encoding="utf-8")
    progress(1.0)
    return report


def _probe(items: Iterator[Item], settings: ImportSettings) -> tuple[Rig, Iterator[Item]]:
    """The rig that the first few clips tell, and all of the items again."""
    looked_at: list[Item] = []
    motions: list[Motion] = []
    problem = "there is none"
    for item in items:
        looked_at.append(item)
        if item.is_motion:
            try:
                motions.append(load_item(item, settings).resample(settings.frame_rate))
            except MotionGenError as error:
                problem = str(error)
        if len(motions) == PROBED:
            break
    if not motions:
        raise MotionGenError(f"no clip can be read from the sources: {problem}")
    return choose_rig(motions, settings.joints), itertools.chain(looked_at, items)


def _collect(results: Iterable[Prepared | Dropped], writer: Writer) -> tuple[list[Kept], list[Dropped]]:
    """Write what is kept, in order."""
    kept: list[Kept] = []
    dropped: list[Dropped] = []
    names: dict[str, str] = {}  # by digest
    for result in results:
        if isinstance(result, Dropped):
            dropped.append(result)
        elif result.clip.digest in names:
            dropped.append(Dropped(result.clip.name, DUPLICATE, f"its content is that of {names[result.clip.digest]}"))
        else:
            names[result.clip.digest] = result.clip.name
            writer.append(result.frames, result.facing)
            kept.append(result.clip)
    return kept, dropped


def _index(folder: Path, kept: list[Kept], dropped: list[Dropped], rig: Rig, settings: ImportSettings) -> Index:
    """The index of what was written, with its statistics."""
    if not kept:
        raise MotionGenError(f"no clip can be kept; the first, '{dropped[0].name}', is dropped: {dropped[0].reason}")
    splits = tuple(split_of(clip.name, settings.held_back) for clip in kept)
    if TRAINING not in splits:
        raise MotionGenError(
            f"all {len(kept)} clips are held back from training; lower held_back, or import more clips"
        )
    pattern = None if settings.labels is None else LabelPattern(settings.labels)
    found = [pattern.labels_of(clip.name) if pattern else {} for clip in kept]
    if pattern and not any(found):
        raise MotionGenError(f"the label pattern '{pattern.text}' fits no name, such as '{kept[0].name}'; change it")
    layout = rig.layout
    index = Index(
        settings,
        layout,
        rig.unit,
        tuple(clip.name for clip in kept),
        np.array([clip.frames for clip in kept], dtype=np.int64),
        splits,
        {field: tuple(each.get(field, "") for each in found) for field in (pattern.fields if pattern else ())},
        reference=np.zeros((len(layout.skeleton), CHANNELS), np.float32),
        mean=np.zeros((layout.count, CHANNELS), np.float32),
        deviation=np.ones((layout.count, CHANNELS), np.float32),
    )
    return with_statistics(Dataset(index, *map_arrays(folder, index)))
