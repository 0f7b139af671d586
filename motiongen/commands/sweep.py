"""Sweeps: many runs of a command from one command line, each in its own folder.

What has become of a run is told by the files in its folder, so that it is known whichever process or machine ran it,
and after the sweep itself was killed: `COMPLETE` is the last file that a run writes, `FAILURE` says why there is none.
"""

from __future__ import annotations

import functools
import json
import os
import re
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict

from motiongen.commands.sweep_plan import Run, plan_runs
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write

COMPLETE = "config.yaml"
FAILURE = "failure.txt"
RUNNING = "running"
SUMMARY = "sweep.json"
MADE = "made"

# Each ended run is printed by the sweep itself; only settings go through Ray's memory, whose size it may choose.
RAY_INIT = {"include_dashboard": False, "log_to_driver": False, "logging_level": 30, "object_store_memory": None}
POLL_SECONDS = 0.5


def composed_text(config: DictConfig) -> str:
    """The composed configuration of a run, which tells whether a folder holds the results of the same run."""
    return OmegaConf.to_yaml(config, resolve=True)


@contextmanager
def completing(folder: Path, composed: str) -> Iterator[Path]:
    """Around what writes a run's results: `COMPLETE`, of which the path is given, is gone before and there afterwards.

    Args:
        folder: for results.
        composed: see `composed_text`.
    """
    path = folder / COMPLETE
    path.unlink(missing_ok=True)  # an earlier run's; what follows replaces its files one by one
    yield path
    with atomic_write(path) as file:
        file.write(composed.encode())


@dataclass(frozen=True)
class SweptTask:
    """A task as one of many: what goes wrong is noted in its folder and stops nothing else.

    Attributes:
        task: what to do with a composed configuration; raises where it cannot.
        working_folder: what relative paths start from, also on other machines.
        sweep_process: the process that launches the runs.
    """

    task: Callable[[DictConfig], None]
    working_folder: str
    sweep_process: int

    def __call__(self, config: DictConfig) -> None:
        """Run the task in the folder that Hydra has made for it."""
        if os.getppid() == self.sweep_process:
            _end_with_parent()
        with _busy:
            self._run(config, Path(HydraConfig.get().runtime.output_dir))

    def _run(self, config: DictConfig, folder: Path) -> None:
        running = folder / RUNNING
        running.touch()
        try:
            os.chdir(self.working_folder)
            self.task(config)
        except MotionGenError as error:
            _note_failure(folder, str(error))
        except Exception as error:  # a bug that one clip brings out is none of the others' concern
            _note_failure(folder, f"{type(error).__name__}: {error}", traceback.format_exc())
        finally:
            running.unlink(missing_ok=True)


_busy = threading.Lock()


@functools.cache
def _end_with_parent() -> None:
    """End this worker, between two runs, when the process that it works for has been killed; joblib's would stay."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(POLL_SECONDS)
        with _busy:
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class FolderSweeper(Sweeper):
    """Launches every combination of the values given, but for those that are complete from an earlier sweep."""

    config: DictConfig
    hydra_context: HydraContext
    launcher: Launcher

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Called by Hydra before `sweep`."""
        if config.hydra.runtime.choices["hydra/launcher"] == "ray":
            _tame_ray(config.hydra.launcher.ray)
        self.config = config
        self.hydra_context = hydra_context
        self.folder = Path(os.path.abspath(os.path.expanduser(str(config.hydra.sweep.dir))))
        task = SweptTask(task_function, os.getcwd(), os.getpid())
        self.launcher = Plugins.instance().instantiate_launcher(hydra_context, task, config)

    def sweep(self, arguments: list[str]) -> None:
        """Launch the runs that are left, and say what has become of all.

        Raises:
            MotionGenError: if a setting is wrong for all, or, when the others are done, if a run failed.
        """
        parser = OverridesParser.create(config_loader=self.hydra_context.config_loader)
        runs = plan_runs(parser.parse_overrides(arguments))
        composed = self._compose_all(runs)
        skipped = [run for run in runs if self._is_complete(run, composed[run])]
        if skipped:
            print(f"{len(skipped)} of {len(runs)} runs are complete in {self.folder}, and skipped", flush=True)
        done = set(skipped)
        left = [run for run in runs if run not in done]
        for run in left:
            for name in (COMPLETE, FAILURE, RUNNING):  # of an earlier sweep, with other settings or without success
                (self.folder / run.name / name).unlink(missing_ok=True)
        try:
            with _progress(self.folder, left, len(skipped), len(runs)):
                self._launch(left)
        finally:
            failed = _summarise(self.folder, left, skipped)
        if failed:
            raise MotionGenError(
                f"{failed} of {len(runs)} runs failed; see {self.folder / SUMMARY}, mend the cause and run the same "
                "command again, which makes only what is left"
            )

    def _compose_all(self, runs: Sequence[Run]) -> dict[Run, str]:
        """The composed configuration of each run.

        Hydra composes the first run with each choice of what shapes a configuration (groups, additions, removals); the
        others differ from it in plain values, which are put in, thirty times as fast.
        """
        loader = self.hydra_context.config_loader
        shaping = {key for key in runs[0].values if key[0] in "+~" or "@" in key or loader.get_group_options(key)}
        first: dict[str, DictConfig] = {}
        texts = {}
        for run in runs:
            shape = repr([run.values[key] for key in shaping])
            if shape not in first:
                first[shape] = loader.load_sweep_config(self.config, list(run.overrides))
                with open_dict(first[shape]):
                    del first[shape]["hydra"]
            for key, value in run.values.items():
                if key not in shaping and not key.startswith("hydra."):
                    OmegaConf.update(first[shape], key, value)
            texts[run] = composed_text(first[shape])
        return texts

    def _is_complete(self, run: Run, composed: str) -> bool:
        try:
            return (self.folder / run.name / COMPLETE).read_text(encoding="utf-8") == composed
        except (OSError, UnicodeDecodeError):
            return False

    def _launch(self, runs: Sequence[Run]) -> None:
        """Launch `runs`; where a launcher breaks down, again those that it had not begun, while that leads on."""
        left = list(runs)
        while left:
            reason = "nothing appeared in its folder, which all machines must share"
            begun = left
            try:
                self.launcher.launch([self._overrides(run) for run in left], initial_job_idx=0)
            except Exception as error:  # a launcher's own, such as a worker that was killed for its memory
                reason = f"{type(error).__name__}: {_first_sentence(error)}"
                begun = [run for run in left if (self.folder / run.name / RUNNING).exists()]
                if not begun and not any(_outcome(self.folder / run.name) for run in left):
                    raise MotionGenError(
                        f"the launcher cannot go on ({reason}); check the settings hydra.launcher"
                    ) from error
                reason = f"its process ended before it did ({reason})"
            for run in begun:
                if _outcome(self.folder / run.name) is None:
                    _note_failure(self.folder / run.name, reason)
                (self.folder / run.name / RUNNING).unlink(missing_ok=True)
            left = [run for run in left if _outcome(self.folder / run.name) is None]

    def _overrides(self, run: Run) -> list[str]:
        places = {"hydra.sweep.dir": str(self.folder), "hydra.sweep.subdir": run.name}
        quoted = [f"{key}={QuotedString(value, Quote.single).with_quotes()}" for key, value in places.items()]
        return [*run.overrides, *quoted]


