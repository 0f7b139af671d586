"""Tables 1 to 4 of the GenMM paper. A row is what one generator does with one set of examples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tools.paper_tables.examples import CLIPS, HUMANS, SETS
from tools.paper_tables.measure import Bench
from tools.paper_tables.published import TABLE_1, TABLE_1_RELEASED, TABLE_2, TABLE_3, TABLE_4, Row

Record = dict[str, Any]

FIGURES = ("coverage_percent", "set_diversity", "global_patch_distance", "local_patch_distance", "seconds")
"""What most tables show of a row, in the order of the paper's Table 1."""

HEADING = ("coverage, %", "set diversity", "global patch distance", "local patch distance", "time, s")

LONGER = 2
"""Sequences are so many times as long as their example (section 4.1)."""

LENGTHS = (1, 2, 4)
"""Of Table 2's sequences, in lengths of all their examples together."""

JOINTS = (24, 65, 433)

# Table 1 has as many as the paper's set diversity.
SEEDS = {"table1": 200, "table2": 16, "table3": 16, "table4": 32}


@dataclass(frozen=True)
class Section:
    """A table that has been measured.

    Attributes:
        name: of its CSV file.
        title: its heading.
        notes: what must be known to read it, a paragraph each.
        rows: the cells of the Markdown table, the heading first.
        records: the same figures in full, a row of the CSV file each.
        plot: the name of the plot that goes with it, if one does.
    """

    name: str
    title: str
    notes: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    records: Sequence[Record]
    plot: str | None = None


def table_1(bench: Bench) -> Section:
    """Single examples (section 4.1)."""
    seeds = bench.seeds or SEEDS["table1"]
    rows: list[list[str]] = [["generator, example", *HEADING, "time to fit, s"]]
    records: list[Record] = []
    for generator in bench.generators:
        released = TABLE_1_RELEASED.get(generator, {})
        found: dict[str, Record] = {}
        for name in CLIPS:
            example = bench.examples.single(name)
            found[name] = _record(bench.measure(generator, example, LONGER, seeds))
            size = f"{example.frames} frames x {example.joints} joints"
            rows.append([f"{generator}, {name} ({size})", *_figures(found[name]), f"{found[name]['fit_seconds']:.3f}"])
            if name in released:
                rows.append([f"its authors' released code, {name}", *_published(released[name]), "-"])
        humans = _mean([found[name] for name in HUMANS])
        rows.append([f"{generator}, mean of the {HUMANS_WORD}", *_figures(humans), f"{humans['fit_seconds']:.3f}"])
        rows.append([f"{generator}, mean of all", *_figures(_mean(list(found.values()))), ""])
        if generator in TABLE_1:
            rows.append([f"{generator}, the paper, on its three clips", *_published(TABLE_1[generator]), "-"])
        records += [{"generator": generator, "example": name, "syntheses": seeds, **r} for name, r in found.items()]
    notes = (
        f"Means over {seeds} sequences twice as long as their example; the paper takes its set diversity over 200. "
        "Times are the least of all sequences, from motion to motion.",
    )
    return Section("table1", "Table 1: single examples", notes, rows, records)


HUMANS_WORD = "three of 65 joints"


def table_2(bench: Bench) -> Section:
    """Several examples (section 4.2)."""
    seeds = bench.seeds or SEEDS["table2"]
    counts = range(2, 6)
    rows: list[list[str]] = [["generator, examples, length", *(f"{count} examples" for count in counts)]]
    records: list[Record] = []
    for generator in bench.generators:
        for name in SETS:
            for times in LENGTHS:
                cells = []
                for count in counts:
                    measured = bench.measure(generator, bench.examples.several(name, count), times, seeds)
                    least = 100 * min(measured["coverage_per_example"])
                    cells.append(f"{100 * measured['coverage']:.2f} / {least:.2f}")
                    which = {"generator": generator, "examples": name, "count": count, "length": times}
                    records.append({**which, "syntheses": seeds, "least_coverage_percent": least, **_record(measured)})
                rows.append([f"{generator}, {name}, x {times}", *cells])
        if generator in TABLE_2:
            rows.append([f"{generator}, the paper, on its five dances", *(_number(v, 2) for v in TABLE_2[generator])])
    notes = (
        "Coverage in percent: of the windows of all examples together (the paper's figure), and of the example that is "
        f"covered least. Means over {seeds} sequences; x 1, x 2, x 4: as long as all examples together, or twice or "
        "four times as long.",
        *(f"- {name}: {what}" for name, what in SETS.items()),
    )
    return Section("table2", "Table 2: several examples", notes, rows, records)


