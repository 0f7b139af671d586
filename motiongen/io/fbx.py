"""FBX by way of Blender, which runs as a program of its own: its importer and exporter know the format, we do not.

`MOTIONGEN_BLENDER` names Blender, or a Python that can import its `bpy` package; else `blender` on the PATH is taken.
Between Blender and here motions travel as GLB, so everything said of that format holds: metres, y up.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from motiongen.errors import MotionGenError
from motiongen.files import atomic_path, open_to_read
from motiongen.io.glb import read_glb, write_glb
from motiongen.motion import Motion

VARIABLE = "MOTIONGEN_BLENDER"

SECONDS = 600
"""After so long Blender is taken to hang."""

SCRIPT = Path(__file__).with_name("blender_convert.py")


def read_fbx(path: Path, up: str | None = None, unit: str | None = None) -> Motion:
    """Read an FBX file (see `motiongen.io.load`).

    Raises:
        MotionGenError: if Blender is not there or cannot read it, or nothing in it is animated.
    """
    open_to_read(path).close()
    with tempfile.TemporaryDirectory(prefix="motiongen-") as folder:
        passed = Path(folder) / f"{path.stem}.glb"
        _convert(path, passed, 0.0)
        motion = read_glb(passed, up, unit)
    return motion.replace(file_layout=None)  # the file in between is nobody's


def write_fbx(motion: Motion, path: Path) -> None:
    """Write an FBX file (see `motiongen.io.save`), at a whole number of frames a second.

    Raises:
        MotionGenError: if Blender is not there, the rate is no whole number, or the file cannot be written.
    """
    rate = round(motion.frame_rate)
    if abs(rate - motion.frame_rate) > 1e-3 * motion.frame_rate:
        raise MotionGenError(
            f"{path}: FBX is written at whole frame rates, not {motion.frame_rate:g} Hz; "
            f"resample to {max(rate, 1)} first"
        )
    with atomic_path(path) as temporary, tempfile.TemporaryDirectory(prefix="motiongen-") as folder:
        passed = Path(folder) / "motion.glb"
        write_glb(motion.replace(file_layout=None), passed)
        _convert(passed, temporary, float(rate))


def _convert(source: Path, target: Path, rate: float) -> None:
    program = os.environ.get(VARIABLE) or shutil.which("blender")
    if program is None or shutil.which(program) is None:
        named = f"; {VARIABLE}={program} is no program" if program else ""
        raise MotionGenError(
            f"FBX files need Blender 4.2 or newer{named}; install it, or name it in the variable {VARIABLE}; "
            "GLB files need nothing"
        )
    arguments = [str(source.resolve()), str(target.resolve()), str(rate)]
    if "python" in Path(program).name.lower():
        command = [program, str(SCRIPT), *arguments]
    else:
        command = [program, "--background", "--factory-startup", "--python-exit-code", "3", "--python", str(SCRIPT)]
        command += ["--", *arguments]
    try:
        ended = subprocess.run(command, check=False, capture_output=True, text=True, timeout=SECONDS)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MotionGenError(f"Blender ({program}) cannot be run ({error}); check {VARIABLE}") from error
    if ended.returncode or not target.is_file():
        lines = (ended.stderr.strip() or ended.stdout.strip() or "it said nothing").splitlines()
        raise MotionGenError(
            f"{source.name}: Blender cannot convert it ({lines[-1].strip()}); try it in Blender itself"
        )
