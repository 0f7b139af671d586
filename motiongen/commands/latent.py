"""`motiongen latent`: applications of a latent space, as a Hydra application over `configs/latent.yaml`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from numpy.typing import NDArray
from omegaconf import DictConfig, OmegaConf

from motiongen.commands.hydra_app import run_application
from motiongen.commands.latent_inputs import Point, latent_generator, points
from motiongen.commands.settings import choice, clip_format, leaving_no_empty, whole
from motiongen.commands.sweep import completing, composed_text
from motiongen.console import progress_bar
from motiongen.errors import MotionGenError
from motiongen.files import atomic_path, atomic_write
from motiongen.motion import Motion

if TYPE_CHECKING:
    from PIL.Image import Image

Values = Mapping[str, Any]

_MOST_CELLS = 16
"""Of a grid of film strips, in each direction."""

_WIDEST = 8192
"""Of a picture, in pixels."""

_ROW = 220
"""Usual height of a film strip's row, in pixels."""

_MAPPED = 3000
"""Codes on the map of clusters: its time grows faster than their number."""


@dataclass
class Made:
    """What a task has made, not written yet.

    Attributes:
        motions: by their names.
        codes: (N, L, S) of the motions, in their order.
        report: what was measured, as JSON can hold it.
        pictures: by file name.
        summary: lines to print.
    """

    motions: list[Motion]
    codes: NDArray[np.float32]
    report: dict[str, Any]
    pictures: dict[str, Image]
    summary: list[str] = field(default_factory=list)


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_application(_task, "latent", arguments)


def _task(config: DictConfig) -> None:
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    with leaving_no_empty(folder):
        values = cast(dict[str, Any], OmegaConf.to_container(config, resolve=True))
        task = choice("task", values["task"], list(TASKS))
        written = clip_format(values)
        for name, least in (("seed", 0), ("poses", 1), ("frames", 1)):
            if values[name] is not None:
                whole(name, values[name], least)
        generator = latent_generator(values["generator"])
        made = TASKS[task](generator, values)
        with completing(folder, composed_text(config)) as complete:
            files = _write(made, generator, values, folder, written)
        if hydra.mode is not RunMode.MULTIRUN:  # a sweep tells of its runs itself
            print("\n".join([*made.summary, f"in {folder}:", f"  {', '.join([*files, complete.name])}"]))


def _write(made: Made, generator: Any, values: Values, folder: Path, suffix: str) -> list[str]:
    """Write all, and say what the files are called, for short."""
    from motiongen.generators.modi.latents import save_latents

    for motion in made.motions:
        motion.save(folder / f"{motion.name}.{suffix}")
    save_latents(folder / "latents.safetensors", generator, made.codes, [motion.name for motion in made.motions])
    for name, picture in made.pictures.items():
        with atomic_path(folder / name) as path:
            picture.save(path)
    report = {"settings": dict(values), "motions": [motion.name for motion in made.motions], **made.report}
    with atomic_write(folder / f"{values['task']}.json") as file:
        file.write(json.dumps(report, indent=1).encode())
    return [f"{len(made.motions)} motions", "latents.safetensors", *made.pictures, f"{values['task']}.json"]


# -- tasks


def interpolation(generator: Any, values: Values) -> Made:
    """Columns of motions from some points to others."""
    from motiongen.generators.modi.latent import interpolate, smoothness

    steps = whole("steps", values["steps"], 1)
    _check_grid(steps + 1, steps, "steps")
    starts, ends = points(generator, values["from"], "from"), points(generator, values["to"], "to")
    if len(ends) not in (1, len(starts)):
        raise MotionGenError(f"to must name one, or as many as from, {len(starts)}, not {len(ends)}")
    ends = ends if len(ends) == len(starts) else ends * len(starts)
    _check_grid(len(starts), len(starts), "from")
    codes = [interpolate(start.code, end.code, steps) for start, end in zip(starts, ends)]
    columns, labels, report, summary = [], [], [], []
    for number, (start, end) in enumerate(zip(starts, ends)):
        names = [f"interpolation_{number:02d}_{step:02d}" for step in range(steps + 1)]
        columns.append(_decode(generator, codes[number], names, values))
        labels.append([_said(start), *(f"{step}/{steps}" for step in range(1, steps)), _said(end)])
        even = smoothness(columns[-1])
        report.append(
            {
                "from": start.name,
                "to": end.name,
                "motions": names,
                "steps": [asdict(step) for step in even.steps],
                "ends": asdict(even.ends),
                "largest_step_over_ends": asdict(even.largest_share),
                "all_steps_over_ends": asdict(even.detour),
                "speed_heights_per_second": list(even.speeds),
            }
        )
        turned, moved = (", ".join(f"{getattr(s, n):.3g}" for s in even.steps) for n in ("degrees", "heights"))
        summary.append(
            f"{start.name} to {end.name}: steps of {turned} degrees and {moved} heights; "
            f"the ends are {even.ends.degrees:.3g} degrees and {even.ends.heights:.3g} heights apart"
        )
    picture = _grid(columns, labels, values)
    motions = [motion for column in columns for motion in column]
    return Made(motions, np.concatenate(codes), {"columns": report}, {"interpolation.png": picture}, summary)


