"""How long reading and writing takes, beside the package pybvh on the same file: `python -m tools.bench_io [CLIP]`.

Times are processor time, which other programs on the machine hardly disturb, in milliseconds: the fastest of several
runs, with the two packages taking turns. A motion here holds quaternions and has been checked, folded and judged when
it is read; pybvh keeps the file's Euler angles, so its way to quaternions and back is timed as well.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pybvh

import motiongen as mg
from motiongen import io

CLIP = Path(__file__).resolve().parents[2] / "shared" / "data" / "characters" / "Salsa-Dancing-6.bvh"

Operation = Callable[[], object]


def operations(clip: Path, folder: Path) -> dict[str, tuple[Operation, Operation | None]]:
    """Each operation, ours and, where it has one, pybvh's."""
    motion, theirs = io.load(clip), pybvh.read_bvh_file(clip)
    root, quaternions = theirs.to_quat()
    out, npz = folder / "out.bvh", folder / "out.npz"
    io.save(motion, npz)

    def read_to_quaternions() -> object:
        return pybvh.read_bvh_file(clip).to_quat()

    def write_from_quaternions() -> None:
        pybvh.write_bvh_file(theirs.from_quat(root, quaternions), out)

    return {
        "read BVH": (lambda: io.load(clip), lambda: pybvh.read_bvh_file(clip)),
        "read BVH to quaternions": (lambda: io.load(clip), read_to_quaternions),
        "write BVH": (lambda: io.save(motion, out), lambda: pybvh.write_bvh_file(theirs, out)),
        "write BVH from quaternions": (lambda: io.save(motion, out), write_from_quaternions),
        "read NPZ": (lambda: io.load(npz), None),
        "write NPZ": (lambda: io.save(motion, npz), None),
    }


def fastest_ms(work: list[Operation], runs: int) -> list[float]:
    """The least processor time of `runs` runs of each, in milliseconds, in turns after one run that does not count."""
    for operation in work:
        operation()
    best = [float("inf")] * len(work)
    for _ in range(runs):
        for i, operation in enumerate(work):
            start = time.process_time()
            operation()
            best[i] = min(best[i], 1e3 * (time.process_time() - start))
    return best


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.bench_io", description=__doc__)
    parser.add_argument("clip", nargs="?", type=Path, default=CLIP, help="a BVH file (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=15, help="runs of each, the fastest counts (default: %(default)s)")
    options = parser.parse_args()
    motion = mg.load(options.clip)
    print(f"{options.clip.name}: {len(motion):,} frames, {len(motion.skeleton)} joints; fastest of {options.runs}\n")
    print("| | motiongen, ms | pybvh, ms | ratio |\n|---|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # pybvh's guess of what is up, which is not what is timed
        for name, (ours, theirs) in operations(options.clip, Path(folder)).items():
            times = fastest_ms([ours] if theirs is None else [ours, theirs], options.runs)
            other = f"{times[1]:.1f} | {times[1] / times[0]:.1f} x" if theirs else "|"
            print(f"| {name} | {times[0]:.1f} | {other} |")


if __name__ == "__main__":
    main()
