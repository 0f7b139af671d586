"""What an encoder makes whole: `python -m tools.modi_encoder_tasks --checkpoint FOLDER --encoder FOLDER --data FOLDER`.

Held-back windows are made noisy, cut off, given the arm of another, or spliced of two, encoded in one pass and decoded.
Written to OUT: `tasks.csv`, a film strip for each task, and `tasks.md` with the table. Feet are not cleaned.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch

import motiongen as mg
from motiongen import rotations as rot
from motiongen.assets import BUNDLED_MODEL
from motiongen.datasets import Dataset
from motiongen.files import atomic_path
from motiongen.generators.modi.alignment import Floats, motions_of, standardised
from motiongen.generators.modi.composites import cut_off, noised, spliced, with_joints
from motiongen.generators.modi.encoder import Encoder
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import body_of, on_device
from motiongen.generators.modi.likeness import errors, mean_error, seen
from motiongen.motion import Motion
from motiongen.render import film_strip
from motiongen.report import markdown_table

NOISE = 0.3
"""Of the noisy windows, in deviations of the data."""

SHOWN = 2
"""Windows of a task that are drawn."""

CREDIT = "Bandai-Namco-Research-Motiondataset, (c) Bandai Namco Research Inc., CC BY-NC 4.0"


@dataclass(frozen=True)
class Figure:
    """How far some motions are from others, in some frames and joints; means."""

    task: str
    what: str
    rotation_degrees: float
    position_heights: float


class Tasks:
    """The encoder, and windows (N, T, E, 4) to try it on."""

    def __init__(self, encoder: Encoder, windows: Floats, joints: Sequence[int]) -> None:
        """Pair each window with another."""
        self.encoder, self.joints = encoder, list(joints)
        self.card, self.body = encoder.generator.card, body_of(encoder.generator)
        self.windows, self.others = np.split(windows, 2)
        self.half = windows.shape[1] // 2
        self.strips: dict[str, list[tuple[str, Floats]]] = {}

    def made(self, given: Floats) -> Floats:
        """Windows as they come back."""
        codes = on_device(self.encoder.generator, self.encoder.codes(given))
        with torch.inference_mode():
            made = self.encoder.generator.network.synthesis(codes).cpu().numpy()
        back: Floats = made * self.card.deviation + self.card.mean
        return back

    def figure(self, task: str, what: str, one: Floats, other: Floats, frames: slice = slice(None),
               joints: Sequence[int] | None = None) -> Figure:  # fmt: skip
        """How far windows are from others."""
        chosen = list(range(len(self.card.layout.skeleton))) if joints is None else list(joints)
        parts = []
        for windows in (one, other):
            whole = seen(self.body, on_device(self.encoder.generator, standardised(self.card, windows)))
            parts.append(
                whole._replace(
                    rotations=whole.rotations[:, frames, chosen],
                    positions=whole.positions[:, frames, chosen],
                    contacts=whole.contacts[:, frames],
                )
            )
        found = mean_error(errors(self.card, *parts))
        return Figure(task, what, found.rotation_degrees, found.position_heights)

    def denoise(self) -> Iterator[Figure]:
        """Noise is given."""
        random = np.random.default_rng(0)
        noisy = np.stack([noised(self.card, window, random, NOISE) for window in self.windows])
        made = self.made(noisy)
        self.strips["denoise"] = [("noisy", noisy), ("decoded", made), ("clean", self.windows)]
        yield self.figure("denoise", "noisy from clean", noisy, self.windows)
        yield self.figure("denoise", "decoded from clean", made, self.windows)
        yield self.figure(
            "denoise", "decoded from clean, had the clean one been given", self.made(self.windows), self.windows
        )

    def predict(self) -> Iterator[Figure]:
        """The first half is given."""
        made = self.made(np.stack([cut_off(self.card, window, self.half) for window in self.windows]))
        still = self.windows.copy()
        still[:, self.half :] = still[:, self.half - 1 : self.half]
        still[:, self.half :, self.card.layout.root] = 0.0
        self.strips["predict"] = [("predicted", made), ("real", self.windows)]
        known, new = slice(None, self.half), slice(self.half, None)
        yield self.figure("predict", "known frames from real", made, self.windows, known)
        yield self.figure("predict", "predicted frames from real", made, self.windows, new)
        yield self.figure("predict", "the last pose held, from real", still, self.windows, new)

    def edit_joints(self) -> Iterator[Figure]:
        """Joints of the others are given."""
        layout = self.card.layout
        mixed = np.stack([with_joints(layout, *pair, self.joints) for pair in zip(self.windows, self.others)])
        made = self.made(mixed)
        rest = [joint for joint in range(len(layout.skeleton)) if joint not in self.joints]
        self.strips["edit_joints"] = [("first", self.windows), ("second", self.others), ("decoded", made)]
        for what, target, joints in (
            ("replaced joints from the second", self.others, self.joints),
            ("replaced joints from the first", self.windows, self.joints),
            ("other joints from the first", self.windows, rest),
        ):
            found = self.figure("edit_joints", what, made, target, joints=joints)
            # Where an arm is in the world is a matter of the way that the first one goes.
            yield replace(found, position_heights=float("nan")) if joints is self.joints else found

    def fuse(self) -> Iterator[Figure]:
        """Halves of two are given."""
        whole = np.stack([spliced(self.card.layout, *pair, self.half) for pair in zip(self.windows, self.others)])
        made = self.made(whole)
        self.strips["fuse"] = [("spliced", whole), ("decoded", made)]
        yield self.figure("fuse", "decoded from spliced, first half", made, whole, slice(None, self.half))
        yield self.figure("fuse", "decoded from spliced, second half", made, whole, slice(self.half, None))
        for what, windows in (("spliced", whole), ("decoded", made)):
            steps = rot.angle_between(*(self.motion_rotations(windows)[:, at] for at in (self.half - 1, self.half)))
            yield Figure("fuse", f"{what}: a joint's turn over the seam", float(np.degrees(steps).mean()), float("nan"))

    def strip(self, task: str) -> tuple[list[Motion], list[str]]:
        """What to draw of a task."""
        rows = [(label, windows[k]) for k in range(SHOWN) for label, windows in self.strips[task]]
        labels = [label for label, _ in rows]
        return list(motions_of(self.card, [window for _, window in rows], labels)), labels

    def motion_rotations(self, windows: Floats) -> np.ndarray:
        """(N, T, J, 4) unit quaternions."""
        turns = windows[:, :, self.card.layout.joints].astype(np.float64)
        return turns / np.linalg.norm(turns, axis=-1, keepdims=True)


TASKS = (Tasks.denoise, Tasks.predict, Tasks.edit_joints, Tasks.fuse)


def write(out: Path, figures: Sequence[Figure], tasks: Tasks) -> None:
    """The table as CSV and Markdown, and the strips."""
    with atomic_path(out / "tasks.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["task", "what", "rotation_degrees", "position_heights"])
        writer.writerows([f.task, f.what, f"{f.rotation_degrees:.4g}", f"{f.position_heights:.4g}"] for f in figures)
    table = [["task", "how far", "rotation, degrees", "position, of the height"]]
    table += [
        [
            f.task,
            f.what,
            f"{f.rotation_degrees:.2f}",
            "" if np.isnan(f.position_heights) else f"{f.position_heights:.2%}",
        ]
        for f in figures
    ]
    joints = ", ".join(tasks.card.layout.skeleton.names[joint] for joint in tasks.joints)
    lines = [
        "# MoDi: what the encoder makes whole",
        "",
        "Written by `python -m tools.modi_encoder_tasks --checkpoint FOLDER --encoder FOLDER --data FOLDER`. "
        f"Checkpoint of {tasks.card.iteration} iterations; {len(tasks.windows)} held-back windows, each paired with "
        f"another. Noise of {NOISE} deviations; {tasks.half} frames known, or of either part; replaced: {joints}. "
        "One pass of the encoder; feet are not cleaned.",
        "",
        *markdown_table(table),
        "",
        f"{CREDIT}.",
        "",
    ]
    for name in tasks.strips:
        motions, labels = tasks.strip(name)
        with atomic_path(out / f"{name}.png") as temporary:
            film_strip(motions, labels, size=(1400, 2000)).save(temporary)
        lines += [f"![{name}]({name}.png)", ""]
    with atomic_path(out / "tasks.md") as temporary:
        temporary.write_text("\n".join(lines))


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(prog="python -m tools.modi_encoder_tasks", description=__doc__)
    parser.add_argument("--checkpoint", type=Path, default=BUNDLED_MODEL)
    parser.add_argument("--encoder", type=Path, required=True)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("docs/results/modi/inversion"))
    parser.add_argument("--windows", type=int, default=64)
    parser.add_argument("--joints", nargs="+", default=["*Arm_R", "Hand_R", "Shoulder_R"])
    given = parser.parse_args()
    torch.set_num_threads(1)
    generator = mg.create("modi", checkpoint=str(given.checkpoint), clean_feet=False)
    assert isinstance(generator, MoDi)
    dataset = Dataset.open(given.data)
    drawn = dataset.draw("held_back", 2 * given.windows, np.random.default_rng(1))
    windows = dataset.batch(drawn, standardised=False)
    tasks = Tasks(Encoder.load(given.encoder, generator), windows, generator.skeleton.select(given.joints))
    figures = []
    for task in TASKS:
        for figure in task(tasks):
            figures.append(figure)
            print(figure, flush=True)
    given.out.mkdir(parents=True, exist_ok=True)
    write(given.out, figures, tasks)


if __name__ == "__main__":
    main()
