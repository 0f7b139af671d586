"""An argument parser whose complaints are `MotionGenError`s, and the arguments that several commands share."""

from __future__ import annotations

import argparse
from typing import NoReturn

from motiongen.errors import MotionGenError
from motiongen.motion import METRES_PER_UNIT, UP_AXES


class Parser(argparse.ArgumentParser):
    """`argparse.ArgumentParser` that raises instead of printing its usage and leaving."""

    def error(self, message: str) -> NoReturn:
        """Raise MotionGenError with `message` and where to find help."""
        raise MotionGenError(f"{message}; see `{self.prog} --help`")


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """Add `--up` and `--unit`: what a file does not say of itself."""
    parser.add_argument("--up", choices=UP_AXES, help="up axis of the file (default: found out)")
    parser.add_argument("--unit", choices=tuple(METRES_PER_UNIT), help="length unit of the file (default: guessed)")