def register_sweeper() -> None:
    """Make `FolderSweeper` known to Hydra, under the name in `configs/hydra/sweeper/folders.yaml`.

    Hydra takes plug-ins from the package `hydra_plugins` only; an entry saves having such a package at the top level.
    """
    Plugins.instance().class_name_to_class["hydra_plugins.motiongen.FolderSweeper"] = FolderSweeper


def _tame_ray(settings: DictConfig) -> None:
    """Fill in how Ray behaves here, where the command line does not say otherwise."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # read when Ray is first imported
    with open_dict(settings):
        for key, value in RAY_INIT.items():
            settings.init.setdefault(key, value)
        if settings.init.address is None and "RAY_ADDRESS" not in os.environ:
            settings.init.address = "local"  # else Ray would look for traces of a cluster, also of one that has ended
        settings.remote.setdefault("max_retries", 0)  # a run that takes its process down is reported, not repeated


def _note_failure(folder: Path, reason: str, details: str = "") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / FAILURE) as file:
        file.write("\n".join([" ".join(reason.split()), details]).encode(errors="backslashreplace"))


def _first_sentence(error: Exception) -> str:
    return re.split(r"[.]?\s*\n|[.] ", str(error).strip())[0]


def _outcome(folder: Path) -> str | None:
    """What has become of a run: `MADE`, the reason why it failed, or None while neither."""
    if (folder / COMPLETE).exists():
        return MADE
    try:
        return (folder / FAILURE).read_text(encoding="utf-8").partition("\n")[0]
    except OSError:
        return None


@contextmanager
def _progress(folder: Path, runs: Sequence[Run], before: int, total: int) -> Iterator[None]:
    """Say of each run, in one line, when it has ended, whichever process runs it."""
    waiting = {run.name: run for run in runs}
    ended = threading.Event()

    def report() -> None:
        for run in list(waiting.values()):
            outcome = _outcome(folder / run.name)
            if outcome is not None:
                del waiting[run.name]
                what = outcome if outcome == MADE else f"failed: {outcome}"
                print(f"[{before + len(runs) - len(waiting)}/{total}] {run.name} {what}", flush=True)

    def watch() -> None:
        while not ended.wait(POLL_SECONDS):
            report()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        report()


def _summarise(folder: Path, launched: Sequence[Run], skipped: Sequence[Run]) -> int:
    """Print and save what was made, skipped and failed; returns how many failed."""
    outcomes = {run: _outcome(folder / run.name) for run in launched}
    failed = {run: outcome for run, outcome in outcomes.items() if outcome not in (MADE, None)}
    by_state: dict[str, list[Any]] = {
        "made": [run.name for run, outcome in outcomes.items() if outcome == MADE],
        "skipped": [run.name for run in skipped],
        "failed": [{"run": run.name, "input": run.clip, "reason": reason} for run, reason in failed.items()],
        "left": [run.name for run, outcome in outcomes.items() if outcome is None],
    }
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / SUMMARY) as file:
        file.write((json.dumps(by_state, indent=1) + "\n").encode())
    print(f"in {folder}: " + ", ".join(f"{len(runs)} {state}" for state, runs in by_state.items() if runs))
    for run, reason in failed.items():
        print(f"  {run.name} ({run.clip}): {reason}")
    return len(failed)
