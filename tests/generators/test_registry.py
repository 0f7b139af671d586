"""The registry: lazy, open to other packages, and not to be brought down by a broken one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import motiongen as mg
from motiongen import MotionGenError

PLUG_IN = '''
"""A generator that plays its first example over and over."""
from dataclasses import dataclass
import numpy as np
import motiongen as mg

SPEC = mg.GeneratorSpec("parrot", "Plays the example again.", "parrot:Options", "parrot:Parrot")

@dataclass(frozen=True)
class Options(mg.Options):
    offset: int = mg.option(0, "Frame to begin with.", minimum=0)

class Parrot(mg.Generator):
    capabilities = mg.Capabilities(constraints=(mg.Loop,))

    @property
    def frame_rate(self):
        return self.examples[0].frame_rate

    def _fit(self, motions):
        pass

    def _sample(self, frames, count, seed, constraints, progress):
        clip = self.examples[0]
        order = (np.arange(frames) + self.options.offset + seed) % len(clip)
        progress(1.0)
        return [clip.replace(rotations=clip.rotations[order], translations=clip.translations[order],
                             name=f"sample_{k:04d}") for k in range(count)]
'''

PROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"
[project]
name = "motiongen-parrot"
version = "1.0"
[project.entry-points."motiongen.generators"]
parrot = "parrot:SPEC"
crashing = "no_such_module_anywhere:SPEC"
pointless = "parrot:Options"
impostor = "impostor:SPEC"
[tool.setuptools]
py-modules = ["parrot", "impostor"]
"""

IMPOSTOR = 'import motiongen as mg\nSPEC = mg.GeneratorSpec("genmm", "Not the real one.", "x:y", "x:z")\n'


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which the plug-in package is really installed, by pip."""
    source, site = tmp_path_factory.mktemp("plug-in"), tmp_path_factory.mktemp("site")
    for name, text in (("parrot.py", PLUG_IN), ("impostor.py", IMPOSTOR), ("pyproject.toml", PROJECT)):
        (source / name).write_text(text)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(site), str(source)], check=True, capture_output=True)
    return {**os.environ, "PYTHONPATH": str(site)}


def motiongen(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "motiongen.cli", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)


def test_a_plug_in_is_listed_and_broken_ones_say_why(environment: dict[str, str]) -> None:
    listed = json.loads(motiongen(environment, "list", "--json").stdout)
    by_name = {entry["name"]: entry for entry in listed["generators"]}
    assert by_name["genmm"]["error"] is None
    assert by_name["parrot"] == {"name": "parrot", "description": "Plays the example again.", "error": None}
    assert "no_such_module_anywhere" in by_name["crashing"]["error"]
    assert "is no GeneratorSpec" in by_name["pointless"]["error"]
    assert any("the name 'genmm' is taken" in (entry["error"] or "") for entry in listed["generators"])


def test_a_plug_in_generates_from_the_command_line_with_its_own_options(
    environment: dict[str, str], tmp_path: Path
) -> None:
    arguments = ("sample", "generator=parrot", "generator.offset=7", "frames=30", "count=1", "preview=none")
    done = motiongen(environment, *arguments, f"output={tmp_path / 'out'}")
    assert done.returncode == 0, done.stderr
    assert len(mg.load(tmp_path / "out" / "sample_0000.bvh")) == 30
    refused = motiongen(environment, *arguments, "generator.ofset=7")
    assert refused.returncode == 2
    assert "did you mean 'generator.offset'?" in refused.stderr


def test_a_broken_plug_in_raises_its_error_when_asked_for(environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "import motiongen as mg; mg.create('crashing')"],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert "generator 'crashing' cannot be loaded" in done.stderr
    assert "no_such_module_anywhere" in done.stderr


def test_listing_imports_no_generator() -> None:
    code = "import sys, motiongen.generators.registry as r; r.specs(); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_unknown_names_and_options_come_with_the_nearest() -> None:
    with pytest.raises(MotionGenError, match="no generator 'genm'; did you mean 'genmm'"):
        mg.create("genm")
    with pytest.raises(MotionGenError, match="unknown option 'alhpa'; did you mean 'alpha'"):
        mg.create("genmm", alhpa=1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"patch_size": 1}, "patch_size must be at least 2, not 1"),
        ({"patch_size": 2.5}, "patch_size must be of type int, not 2.5"),
        ({"patch_size": True}, "patch_size must be of type int, not True"),
        ({"alpha": -0.1}, "alpha must be at least 0, not -0.1"),
        ({"alpha": "much"}, "alpha must be of type float or none, not 'much'"),
        ({"scale_factor": 1}, "scale_factor must be at least 1.02, not 1"),
        ({"working_rate": 0}, "working_rate must be more than 0, not 0"),
        ({"noise": float("nan")}, "noise must be a finite number, not nan"),
        ({"standing_feet": 1}, "standing_feet must be of type str, not 1"),
    ],
)
def test_options_out_of_range_are_refused(options: dict, message: str) -> None:
    with pytest.raises(MotionGenError, match=message):
        mg.create("genmm", **options)
