"""What is left on disk: a page of Markdown, CSV files, and plots."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from motiongen.files import atomic_path, atomic_write
from motiongen.report import markdown_table
from tools.paper_tables.long_outputs import fit_line
from tools.paper_tables.tables import Record, Section

COLOURS = ("#1f6f8b", "#c8553d", "#6a994e", "#7b5ea7")


def write(folder: Path, sections: Mapping[str, Section | None], facts: Sequence[str]) -> Path:
    """Write `tables.md`, and for each section that was measured its CSV file and its plot. Returns the page's path.

    Args:
        folder: made where it is missing.
        sections: by name, in the page's order; None: not measured with this code.
        facts: how it was measured, a line each.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# The tables of the GenMM paper, measured here", "", *(f"- {fact}" for fact in facts)]
    for name, section in sections.items():
        if section is None:
            lines += ["", f"{name} has not been measured with this code and these settings."]
            continue
        lines += ["", f"## {section.title}", "", *_paragraphs(section.notes), "", *markdown_table(section.rows)]
        _write_csv(folder / f"{section.name}.csv", section.records)
        if section.plot is not None:
            with atomic_path(folder / section.plot) as path:
                PLOTS[section.name](section.records, path)
            lines += ["", f"![{section.title}]({section.plot})"]
    page = folder / "tables.md"
    with atomic_write(page) as file:
        file.write(("\n".join(lines) + "\n").encode())
    return page


def _paragraphs(notes: Sequence[str]) -> list[str]:
    """Lines of paragraphs; those that begin with a dash make a list."""
    lines: list[str] = []
    for note in notes:
        lines += ["", note] if lines and not (note.startswith("- ") and lines[-1].startswith("- ")) else [note]
    return lines


def _write_csv(path: Path, records: Sequence[Record]) -> None:
    names = list(dict.fromkeys(name for record in records for name in record))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    with atomic_write(path) as file:
        file.write(text.getvalue().encode())


# -- plots


def plot_settings(records: Sequence[Record], path: Path) -> None:
    """Table 4: coverage and local patch distance of every setting, beside the paper's."""
    figure, panels = _figure(len(_by_generator(records)), height=1.5 + 0.3 * len(records))
    shown = {"coverage_percent": "coverage, %", "local_patch_distance": "local patch distance"}
    for row, (generator, found) in zip(panels, _by_generator(records).items()):
        places = range(len(found))
        for panel, (name, label) in zip(row, shown.items()):
            panel.barh([p - 0.2 for p in places], [r[name] for r in found], 0.38, color=COLOURS[0], label=generator)
            panel.barh(
                [p + 0.2 for p in places], [r[f"paper_{name}"] for r in found], 0.38, color="#bbb", label="paper"
            )
            panel.set_yticks(list(places), [r["setting"] for r in found])
            panel.set_xlabel(label)
            panel.invert_yaxis()
        row[1].legend(frameon=False, loc="center right")
    figure.savefig(path, dpi=120)


def plot_long_outputs(records: Sequence[Record], path: Path) -> None:
    """Figure 9: time and peak of memory against frames, with straight lines through the points."""
    figure, panels = _figure(1, height=4.0)
    for panel, name, label in zip(panels[0], ("seconds", "peak_mib"), ("time, s", "peak of memory, MiB")):
        for colour, (generator, found) in zip(COLOURS, _by_generator(records).items()):
            frames, values = [r["frames"] for r in found], [r[name] for r in found]
            line = fit_line(frames, values)
            ends = [0, max(frames)]
            panel.plot(frames, values, "o", color=colour, label=generator)
            panel.plot(ends, [line.slope * end + line.intercept for end in ends], color=colour, linewidth=1)
        panel.set_xlabel("frames made")
        panel.set_ylabel(label)
        panel.set_ylim(bottom=0)
        panel.legend(frameon=False)
    figure.savefig(path, dpi=120)


PLOTS: Mapping[str, Callable[[Sequence[Record], Path], None]] = {
    "table4": plot_settings,
    "figure9": plot_long_outputs,
}


def _figure(rows: int, height: float) -> tuple[Any, Any]:
    """A figure, and its panels as (rows, 2)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, height), layout="constrained")
    panels = figure.subplots(rows, 2, squeeze=False)
    for panel in panels.flat:
        panel.spines[["top", "right"]].set_visible(False)
    return figure, panels


def _by_generator(records: Sequence[Record]) -> dict[str, list[Record]]:
    found: dict[str, list[Record]] = {}
    for record in records:
        found.setdefault(record["generator"], []).append(record)
    return found
