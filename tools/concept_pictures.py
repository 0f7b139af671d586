"""Pictures of `docs/concepts.md`, `start.md` and `plugin.md`: `python -m tools.concept_pictures docs/pictures`.

Everything shown is computed by the code that is explained: the pyramid, the matching, the blending and the skeleton's
levels are GenMM's and MoDi's own. Motion is the bundled clip's, or the bundled model's. Needs the extra `plots`.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from matplotlib.figure import Figure
from PIL import Image

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.contact import foot_joints
from motiongen.features import layout_of, to_features
from motiongen.files import atomic_path
from motiongen.generators.genmm.blending import blend
from motiongen.generators.genmm.options import GenMMOptions
from motiongen.generators.genmm.pyramid import PartSource, build_pyramid
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.hierarchy import build_hierarchy
from motiongen.generators.modi.options import NetworkOptions
from motiongen.render import film_strip

PURPLE, BLUE, ORANGE, INK = "#7a3fb5", "#2f6fd0", "#e07b1a", "#333333"
PLUG_IN = Path(__file__).resolve().parent.parent / "docs" / "examples" / "motiongen-shuffle"

JOINT = "RightArm"
"""Whose rotation stands for the motion in plots over time."""


def example() -> mg.Motion:
    """The bundled clip."""
    return mg.load(EXAMPLE_CLIP)


# -- concepts


def pyramid() -> Image.Image:
    """One number of a joint's rotation at the stages of GenMM's pyramid."""
    clip, options = example(), GenMMOptions()
    layout = layout_of([clip])
    features = torch.from_numpy(to_features(clip, layout))
    stages = build_pyramid([PartSource([features])], options.patch_size, options.coarse_patches, options.scale_factor)
    chosen = [stages.stages[number] for number in np.linspace(0, len(stages.stages) - 1, 4).round().astype(int)]
    figure = Figure(figsize=(9, 5), layout="constrained")
    column = 6 * clip.skeleton.index(JOINT)
    for axes, stage in zip(figure.subplots(len(chosen), 1, sharex=True), chosen):
        values = stage.parts[0].frames[:, column].numpy()
        times = np.linspace(0, clip.duration, len(values))
        axes.plot(times, values, ".-", color=PURPLE, markersize=3, linewidth=1)
        axes.axvspan(times[0], times[options.patch_size - 1], color=ORANGE, alpha=0.25)
        axes.set_title(f"{len(values)} frames; a patch of {options.patch_size} spans "
                       f"{times[options.patch_size - 1]:.2g} s", fontsize=9, loc="left")  # fmt: skip
        axes.set_yticks([])
    axes.set_xlabel("seconds of the bundled clip; orange: one patch")
    return _drawn(figure)


def completeness() -> Image.Image:
    """How much of the example is shown with and without bidirectional similarity, for several alpha."""
    clip = example()
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    alphas: list[float | None] = [None, 1.0, 0.01]
    for axes, alpha in zip(figure.subplots(1, len(alphas), sharey=True), alphas):
        motion = mg.create("genmm", alpha=alpha, standing_feet="free").fit([clip]).sample(len(clip), seed=0)[0]
        nearest = _nearest_frames(motion, clip)
        shown = np.bincount(nearest, minlength=len(clip)) > 0
        axes.plot(np.arange(len(motion)) / motion.frame_rate, nearest / clip.frame_rate, ".", markersize=2, color=BLUE)
        for frame in np.flatnonzero(~_widened(shown)):
            axes.axhspan(frame / clip.frame_rate, (frame + 1) / clip.frame_rate, color=ORANGE, alpha=0.25, linewidth=0)
        share = _widened(shown).mean()
        name = "nearest patch only" if alpha is None else f"alpha = {alpha:g}"
        axes.set_title(f"{name}: {share:.0%} shown", fontsize=10)
        axes.set_xlabel("seconds of the new motion")
        if axes.get_subplotspec().is_first_col():
            axes.set_ylabel("seconds of the example")
    return _drawn(figure)


def _nearest_frames(motion: mg.Motion, clip: mg.Motion) -> np.ndarray:
    """(T,) for each frame of a motion the frame of the clip whose surroundings, a third of a second, are most alike."""
    layout, width = layout_of([clip]), 5
    both = [to_features(each, layout)[:, layout.rotations] for each in (motion, clip)]
    windows = [
        np.lib.stride_tricks.sliding_window_view(
            np.pad(each, ((width, width), (0, 0)), mode="edge"), 2 * width + 1, axis=0
        )
        for each in both
    ]
    ours, theirs = (torch.from_numpy(window.reshape(len(window), -1).copy()) for window in windows)
    return torch.cdist(ours, theirs).argmin(dim=1).numpy()


def _widened(shown: np.ndarray, frames: int = 15) -> np.ndarray:
    """(T,) True within half a second of what is shown."""
    return np.convolve(shown, np.ones(2 * frames + 1), mode="same") > 0


def blending() -> Image.Image:
    """Overlapping patches of an example, and the mean that they vote for."""
    clip, size = example(), GenMMOptions().patch_size
    column = 6 * clip.skeleton.index(JOINT)
    frames = torch.from_numpy(to_features(clip, layout_of([clip])))
    starts = [*range(100, 112), *range(330, 342)]  # two runs of the example, joined in the middle
    blended = blend(torch.tensor([starts]), frames, size)[0, :, column].numpy()
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    patches, result = figure.subplots(2, 1, sharex=True)
    for place, start in enumerate(starts):
        span = range(place, place + size)
        colour = BLUE if start < 200 else ORANGE
        patches.plot((span[0], span[-1]), (-place, -place), color=colour, linewidth=3)
        result.plot(span, frames[start : start + size, column], color=colour, linewidth=1.2)
    result.plot(blended, color=INK, linewidth=2.4, label="their mean")
    patches.set(ylabel="patches", yticks=[])
    result.set(xlabel="frames of the new motion", ylabel=f"rotation of {JOINT}", yticks=[])
    patches.set_title("blue: patches from second 3 of the example; orange: from second 11", fontsize=9, loc="left")
    result.legend(fontsize=8)
    return _drawn(figure)


def hierarchy() -> Image.Image:
    """The levels of the bundled clip's skeleton, as MoDi's networks merge its joints."""
    clip = example()
    levels = build_hierarchy(clip.skeleton, foot_joints([clip]), NetworkOptions()).levels
    places = _at_rest(clip)
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    joints = len(clip.skeleton)
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    for axes, level in zip(figure.subplots(1, len(levels)), levels):
        bodies = [[joint for joint in members if joint < joints] for members in level.members]
        centres = [places[members].mean(axis=0) if members else None for members in bodies]
        for entity, parent in enumerate(level.parents):
            here, there = centres[entity], centres[parent] if parent >= 0 else None
            if here is not None and there is not None:
                axes.plot(*zip(here, there), color=PURPLE, linewidth=1.5)
        for members, centre in zip(bodies, centres):
            if centre is not None:
                axes.plot(*centre, "o", color=ORANGE, markersize=3 + 2 * len(members) ** 0.5)
        count = sum(map(bool, bodies))
        axes.set_title("1 joint" if count == 1 else f"{count} joints", fontsize=10)
        axes.set(xlim=(left - 1, right + 1), ylim=(low - 1, high + 1), aspect="equal")
        axes.axis("off")
    return _drawn(figure)


def _at_rest(clip: mg.Motion) -> np.ndarray:
    """(J, 2) where the joints of the skeleton at rest are, seen from the front."""
    skeleton = clip.skeleton
    places = np.zeros((len(skeleton), 3))
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            places[joint] = places[parent] + skeleton.offsets[joint]
    return places[:, :2]


def latent_space() -> Image.Image:
    """Codes of the bundled model on their two main axes, coloured by a score of the motion that each makes."""
    model = mg.create("modi", clean_feet=False)
    assert isinstance(model, MoDi)
    codes = model.latents(300, seed=0)
    speeds = [_speed(motion) for motion in model.decode(codes)]
    centred = codes - codes.mean(axis=0)
    axes_of_codes = np.linalg.svd(centred, full_matrices=False)[2][:2]
    flat = centred @ axes_of_codes.T
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    dots = axes.scatter(flat[:, 0], flat[:, 1], c=speeds, s=14, cmap="viridis")
    mean = (model.mean_latent() - codes.mean(axis=0)) @ axes_of_codes.T
    axes.plot(*mean, "x", color=ORANGE, markersize=10, markeredgewidth=3)
    figure.colorbar(dots, label="speed of the joints, heights per second")
    axes.set(xlabel="first main axis of 300 random codes", ylabel="second", xticks=[], yticks=[])
    return _drawn(figure)


def _speed(motion: mg.Motion) -> float:
    steps = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1)
    return float(steps.mean()) * motion.frame_rate / motion.skeleton.height


# -- the first ten minutes


def vary() -> Image.Image:
    """The bundled clip and three variations."""
    clip = example()
    motions = mg.create("genmm").fit([clip]).sample(frames=360, count=3, seed=0)
    return film_strip([clip[:360], *motions], ["example", "sample 0", "sample 1", "sample 2"], poses=9)


def control() -> Image.Image:
    """A loop, and a motion through three poses."""
    clip = example()
    generator = mg.create("genmm").fit([clip])
    loop = generator.sample(frames=120, constraints=[mg.Loop()])[0]
    once_more = mg.concatenate([loop, loop[:1]])
    keys = {0: 30, 60: 250, 120: 420}
    poses = mg.Keyframes({frame: clip[pose] for frame, pose in keys.items()})
    keyed = generator.sample(frames=121, constraints=[poses])[0]
    moments = list(range(0, 121, 15))
    marked = [np.isin(np.arange(121), held) for held in ([0, 120], list(keys))]
    return film_strip([once_more, keyed], ["loop", "keys"], moments=[moments] * 2, marked=marked)


def modi() -> Image.Image:
    """Three motions of the bundled model."""
    motions = mg.create("modi").sample(frames=64, count=3, seed=6)
    return film_strip(motions, ["sample 0", "sample 1", "sample 2"], poses=9)


def shuffle() -> Image.Image:
    """The bundled clip, and two motions of the plug-in that serves as an example."""
    sys.path.insert(0, str(PLUG_IN))
    try:
        module = importlib.import_module("motiongen_shuffle.generator")
    finally:
        sys.path.remove(str(PLUG_IN))
    clip = example()
    motions = module.Shuffle(module.ShuffleOptions()).fit([clip]).sample(frames=360, count=2, seed=0)
    return film_strip([clip[:360], *motions], ["example", "sample 0", "sample 1"], poses=9)


PICTURES: dict[str, Callable[[], Image.Image]] = {
    "concepts/pyramid": pyramid,
    "concepts/completeness": completeness,
    "concepts/blending": blending,
    "concepts/hierarchy": hierarchy,
    "concepts/latent_space": latent_space,
    "start/vary": vary,
    "start/control": control,
    "start/modi": modi,
    "start/shuffle": shuffle,
}


def _drawn(figure: Figure) -> Image.Image:
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=100)
        return Image.open(file).convert("RGB")


def main() -> None:
    """Draw all, or some."""
    parser = argparse.ArgumentParser(prog="python -m tools.concept_pictures", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", choices=PICTURES, default=list(PICTURES), metavar="NAME")
    options = parser.parse_args()
    torch.set_num_threads(1)
    for name in options.only:
        target = options.folder / f"{name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(target) as path:
            PICTURES[name]().quantize(128).save(path, optimize=True)
        print(f"{target}: {target.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
