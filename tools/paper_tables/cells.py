"""Results that are kept: what was measured once with this code and these settings is not measured again."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import motiongen as mg
from motiongen.files import atomic_write

_SOURCE = Path(mg.__file__).parent
# What a result cannot depend on; all other modules of the library count as its code.
_FACES = ("blender", "cli.py", "commands", "console.py", "io", "render", "report.py", "web")
_PACKAGES = ("torch", "numpy")


class NotMeasuredError(Exception):
    """A result is not known, and only known ones are asked for."""


@dataclass
class Cells:
    """Results by settings, each in a JSON file of its own that appears when it is complete.

    Attributes:
        folder: where the files are.
        code: what `code_version` says.
        measuring: whether what is not known is measured; if not, it raises `NotMeasuredError`.
        measured: how many results were measured, rather than read.
    """

    folder: Path
    code: str
    measuring: bool = True
    measured: int = field(default=0, init=False)

    def get(self, settings: Mapping[str, Any], work: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
        """What `work` returns, or returned when it was last called for the same settings, code and machine.

        Args:
            settings: plain data that decides the result.
            work: measures; returns plain data.

        Raises:
            NotMeasuredError: if the result is not known and nothing is to be measured.
        """
        decisive = {"settings": settings, "code": self.code, "versions": versions(), "machine": machine()}
        path = self.folder / f"{digest(json.dumps(decisive, sort_keys=True).encode())[:24]}.json"
        what = ", ".join(f"{name} {value}" for name, value in settings.items() if name != "content")
        if path.is_file():
            print(f"known: {what}", file=sys.stderr)
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["result"]
            return found
        if not self.measuring:
            raise NotMeasuredError(what)
        begun = time.perf_counter()
        result = dict(work())
        self.folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as file:
            file.write(json.dumps({**decisive, "result": result}, indent=1).encode())
        self.measured += 1
        print(f"{time.perf_counter() - begun:6.1f} s: {what}", file=sys.stderr)
        return result


def digest(*parts: bytes) -> str:
    """A name for these bytes that no others have."""
    found = hashlib.sha256()
    for part in parts:
        found.update(len(part).to_bytes(8, "little"))
        found.update(part)
    return found.hexdigest()


def content_of(motion: mg.Motion) -> str:
    """A name for a clip's joints and frames, wherever it lies."""
    skeleton = motion.skeleton
    numbers = (skeleton.offsets, motion.rotations, motion.translations)
    words = json.dumps([skeleton.names, skeleton.parents, motion.translating, motion.frame_rate])
    return digest(words.encode(), *(array.tobytes() for array in numbers))[:12]


def code_version() -> str:
    """A name for the source of the library, but for reading, showing and the command line."""
    files = sorted(path for path in _SOURCE.rglob("*.py") if path.relative_to(_SOURCE).parts[0] not in _FACES)
    return digest(*(str(path.relative_to(_SOURCE)).encode() + b"\0" + path.read_bytes() for path in files))[:12]


def versions() -> dict[str, str]:
    """Of Python and of the packages that figures depend on."""
    return {"Python": platform.python_version(), **{package: version(package) for package in _PACKAGES}}


def machine() -> str:
    """The processor, how many cores of it, and the memory."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{_processor()}, {cores} cores, {memory:.0f} GiB of memory, {platform.system()}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()
