"""Sweeps of `motiongen sample`: named folders, going on after a stop, failures that stop nothing else, launchers."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st

from motiongen.cli import main
from motiongen.commands.sweep import COMPLETE, FAILURE, RUNNING, SUMMARY, FolderSweeper
from motiongen.commands.sweep_plan import Run, plan_runs
from motiongen.errors import MotionGenError
from tests.strategies import random_motion, random_skeleton

SETTINGS = ("preview=none", "frames=24", "count=1")
PLUGINS = {"joblib": "hydra_joblib_launcher", "ray": "hydra_ray_launcher"}


def is_installed(launcher: str) -> bool:
    return find_spec("hydra_plugins") is not None and find_spec(f"hydra_plugins.{PLUGINS[launcher]}") is not None


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two clips, one of an odd name, a broken one, and a file that is no clip."""
    folder = tmp_path_factory.mktemp("clips of a rig")
    rng = np.random.default_rng(0)
    skeleton = random_skeleton(rng, 5, depth_first=True)
    for name in ("walk", "it's (1)"):
        random_motion(rng, skeleton, frames=50, translating=(0,), smooth=True).save(folder / f"{name}.bvh")
    (folder / "broken.bvh").write_text("HIERARCHY\n")
    (folder / "notes.txt").write_text("not a clip\n")
    return folder


def sweep(*arguments: object) -> int:
    return main(["sample", "-m", *SETTINGS, *map(str, arguments)])


def motions(folder: Path) -> dict[str, bytes]:
    return {path.parent.name: path.read_bytes() for path in sorted(folder.glob("*/sample_0000.bvh"))}


# -- runs and their names


def plan(*overrides: str) -> list[Run]:
    return plan_runs(OverridesParser.create().parse_overrides(list(overrides)))


@given(st.lists(st.lists(st.integers(0, 99), min_size=1, max_size=4), min_size=1, max_size=3))
def test_every_combination_of_different_values_is_a_run_with_a_name_of_its_own(values: list[list[int]]) -> None:
    runs = plan(*(f"a.k{i}={','.join(map(str, choices))}" for i, choices in enumerate(values)))
    expected = list(product(*(dict.fromkeys(choices) for choices in values)))
    assert [tuple(int(o.split("=")[1]) for o in run.overrides) for run in runs] == expected
    assert len({run.name for run in runs}) == len(runs)


@given(st.lists(st.text(min_size=1, max_size=100).filter(lambda text: "\n" not in text), min_size=2, unique=True))
def test_any_clip_names_give_different_names_of_one_folder_each(texts: list[str]) -> None:
    usable = [re.sub(r"[\\'\0*?\[]", "", text) or "x" for text in texts]  # neither ends the quotes nor is a pattern
    runs = plan("input=" + ",".join(f"'{text}.bvh'" for text in usable))
    names = {run.name.casefold() for run in runs}
    assert len(names) == len(runs) == len(set(usable))
    assert all(name not in (".", "..") and not set(name) & set("/\\:*?\"<>| '") for name in names)


def test_names_say_what_varies() -> None:
    assert [run.name for run in plan("input=a/walk.bvh,a/run.bvh", "seed=0,1", "frames=9")] == [
        "walk,seed=0",
        "walk,seed=1",
        "run,seed=0",
        "run,seed=1",
    ]
    assert [run.name for run in plan("input=a/walk.bvh,b/walk.bvh")] == ["a_walk.bvh", "b_walk.bvh"]
    assert [run.name for run in plan("input=[a.bvh,b.bvh],c.npz")] == ["a+b", "c"]
    assert [run.name for run in plan("a.alpha=1", "b.alpha=2,3")] == ["alpha=2", "alpha=3"]
    assert [run.name for run in plan("a.alpha=1,2", "b.alpha=3,4")][:1] == ["a.alpha=1,b.alpha=3"]
    assert [run.name for run in plan("seed=3")] == ["run"]


# -- what a sweep makes


