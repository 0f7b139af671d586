"""Read and write BVH clips and hold them to a slow reader: `python -m tools.check_io FOLDER...`.

Prints a Markdown table with one row a clip, and one row for each `.tar.xz` archive of clips. Errors are how far any
joint or end site is from where the slow reader of the tests puts it, at most, in skeleton heights. Besides, each clip
is written once more, which must give the same bytes, and written z-up, which must be noticed.
"""

from __future__ import annotations

import argparse
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import motiongen as mg
from motiongen import io
from motiongen.kinematics import end_site_positions
from tests.io.slow_bvh import read_slowly


@dataclass(frozen=True)
class Checked:
    """What was found about one clip."""

    joints: int
    frames: int
    frame_rate: float
    up: str
    unit: str
    read_error: float
    written_error: float
    same_bytes: bool
    turned_up: str


def error_in_heights(motion: mg.Motion, path: Path) -> float:
    """The largest distance of a joint or end site from where the slow reader puts it."""
    expected = np.concatenate(read_slowly(path).positions(), axis=1)
    if motion.up == "z":
        expected = np.stack([expected[..., 0], expected[..., 2], -expected[..., 1]], axis=-1)
    found = np.concatenate([motion.positions, end_site_positions(motion)], axis=1)
    return float(np.linalg.norm(found - expected, axis=-1).max()) / motion.skeleton.height


def check(path: Path, folder: Path) -> Checked:
    """Read a clip, write it, read that, write it again, and write it z-up."""
    once, twice, turned = folder / "once.bvh", folder / "twice.bvh", folder / "turned.bvh"
    motion = io.load(path)
    io.save(motion, once)
    again = io.load(once)
    io.save(again, twice)
    io.save(motion.replace(up="z"), turned)
    return Checked(
        len(motion.skeleton),
        len(motion),
        motion.frame_rate,
        motion.up,
        motion.unit or "unknown",
        error_in_heights(motion, path),
        error_in_heights(again, once),
        once.read_bytes() == twice.read_bytes(),
        io.load(turned).up,
    )


def clips_of(archive: Path, folder: Path) -> Iterator[Path]:
    """The clips of an archive, unpacked one after the other."""
    with tarfile.open(archive) as members:
        for member in members:
            if member.isfile() and member.name.endswith(".bvh"):
                content = members.extractfile(member)
                if content is not None:
                    path = folder / Path(member.name).name
                    path.write_bytes(content.read())
                    yield path
                    path.unlink()


def row(name: str, checked: list[Checked]) -> str:
    """One line of the table for one clip or many."""

    def span(values: list[float]) -> str:
        low, high = min(values), max(values)
        return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"

    def counts(values: list[str]) -> str:
        found = sorted(set(values))
        return ", ".join(f"{value}: {values.count(value):,}" if len(found) > 1 else value for value in found)

    cells = [
        name,
        f"{len(checked):,}",
        span([c.joints for c in checked]),
        f"{sum(c.frames for c in checked):,}",
        span([c.frame_rate for c in checked]),
        counts([c.up for c in checked]),
        counts([c.unit for c in checked]),
        f"{max(c.read_error for c in checked):.1e}",
        f"{max(c.written_error for c in checked):.1e}",
        f"{sum(c.same_bytes for c in checked):,}",
        f"{sum(c.turned_up == 'z' for c in checked):,}",
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.check_io", description=__doc__)
    parser.add_argument("folder", nargs="+", type=Path, help="folders with .bvh files and .tar.xz archives of them")
    options = parser.parse_args()
    headings = [
        "file",
        "clips",
        "joints",
        "frames",
        "Hz",
        "up",
        "unit guess",
        "error, read",
        "error, written and read",
        "same bytes again",
        "turned, z found",
    ]
    print(f"| {' | '.join(headings)} |\n|---|{'---:|' * (len(headings) - 1)}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for given in options.folder:
            for path in sorted(given.glob("*.bvh")):
                print(row(path.name, [check(path, folder)]), flush=True)
            for archive in sorted(given.glob("*.tar.xz")):
                print(row(archive.name, [check(path, folder) for path in clips_of(archive, folder)]), flush=True)


if __name__ == "__main__":
    main()
