"""The pictures of `docs/applications.md`: `python -m tools.application_pictures FOLDER [--only NAME...]`.

FOLDER holds real clips (`bandai-namco/dataset-*.tar.xz`); all else is the bundled clip. What is given is drawn in
purple, what is made in blue and orange. Needs matplotlib (extra `plots`).
"""

from __future__ import annotations

import argparse
import io
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.contact import contact_labels, foot_joints
from motiongen.files import atomic_path
from motiongen.generators.base import Generator
from motiongen.render import film_strip
from motiongen.render.figure import LEFT, MARKED, RIGHT
from motiongen.render.palette import SIDES, Colour
from motiongen.trajectory import path_through
from tools.genmm_locomotion import TURNS, archived_clips

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Clips = Mapping[str, mg.Motion]

WALK, OLD, GIANT = (f"dataset-1_walk_{style}_001" for style in ("normal", "old", "giant"))
WAVES = [f"dataset-2_raise-up-both-hands_{style}_00{k}" for style in ("active", "normal") for k in (1, 2, 3, 4)]
ARCHIVED = (WALK, *TURNS, OLD, GIANT, *WAVES)

LOWER_BODY = ("Hips", "*Leg*", "*Foot*", "*Toe*")
COLOURS = 256
"""Of a picture's palette."""


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


PURPLE, INK = _hex(SIDES[MARKED]), "#333333"

STRIDES = [*range(0, 140, 20)]
"""Frames of walks: no multiple of a stride, which would show the same pose again and again."""

PATHS = {
    "S": (330, [[0, 0], [250, 250], [-250, 700], [0, 1000]]),
    "closed, as a loop": (330, [[0, 0], [180, 270], [0, 540], [-180, 270], [0, 0]]),
    "corner": (250, [[0, 0], [0, 500], [0, 500], [500, 500]]),
}
"""Frames, and points in centimetres."""


def bundled(**options: float) -> tuple[mg.Motion, Generator]:
    """The bundled clip, and a generator that has it."""
    clip = mg.load(EXAMPLE_CLIP)
    return clip, mg.create("genmm", **options).fit([clip])


def vary(clips: Clips) -> Image.Image:
    """An example and three variations."""
    clip, generator = bundled()
    motions = generator.sample(frames=360, count=3)
    return film_strip([clip[:360], *motions], ["example", "seed 0, first", "second", "third"])


def parts(clips: Clips) -> Image.Image:
    """Two-armed waves as an example, whole bodies, and one-armed waves by parts."""
    generator = mg.create("genmm").fit([clips[name] for name in WAVES])
    whole = generator.sample(frames=270)[0]
    apart = generator.sample(frames=270, constraints=[mg.Parts()])[0]
    shown = [clips[WAVES[4]], whole, apart]
    return film_strip(shown, ["example", "whole body", "parts"], marked=[_lone_arm(motion) for motion in shown])


def completion(clips: Clips) -> Image.Image:
    """The legs of one walk, and the upper body of another made for them."""
    legs, example = clips[WALK][:180], clips[GIANT]
    made = mg.create("genmm").fit([example]).sample(180, constraints=[mg.FixedJoints(legs, LOWER_BODY)])[0]
    given = np.zeros((180, len(legs.skeleton)), dtype=bool)
    given[:, list(legs.skeleton.select(LOWER_BODY))] = True
    shown = [legs, example[:180], made]
    labels = ["legs' clip", "example", "completed"]
    return film_strip(shown, labels, moments=[STRIDES] * 3, marked=[given, None, given])


def keyframes(clips: Clips) -> Image.Image:
    """Two ways through the same poses."""
    clip, generator = bundled(coarse_patches=12.0)
    keys = {0: 30, 50: 250, 100: 420, 150: 600}
    poses = mg.Keyframes({frame: clip[pose] for frame, pose in keys.items()})
    made = generator.sample(151, count=2, constraints=[poses])
    marked = [_at(keys, motion) for motion in made]
    return film_strip(made, ["keys", "another way"], moments=[[*range(0, 151, 10)]] * 2, marked=marked)


def loop(clips: Clips) -> Image.Image:
    """Loops of a walk played once and a frame more, on the spot and on its way."""
    generator = mg.create("genmm").fit([clips[WALK]])
    shown = [_once_more(generator.sample(72, constraints=[mg.Loop(in_place)])[0]) for in_place in (False, True)]
    marked = [_at((0, 72), motion) for motion in shown]
    return film_strip(shown, ["travelling", "in place"], moments=[[*range(0, 73, 9)]] * 2, marked=marked)


def loop_with_keys(clips: Clips) -> Image.Image:
    """A loop that comes by two poses every round."""
    clip, generator = bundled()
    poses = mg.Keyframes({0: clip[30], 60: clip[250]})
    made = generator.sample(120, count=2, constraints=[poses, mg.Loop()])
    shown = [_once_more(motion) for motion in made]
    marked = [_at((0, 60, 120), motion) for motion in shown]
    return film_strip(shown, ["loop and keys", "another"], moments=[[*range(0, 121, 12)]] * 2, marked=marked)


