"""`motiongen sample`: new motions from examples, as a Hydra application over `configs/sample.yaml`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from motiongen.commands.constraint_settings import Material, read_constraints
from motiongen.commands.hydra_app import run_application
from motiongen.commands.inputs import Inputs, load_examples, read_input
from motiongen.commands.settings import (
    choice,
    chosen_generator,
    leaving_no_empty,
    own_format,
    positive,
    suffix_of,
    up_and_unit,
    whole,
)
from motiongen.commands.sweep import completing, composed_text
from motiongen.console import progress_bar
from motiongen.errors import MotionGenError
from motiongen.generators.constraints import Constraint, FixedJoints, Keyframes, Segment, Style
from motiongen.generators.options import Options
from motiongen.generators.registry import GeneratorSpec
from motiongen.motion import Motion

if TYPE_CHECKING:
    from motiongen.generators.base import Generator
    from motiongen.report import Report

PREVIEWS = ("auto", "mp4", "gif", "none")


@dataclass(frozen=True)
class Request:
    """A composed configuration, checked: everything `motiongen sample` needs to start."""

    inputs: Inputs
    up: str | None
    unit: str | None
    spec: GeneratorSpec
    options: Options
    frames: int | None
    count: int
    seed: int
    format: str | None
    preview: str
    preview_count: int
    preview_seconds: float
    preview_rate: float
    constraints: Mapping[str, Mapping[str, Any]]


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_application(_task, "sample", arguments)


def _task(config: DictConfig) -> None:
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    with leaving_no_empty(folder):
        _sample(read_request(config), folder, composed_text(config), alone=hydra.mode is not RunMode.MULTIRUN)


def read_request(config: DictConfig) -> Request:
    """Check a composed configuration.

    Raises:
        MotionGenError: naming the setting, what came and what is allowed.
    """
    constraints = _constraints(config)
    values = cast(dict[str, Any], OmegaConf.to_container(config, resolve=True))
    spec, options = chosen_generator(values["generator"])
    up, unit = up_and_unit(values)
    frames = values["frames"]
    return Request(
        inputs=read_input(values["input"], needed=not spec.capabilities.needs_training),
        up=up,
        unit=unit,
        spec=spec,
        options=spec.options_type().build(options),
        frames=None if frames is None else whole("frames", frames, 1),
        count=whole("count", values["count"], 1),
        seed=whole("seed", values["seed"], 0),
        format=own_format(values),
        preview=_preview(values["preview"]),
        preview_count=whole("preview_count", values["preview_count"], 0),
        preview_seconds=positive("preview_seconds", values["preview_seconds"]),
        preview_rate=positive("preview_rate", values["preview_rate"]),
        constraints=constraints,
    )


def _sample(request: Request, folder: Path, composed: str, alone: bool) -> None:
    given = load_examples(request.inputs, request.up, request.unit)
    examples = given.body
    begun = time.perf_counter()
    generator = request.spec.create(request.options)
    if given.clips:
        generator.fit(given.clips)
    fitted = time.perf_counter()
    material = Material(examples, generator.frame_rate, request.up, request.unit)
    constraints = [*read_constraints(request.constraints, material), *given.constraints]
    frames = request.frames or _default_frames(generator, constraints)
    with _watched("sampling", alone) as progress:
        motions = generator.sample(frames, request.count, request.seed, constraints, progress)
    sampled = time.perf_counter()
    from motiongen.report import make_report

    run = {
        "settings": list(HydraConfig.get().overrides.task),
        "generator": request.spec.name,
        "options": request.options.to_dict(),
        "examples": [clip.name for clip in given.clips],
        "constraints": list(request.constraints),
        "frames": frames,
        "frame_rate_hz": generator.frame_rate,
        "count": request.count,
        "seed": request.seed,
        "fit_seconds": fitted - begun,
        "sample_seconds": sampled - fitted,
        "credit": generator.credit,
    }
    with completing(folder, composed) as complete:
        written = [folder / f"{motion.name}.{suffix_of(motion, request.format)}" for motion in motions]
        for motion, path in zip(motions, written):
            motion.save(path)
        pictures = _draw(request, examples, motions, folder, alone)
        report = make_report(examples, motions, run, in_parts=bool(given.constraints))
        pages = report.save(folder)
    if alone:
        _summarise(report, sampled - fitted, folder, [*written, *pictures, *pages, complete])


def _watched(what: str, alone: bool) -> AbstractContextManager[Callable[[float], None]]:
    """A progress bar, but not for each of a sweep's runs, which share a terminal."""
    return progress_bar(what) if alone else nullcontext(lambda share: None)