def table_3(bench: Bench) -> Section:
    """Skeletons of different complexity (section 4.2)."""
    seeds = bench.seeds or SEEDS["table3"]
    rows: list[list[str]] = [["generator, joints", *HEADING, "the paper's coverage, %"]]
    records: list[Record] = []
    for generator in bench.generators:
        for joints, published in zip(JOINTS, TABLE_3.get(generator, (None,) * len(JOINTS))):
            found = []
            for name in HUMANS:
                example = bench.examples.with_joints(name, joints)
                found.append(_record(bench.measure(generator, example, LONGER, seeds)))
                records.append(
                    {"generator": generator, "example": name, "joints": joints, "syntheses": seeds, **found[-1]}
                )
            rows.append([f"{generator}, {joints}", *_figures(_mean(found)), _number(published, 2)])
    notes = (
        f"Means over the {HUMANS_WORD} of Table 1 and {seeds} sequences twice as long as their example. "
        "`tools.make_creature` leaves fingers and small bones out for the 24, and adds a tail, wings, a skirt and hair "
        "that swing behind the motion for the 433; the paper's three skeletons are different characters.",
    )
    return Section("table3", "Table 3: skeletons of different complexity", notes, rows, records)


def table_4(bench: Bench) -> Section:
    """Hyper-parameters (section 4.3), of generators whose paper has changed them one by one."""
    seeds = bench.seeds or SEEDS["table4"]
    shown = ("coverage, %", "set diversity", "global patch distance", "local patch distance")
    rows: list[list[str]] = [["generator, setting", *(text for column in shown for text in (column, "paper"))]]
    records: list[Record] = []
    for generator in bench.generators:
        for setting, (options, published) in TABLE_4.get(generator, {}).items():
            found = []
            for name in HUMANS:
                example = bench.examples.single(name)
                found.append(_record(bench.measure(generator, example, LONGER, seeds, options)))
            mean = _mean(found)
            pairs = zip(_figures(mean), _published(published))
            rows.append([f"{generator}, {setting}", *(text for pair in pairs for text in pair)])
            paper = {f"paper_{name}": value for name, value in zip(FIGURES, published)}
            records.append({"generator": generator, "setting": setting, "syntheses": seeds, **mean, **paper})
    notes = (
        f"Means over the {HUMANS_WORD} of Table 1 and {seeds} sequences each, twice as long as their example; every "
        "setting but the one named is the default.",
    )
    return Section("table4", "Table 4: hyper-parameters", notes, rows, records, plot="table4.png")


TABLES: Mapping[str, Callable[[Bench], Section]] = {
    "table1": table_1,
    "table2": table_2,
    "table3": table_3,
    "table4": table_4,
}


# -- cells


def _record(measured: Mapping[str, Any]) -> Record:
    """The figures of a row."""
    percent = {"coverage_percent": 100 * measured["coverage"]}
    names = (*FIGURES[1:], "median_seconds", "fit_seconds")
    return {**percent, **{name: measured[name] for name in names}}


def _mean(records: Sequence[Record]) -> Record:
    """The mean of each figure, None where one of them has none."""
    values = {name: [record[name] for record in records] for name in records[0]}
    return {name: None if None in found else float(np.mean(found)) for name, found in values.items()}


def _figures(record: Record) -> list[str]:
    return _published(tuple(record[name] for name in FIGURES))


def _published(row: Row) -> list[str]:
    return [_number(value, decimals) for value, decimals in zip(row, (2, 3, 3, 3, 3))]


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
