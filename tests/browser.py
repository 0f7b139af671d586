"""Which Chromium tests drive, where there is one."""

from __future__ import annotations

import os
import shutil

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")


def chromium() -> str:
    """The program that `MOTIONGEN_CHROMIUM` names, or one of the usual name; without one the test is skipped."""
    given = os.environ.get("MOTIONGEN_CHROMIUM")
    found = shutil.which(given) if given else next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        wanted = f"MOTIONGEN_CHROMIUM is {given}" if given else f"none of {', '.join(_NAMES)} is found"
        pytest.skip(f"no Chromium on this machine: {wanted}")
    return found