def _draw(
    request: Request, examples: Sequence[Motion], motions: Sequence[Motion], folder: Path, alone: bool
) -> list[Path]:
    if request.preview == "none" or request.preview_count == 0:
        return []
    from motiongen.render import render_clips

    shown = [*examples[:1], *motions[: request.preview_count]]
    labels = ["example"] * len(examples[:1]) + [motion.name.replace("_", " ") for motion in motions]
    pictures = [folder / f"preview.{request.preview}", folder / "film_strip.png"]
    with _watched("drawing", alone) as progress:
        for picture in pictures:
            render_clips(
                shown,
                picture,
                labels=labels[: len(shown)],
                frame_rate=None if picture.suffix == ".png" else request.preview_rate,
                seconds=request.preview_seconds,
                progress=progress,
            )
    return pictures


def _summarise(report: Report, seconds: float, folder: Path, files: Sequence[Path]) -> None:
    run, metrics = report.run, report.metrics
    source = ", ".join(run["examples"]) or "a checkpoint"
    print(
        f"{run['count']} x {run['frames']} frames at {run['frame_rate_hz']:g} Hz from {source} "
        f"in {seconds:.2f} s, seed {run['seed']}"
    )
    if metrics is not None:
        print(f"coverage {metrics.coverage:.3f}, local patch distance {metrics.local_patch_distance:.3f}")
    if run["credit"]:
        print(f"model: {run['credit']}")
    print(f"in {folder}:")
    print("  " + ", ".join(path.name for path in files))
    known = {path.name for path in files}
    if stale := sorted(path.name for path in folder.glob("sample_*.*") if path.name not in known):
        print(f"  from an earlier run, left as they were: {', '.join(stale)}")


def _default_frames(generator: Generator, constraints: Sequence[Constraint]) -> int:
    """As many as a constraint says, else as many as the generator usually makes, at its rate."""
    for constraint in constraints:
        if isinstance(constraint, Segment):
            return len(constraint.motion)
        if isinstance(constraint, Keyframes):
            return max(constraint.poses) + 1
        if isinstance(constraint, FixedJoints):
            return len(constraint.motion.resample(generator.frame_rate))
        if isinstance(constraint, Style):
            return len(constraint.content.resample(generator.frame_rate))
    return generator.usual_frames


def _constraints(config: DictConfig) -> dict[str, dict[str, Any]]:
    if not OmegaConf.is_dict(config.constraints):
        raise MotionGenError(f"constraints={config.constraints} says nothing; write constraint=NAME, such as loop")
    for kind, values in config.constraints.items():
        if not OmegaConf.is_dict(values):
            raise MotionGenError(
                f"constraints.{kind}={values} says nothing; write constraint={kind}, and constraints.{kind}.KEY=VALUE"
            )
        for key in values:
            if OmegaConf.is_missing(values, key):
                raise MotionGenError(f"constraint={kind} needs constraints.{kind}.{key}=...; see configs/constraint")
    return cast(dict[str, dict[str, Any]], OmegaConf.to_container(config.constraints))


def _preview(value: Any) -> str:
    """The suffix of the preview, or none."""
    from importlib.util import find_spec

    chosen: str = choice("preview", "none" if value in (None, False) else value, PREVIEWS)
    has_video = find_spec("imageio_ffmpeg") is not None
    if chosen == "mp4" and not has_video:
        raise MotionGenError("preview=mp4 needs the extra 'video': pip install 'motiongen[video]'; gif works without")
    return chosen if chosen != "auto" else ("mp4" if has_video else "gif")
