"""`motiongen sample`: new motions from examples, as a Hydra application over `configs/sample.yaml`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from motiongen import io
from motiongen.assets import EXAMPLE_CLIP
from motiongen.commands.constraint_settings import Material, read_constraints
from motiongen.commands.hydra_app import run_application
from motiongen.console import progress_bar
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.constraints import Constraint, FixedJoints, Keyframes, Segment, Style
from motiongen.generators.options import Options
from motiongen.generators.registry import GeneratorSpec, spec_of
from motiongen.motion import METRES_PER_UNIT, UP_AXES, Motion

if TYPE_CHECKING:
    from motiongen.generators.base import Generator
    from motiongen.report import Report

PREVIEWS = ("auto", "mp4", "gif", "none")


@dataclass(frozen=True)
class Request:
    """A composed configuration, checked: everything `motiongen sample` needs to start."""

    clips: tuple[Path, ...]
    up: str | None
    unit: str | None
    spec: GeneratorSpec
    options: Options
    frames: int | None
    count: int
    seed: int
    format: str
    preview: str
    preview_count: int
    preview_seconds: float
    constraints: Mapping[str, Mapping[str, Any]]


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    hydra_application(arguments)


def hydra_application(arguments: Sequence[str]) -> None:
    """The Hydra application, also for Hydra's own flags and for completion."""
    run_application(_task, "sample", arguments)


def _task(config: DictConfig) -> None:
    folder = Path(HydraConfig.get().runtime.output_dir)
    try:
        request = read_request(config)
        _sample(request, folder, OmegaConf.to_yaml(config, resolve=True))
    except BaseException:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()  # Hydra has made it; a run that came to nothing leaves nothing
        raise


def read_request(config: DictConfig) -> Request:
    """Check a composed configuration.

    Raises:
        MotionGenError: naming the setting, what came and what is allowed.
    """
    constraints = _constraints(config)
    values = cast(dict[str, Any], OmegaConf.to_container(config, resolve=True))
    generator = dict(values["generator"])
    spec = spec_of(str(generator.pop("name")))
    formats = [suffix.lstrip(".") for suffix in io.formats()]
    frames = values["frames"]
    return Request(
        clips=_clips(values["input"]),
        up=_choice("up", values["up"], (None, *UP_AXES)),
        unit=_choice("unit", values["unit"], (None, *METRES_PER_UNIT)),
        spec=spec,
        options=spec.options_type().build(generator),
        frames=None if frames is None else _whole("frames", frames, 1),
        count=_whole("count", values["count"], 1),
        seed=_whole("seed", values["seed"], 0),
        format=_choice("format", values["format"], formats),
        preview=_preview(values["preview"]),
        preview_count=_whole("preview_count", values["preview_count"], 0),
        preview_seconds=_positive("preview_seconds", values["preview_seconds"]),
        constraints=constraints,
    )


def _sample(request: Request, folder: Path, composed: str) -> None:
    examples = [io.load(path, up=request.up, unit=request.unit) for path in request.clips]
    begun = time.perf_counter()
    generator = request.spec.create(request.options).fit(examples)
    fitted = time.perf_counter()
    material = Material(examples, generator.frame_rate, request.up, request.unit)
    constraints = read_constraints(request.constraints, material)
    frames = request.frames or _default_frames(examples, generator, constraints)
    with progress_bar("sampling") as progress:
        motions = generator.sample(frames, request.count, request.seed, constraints, progress)
    sampled = time.perf_counter()
    written = []
    for motion in motions:
        written.append(folder / f"{motion.name}.{request.format}")
        motion.save(written[-1])
    written.append(folder / "config.yaml")
    with atomic_write(written[-1]) as file:
        file.write(composed.encode())
    run = {
        "settings": list(HydraConfig.get().overrides.task),
        "generator": request.spec.name,
        "options": request.options.to_dict(),
        "examples": [clip.name for clip in examples],
        "constraints": list(request.constraints),
        "frames": frames,
        "frame_rate_hz": generator.frame_rate,
        "count": request.count,
        "seed": request.seed,
        "fit_seconds": fitted - begun,
        "sample_seconds": sampled - fitted,
    }
    pictures = _draw(request, examples, motions, folder)
    from motiongen.report import make_report

    report = make_report(examples, motions, run)
    pages = report.save(folder)
    _summarise(report, sampled - fitted, folder, [*written, *pictures, *pages])


