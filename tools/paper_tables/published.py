"""Figures that others have published, to be printed beside our own."""

from __future__ import annotations

from collections.abc import Mapping

Row = tuple[float | None, ...]

# Table 1: coverage in percent, set diversity, global and local patch distance, seconds.
TABLE_1: Mapping[str, Row] = {
    "genmm": (99.89, 0.28, 0.22, 0.18, 0.08),
    "ganimator": (49.07, 0.24, 2.18, 2.08, 0.12),
}

# The authors' released code with E = 5 and K = 4 on our clips, by our definitions, on a machine of 2 cores.
TABLE_1_RELEASED: Mapping[str, Mapping[str, Row]] = {
    "genmm": {
        "Salsa-Dancing-6": (100.0, None, 0.069, 0.066, 2.05),
        "Baseball-Milling-Idle": (99.7, None, 0.077, 0.071, 2.31),
        "Walk-In-Circle": (100.0, None, 0.112, 0.084, 0.73),
        "elephant-idle1": (100.0, None, 0.060, 0.040, 0.22),
    },
}

# Table 2: coverage in percent with 2, 3, 4 and 5 examples.
TABLE_2: Mapping[str, Row] = {
    "genmm": (99.71, 99.95, 99.91, 99.64),
    "ganimator": (63.55, 23.90, 17.30, 16.22),
}

# Table 3: coverage in percent with 24, 65 and 433 joints.
TABLE_3: Mapping[str, Row] = {
    "genmm": (97.82, 99.84, 86.90),
    "ganimator": (92.10, 44.10, 2.38),
}

# Table 4: what is changed -> options, and coverage in percent, set diversity, global and local patch distance.
TABLE_4: Mapping[str, Mapping[str, tuple[Mapping[str, float | None], Row]]] = {
    "genmm": {
        "the paper's defaults": ({}, (99.89, 0.28, 0.22, 0.18)),
        "α not used": ({"alpha": None}, (87.45, 0.27, 0.18, 0.17)),
        "α = 5": ({"alpha": 5.0}, (87.89, 0.27, 0.18, 0.17)),
        "α = 0.5": ({"alpha": 0.5}, (88.47, 0.27, 0.18, 0.17)),
        "α = 0.05": ({"alpha": 0.05}, (93.80, 0.27, 0.18, 0.17)),
        "α = 0.005": ({"alpha": 0.005}, (99.96, 0.27, 0.30, 0.23)),
        "α = 0": ({"alpha": 0.0}, (36.78, 0.25, 2.17, 1.60)),
        "K = 20": ({"coarse_patches": 20.0}, (87.74, 0.25, 1.03, 0.71)),
        "K = 15": ({"coarse_patches": 15.0}, (92.04, 0.26, 0.73, 0.54)),
        "K = 10": ({"coarse_patches": 10.0}, (96.07, 0.27, 0.42, 0.36)),
        "p = 23": ({"patch_size": 23}, (99.85, 0.26, 0.27, 0.24)),
        "p = 17": ({"patch_size": 17}, (99.88, 0.26, 0.23, 0.21)),
        "p = 5": ({"patch_size": 5}, (99.66, 0.27, 0.41, 0.32)),
        "r = 2": ({"scale_factor": 2.0}, (99.61, 0.27, 0.22, 0.20)),
        "r = 4": ({"scale_factor": 4.0}, (99.16, 0.27, 0.34, 0.28)),
        "r = 8": ({"scale_factor": 8.0}, (97.97, 0.26, 0.57, 0.42)),
    },
}
