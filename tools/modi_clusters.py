"""Clusters of MoDi's codes, and whether they agree with the data's labels.

    python -m tools.modi_clusters --checkpoint FOLDER --data DATASET docs/results/modi/clusters

Random codes are grouped by K-means, and motions drawn that stand for each group (Fig. 5). Then real clips of the
held-back part, a window from the middle of each, are given to the groups in two ways: by the code in W that gradient
descent finds for them, and by the random code whose motion is nearest. How well that agrees with the labels stands
beside shuffled labels, and beside K-means of the real windows themselves. Written are `clusters.md`, `labels.csv` and
pictures. About five minutes on one core.
"""

from __future__ import annotations

import argparse
import csv
import io
import os
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from numpy.typing import NDArray

import motiongen as mg
from motiongen.commands import latent as command
from motiongen.datasets import Dataset
from motiongen.files import atomic_path, atomic_write
from motiongen.generators.modi.alignment import standardised
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import InversionOptions, body_of, descend, on_device
from motiongen.generators.modi.latent import Agreement, Clusters, agreement, cluster
from motiongen.report import markdown_table

Floats = NDArray[np.float32]

FRAME_STEP = 4
"""From one frame of a motion that is compared to the next: at 30 Hz, 7.5 poses a second tell motions apart as well."""

BATCH = 100

LABELS = ("content", "style")
"""Those of the data's that are compared, as far as it has them."""


@dataclass(frozen=True, eq=False)
class Real:
    """Windows of real clips.

    Attributes:
        windows: (N, T, E, 4) entities, one from the middle of each clip.
        labels: by name, (N,) of the clips.
    """

    windows: Floats
    labels: dict[str, list[str]]

    def some(self, numbers: NDArray[np.int64]) -> Real:
        """A part of them."""
        labels = {name: [values[number] for number in numbers] for name, values in self.labels.items()}
        return Real(self.windows[numbers], labels)


