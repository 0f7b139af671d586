"""`motiongen edit`: more or less of an attribute, as a Hydra application over `configs/edit.yaml`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from motiongen.attributes import Attribute, attribute_of, attributes_for
from motiongen.commands.hydra_app import run_command
from motiongen.commands.latent_inputs import Point, latent_generator, points
from motiongen.commands.settings import clip_format, whole
from motiongen.console import progress_bar
from motiongen.errors import MotionGenError
from motiongen.files import atomic_path, atomic_write
from motiongen.motion import Motion

if TYPE_CHECKING:
    from motiongen.generators.modi.directions import Direction

DEFAULT_ATTRIBUTE = "gral"

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Plan:
    """How motions are edited.

    Attributes:
        direction: along which.
        attribute: what there is to be more of.
        learnt: whether the direction is new.
        strengths: (K,) how far.
        layers: which layers of codes move; None: all.
    """

    direction: Direction
    attribute: Attribute
    learnt: bool
    strengths: Sequence[float]
    layers: Sequence[int] | None


@dataclass(frozen=True)
class Edited:
    """A point moved along a direction.

    Attributes:
        start: the point.
        codes: (K, L, S) for each strength.
        motions: (K,) for each strength.
        scores: name -> (K,) score of each strength.
    """

    start: Point
    codes: NDArray[np.float32]
    motions: list[Motion]
    scores: dict[str, list[float]]


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_command(_edit, "edit", arguments)


def _edit(values: Values, folder: Path) -> None:
    strengths, layers = _strengths(values["strengths"]), _layers(values["layers"])
    written = clip_format(values)
    for name, least in (("seed", 0), ("samples", 1), ("poses", 1), ("frames", 1)):
        if values[name] is not None:
            whole(name, values[name], least)
    named = None if values["attribute"] is None else attribute_of(str(values["attribute"]))
    generator = latent_generator(values["generator"])
    starts = points(generator, values["input"], "input")
    plan = Plan(*_direction(generator, named, values), strengths, layers)
    edited = [_moved(generator, start, number, plan, values["frames"]) for number, start in enumerate(starts)]
    files = _write(edited, plan, generator, values, folder, written)
    print("\n".join(_summary(edited, plan)))
    print(f"{len(edited) * len(strengths)} motions, {', '.join(files)}")
    print(f"  in {folder}")


def _strengths(given: Any) -> list[float]:
    if not isinstance(given, list) or not given or not all(_is_number(each) for each in given):
        raise MotionGenError(f"strengths must be a list of numbers such as [-2,-1,0,1,2], not {given!r}")
    if len(set(given)) < len(given):
        raise MotionGenError(f"strengths must differ from each other, unlike {given}; each makes one motion")
    return [float(each) for each in given]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _layers(given: Any) -> list[int] | None:
    if given is None:
        return None
    if not isinstance(given, list) or not given:
        raise MotionGenError(f"layers must be a list of numbers such as [0,1,2,3], or null for all, not {given!r}")
    return [whole("layers", each, 0) for each in given]


def _direction(generator: Any, named: Attribute | None, values: Values) -> tuple[Direction, Attribute, bool]:
    """The direction, its attribute, and whether the direction is new."""
    from motiongen.generators.modi.directions import kept_direction, learn_direction, load_direction

    apart = [attribute_of(str(each)) for each in values["orthogonal_to"] or []]
    path = None if values["direction"] is None else Path(str(values["direction"]))
    if path is not None and apart:
        raise MotionGenError("orthogonal_to needs a direction that is learnt; leave out direction, or orthogonal_to")
    wanted = (named or attribute_of(DEFAULT_ATTRIBUTE)) if path is None else named
    if path is None and wanted is not None and not apart:
        path = kept_direction(generator, wanted.name)
    if path is not None:
        direction = load_direction(path, generator)
        if wanted is not None and wanted.name != direction.name:
            raise MotionGenError(
                f"{path}: this is a direction of '{direction.name}', not '{wanted.name}'; leave out attribute"
            )
        return direction, wanted or attribute_of(direction.name), False
    attribute = cast(Attribute, wanted)
    with progress_bar("learning") as progress:
        direction = learn_direction(generator, attribute, values["samples"], values["seed"], apart, progress)
    return direction, attribute, True


def _moved(generator: Any, start: Point, number: int, plan: Plan, frames: int | None) -> Edited:
    from motiongen.generators.modi.directions import move

    codes = move(start.code[None], plan.direction, plan.strengths, plan.layers)[:, 0]
    motions = [
        motion.replace(name=f"{plan.attribute.name}_{number:02d}_{strength:+g}")
        for motion, strength in zip(generator.decode(codes, frames), plan.strengths)
    ]
    scored = attributes_for(motions[0]) | {plan.attribute.name: plan.attribute}
    return Edited(start, codes, motions, {name: [each.score(m) for m in motions] for name, each in scored.items()})


def _write(
    edited: Sequence[Edited], plan: Plan, generator: Any, values: Values, folder: Path, suffix: str
) -> list[str]:
    """Write everything. Returns the names of the files that are no motions."""
    from motiongen.generators.modi.directions import save_direction
    from motiongen.generators.modi.latents import save_latents
    from motiongen.render import film_strip

    name, files = plan.attribute.name, []
    for number, each in enumerate(edited):
        for motion in each.motions:
            motion.save(folder / f"{motion.name}.{suffix}")
        labels = [f"{strength:+g}: {score:.2f}" for strength, score in zip(plan.strengths, each.scores[name])]
        files.append(f"{name}_{number:02d}.png")
        with atomic_path(folder / files[-1]) as path:
            film_strip(each.motions, labels, values["poses"]).save(path)
    codes = np.concatenate([each.codes for each in edited])
    files.append("latents.safetensors")
    save_latents(folder / files[-1], generator, codes, [motion.name for each in edited for motion in each.motions])
    if plan.learnt:
        files.append(f"{name}_direction.safetensors")
        save_direction(folder / files[-1], generator, plan.direction)
    report = {
        "settings": dict(values),
        "attribute": {"name": name, "summary": plan.attribute.summary},
        "direction": plan.direction.to_dict(),
        "strengths": list(plan.strengths),
        "motions": [
            {"start": each.start.name, "motions": [motion.name for motion in each.motions], "scores": each.scores}
            for each in edited
        ],
    }
    files.append("edit.json")
    with atomic_write(folder / files[-1]) as file:
        file.write(json.dumps(report, indent=1).encode())
    return files


def _summary(edited: Sequence[Edited], plan: Plan) -> list[str]:
    from motiongen.report import markdown_table

    attribute, direction = plan.attribute, plan.direction
    gain = "" if direction.change is None else f"; a step of 1 changes it by {direction.change:+.2f} of its deviations"
    table = [["strength", *(each.start.name for each in edited)]]
    table += [
        [f"{strength:+g}", *(f"{each.scores[attribute.name][row]:.3f}" for each in edited)]
        for row, strength in enumerate(plan.strengths)
    ]
    return [
        f"{attribute.name}: {attribute.summary}",
        f"the direction tells much of it from little in {direction.accuracy:.0%} of held-out motions{gain}",
        "",
        *markdown_table(table),
        "",
    ]