def mean(generator: Any, values: Values) -> Made:
    """The motion of the mean code."""
    from motiongen.generators.modi.latent import speed

    code = generator.check_latents(generator.mean_latent()[None])
    motions = _decode(generator, code, ["mean"], values)
    moving = speed(motions[0])
    summary = [f"the joints of the mean motion move at {moving:.3g} heights per second"]
    picture = _grid([motions], [["mean"]], values)
    return Made(motions, code, {"speed_heights_per_second": moving}, {"mean.png": picture}, summary)


def mixing(generator: Any, values: Values) -> Made:
    """Coarse layers of each of some points with the fine ones of each of others."""
    from motiongen.generators.modi.latent import apart, mix

    layers = generator.latent_layers
    levels = generator.network.synthesis.first_codes  # where each begins, and the end of the last
    first = levels[len(levels) // 2] if values["first"] is None else whole("first", values["first"], 0)
    if first > layers:
        raise MotionGenError(f"first must be from 0 to {layers}, the number of layers, not {first}")
    rows, columns = (points(generator, values[name], name) for name in ("coarse", "fine"))
    _check_grid(len(rows) + 1, len(rows), "coarse")
    _check_grid(len(columns) + 1, len(columns), "fine")
    fine, coarse = _named(generator, columns, "fine", values), _named(generator, rows, "coarse", values)
    codes = [point.code for point in (*columns, *rows)]
    shown: list[list[Motion | None]] = [[None, *coarse]]
    labels = [["", *(f"{_said(point)}: coarse" for point in rows)]]
    report, away = [], []
    for column, source in enumerate(columns):
        mixed = [mix(row.code, source.code, first) for row in rows]
        names = [f"mixing_{row:02d}_{column:02d}" for row in range(len(rows))]
        made = _decode(generator, np.stack(mixed), names, values)
        for row, motion in enumerate(made):
            far = [apart(motion, other) for other in (coarse[row], fine[column])]
            away.append([each.degrees for each in far])
            report.append(
                {
                    "motion": motion.name,
                    "coarse": rows[row].name,
                    "fine": source.name,
                    "from_coarse": asdict(far[0]),
                    "from_fine": asdict(far[1]),
                }
            )
        codes += mixed
        shown.append([fine[column], *made])
        labels.append([f"{_said(source)}: fine", *[""] * len(rows)])
    degrees = np.mean(away, axis=0)
    summary = [
        f"{first} of {layers} layers are the coarse one's: mixes are on average {degrees[0]:.3g} degrees from it and "
        f"{degrees[1]:.3g} from the fine one"
    ]
    motions = [*fine, *coarse, *(each for column in shown[1:] for each in column[1:] if each is not None)]
    pictures = {"mixing.png": _grid(shown, labels, values)}
    return Made(motions, np.stack(codes), {"first": first, "mixes": report}, pictures, summary)


def crowd(generator: Any, values: Values) -> Made:
    """Variations around points, in one scene."""
    from motiongen.generators.modi.latent import apart, deviation, vary
    from motiongen.render.crowd import draw_scene, place_crowd

    count = whole("count", values["count"], 1)
    sigma, gap, moment = (_number(name, values[name]) for name in ("sigma", "gap", "moment"))
    heading = None if values["heading_degrees"] is None else _number("heading_degrees", values["heading_degrees"], None)
    if moment > 1:
        raise MotionGenError(f"moment must be a share of the motion, 0 to 1, not {moment}")
    spread, seed = deviation(generator), values["seed"]
    codes, motions, report, summary = [], [], [], []
    for number, point in enumerate(points(generator, values["around"], "around")):
        codes.append(vary(point.code, count, sigma, spread, seed + number))
        names = [f"crowd_{number * count + index:04d}" for index in range(count)]
        origin = _decode(generator, point.code[None], [point.name], values)[0]
        made = _decode(generator, codes[-1], names, values)
        far = [apart(origin, motion) for motion in made]
        report.append({"around": point.name, "motions": names, "from_it": [asdict(each) for each in far]})
        degrees, heights = np.mean([[each.degrees, each.heights] for each in far], axis=0)
        summary.append(
            f"around {point.name}: {count} variations, mean distance {degrees:.3g} degrees and {heights:.3g} heights"
        )
        motions += made
    placed = place_crowd(motions, gap, heading, seed)
    picture = draw_scene(placed, round(moment * (len(placed[0]) - 1)))
    return Made(placed, np.concatenate(codes), {"crowd": report}, {"crowd.png": picture}, summary)


def clusters(generator: Any, values: Values) -> Made:
    """Random codes in groups, and motions that stand for each."""
    from motiongen.generators.modi.latent import FEWEST_MAPPED, cluster, flattened, learning, representatives
    from motiongen.render.scatter import draw_scatter

    count, groups, shown = (whole(name, values[name], 1) for name in ("count", "clusters", "shown"))
    _check_grid(shown, shown, "shown")
    if count < max(groups, FEWEST_MAPPED):
        raise MotionGenError(f"count must be at least {max(groups, FEWEST_MAPPED)} for {groups} clusters, not {count}")
    learning("cluster")  # refuses before thousands of codes are drawn
    codes = generator.latents(count, values["seed"])
    found = cluster(codes, groups, values["seed"])
    chosen = representatives(found, codes, shown, values["seed"])
    mapped = flattened(codes[:_MAPPED], values["seed"])
    pictures, motions, report = {"map.png": draw_scatter(mapped, found.members[:_MAPPED])}, [], []
    for group, members in enumerate(chosen):
        names = [f"cluster_{group:02d}_{number:02d}" for number in range(len(members))]
        made = _decode(generator, codes[members], names, values)
        labels = ["nearest", *(f"random {number}" for number in range(1, len(members)))]
        pictures[f"cluster_{group:02d}.png"] = _grid([made], [labels], values)
        motions += made
        report.append({"codes": int(found.sizes[group]), "motions": names, "numbers": members.tolist()})
    summary = [f"{count} codes in {groups} clusters of {', '.join(map(str, found.sizes))}"]
    kept = generator.check_latents(codes[np.concatenate(chosen)])
    return Made(motions, kept, {"clusters": report, "centres": found.centres.tolist()}, pictures, summary)


TASKS: dict[str, Callable[[Any, Values], Made]] = {
    each.__name__: each for each in (interpolation, mean, mixing, crowd, clusters)
}


# -- what they share


def _decode(generator: Any, codes: NDArray[np.float32], names: Sequence[str], values: Values) -> list[Motion]:
    """The motions of codes (N, S) or (N, L, S), named."""
    motions = []
    with progress_bar("making") as progress:
        for index, (code, name) in enumerate(zip(codes, names)):
            motions.append(generator.decode(code[None], values["frames"])[0].replace(name=name))
            progress((index + 1) / len(codes))
    return motions


def _named(generator: Any, given: Sequence[Point], what: str, values: Values) -> list[Motion]:
    codes = np.stack([point.code for point in given])
    return _decode(generator, codes, [f"{what}_{number:02d}" for number in range(len(given))], values)


def _said(point: Point) -> str:
    return point.name.replace("_", " ")


def _grid(columns: Sequence[Sequence[Motion | None]], labels: Sequence[Sequence[str]], values: Values) -> Image:
    """Film strips in columns, all at one scale; None leaves a cell free."""
    from motiongen.render import film_strip
    from motiongen.render.draw import blank

    places = [(x, y) for x, column in enumerate(columns) for y, each in enumerate(column) if each is not None]
    shown = [motion for column in columns for motion in column if motion is not None]
    rows = max(map(len, columns))
    limits = _WIDEST // len(columns), min(_ROW, _WIDEST // rows) * len(shown)
    strip = film_strip(shown, [labels[x][y] for x, y in places], values["poses"], size=limits)
    width, height = strip.width, strip.height // len(shown)
    picture = blank((width * len(columns), height * rows))
    for number, (x, y) in enumerate(places):
        picture.paste(strip.crop((0, number * height, width, (number + 1) * height)), (x * width, y * height))
    return picture


def _check_grid(cells: int, given: int, name: str) -> None:
    if cells > _MOST_CELLS:
        raise MotionGenError(
            f"{name} makes a picture of {cells} rows or columns, and at most {_MOST_CELLS} can be seen; give fewer "
            f"than {given}"
        )


def _number(name: str, value: Any, least: float | None = 0.0) -> float:
    """The setting as a finite number of at least `least`; anything else is refused."""
    right = isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value)
    if not right or (least is not None and value < least):
        bound = "" if least is None else f" of at least {least:g}"
        raise MotionGenError(f"{name} must be a number{bound}, not {value!r}")
    return float(value)
