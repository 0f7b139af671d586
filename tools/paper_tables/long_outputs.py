"""Figure 9 of the GenMM paper (section 4.4): time and memory against the frames that are made.

Every point is measured in a process of its own, so that its peak of memory is its own. The process is this module run
as a program: it reads a job from standard input and prints what it has measured.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import motiongen as mg
from motiongen.errors import MotionGenError
from tools.paper_tables.cells import code_version, content_of
from tools.paper_tables.examples import LONG_EXAMPLE
from tools.paper_tables.measure import Bench
from tools.paper_tables.tables import Record, Section

ROOT = Path(__file__).resolve().parents[2]

FRAMES = (1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000)

REPEATS = 3
"""Times a sequence is made; the least time counts."""


@dataclass(frozen=True)
class Job:
    """What a process measures.

    Attributes:
        generator: its registered name.
        example: path of the example.
        frames: how many to make.
        repeats: how often.
        code: what `code_version` must say.
    """

    generator: str
    example: str
    frames: int
    repeats: int
    code: str


@dataclass(frozen=True)
class Line:
    """The straight line nearest to points, by least squares.

    Attributes:
        slope: per frame.
        intercept: at no frames.
        determination: R², the share of the points' variance that the line explains.
    """

    slope: float
    intercept: float
    determination: float


def figure_9(bench: Bench) -> Section:
    """Time and memory of sequences of more and more frames."""
    name, length = LONG_EXAMPLE
    example = bench.examples.clip(name)[:length]
    rows: list[list[str]] = [["generator, frames", "time, s", "time per 1,000 frames, s", "peak of memory, MiB"]]
    records: list[Record] = []
    notes = [
        f"Sequences from {len(example)} frames of {name}, {len(example.skeleton)} joints. Every point is a process of "
        f"its own, its time the least of {REPEATS}, from motion to motion; the peak is the whole process's, of which "
        "some hundreds of MiB are libraries and the example. The paper shows both to be linear, with about 3 s for "
        "100,000 frames on an NVIDIA V100.",
    ]
    for generator in bench.generators:
        points = [{"frames": frames, **_point(bench, generator, example, frames)} for frames in FRAMES]
        records += [{"generator": generator, **point} for point in points]
        rows += [_row(generator, point) for point in points]
        frames, seconds, memory = ([point[key] for point in points] for key in ("frames", "seconds", "peak_mib"))
        time_line, memory_line = fit_line(frames, seconds), fit_line(frames, memory)
        notes.append(
            f"Straight lines through the points of {generator}: {time_line.intercept:.3f} s and "
            f"{1000 * time_line.slope:.4f} s per 1,000 frames (R² {time_line.determination:.4f}); "
            f"{memory_line.intercept:.0f} MiB and {1000 * memory_line.slope:.1f} MiB per 1,000 frames "
            f"(R² {memory_line.determination:.4f})."
        )
    return Section("figure9", "Figure 9: time and memory of long sequences", tuple(notes), rows, records, "figure9.png")


def _row(generator: str, point: Mapping[str, Any]) -> list[str]:
    frames, seconds = point["frames"], point["seconds"]
    per_thousand = 1000 * seconds / frames
    return [f"{generator}, {frames:,}", f"{seconds:.3f}", f"{per_thousand:.4f}", f"{point['peak_mib']:.0f}"]


def fit_line(across: ArrayLike, values: ArrayLike) -> Line:
    """The straight line nearest to values at places `across`."""
    at, found = np.asarray(across, dtype=float), np.asarray(values, dtype=float)
    slope, intercept = np.polyfit(at, found, 1)
    residual = found - (slope * at + intercept)
    variance = float(found.var())
    determination = 1.0 if variance == 0 else 1.0 - float(np.mean(residual**2)) / variance
    return Line(float(slope), float(intercept), determination)


def _point(bench: Bench, generator: str, example: mg.Motion, frames: int) -> dict[str, Any]:
    settings = {
        "figure": "9",
        "generator": generator,
        "frames": frames,
        "repeats": REPEATS,
        "content": content_of(example),
    }
    return bench.cells.get(settings, lambda: in_own_process(generator, example, frames, bench.cells.code))


def in_own_process(generator: str, example: mg.Motion, frames: int, code: str) -> dict[str, Any]:
    """What `measure_job` says in a process of its own.

    Raises:
        MotionGenError: if the process ends with an error, as it does where the code is no longer `code`.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "example.npz"
        example.save(path)
        job = Job(generator, str(path), frames, REPEATS, code)
        ended = subprocess.run(
            [sys.executable, "-m", "tools.paper_tables.long_outputs"],
            input=json.dumps(asdict(job)), capture_output=True, text=True, check=False, cwd=ROOT,
        )  # fmt: skip
    if ended.returncode != 0:
        reason = (ended.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise MotionGenError(f"{frames} frames could not be measured: {reason}; run again to go on from here")
    found: dict[str, Any] = json.loads(ended.stdout)
    return found


def measure_job(job: Job) -> dict[str, float]:
    """Least time in seconds, and the peak of this process's memory in MiB, in all and before the first sequence."""
    if code_version() != job.code:
        raise MotionGenError("the code has changed since the measurement began; start it again")
    made = mg.create(job.generator).fit([mg.load(job.example)])
    before = peak_memory()
    seconds = []
    for seed in range(job.repeats):
        begun = time.perf_counter()
        made.sample(job.frames, seed=seed)
        seconds.append(time.perf_counter() - begun)
    return {"seconds": min(seconds), "peak_mib": peak_memory() / 2**20, "peak_before_mib": before / 2**20}


def peak_memory() -> int:
    """The most bytes that this process has held in memory so far.

    What the system reports of resources counts, on Linux, the process that started this one as well; what it reports of
    the status of the process does not.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    print(json.dumps(measure_job(Job(**json.load(sys.stdin)))))
