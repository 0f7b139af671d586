"""From motions to panels: one scale, one kind of camera, and a picture for every moment."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from motiongen import kinematics
from motiongen.motion import METRES_PER_UNIT, Motion
from motiongen.render import camera as cam
from motiongen.render import draw
from motiongen.render.camera import Camera, Frame
from motiongen.render.figure import Figure, build_figure, facing, figure_scale, node_positions
from motiongen.render.ground import Ground
from motiongen.render.palette import FAINT_INK, INK

Array = NDArray[np.float64]

_STEP_BACK = 1.9
"""How much further than a following camera a fixed one may have to stand: further back, figures get too small."""

_SEEN = 2.6
"""How far around the camera's point the ground is seen, in heights."""

CLIMB = 2.0
"""Way up and down, in heights, from which on following cameras follow that too."""

_ONE_SCALE = 4.0
"""Skeletons whose heights differ by less than this factor are shown at one scale: they share their unit."""

_QUARTER = np.radians(42.0)
"""How far beside the figure's front the camera stands."""

_LIGHT = (0.28, 0.12)
"""Where the shadow of a point one height up falls: to the right and away from the camera."""


@dataclass(frozen=True, eq=False)
class Actor:
    """A clip, ready to be shown: lengths in heights, ground at y = 0, one entry for every moment shown.

    Attributes:
        label: what to write above it.
        figure: the bones.
        nodes: (N, J + S, 3) where its nodes are.
        seconds: (N,) the clip's own time.
        live: (N,) False once the clip is over and its last pose is held.
        front: (3,) the ground direction it faces, over all.
        yard: how long a height on the stage is in the clip's unit.
    """

    label: str
    figure: Figure
    nodes: Array
    seconds: Array
    live: NDArray[np.bool_]
    front: Array
    yard: float

    @property
    def way(self) -> Array:
        """(N, 3) the root's way over the ground."""
        return self.nodes[:, self.figure.root] * [1.0, 0.0, 1.0]

    def at(self, moments: NDArray[np.int64]) -> Actor:
        """The actor at some of its moments only."""
        return dataclasses.replace(
            self, nodes=self.nodes[moments], seconds=self.seconds[moments], live=self.live[moments]
        )

    @property
    def travel(self) -> float:
        """The diagonal of the box around the way, in heights."""
        return float(np.linalg.norm(np.ptp(self.way, axis=0)))


def cast(motions: Sequence[Motion], labels: Sequence[str], frames: Sequence[NDArray[np.int64]]) -> list[Actor]:
    """The actors of `motions`, showing the given `frames` (N,) of each; indices past the end hold the last frame.

    Skeletons of about the same height, in metres where all units are known, are shown at one scale; where heights lie
    further apart, each at its own. Clips on the same joints are seen from the same side.
    """
    everything = [node_positions(motion) for motion in motions]
    heights = [figure_scale(motion, nodes) for motion, nodes in zip(motions, everything)]
    yards = _yards(motions, heights)
    fronts: dict[tuple[str, ...], Array] = {}
    actors = []
    for i, (motion, every) in enumerate(zip(motions, everything)):
        shown = np.minimum(frames[i], len(motion) - 1)
        nodes = (every[shown] - [0.0, kinematics.ground_height(motion), 0.0]) / yards[i]
        figure = build_figure(motion, nodes, heights[i] / yards[i])
        front = fronts.setdefault(motion.skeleton.names, _front(motion, nodes))
        times, playing = shown / motion.frame_rate, frames[i] < len(motion)
        actors.append(Actor(labels[i], figure, nodes, times, playing, front, yards[i]))
    return actors


def _yards(motions: Sequence[Motion], heights: Sequence[float]) -> list[float]:
    """How long a height on the stage is in each motion's unit."""
    units = [METRES_PER_UNIT.get(motion.unit or "", 0.0) for motion in motions]
    if not all(units):
        units = [1.0] * len(motions)
    sizes = [height * unit for height, unit in zip(heights, units)]
    if max(sizes) >= _ONE_SCALE * min(sizes):
        return list(heights)
    return [max(sizes) / unit for unit in units]