def segment(clips: Clips) -> Image.Image:
    """Six seconds of a clip, and the first and the last of five others."""
    clip, generator = bundled(coarse_patches=12.0)
    made = generator.sample(len(clip), count=5, constraints=[mg.Segment(clip, 240, 420)])
    kept = ~_at(range(240, 420), clip)
    labels = ["clip", "redone", "once more"]
    return film_strip([clip, made[0], made[4]], labels, moments=[[*range(201, 466, 20)]] * 3, marked=[kept] * 3)


def continuation(clips: Clips) -> Image.Image:
    """The end of a clip, and two ways on."""
    clip, generator = bundled(coarse_patches=12.0)
    made = generator.sample(120, count=2, constraints=[mg.Continuation(clip)])
    shown = [mg.concatenate([clip[-60:], motion], align=False) for motion in made]
    given = [_at(range(60), motion) for motion in shown]
    return film_strip(shown, ["goes on", "another way"], moments=[[*range(14, 180, 15)]] * 2, marked=given)


def in_between(clips: Clips) -> Image.Image:
    """From one clip to another, twice."""
    clip, generator = bundled(coarse_patches=12.0)
    before, after = clip[60:150], clip[390:480]
    made = generator.sample(90, count=2, constraints=[mg.InBetween(before, after)])
    shown = [mg.concatenate([before, motion, after], align=False)[45:-45] for motion in made]
    given = [~_at(range(45, 135), motion) for motion in shown]
    return film_strip(shown, ["in between", "another"], moments=[[*range(0, 180, 15)]] * 2, marked=given)


def style(clips: Clips) -> Image.Image:
    """A walk, another's manner, and the walk in that manner."""
    content, example = clips[WALK][:180], clips[OLD]
    made = mg.create("genmm").fit([example]).sample(180, constraints=[mg.Style(content)])[0]
    shown = [content, example[:180], made]
    labels, marked = ["content", "example", "result"], [_at(range(180), content), None, None]
    return film_strip(shown, labels, moments=[STRIDES] * 3, marked=marked)


def several_examples(clips: Clips) -> Image.Image:
    """Two examples, and a motion that changes between them."""
    examples = [clips[WALK], clips[GIANT]]
    made = mg.create("genmm", coarse_patches=8.0).fit(examples).sample(360)[0]
    marked = [None, _at(range(len(examples[1])), examples[1]), _nearer_second(made, examples)]
    moments = [STRIDES, STRIDES, [*range(10, 360, 51)]]
    return film_strip([*examples, made], ["first example", "second", "from both"], moments=moments, marked=marked)


def root_path(clips: Clips) -> Image.Image:
    """Walks along paths, from above."""
    walk, generator = clips[WALK], mg.create("genmm").fit([clips[WALK]])

    def draw(axis: Axes, title: str) -> None:
        frames, points = PATHS[title]
        path = mg.RootPath(np.array(points, dtype=float))
        made = generator.sample(frames, constraints=[path, mg.Loop()] if path.closed else [path])[0]
        axis.plot(*path_through(path.points).places.T / walk.skeleton.height, color="#cfcfcc", lw=7)
        _footprints(axis, made)
        axis.plot(*_ground(made).T, color=INK, lw=1)
        axis.plot(*path.points.T / walk.skeleton.height, "o", color=PURPLE, ms=7)

    return _from_above(list(PATHS), draw)


def random_locomotion(clips: Clips) -> Image.Image:
    """Where three examples go, and where syntheses of them go."""
    examples = [clips[name] for name in (WALK, *TURNS)]
    made = mg.create("genmm").fit(examples).sample(900, count=4)
    titles = ["examples", *(f"synthesis {number}" for number in range(len(made)))]

    def draw(axis: Axes, title: str) -> None:
        if title == "examples":
            for example in examples:
                axis.plot(*(_ground(example) - _ground(example)[0]).T, color=PURPLE, lw=2)
            axis.plot(0, 0, "o", color=INK, ms=6)
            return
        motion = made[titles.index(title) - 1]
        _footprints(axis, motion)
        axis.plot(*_ground(motion).T, color=INK, lw=1)
        axis.plot(*_ground(motion)[0], "o", color=INK, ms=6)

    return _from_above(titles, draw)


def stream(clips: Clips) -> Image.Image:
    """Ten chunks of an endless walk, from above."""
    generator = mg.create("genmm").fit([clips[name] for name in (WALK, *TURNS)])
    taken = list(itertools.islice(generator.stream(chunk_frames=150), 10))

    def draw(axis: Axes, title: str) -> None:
        for number, chunk in enumerate(taken):
            axis.plot(*_ground(chunk).T, color=_hex(SIDES[LEFT if number % 2 else RIGHT]), lw=2)
            axis.plot(*_ground(chunk)[0], "o", color=INK, ms=4)

    return _from_above(["ten chunks"], draw, width=5.0)


