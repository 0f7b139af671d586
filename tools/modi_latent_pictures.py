"""Pictures and figures of what MoDi's latent space is good for.

    python -m tools.modi_latent_pictures --checkpoint FOLDER docs/pictures/latent docs/results/modi/latent.md

Pictures of `docs/latent.md` (sections 4.2 and 4.5 of the paper: Fig. 6, Fig. 9; style mixing), and a page of figures:
how even steps between motions are, how truncation calms, how far noise of each sigma leads, and what each layer
decides. All motions are the model's own. About two minutes on one core.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from numpy.typing import NDArray

import motiongen as mg
from motiongen.commands import latent as command
from motiongen.files import atomic_path, atomic_write
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.latent import (
    Apart,
    Smoothness,
    apart,
    deviation,
    interpolate,
    mix,
    smoothness,
    vary,
)
from motiongen.report import markdown_table

Codes = NDArray[np.float32]

SHARED = {"seed": 0, "frames": None, "poses": 6}
PICTURES: dict[str, tuple[Any, dict[str, Any]]] = {
    "interpolation": (command.interpolation, {"steps": 4}),
    "truncation": (command.interpolation, {"to": "mean", "steps": 4}),
    "mixing": (command.mixing, {"first": None, "poses": 4}),
    "crowd": (command.crowd, {"sigma": 0.3, "count": 12, "gap": 0.1, "heading_degrees": None, "moment": 0.5}),
}

STEPS = 4
TRUNCATIONS = (1.0, 0.75, 0.5, 0.25, 0.0)
SIGMAS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3)


def draw(generator: MoDi, folder: Path, seeds: list[int]) -> None:
    """Write the pictures, of motions of the given six seeds."""
    named = {
        "interpolation": {"from": seeds[:2], "to": seeds[2:4]},
        "truncation": {"from": seeds[:2]},
        "mixing": {"coarse": seeds[:3], "fine": seeds[3:5]},
        "crowd": {"around": seeds[5]},
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, (task, settings) in PICTURES.items():
        made = task(generator, {**SHARED, **settings, **named[name]})
        for picture in made.pictures.values():
            with atomic_path(folder / f"{name}.png") as path:
                picture.quantize(256).save(path, optimize=True)


def mean_of(found: Iterable[Apart]) -> Apart:
    """Of several."""
    each = list(found)
    return Apart(float(np.mean([a.degrees for a in each])), float(np.mean([a.heights for a in each])))


def smoothness_rows(generator: MoDi, starts: Codes, ends: Codes) -> list[list[str]]:
    """How even steps are between random motions, and towards the mean one."""
    rows = [["to", "distance of ends", "mean step", "largest step over ends", "all steps over ends"]]
    targets = {"another motion": ends, "the mean motion": np.tile(generator.mean_latent(), (len(starts), 1))}
    for name, target in targets.items():
        found = [between(generator, *pair) for pair in zip(starts, target)]
        rows.append(
            [
                name,
                said(mean_of(each.ends for each in found)),
                said(mean_of(step for each in found for step in each.steps)),
                plain(mean_of(each.largest_share for each in found)),
                plain(mean_of(each.detour for each in found)),
            ]
        )
    return rows


def between(generator: MoDi, start: Codes, end: Codes) -> Smoothness:
    """Of the steps from one code to another."""
    return smoothness(generator.decode(interpolate(start, end, STEPS)))


def truncation_rows(generator: MoDi, codes: Codes) -> list[list[str]]:
    """How truncation calms motions, and brings them nearer to each other."""
    rows = [["truncation", "speed in heights per second", "calmer than the one before", "apart from each other"]]
    before: list[float] = []
    for kept in TRUNCATIONS:
        mean = generator.mean_latent()
        motions = generator.decode(mean + np.float32(kept) * (codes - mean))
        speeds = [smoothness([motion, motion]).speeds[0] for motion in motions]
        calmer = f"{np.mean(np.array(speeds) < np.array(before)):.0%}" if before else "-"
        pairs = mean_of(apart(one, other) for one, other in itertools.pairwise(motions))
        rows.append([f"{kept:g}", f"{np.mean(speeds):.3f}", calmer, said(pairs)])
        before = speeds
    return rows


def sigma_rows(generator: MoDi, codes: Codes) -> list[list[str]]:
    """How far neighbours of each sigma are from their motion."""
    spread = deviation(generator)
    scale = float(np.sqrt(np.mean(spread**2)))
    rows = [["sigma", "noise on W, root mean square", "apart from the motion"]]
    origins = generator.decode(codes)
    for sigma in SIGMAS:
        near = [generator.decode(vary(code, 4, sigma, spread, seed)) for seed, code in enumerate(codes)]
        away = mean_of(apart(origin, each) for origin, motions in zip(origins, near) for each in motions)
        rows.append([f"{sigma:g}", f"{sigma * scale:.2f}", said(away)])
    return rows


def mixing_rows(generator: MoDi, coarse: Codes, fine: Codes) -> list[list[str]]:
    """How far mixes are from either, for each first layer of the fine one."""
    rows = [["first layer of the fine one", "from the coarse one", "from the fine one"]]
    sources = [generator.decode(each) for each in (coarse, fine)]
    codes = [generator.check_latents(each) for each in (coarse, fine)]
    for first in range(generator.latent_layers + 1):
        mixed = generator.decode(np.stack([mix(one, other, first) for one, other in zip(*codes)]))
        rows.append([str(first), *(said(mean_of(map(apart, mixed, source))) for source in sources)])
    return rows


def said(found: Apart) -> str:
    """In a table."""
    return f"{found.degrees:.2f}° / {found.heights:.3f}"


def plain(found: Apart) -> str:
    """In a table, without units."""
    return f"{found.degrees:.2f} / {found.heights:.2f}"


def page(generator: MoDi, count: int, seed: int) -> str:
    """The page of figures."""
    begun = time.process_time()
    codes, others = np.split(generator.latents(2 * count, seed), 2)
    tables = [
        (
            f"Interpolation in {STEPS} steps (section 4.2)",
            f"Over ends: the largest of {STEPS} steps at best {1 / STEPS:g}, all of them at best 1.",
            smoothness_rows(generator, codes, others),
        ),
        (
            "Truncation (section 4.2)",
            "Share of a code's difference from the mean one that is kept, and of how many motions it lowers the speed.",
            truncation_rows(generator, codes),
        ),
        (
            "Variations (section 4.5)",
            "Sigma is in deviations of W, coordinate by coordinate.",
            sigma_rows(generator, codes),
        ),
        (
            "Style mixing",
            f"Layers of {generator.latent_layers} from the given one on take the fine code.",
            mixing_rows(generator, codes, others),
        ),
    ]
    lines = [line for title, text, rows in tables for line in (f"## {title}", "", text, "", *markdown_table(rows), "")]
    return "\n".join(
        [
            "# MoDi: figures of the latent space",
            "",
            "Written by `python -m tools.modi_latent_pictures`: "
            f"checkpoint of {generator.card.iteration:,} iterations, {count} motions (or pairs) a figure, seed {seed}, "
            f"feet not cleaned; {time.process_time() - begun:.0f} s of processor time. Distances are "
            "means over frames and joints: of rotations in degrees, of places in skeleton heights.",
            "",
            *lines,
        ]
    )


def main() -> None:
    """Draw and measure."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_latent_pictures", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("pictures", type=Path, help="folder")
    parser.add_argument("page", type=Path, help="Markdown file of the figures")
    parser.add_argument("--checkpoint", help="folder; by default the bundled one")
    parser.add_argument("--seeds", type=int, nargs=6, default=[1, 2, 3, 4, 5, 12], help="of the motions in pictures")
    parser.add_argument("--count", type=int, default=32, help="motions, or pairs of them, for each figure")
    parser.add_argument("--seed", type=int, default=0, help="of the figures")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    shown, measured = (mg.create("modi", checkpoint=options.checkpoint, clean_feet=clean) for clean in (True, False))
    assert isinstance(shown, MoDi)
    assert isinstance(measured, MoDi)
    draw(shown, options.pictures, options.seeds)
    text = page(measured, options.count, options.seed)
    options.page.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(options.page) as file:
        file.write(text.encode())
    print(text)


if __name__ == "__main__":
    main()
