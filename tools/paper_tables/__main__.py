"""The command line: `python -m tools.paper_tables genmm` or `modi --data FOLDER`; each takes `--help`."""

from __future__ import annotations

import os

# Before torch is first imported: threads of two busy processes that spin while they wait slow each other.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import motiongen as mg
from motiongen.errors import MotionGenError, nearest_of
from motiongen.generators.registry import spec_of
from tools.paper_tables import architectures, page
from tools.paper_tables.cells import Cells, NotMeasuredError, code_version, machine, versions
from tools.paper_tables.examples import Examples
from tools.paper_tables.long_outputs import ROOT, figure_9
from tools.paper_tables.measure import Bench
from tools.paper_tables.tables import TABLES, Section

SECTIONS: Mapping[str, Callable[[Bench], Section]] = {**TABLES, "figure9": figure_9}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write, and say where. Returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser().parse_args(given)
    try:
        print(options.run(options, shlex.join(["python", "-m", "tools.paper_tables", *given])))
    except MotionGenError as error:
        print(f"paper_tables: {error}", file=sys.stderr)
        return 2
    return 0


def run(options: argparse.Namespace, command: str) -> Path:
    """Measure what is asked for, and write it with what is known of the rest. Returns the page's path.

    Raises:
        MotionGenError: if a name is unknown, or a clip cannot be read.
    """
    only = options.only.split(",") if options.only else list(SECTIONS)
    for name in only:
        if name not in SECTIONS:
            raise MotionGenError(
                f"there is no '{name}'{nearest_of(name, SECTIONS) or ';'} there are {', '.join(SECTIONS)}"
            )
    if options.seeds is not None and options.seeds < 2:
        raise MotionGenError(f"--seeds must be 2 or more, not {options.seeds}: set diversity compares sequences")
    generators = options.generators.split(",")
    for generator in generators:
        spec_of(generator)  # refuses unknown names before any work
    cells = Cells(options.out / ".cache", code_version())
    bench = Bench(generators, Examples(options.data), cells, options.seeds)
    sections: dict[str, Section | None] = {}
    for name, table in SECTIONS.items():
        cells.measuring = name in only
        try:
            sections[name] = table(bench)
        except NotMeasuredError:
            sections[name] = None
    facts = (
        f"Command: `{command}`",
        f"Machine: {machine()}, {_threads()}",
        f"Versions: motiongen {mg.__version__} (source {cells.code}), "
        + ", ".join(f"{name} {number}" for name, number in versions().items()),
        "Metrics: 6D local rotations at 30 frames per second, see `motiongen.metrics.one_clip`; "
        "seeds 0, 1, 2, ...; all clips resampled to 30 frames per second first",
        "Where and why figures differ from the paper's: [discussion.md](discussion.md)",
    )
    return page.write(options.out, sections, facts)


def _threads() -> str:
    import torch

    count = torch.get_num_threads()
    return f"{count} thread{'s' if count > 1 else ''}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.paper_tables", description="Measure a paper's tables anew.")
    papers = parser.add_subparsers(dest="paper", required=True, metavar="PAPER")
    genmm = papers.add_parser("genmm", help="GenMM's tables 1 to 4 and figure 9")
    genmm.set_defaults(run=run)
    genmm.add_argument("--generators", default="genmm", help="registered generators with rows, by commas")
    genmm.add_argument("--only", help=f"what to measure, by commas: {', '.join(SECTIONS)}; default: all")
    genmm.add_argument("--seeds", type=int, help="sequences that a cell is the mean of; default: each table's own")
    genmm.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data", help="the folder of real clips")
    genmm.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "genmm", help="where to write")
    modi = papers.add_parser("modi", help="MoDi's table 2 and the mixing rows of its table 1")
    modi.set_defaults(run=architectures.run)
    architectures.add_arguments(modi)
    return parser


if __name__ == "__main__":
    sys.exit(main())