def held_back(data: Dataset) -> Real:
    """A window from the middle of each held-back clip that has labels."""
    names = [name for name in LABELS if name in data.labels]
    if not names:
        raise SystemExit(f"the dataset has none of the labels {', '.join(LABELS)}; import it with --labels")
    clips = [clip for clip in data.clips("held_back").tolist() if all(data.labels[name][clip] for name in names)]
    lengths = data.index.lengths[clips]
    middles = np.stack([clips, (lengths - data.window_frames) // 2], axis=1)
    labels = {name: [data.labels[name][clip] for clip in clips] for name in names}
    return Real(data.batch(middles, standardised=False), labels)


@torch.inference_mode()
def places_of(generator: MoDi, motions: torch.Tensor) -> Floats:
    """(N, D) where the joints of standardised motions are in the world, every `FRAME_STEP` frames, in heights."""
    return body_of(generator).positions(motions)[:, ::FRAME_STEP].flatten(1).cpu().numpy()


@torch.inference_mode()
def places_of_codes(generator: MoDi, codes: Floats) -> Floats:
    """(N, D) `places_of` the motions of codes (N, S)."""
    parts = []
    for first in range(0, len(codes), BATCH):
        some = on_device(generator, generator.check_latents(codes[first : first + BATCH]))
        parts.append(places_of(generator, generator.network.synthesis(some)))
    return np.concatenate(parts)


def nearest(one: Floats, other: Floats) -> NDArray[np.int64]:
    """(N,) which row of `other` (M, D) is nearest to each of `one` (N, D)."""
    squares = (other**2).sum(axis=1) - 2 * one @ other.T
    return squares.argmin(axis=1)


def explained(values: Floats, groups: NDArray[np.int64]) -> float:
    """Share of the variance of values (N, D) that the groups' means account for."""
    centred = values - values.mean(axis=0)
    between = sum(
        (groups == group).sum() * np.square(centred[groups == group].mean(axis=0)).sum() for group in np.unique(groups)
    )
    return float(between / np.square(centred).sum())


def away(one: Floats, other: Floats) -> float:
    """How far joints are apart on average, in heights, of rows (N, D)."""
    ways = np.linalg.norm((one - other).reshape(len(one), -1, 3), axis=-1)
    return float(ways.mean())


@dataclass(frozen=True, eq=False)
class Assigned:
    """Real windows in groups.

    Attributes:
        how: in words.
        groups: (N,) one for each window.
        real: the windows.
        error: how far what stands for a window is from it, in heights; None where it is the window itself.
    """

    how: str
    groups: NDArray[np.int64]
    real: Real
    error: float | None

    def row(self, label: str, found: Agreement) -> list[str]:
        """Of the table."""
        error = "-" if self.error is None else f"{self.error:.3f}"
        figures = (found.information, found.chance_information, found.purity, found.chance_purity)
        return [self.how, label, str(len(self.groups)), error, *(f"{figure:.3f}" for figure in figures)]


def assign(generator: MoDi, clusters: Clusters, real: Real, options: argparse.Namespace) -> tuple[list[Assigned], str]:
    """Real windows to groups in each way, and a line on how alike motions of a group are."""
    codes = generator.latents(options.samples, options.seed + 1)
    made, groups = places_of_codes(generator, codes), clusters.of(codes)
    shuffled = np.random.default_rng(options.seed).permutation(groups)
    line = (
        f"Of {options.samples} further random codes the clusters account for {explained(codes, groups):.1%} of the "
        f"variance, and of their motions' joint places for {explained(made, groups):.1%} (shuffled: "
        f"{explained(codes, shuffled):.1%} and {explained(made, shuffled):.1%})."
    )
    places = places_of(generator, on_device(generator, standardised(generator.card, real.windows)))
    near = nearest(places, made)
    chosen = np.random.default_rng(options.seed).permutation(len(real.windows))[: options.clips]
    some = real.some(chosen)
    settings = InversionOptions(space="W", steps=options.steps, starts=1, seed=options.seed)
    inverted = descend(generator, some.windows, settings)[0][:, 0]
    found = places_of_codes(generator, inverted)
    themselves = cluster(places, len(clusters.centres), options.seed).members
    return [
        Assigned(f"inverted in W, {options.steps} steps", clusters.of(inverted), some, away(found, places[chosen])),
        Assigned(
            f"nearest of {options.samples} samples",
            groups[near[chosen]],
            some,
            away(made[near[chosen]], places[chosen]),
        ),
        Assigned(f"nearest of {options.samples} samples", groups[near], real, away(made[near], places)),
        Assigned("no codes: K-means of the windows", themselves, real, None),
    ], line


def counted(ways: Sequence[Assigned], label: str, count: int) -> list[list[str]]:
    """For each cluster and label how many windows came there in each way."""
    rows = [["cluster", label, "inverted", "nearest"]]
    tallies = [Counter(zip(each.groups.tolist(), each.real.labels[label])) for each in (ways[0], ways[2])]
    kinds = sorted(set(ways[2].real.labels[label]))
    for group in range(count):
        for kind in kinds:
            numbers = [tally[group, kind] for tally in tallies]
            if any(numbers):
                rows.append([str(group), kind, *map(str, numbers)])
    return rows


def summary_of(ways: Sequence[Assigned], label: str, sizes: Sequence[int]) -> list[list[str]]:
    """For each cluster the labels that most windows in it have."""
    rows = [["cluster", "random codes", "inverted windows", "nearest windows"]]
    for group, size in enumerate(sizes):
        cells = []
        for each in (ways[0], ways[2]):
            inside = Counter(kind for kind, of in zip(each.real.labels[label], each.groups) if of == group)
            cells.append(", ".join(f"{kind} {number}" for kind, number in inside.most_common(4)) or "none")
        rows.append([str(group), str(size), *cells])
    return rows


def main() -> None:
    """Group, assign, measure, write."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_clusters", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("out", type=Path)
    parser.add_argument("--checkpoint", help="folder; by default the bundled one")
    parser.add_argument("--data", required=True, help="folder of a dataset with labels")
    parser.add_argument("--codes", type=int, default=10_000, help="random codes to group")
    parser.add_argument("--clusters", type=int, default=8)
    parser.add_argument("--samples", type=int, default=5000, help="further codes, to find the nearest of")
    parser.add_argument("--clips", type=int, default=96, help="held-back clips to invert")
    parser.add_argument("--steps", type=int, default=60, help="of each inversion")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    begun = time.process_time()
    generator = mg.create("modi", checkpoint=options.checkpoint, clean_feet=False)
    assert isinstance(generator, MoDi)
    real = held_back(Dataset.open(options.data))
    settings = {"count": options.codes, "clusters": options.clusters, "shown": 4, "seed": options.seed}
    shown = command.clusters(generator, {**settings, "frames": None, "poses": 6})
    clusters = Clusters(np.array(shown.report["centres"], dtype=np.float32), np.zeros(0, dtype=np.int64))
    ways, line = assign(generator, clusters, real, options)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, picture in shown.pictures.items():
        with atomic_path(options.out / name) as path:
            picture.save(path, optimize=True)
    sizes = [each["codes"] for each in shown.report["clusters"]]
    label = next(iter(real.labels))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(counted(ways, label, options.clusters))
    with atomic_write(options.out / "labels.csv") as file:
        file.write(text.getvalue().encode())
    page = _page(generator, ways, line, sizes, options, time.process_time() - begun)
    with atomic_write(options.out / "clusters.md") as file:
        file.write(page.encode())
    print(page)


def _page(
    generator: MoDi,
    ways: Sequence[Assigned],
    line: str,
    sizes: Sequence[int],
    options: argparse.Namespace,
    seconds: float,
) -> str:
    labels = list(ways[0].real.labels)
    rows = [["windows assigned by", "label", "windows", "apart in heights", "AMI", "shuffled", "purity", "shuffled"]]
    rows += [each.row(name, agreement(each.groups, each.real.labels[name])) for name in labels for each in ways]
    lines = [
        "# MoDi: clusters of the latent space",
        "",
        "Written by `python -m tools.modi_clusters`: "
        f"checkpoint of {generator.card.iteration:,} iterations, {options.codes:,} random codes in {options.clusters} "
        f"clusters (K-means in W), held-back clips, seed {options.seed}; {seconds:.0f} s of processor time. "
        "Real clips: Bandai-Namco-Research-Motiondataset, (c) Bandai Namco Research Inc., CC BY-NC 4.0.",
        "",
        "## Agreement with the data's labels",
        "",
        "AMI is the adjusted mutual information: 0 by chance, 1 where cluster and label tell each other. Purity is the "
        "share of windows with their cluster's most frequent label. Beside both, the same with shuffled labels.",
        "",
        *markdown_table(rows),
        "",
        line,
        "",
        f"## What is in them ({labels[0]}, its most frequent values; all of them: [labels.csv](labels.csv))",
        "",
        *markdown_table(summary_of(ways, labels[0], sizes)),
        "",
        "## Map (t-SNE)",
        "",
        "![Random codes on a map, coloured by cluster](map.png)",
        "",
    ]
    for group in range(len(sizes)):
        title = f"Cluster {group}"
        lines += [f"## {title}", "", f"![{title}: the motion nearest to its centre, and random ones]"
                  f"(cluster_{group:02d}.png)", ""]  # fmt: skip
    return "\n".join(lines)


if __name__ == "__main__":
    main()
