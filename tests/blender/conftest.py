"""Where real Blender is."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.conftest import ROOT


@pytest.fixture(scope="session")
def blender() -> str:
    """The Python that can import `bpy`."""
    python = os.environ.get("MOTIONGEN_BLENDER_PYTHON", str(ROOT / ".venv-blender" / "bin" / "python"))
    if not Path(python).is_file():
        pytest.skip(f"no Python with Blender's bpy at {python}; `make test-blender` makes it")
    return python