def _front(motion: Motion, nodes: Array) -> Array:
    """(3,) the ground direction that a figure with nodes (T, J + S, 3) faces over all, or else goes, or else +z."""
    faced = facing(motion.skeleton, nodes)
    if faced is not None:
        mean = faced.mean(axis=0)
        return mean if np.linalg.norm(mean) > 0.5 else faced[0]  # one that turns all round is met from its first front
    gone = (nodes[-1, motion.root] - nodes[0, motion.root]) * [1.0, 0.0, 1.0]
    return gone if np.linalg.norm(gone) > 0.5 else np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class View:
    """How one actor is seen: a camera that keeps its direction, shifted along a track.

    Attributes:
        camera: at shift zero, with the track's point at the world's origin.
        track: (N, 3) the shift at every moment; constant where the camera is fixed.
        radius: how far around the track's point the ground is seen, in heights.
    """

    camera: Camera
    track: Array
    radius: float


def views(actors: Sequence[Actor], frame: Frame, frame_rate: float) -> list[View]:
    """One camera for every actor: all fixed, unless that made the figures too small; then all follow.

    All stand at the same distance, far enough that no figure ever leaves `frame`, and see the ground at the same height
    in the picture.
    """
    fixed = [np.broadcast_to(_middle(actor), actor.way.shape) for actor in actors]
    gliding = [_gliding(actor, frame_rate) for actor in actors]
    distance, cameras = _cameras(actors, fixed, frame)
    nearer, following = _cameras(actors, gliding, frame)
    if distance > _STEP_BACK * nearer:
        return [View(camera, track, _SEEN) for camera, track in zip(following, gliding)]
    radius = _SEEN + max(actor.travel for actor in actors) / 2
    return [View(camera, track, radius) for camera, track in zip(cameras, fixed)]


def closeups(
    actors: Sequence[Actor], moments: Sequence[NDArray[np.int64]], height: float, *, top: float, bottom: float
) -> tuple[int, list[View]]:
    """Views of single poses in cells of one size, each with the root in the middle, and how wide the cells must be.

    Args:
        actors: who is shown.
        moments: the moments (P,) of each that are.
        height: of a cell in pixels, with `top` and `bottom` pixels to be kept free.
    """
    posed = [actor.at(moment) for actor, moment in zip(actors, moments)]
    focal, best = cam.focal_length(height), np.inf
    for width in np.linspace(2.0, 0.4, 33) * height:  # as narrow as can be without having to stand further back
        frame = Frame(0.05 * width, top, 0.95 * width, height - bottom, focal)
        distance, cameras = _cameras(posed, [actor.way for actor in posed], frame)
        if distance > 1.001 * best:
            break
        best, cell, views = distance, int(width), [View(c, a.way, _SEEN) for c, a in zip(cameras, posed)]
    return cell, views


def _cameras(actors: Sequence[Actor], tracks: Sequence[Array], frame: Frame) -> tuple[float, list[Camera]]:
    """The distance from which all actors are seen whole, and their cameras, for cameras that move on `tracks`."""
    axes = [cam.view_axes(_turned(actor.front)) for actor in actors]
    needs = np.stack(
        [
            cam.reaches(
                (actor.nodes - track[:, None])[:, actor.figure.drawn], actor.figure.thickest + 0.01, axis, frame
            )
            for actor, track, axis in zip(actors, tracks, axes)
        ]
    )  # (actors, sideways and up, plus and minus)
    needs[:, 1] = needs[:, 1].max(axis=0)
    aims = (needs[..., 0] - needs[..., 1]) / 2  # (actors, 2)
    closest = 0.5 / float(frame.slopes.max())  # a crouching or tiny figure does not fill the picture
    distance = max(float((needs.sum(axis=-1) / (2 * frame.slopes)).max()), closest)
    return distance, [cam.place(axis, aim, distance, frame) for axis, aim in zip(axes, aims)]


def _middle(actor: Actor) -> Array:
    """(3,) the ground below the middle of the actor's way."""
    return (actor.way.min(axis=0) + actor.way.max(axis=0)) / 2


def _gliding(actor: Actor, frame_rate: float) -> Array:
    """(N, 3) a calm track along the actor's way, on the ground unless the figure climbs."""
    way = actor.nodes[:, actor.figure.root]
    return cam.glide(way if np.ptp(way[:, 1]) > CLIMB else actor.way, frame_rate)


def _turned(front: Array) -> Array:
    """The ground direction beside `front` (3,) from which the figure is seen at three quarters."""
    c, s = np.cos(_QUARTER), np.sin(_QUARTER)
    return np.array([c * front[0] + s * front[2], 0.0, c * front[2] - s * front[0]])


