"""`motiongen data import|info|pack|unpack`: datasets of motion windows for training."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Sequence
from typing import Any

from motiongen.commands.arguments import Parser, add_reading_arguments
from motiongen.console import progress_bar
from motiongen.datasets import Dataset, ImportReport, ImportSettings, import_clips, pack, unpack
from motiongen.datasets.labels import SPLITS
from motiongen.datasets.sources import ARCHIVES

SHOWN = 6
"""How many names or values of a kind are printed; report.json has all."""


def run(arguments: Sequence[str]) -> None:
    """Run one of the sub-commands."""
    parser = Parser(prog="motiongen data", description="Datasets of motion windows for training.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_import(commands.add_parser("import", help="make a dataset of folders and archives of clips"))
    _add_info(commands.add_parser("info", help="what is in a dataset, and whether it is as it was written"))
    _add_pack(commands.add_parser("pack", help="write a dataset as one small file"))
    _add_unpack(commands.add_parser("unpack", help="make a dataset of a packed file"))
    options = parser.parse_args(arguments)
    act: Callable[[argparse.Namespace], None] = options.act
    act(options)


def _add_import(parser: argparse.ArgumentParser) -> None:
    default = ImportSettings()
    parser.description = (
        "Make a dataset of the clips in folders and archives. All are brought to the skeleton of the first; what is "
        "dropped is said, and why."
    )
    parser.add_argument("sources", nargs="+", metavar="SOURCE", help=f"a folder, or an archive: {', '.join(ARCHIVES)}")
    parser.add_argument("out", metavar="OUT", help="the folder to make")
    parser.add_argument(
        "--joints", nargs="+", default=(), metavar="PATTERN", help="joints to keep (default: all from the root down)"
    )
    parser.add_argument("--rate", type=float, default=default.frame_rate, help="frames a second (default: %(default)g)")
    parser.add_argument("--frames", type=int, default=default.frames, help="length of a window (default: %(default)s)")
    parser.add_argument(
        "--stride", type=int, default=default.stride, help="frames from window to window (default: %(default)s)"
    )
    parser.add_argument("--labels", metavar="PATTERN", help="labels in file names, such as {content}_{style}_{number}")
    parser.add_argument(
        "--held-back", type=float, default=default.held_back, help="share kept out of training (default: %(default)s)"
    )
    parser.add_argument("--workers", type=int, default=_processors(), help="processes to use (default: %(default)s)")
    add_reading_arguments(parser)
    parser.set_defaults(act=_import)


def _import(options: argparse.Namespace) -> None:
    settings = ImportSettings(
        tuple(options.joints),
        options.rate,
        options.frames,
        options.stride,
        options.labels,
        options.held_back,
        options.up,
        options.unit,
    )
    with progress_bar("importing") as progress:
        report = import_clips(options.sources, options.out, settings, workers=options.workers, progress=progress)
    _print_table(_report_rows(report), title=options.out)
    _print_dropped(report)


def _add_info(parser: argparse.ArgumentParser) -> None:
    parser.description = "What is in a dataset. Every frame is compared with the fingerprint."
    parser.add_argument("dataset", help="the folder of the dataset")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.set_defaults(act=_info)


def _info(options: argparse.Namespace) -> None:
    facts = describe(Dataset.verify(options.dataset))
    if options.json:
        print(json.dumps(facts, indent=2))
    else:
        rows = [(key.replace("_", " "), _text(value)) for key, value in facts.items()]
        _print_table(rows, title=options.dataset)


def _add_pack(parser: argparse.ArgumentParser) -> None:
    parser.description = "Write a dataset as one file of 16-bit numbers, and say what that loses."
    parser.add_argument("dataset", help="the folder of the dataset")
    parser.add_argument("file", help="the .npz file to write")
    parser.set_defaults(act=_pack)


def _pack(options: argparse.Namespace) -> None:
    loss = pack(Dataset.open(options.dataset), options.file)
    megabytes = os.path.getsize(options.file) / 1e6
    lost = f"{loss.rotation_degrees:.2g} degrees and {loss.position_heights:.2g} heights"
    print(f"{options.file}: {megabytes:.1f} MB; at most {lost} are lost")


def _add_unpack(parser: argparse.ArgumentParser) -> None:
    parser.description = "Make a dataset's folder of a packed file."
    parser.add_argument("file", help="the file that `motiongen data pack` wrote")
    parser.add_argument("out", metavar="OUT", help="the folder to make")
    parser.set_defaults(act=_unpack)


def _unpack(options: argparse.Namespace) -> None:
    dataset = unpack(options.file, options.out)
    print(f"{options.out}: {len(dataset.names)} clips, {len(dataset.frames)} frames, fingerprint {dataset.fingerprint}")


def describe(dataset: Dataset) -> dict[str, Any]:
    """What there is to say of a dataset, as plain data."""
    skeleton = dataset.skeleton
    return {
        "fingerprint": dataset.fingerprint,
        "packed_from": dataset.index.packed_from,
        "joints": list(skeleton.names),
        "feet": [skeleton.names[joint] for joint in dataset.layout.feet],
        "height": skeleton.height,
        "unit": dataset.index.unit,
        "frame_rate_hz": dataset.frame_rate,
        "window_frames": dataset.window_frames,
        "stride": dataset.index.settings.stride,
        "clips": {split: len(dataset.clips(split)) for split in SPLITS},
        "frames": {split: int(dataset.index.lengths[dataset.clips(split)].sum()) for split in SPLITS},
        "windows": {split: len(dataset.windows(split)) for split in SPLITS},
        "labels": {field: sorted(set(values)) for field, values in dataset.labels.items()},
    }


def _report_rows(report: ImportReport) -> list[tuple[str, str]]:
    """What an import made, line by line."""
    rows = [
        ("joints", _text(report.joints)),
        ("feet", _text(report.feet) or "none found"),
        *((what, _text(getattr(report, what))) for what in ("clips", "frames", "windows")),
        *((f"label {field}", _text(values)) for field, values in report.labels.items()),
        *(("odd", f"{note} ({count} clips)") for note, count in list(report.notes.items())[:SHOWN]),
    ]
    if report.other_bones:
        bones, scale = max(report.other_bones.values(), key=lambda each: abs(each[1] - 1))
        rows.append(
            (
                "other bones",
                f"{len(report.other_bones)} clips brought to the first one's; at most {bones:.1%} of the height apart, "
                f"{scale:.2f} times as tall: {_text(report.other_bones)}",
            )
        )
    if report.held_still:
        most = max(report.held_still.values())
        rows.append(
            ("held still", f"{len(report.held_still)} clips' joints that moved by up to {most:.1%} of the height")
        )
    return [*rows, ("fingerprint", report.fingerprint), ("time", f"{report.seconds:.1f} s")]


def _print_table(rows: Sequence[tuple[str, str]], title: str) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), show_header=False, title_justify="left")
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in rows:
        table.add_row(Text(name), Text(text))  # as text: names may hold what rich takes for markup
    Console().print(table)


def _print_dropped(report: ImportReport) -> None:
    """The files that are not in the dataset, by the kind of reason; nothing where there are none."""
    if not report.dropped:
        return
    rows = [
        (f"{len(dropped)} {kind}", f"{each.name}: {each.reason}" if shown < SHOWN else "... (all are in report.json)")
        for kind, dropped in report.dropped_by_kind().items()
        for shown, each in enumerate(dropped[: SHOWN + 1])
    ]
    named = [(kind if i == 0 or rows[i - 1][0] != kind else "", text) for i, (kind, text) in enumerate(rows)]
    _print_table(named, title=f"dropped: {len(report.dropped)} files")


def _text(value: Any) -> str:
    """A value on one line, long lists shortened."""
    if isinstance(value, dict) and all(isinstance(each, int) for each in value.values()):
        parts = [f"{key or '(none)'} {each:,}" for key, each in value.items()]
    elif isinstance(value, dict):
        parts = [f"{key} ({_text(each)})" if isinstance(each, list) else str(key) for key, each in value.items()]
    elif isinstance(value, (list, tuple)):
        parts = [str(each) for each in value]
    else:
        return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
    more = f" and {len(parts) - SHOWN} more" if len(parts) > SHOWN + 1 else ""
    return ", ".join(parts[:SHOWN] if more else parts) + more


def _processors() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
