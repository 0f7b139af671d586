"""Compare `motiongen.rotations` with `scipy.spatial.transform.Rotation` in time: python -m tools.bench_rotations.

The numbers are the rotations of an ordinary clip: 1,300 frames of 65 joints. Each operation starts and ends with the
arrays that a motion holds, as each does in this project. Times are the fastest of several runs, in milliseconds.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from motiongen import rotations as rot

Operation = Callable[[], object]


def operations(count: int) -> dict[str, tuple[Operation, Operation]]:
    """Each operation, ours and SciPy's, on `count` random rotations."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, count, 4))
    a, b = a / np.linalg.norm(a, axis=-1, keepdims=True), b / np.linalg.norm(b, axis=-1, keepdims=True)
    v, weights = rng.normal(size=(count, 3)), rng.uniform(size=count)
    matrices = rot.to_matrix(a)
    times = np.arange(count) + weights  # between each rotation and the next

    of = Rotation.from_quat

    def scipy_multiply() -> object:
        return (of(a) * of(b)).as_quat()

    def scipy_angle() -> object:
        return (of(a).inv() * of(b)).magnitude()

    def scipy_slerp() -> object:
        return Slerp(np.arange(count), of(a))(times[:-1]).as_quat()

    return {
        "multiply": (lambda: rot.multiply(a, b), scipy_multiply),
        "inverse": (lambda: rot.inverse(a), lambda: of(a).inv().as_quat()),
        "rotate": (lambda: rot.rotate(a, v), lambda: of(a).apply(v)),
        "to_matrix": (lambda: rot.to_matrix(a), lambda: of(a).as_matrix()),
        "from_matrix": (lambda: rot.from_matrix(matrices), lambda: Rotation.from_matrix(matrices).as_quat()),
        "slerp": (lambda: rot.slerp(a[:-1], a[1:], weights[:-1]), scipy_slerp),
        "angle_between": (lambda: rot.angle_between(a, b), scipy_angle),
    }


def fastest_ms(operation: Operation, runs: int) -> float:
    """The fastest of `runs` runs, in milliseconds."""
    operation()
    best = float("inf")
    for _ in range(runs):
        start = time.perf_counter()
        operation()
        best = min(best, time.perf_counter() - start)
    return 1e3 * best


def import_ms(module: str, runs: int) -> float:
    """What importing a module costs on top of NumPy, in a fresh Python, in milliseconds."""
    program = f"import time, numpy; t = time.perf_counter(); import {module}; print(time.perf_counter() - t)"
    outputs = [subprocess.check_output([sys.executable, "-c", program], text=True) for _ in range(runs)]
    return 1e3 * min(float(output) for output in outputs)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time motiongen's rotations against SciPy's.")
    parser.add_argument("--count", type=int, default=84_000, help="how many rotations (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=15, help="runs of each, the fastest counts (default: %(default)s)")
    arguments = parser.parse_args()
    print(f"{arguments.count:,} rotations, fastest of {arguments.runs}")
    print(f"{'':14} {'own ms':>8} {'SciPy ms':>9} {'ratio':>6}")
    for name, (own, scipys) in operations(arguments.count).items():
        ours, theirs = fastest_ms(own, arguments.runs), fastest_ms(scipys, arguments.runs)
        print(f"{name:14} {ours:8.2f} {theirs:9.2f} {theirs / ours:5.1f}x")
    ours, theirs = (import_ms(module, 3) for module in ("motiongen.rotations", "scipy.spatial.transform"))
    print(f"{'import':14} {ours:8.2f} {theirs:9.2f} {theirs / ours:5.1f}x")


if __name__ == "__main__":
    main()