@dataclass(frozen=True, eq=False)
class Panel:
    """One actor's part of the picture.

    Attributes:
        actor: who is shown.
        view: how it is seen.
        size: width and height in pixels.
        text_size: height of the words, in pixels.
        supersample: samples a pixel, in each direction, for all that is drawn with edges.
    """

    actor: Actor
    view: View
    size: tuple[int, int]
    text_size: float
    supersample: int

    def paint(self, moment: int) -> Image.Image:
        """The picture of the panel at one moment (0 to N - 1)."""
        picture = Image.fromarray(self._ground(moment))
        self.paint_path(picture, moment)
        self.paint_figure(picture, moment)
        self.paint_words(picture, moment)
        return picture

    def paint_figure(self, picture: Image.Image, moment: int) -> None:
        """The figure on its shadow."""
        figure, focal = self.actor.figure, self.view.camera.focal
        pixels, depths = self._shadow_pixels
        draw.paint_shadow(picture, figure, pixels[moment], depths[moment], focal=focal)
        pixels, depths = self._pixels
        still = not self.actor.live[moment]
        draw.paint_figure(
            picture, figure, pixels[moment], depths[moment], focal=focal, factor=self.supersample, still=still
        )

    def paint_path(self, picture: Image.Image, moment: int) -> None:
        """The root's way over the ground."""
        way, kept = self.actor.way, self._kept
        before, after = kept[kept < moment], kept[kept > moment]
        points = way[np.concatenate([before, [moment], after])] - self.view.track[moment]
        pixels, depths = self.view.camera.project(points)
        near = (depths > cam.NEAR) & (np.hypot(points[:, 0], points[:, 2]) < 0.85 * self.view.radius)
        draw.paint_path(picture, pixels, near, now=len(before), factor=self.supersample)

    def paint_words(self, picture: Image.Image, moment: int) -> None:
        """The label, and the clip's own time."""
        width, size = self.size[0], self.text_size
        clock = f"{self.actor.seconds[moment]:.1f} s"
        inset = 0.7 * size
        room = width - 3 * inset - draw.font(size).getlength(clock)
        label = draw.fitting(self.actor.label, size, room)
        draw.write(picture, (inset, inset), label, size=size, colour=INK, anchor="la")
        draw.write(picture, (width - inset, inset), clock, size=size, colour=FAINT_INK, anchor="ra")

    def _ground(self, moment: int) -> NDArray[np.uint8]:
        shift = self.view.track[moment]
        if np.ptp(self.view.track[:, 1]) > 0:  # the camera climbs: its height above the ground is another every time
            level = self.view.camera.moved(shift * [0.0, 1.0, 0.0])
            return Ground(level, self.size, self.view.radius).paint(shift)
        if np.ptp(self.view.track, axis=0).max() > 0:
            return self._flat_ground.paint(shift)
        return self._still_ground

    @cached_property
    def _flat_ground(self) -> Ground:
        return Ground(self.view.camera, self.size, self.view.radius)

    @cached_property
    def _still_ground(self) -> NDArray[np.uint8]:
        return self._flat_ground.paint(self.view.track[0])

    @cached_property
    def _pixels(self) -> tuple[Array, Array]:
        """(N, J + S, 2) pixels and (N, J + S) depths of the nodes."""
        return self.view.camera.project(self.actor.nodes - self.view.track[:, None])

    @cached_property
    def _shadow_pixels(self) -> tuple[Array, Array]:
        """(N, J + S, 2) pixels and (N, J + S) depths of where the nodes' shadows fall."""
        right, forward = self.view.camera.axes[0], self.view.camera.axes[2] * [1.0, 0.0, 1.0]
        height = np.maximum(self.actor.nodes[..., 1:2], 0.0)
        lit = self.actor.nodes * [1.0, 0.0, 1.0] + height * (_LIGHT[0] * right + _LIGHT[1] * forward)
        return self.view.camera.project(lit - self.view.track[:, None])

    @cached_property
    def _kept(self) -> NDArray[np.int64]:
        """The moments at which the way has gone on by a step too short to see; no need to draw what lies between."""
        gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.actor.way, axis=0), axis=1))])
        return np.flatnonzero(np.diff(np.floor(gone / 0.03), prepend=-1.0))
