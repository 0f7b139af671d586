"""What a user's mistake raises, and what stops work that nobody wants any more."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class MotionGenError(ValueError):
    """A mistake in what the user gave: a file, an option, a constraint.

    The message is one line that says what came, what is allowed and what to do. The command line prints it without a
    traceback and exits with code 2. A bug in motiongen itself is never a `MotionGenError`.
    """


class CancelledError(Exception):
    """Nobody wants any more what is being made."""


def nearest_of(name: str, allowed: Iterable[str]) -> str:
    """`"; did you mean 'x'?"` for the allowed name closest to `name`, whatever its case, or "" when none is close."""
    by_lower = {option.lower(): option for option in allowed}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.5)
    return f"; did you mean '{by_lower[close[0]]}'?" if close else ""