def _draw(request: Request, examples: Sequence[Motion], motions: Sequence[Motion], folder: Path) -> list[Path]:
    if request.preview == "none" or request.preview_count == 0:
        return []
    from motiongen.render import render_clips

    shown = [examples[0], *motions[: request.preview_count]]
    labels = ["example", *(motion.name.replace("_", " ") for motion in shown[1:])]
    pictures = [folder / f"preview.{request.preview}", folder / "film_strip.png"]
    with progress_bar("drawing") as progress:
        for picture in pictures:
            render_clips(shown, picture, labels=labels, seconds=request.preview_seconds, progress=progress)
    return pictures


def _summarise(report: Report, seconds: float, folder: Path, files: Sequence[Path]) -> None:
    run, metrics = report.run, report.metrics
    print(
        f"{run['count']} x {run['frames']} frames at {run['frame_rate_hz']:g} Hz from {', '.join(run['examples'])} "
        f"in {seconds:.2f} s, seed {run['seed']}"
    )
    if metrics is not None:
        print(f"coverage {metrics.coverage:.3f}, local patch distance {metrics.local_patch_distance:.3f}")
    print(f"in {folder}:")
    print("  " + ", ".join(path.name for path in files))
    known = {path.name for path in files}
    if stale := sorted(path.name for path in folder.glob("sample_*.*") if path.name not in known):
        print(f"  from an earlier run, left as they were: {', '.join(stale)}")


def _default_frames(examples: Sequence[Motion], generator: Generator, constraints: Sequence[Constraint]) -> int:
    """As many as a constraint says, else twice the examples' length, in frames at the generator's rate."""
    for constraint in constraints:
        if isinstance(constraint, Segment):
            return len(constraint.motion)
        if isinstance(constraint, Keyframes):
            return max(constraint.poses) + 1
        if isinstance(constraint, FixedJoints):
            return len(constraint.motion.resample(generator.frame_rate))
        if isinstance(constraint, Style):
            return len(constraint.content.resample(generator.frame_rate))
    return round(2 * sum(len(clip) * generator.frame_rate / clip.frame_rate for clip in examples))


def _constraints(config: DictConfig) -> dict[str, dict[str, Any]]:
    for kind, values in config.constraints.items():
        for key in values:
            if OmegaConf.is_missing(values, key):
                raise MotionGenError(f"constraint={kind} needs constraints.{kind}.{key}=...; see configs/constraint")
    return cast(dict[str, dict[str, Any]], OmegaConf.to_container(config.constraints))


def _clips(given: Any) -> tuple[Path, ...]:
    """The paths of the examples: files as they are, folders as the clips in them."""
    if given is None:
        return (EXAMPLE_CLIP,)
    entries = given if isinstance(given, list) else [given]
    paths: list[Path] = []
    for entry in entries:
        path = Path(str(entry)).expanduser()
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if p.suffix.lower() in io.formats())
            if not inside:
                raise MotionGenError(f"folder '{path}' holds no clip; the formats are {', '.join(io.formats())}")
            paths += inside
        else:
            paths.append(path)
    if not paths:
        raise MotionGenError("input is an empty list; name at least one clip, or leave it out for the bundled one")
    return tuple(paths)


def _whole(name: str, value: Any, least: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise MotionGenError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return value


def _positive(name: str, value: Any) -> float:
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 < value < float("inf"):
        raise MotionGenError(f"{name} must be a positive number, not {value!r}")
    return float(value)


def _choice(name: str, value: Any, allowed: Sequence[Any]) -> Any:
    if value not in allowed:
        words = ", ".join("null" if word is None else str(word) for word in allowed)
        raise MotionGenError(f"{name} must be one of {words}, not {value!r}")
    return value


def _preview(value: Any) -> str:
    """The suffix of the preview, or none."""
    from importlib.util import find_spec

    chosen: str = _choice("preview", "none" if value in (None, False) else value, PREVIEWS)
    has_video = find_spec("imageio_ffmpeg") is not None
    if chosen == "mp4" and not has_video:
        raise MotionGenError("preview=mp4 needs the extra 'video': pip install 'motiongen[video]'; gif works without")
    return chosen if chosen != "auto" else ("mp4" if has_video else "gif")
