"""Several figures in one scene: placed so that they keep clear of each other, and drawn together."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.render import camera as cam
from motiongen.render import draw
from motiongen.render.camera import Camera, Frame, focal_length
from motiongen.render.figure import node_positions
from motiongen.render.ground import Ground
from motiongen.render.stage import Panel, View, cast
from motiongen.render.strip import checked_supersample

Array = NDArray[np.float64]

_TURN = math.pi * (3 - math.sqrt(5))
"""From one place of the spiral to the next: with the golden angle, places are nowhere denser than elsewhere."""

_RING = 0.2
"""Of how far two must be apart: the spiral's places are about twice that share of it from each other."""

_BATCH = 512
"""Places that are looked at together."""

_SKIM = 8
"""Every so many frames tell most places that are taken."""

_SHOWN = 0.15
"""In heights: how much room the picture leaves around what it shows."""

_AROUND = 2.6
"""In heights; how much further than the ways the ground is seen."""

_ELEVATION = math.radians(24.0)
"""How far the camera looks down: more than on one figure, so that those behind are seen between those before."""

_SMALLEST, _LARGEST = 64, 8192


def place_crowd(
    motions: Sequence[Motion], gap: float = 0.1, heading_degrees: float | None = None, seed: int = 0
) -> list[Motion]:
    """The motions in one scene, none of them ever nearer than `gap` to another.

    Each is turned about the up axis and put on the first place of a spiral around the origin where, in no frame, the
    circle around its root that holds all of its joints and end sites comes nearer than `gap` to another's. One that is
    over stands on its last frame. All begin at once.

    Args:
        motions: on skeletons of one size, in one unit.
        gap: in skeleton heights of the first motion.
        heading_degrees: how far to turn each, counter-clockwise seen from above; None: at random.
        seed: of the random turns.

    Raises:
        MotionGenError: if there is no motion, or the gap is negative or not finite.
    """
    if not motions:
        raise MotionGenError("a crowd needs at least one motion; none came")
    if not (math.isfinite(gap) and gap >= 0):
        raise MotionGenError(f"gap must be a number of at least 0 heights, not {gap}")
    turns = np.random.default_rng(seed).uniform(0, 2 * math.pi, len(motions))
    if heading_degrees is not None:
        turns[:] = math.radians(heading_degrees)
    height = motions[0].skeleton.height
    frames = np.arange(max(map(len, motions)))
    turned = [_turned(motion, turn) for motion, turn in zip(motions, turns)]
    bodies = [_circles(motion, frames, height) for motion in turned]
    ring = _RING * (gap + 2 * float(np.mean([radii for _, radii in bodies])))
    placed: list[Motion] = []
    circles: list[tuple[Array, Array]] = []
    for motion, (centres, radii) in zip(turned, bodies):
        place = _first_free(centres, radii, circles, gap, ring)
        circles.append((centres + place, radii))
        placed.append(motion.transform(shift=np.array([place[0], 0.0, place[1]]) * height))
    return placed


def _turned(motion: Motion, angle_radians: float) -> Motion:
    """The motion turned about the up axis, its root's start over the origin."""
    turn = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), angle_radians)
    return motion.transform(turn, -rot.rotate(turn, motion.root_positions[0]) * [1.0, 0.0, 1.0])


def _circles(motion: Motion, frames: NDArray[np.int64], height: float) -> tuple[Array, Array]:
    """(F, 2) the root over the ground at each frame, and (F,) how far its body reaches from there, in heights."""
    nodes = node_positions(motion)[np.minimum(frames, len(motion) - 1)][..., [0, 2]] / height  # (F, N, 2)
    centres = motion.root_positions[np.minimum(frames, len(motion) - 1)][..., [0, 2]] / height
    return centres, np.linalg.norm(nodes - centres[:, None], axis=-1).max(axis=1)


def _first_free(centres: Array, radii: Array, others: Sequence[tuple[Array, Array]], gap: float, ring: float) -> Array:
    """(2,) the first place of the spiral where the circles keep clear of the others."""
    first = 0
    while True:
        number = np.arange(first, first + _BATCH)
        angle, distance = number * _TURN, ring * np.sqrt(number)
        places = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)  # (P, 2)
        free = np.ones(_BATCH, dtype=bool)
        for step, (other, reach) in itertools.product((_SKIM, 1), others):  # few places are left for all frames
            left = np.flatnonzero(free)
            away = np.linalg.norm(centres[::step] + places[left, None] - other[::step], axis=-1)  # (P', F')
            free[left] = (away >= (radii + reach)[::step] + gap).all(axis=1)
        if free.any():
            place: Array = places[int(free.argmax())]
            return place
        first += _BATCH


def draw_scene(
    motions: Sequence[Motion], moment: int, size: tuple[int, int] = (1280, 720), supersample: int = 3
) -> Image.Image:
    """One frame of motions that share a scene, each on its way over the ground: strong so far, faint from there on.

    Args:
        motions: where they are.
        moment: the frame; a motion that is over stands on its last, in grey.
        size: width and height in pixels.
        supersample: samples a pixel, in each direction, where edges are drawn.

    Raises:
        MotionGenError: if there is no motion, no such frame in any, or the size or `supersample` is out of range.
    """
    if not motions:
        raise MotionGenError("there is nothing to show: give at least one clip")
    longest = max(map(len, motions))
    if not 0 <= moment < longest:
        raise MotionGenError(f"moment must be a frame from 0 to {longest - 1}, not {moment}")
    if not all(_SMALLEST <= side <= _LARGEST for side in size):
        raise MotionGenError(f"a scene must have {_SMALLEST} to {_LARGEST} pixels a side, not {size[0]} x {size[1]}")
    checked_supersample(supersample)
    actors = cast(motions, [""] * len(motions), [np.arange(longest)] * len(motions))
    drawn = np.concatenate([actor.nodes[moment, actor.figure.drawn] for actor in actors])
    ways = np.concatenate([actor.way for actor in actors])
    camera = _camera(np.concatenate([drawn, ways]), size)
    radius = _AROUND + float(np.linalg.norm(ways, axis=1).max())
    picture = Image.fromarray(Ground(camera, size, radius).paint(np.zeros(3)))
    for actor in actors:
        pixels, depths = camera.project(actor.way)
        draw.paint_path(picture, pixels, depths > cam.NEAR, now=moment, factor=supersample)
    view = View(camera, np.zeros((longest, 3)), radius)
    for actor in sorted(actors, key=lambda each: -float(camera.project(each.way[moment])[1])):
        Panel(actor, view, size, 0.0, supersample).paint_figure(picture, moment)
    return picture


def _camera(points: Array, size: tuple[int, int]) -> Camera:
    """The camera that looks down at points (N, 3) from the front, and sees them all."""
    eye = np.array([0.0, math.sin(_ELEVATION), math.cos(_ELEVATION)])
    axes = Camera.look_at(eye, np.zeros(3), 1.0, (0.0, 0.0)).axes
    width, height = size
    frame = Frame(0.03 * width, 0.05 * height, 0.97 * width, 0.95 * height, focal_length(max(size)))
    needs = cam.reaches(points, _SHOWN, axes, frame)
    distance = float((needs.sum(axis=1) / (2 * frame.slopes)).max())
    return cam.place(axes, (needs[:, 0] - needs[:, 1]) / 2, distance, frame)