PICTURES: dict[str, Callable[[Clips], Image.Image]] = {
    "vary": vary,
    "parts": parts,
    "completion": completion,
    "keyframes": keyframes,
    "loop": loop,
    "loop_with_keys": loop_with_keys,
    "segment": segment,
    "continuation": continuation,
    "in_between": in_between,
    "root_path": root_path,
    "random_locomotion": random_locomotion,
    "style": style,
    "stream": stream,
    "several_examples": several_examples,
}


# -- what is marked


def _lone_arm(motion: mg.Motion) -> NDArray[np.bool_]:
    """(T, J) the arm whose hand is above its shoulder while the other's is not."""
    skeleton, height = motion.skeleton, motion.positions[..., 1]
    up = [height[:, skeleton.index(f"Hand_{s}")] > height[:, skeleton.index(f"Shoulder_{s}")] for s in "LR"]
    marks = np.zeros(height.shape, dtype=bool)
    for side, alone in zip("LR", (up[0] & ~up[1], up[1] & ~up[0])):
        marks[:, list(skeleton.subtree(skeleton.index(f"Shoulder_{side}")))] = alone[:, None]
    return marks


def _at(frames: Iterable[int], motion: mg.Motion) -> NDArray[np.bool_]:
    """(T,) True at these frames."""
    return np.isin(np.arange(len(motion)), list(frames))


def _once_more(motion: mg.Motion) -> mg.Motion:
    """A loop and the first frame of its second round, where it stands then."""
    root, ground = motion.root_positions, np.array([1.0, 0.0, 1.0])
    over_the_seam = 0.5 * ((root[-1] - root[-2]) + (root[1] - root[0]))
    shift = (root[-1] - root[0] + over_the_seam) * ground
    return mg.concatenate([motion, motion[:1].transform(shift=shift)], align=False)


def _nearer_second(motion: mg.Motion, examples: Sequence[mg.Motion]) -> NDArray[np.bool_]:
    """(T,) whether a pose is more like one of the second example than like any of the first."""
    first, second = (
        np.linalg.norm(_pose(motion)[:, None] - _pose(example)[None], axis=-1).min(axis=1) for example in examples
    )
    return second < first


def _pose(motion: mg.Motion) -> Array:
    """(T, 6 J) joints from the root, in heights, and how they move in a fifth of a second."""
    places = (motion.positions - motion.root_positions[:, None]).reshape(len(motion), -1) / motion.skeleton.height
    return np.concatenate([places, np.gradient(places, axis=0) * motion.frame_rate / 5], axis=1)


# -- from above


def _from_above(titles: Sequence[str], draw: Callable[[Axes, str], None], width: float = 3.0) -> Image.Image:
    """One panel for each title, in heights, drawn by `draw(axis, title)`."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(titles), figsize=(width * len(titles), width + 0.5), squeeze=False)
    for axis, title in zip(axes[0], titles):
        draw(axis, title)
        axis.set_title(title, fontsize=10)
        axis.set_aspect("equal", adjustable="datalim")
        axis.invert_xaxis()  # seen from above with +z upwards, +x is to the left
        axis.tick_params(labelsize=8)
    figure.tight_layout()
    file = io.BytesIO()
    figure.savefig(file, dpi=90)
    plt.close(figure)
    return Image.open(file).convert("RGB")


def _ground(motion: mg.Motion) -> Array:
    """(T, 2) where the root is over the ground, x and z, in heights."""
    return motion.root_positions[:, [0, 2]] / motion.skeleton.height


def _footprints(axis: Axes, motion: mg.Motion) -> None:
    """Where the feet of a rig with sides `_L` and `_R` stand, left in blue and right in orange."""
    feet = foot_joints(motion)
    stands = contact_labels(motion, feet)
    for column, foot in enumerate(feet):
        side = LEFT if motion.skeleton.names[foot].endswith("_L") else RIGHT
        places = motion.positions[stands[:, column], foot][:, [0, 2]] / motion.skeleton.height
        axis.plot(*places.T, "o", color=_hex(SIDES[side]), ms=3, mew=0)


def main() -> None:
    """Draw the pictures."""
    parser = argparse.ArgumentParser(prog="python -m tools.application_pictures", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=Path("docs/pictures/applications"))
    parser.add_argument("--only", nargs="+", choices=list(PICTURES), default=list(PICTURES))
    options = parser.parse_args()
    clips = archived_clips(options.folder, ARCHIVED)
    options.output.mkdir(parents=True, exist_ok=True)
    for name in options.only:
        picture = PICTURES[name](clips).quantize(COLOURS, dither=Image.Dither.NONE)
        with atomic_path(options.output / f"{name}.png") as path:
            picture.save(path, format="PNG", optimize=True)
        print(f"{name}.png: {(options.output / f'{name}.png').stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