def test_a_sweep_over_a_pattern_makes_what_single_runs_make_and_lists_what_failed(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert sweep(f"input={clips}/*.bvh", "seed=0,1", f"output={out}") == 2
    said = capsys.readouterr()
    made = motions(out)
    assert set(made) == {"walk,seed=0", "walk,seed=1", "it_s_1_,seed=0", "it_s_1_,seed=1"}
    for name, clip, seed in (("walk,seed=1", "walk", 1), ("it_s_1_,seed=0", "it's (1)", 0)):
        single = tmp_path / name
        assert main(["sample", *SETTINGS, f"input={clips / clip}.bvh", f"seed={seed}", f"output={single}"]) == 0
        assert (single / "sample_0000.bvh").read_bytes() == made[name]
    lines = said.out.splitlines()
    for seed in (0, 1):
        assert sum(line.startswith(f"  broken,seed={seed} ({clips}/broken.bvh): ") for line in lines) == 1
    assert len(lines) == 6 + 1 + 2  # a line a run, what came of all, and the failures
    assert (
        said.err == f"motiongen: 2 of 6 runs failed; see {out / SUMMARY}, mend the cause and run the same command "
        "again, which makes only what is left\n"
    )
    summary = json.loads((out / SUMMARY).read_text())
    assert set(summary["made"]) == set(made)
    assert [entry["run"] for entry in summary["failed"]] == ["broken,seed=0", "broken,seed=1"]
    assert {path.name for path in (out / "broken,seed=0").iterdir()} == {FAILURE}


def test_the_same_command_makes_only_what_is_left(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = (f"input={clips / 'walk.bvh'}", "seed=0,1,2", f"output={out}")
    assert sweep(*command) == 0
    first, written = motions(out), {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    (out / "seed=1" / COMPLETE).unlink()  # as if killed in the middle of it
    (out / "seed=1" / RUNNING).touch()
    capsys.readouterr()
    assert sweep(*command) == 0
    assert f"2 of 3 runs are complete in {out}, and skipped" in capsys.readouterr().out
    assert motions(out) == first
    changed = {path.parent.name for path, when in written.items() if path.stat().st_mtime_ns != when}
    assert changed == {"seed=1"}
    summary = json.loads((out / SUMMARY).read_text())
    assert (summary["made"], summary["skipped"]) == (["seed=1"], ["seed=0", "seed=2"])
    assert not (out / "seed=1" / RUNNING).exists()


def test_a_run_with_other_settings_is_not_taken_for_done(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = (f"input={clips / 'walk.bvh'}", "seed=0,1", f"output={out}")
    assert sweep(*command) == 0
    first = motions(out)
    assert sweep(*command, "frames=30") == 0
    assert json.loads((out / SUMMARY).read_text())["skipped"] == []
    assert all(motions(out)[name] != first[name] for name in first)


def test_a_killed_sweep_goes_on(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [f"input={clips / 'walk.bvh'}", "seed=range(6)", f"output={out}"]
    process = subprocess.Popen([sys.executable, "-m", "motiongen.cli", "sample", "-m", *SETTINGS, *command])
    try:
        while not list(out.glob(f"*/{COMPLETE}")) and process.poll() is None:
            time.sleep(0.01)
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    before = len(list(out.glob(f"*/{COMPLETE}")))
    assert sweep(*command) == 0
    summary = json.loads((out / SUMMARY).read_text())
    assert len(summary["skipped"]) == before >= 1
    assert len(summary["skipped"]) + len(summary["made"]) == len(motions(out)) == 6


# -- what can go wrong


def test_a_bug_in_one_run_is_noted_with_its_traceback(
    clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from motiongen.commands import sample

    def failing(request: sample.Request, *rest: object, **others: object) -> None:
        raise ZeroDivisionError(f"seed {request.seed}")

    monkeypatch.setattr(sample, "_sample", failing)
    assert sweep(f"input={clips / 'walk.bvh'}", "seed=0,1", f"output={tmp_path}") == 2
    text = (tmp_path / "seed=1" / FAILURE).read_text()
    assert text.startswith("ZeroDivisionError: seed 1\nTraceback")


class BreakingLauncher:
    """Runs one after the other, and breaks down at those whose seed is in `deadly`."""

    def __init__(self, folder: Path, deadly: set[int]) -> None:
        self.folder, self.deadly = folder, deadly
        self.launched: list[int] = []

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> None:
        for overrides in job_overrides:
            seed = int(overrides[0].removeprefix("seed="))
            folder = self.folder / f"seed={seed}"
            folder.mkdir(parents=True)
            (folder / RUNNING).touch()
            self.launched.append(seed)
            if seed in self.deadly:
                raise RuntimeError("a worker was killed\nlong story")
            (folder / RUNNING).unlink()
            (folder / COMPLETE).touch()


def test_a_run_that_takes_its_process_down_fails_and_the_others_go_on(tmp_path: Path) -> None:
    sweeper = FolderSweeper()
    sweeper.folder = tmp_path
    launcher = BreakingLauncher(tmp_path, deadly={1, 4})
    sweeper.launcher = launcher
    sweeper._launch(plan("seed=0,1,2,3,4"))
    assert launcher.launched == [0, 1, 2, 3, 4]
    for seed in (1, 4):
        reason = "its process ended before it did (RuntimeError: a worker was killed)"
        assert (tmp_path / f"seed={seed}" / FAILURE).read_text().splitlines() == [reason]


def test_a_worker_lost_between_two_runs_costs_none(tmp_path: Path) -> None:
    class Losing(BreakingLauncher):
        def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> None:
            super().launch(job_overrides[:1], initial_job_idx)
            if len(job_overrides) > 1:
                raise RuntimeError("a worker was killed")

    sweeper = FolderSweeper()
    launcher = Losing(tmp_path, set())
    sweeper.folder, sweeper.launcher = tmp_path, launcher
    sweeper._launch(plan("seed=0,1,2"))
    assert launcher.launched == [0, 1, 2]
    assert not list(tmp_path.glob(f"*/{FAILURE}"))


def test_a_launcher_that_cannot_begin_is_one_line(tmp_path: Path) -> None:
    class Refusing(BreakingLauncher):
        def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> None:
            raise ConnectionError("no cluster there")

    sweeper = FolderSweeper()
    sweeper.folder, sweeper.launcher = tmp_path, Refusing(tmp_path, set())
    with pytest.raises(MotionGenError, match=r"launcher cannot go on.*no cluster there"):
        sweeper._launch(plan("seed=0,1"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-m", "input=nowhere/*.bvh"], ["no clip fits", "nowhere/*.bvh", ".npz"]),
        (["input=nowhere/*.bvh"], ["is a pattern", "-m"]),
        (["-m", "seed=interval(0,1)"], ["cannot sweep over", "interval", "range"]),
        (["-m", "seed=0,1", "frmes=3"], ["unknown setting 'frmes'", "did you mean 'frames'"]),
        (["-m", "generator=genmm,gemm"], ["no generator 'gemm'", "genmm"]),
    ],
)
def test_mistakes_are_refused_before_anything_is_made(
    arguments: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sample", *arguments, f"output={tmp_path / 'out'}"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert all(word in message for word in words)
    assert not (tmp_path / "out").exists()


# -- launchers


@pytest.mark.parametrize(("launcher", "extra"), [("joblib", "sweep"), ("ray", "ray")])
def test_a_launcher_that_is_not_installed_names_its_extra(
    launcher: str, extra: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if is_installed(launcher):
        pytest.skip(f"the extra '{extra}' is installed")
    assert sweep(f"hydra/launcher={launcher}") == 2
    assert f"hydra/launcher={launcher} needs the extra '{extra}': pip install" in capsys.readouterr().err


@pytest.mark.parametrize(
    "settings",
    [
        ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
        ("hydra/launcher=ray", "+hydra.launcher.ray.init.num_cpus=2"),
    ],
    ids=["joblib", "ray"],
)
def test_a_launcher_makes_the_same_as_one_process(settings: tuple[str, ...], clips: Path, tmp_path: Path) -> None:
    """From a folder of its own with relative paths, and in a process of its own, as Ray leaves traces in one."""
    launcher = settings[0].partition("=")[2]
    if not is_installed(launcher):
        pytest.skip(f"hydra/launcher={launcher} is not installed")
    (tmp_path / "clips").symlink_to(clips)
    command = [sys.executable, "-m", "motiongen.cli", "sample", "-m", *SETTINGS, "input=clips/*.bvh", "seed=0,1"]
    ended = subprocess.run(
        [*command, *settings, "output=out"], cwd=tmp_path, capture_output=True, text=True, timeout=200, check=False
    )
    assert ended.returncode == 2, ended.stderr
    assert "broken,seed=1 (clips/broken.bvh): " in ended.stdout
    assert sweep(f"input={clips}/*.bvh", "seed=0,1", f"output={tmp_path / 'alone'}") == 2
    assert len(motions(tmp_path / "out")) == 4
    assert motions(tmp_path / "out") == motions(tmp_path / "alone")
