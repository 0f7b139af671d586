"""What comes with the package: the example clip and the configuration files."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent

EXAMPLE_CLIP = _PACKAGE / "assets" / "cmu_01_01.bvh"
"""CMU subject 1, trial 1: jumping forward and turning round, 30 Hz. See NOTICE for its source."""

BUNDLED_MODEL = _PACKAGE / "assets" / "modi"
"""The checkpoint of MoDi that is used where none is named; its README.md says what it was trained on and how well."""

BUNDLED_RECOGNISER = _PACKAGE / "assets" / "recogniser"
"""The recogniser of motions that is used where none is named; it knows the skeleton of `BUNDLED_MODEL`."""


def config_folder() -> Path:
    """The Hydra configuration tree: inside the installed package, or at the root of a source checkout."""
    inside = _PACKAGE / "configs"
    return inside if inside.is_dir() else _PACKAGE.parent / "configs"
