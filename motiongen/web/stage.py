"""The stage of one visitor's page: actors on a ground, their ways and standing feet, and a camera that goes along."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motiongen.motion import Motion
from motiongen.render import camera as cam
from motiongen.render.figure import MARKED
from motiongen.render.palette import BACKDROP, GRID, GROUND, SIDES, mix
from motiongen.trajectory import path_through
from motiongen.web.body import STATURE, bodies
from motiongen.web.figures import Figures, Marks, Part, add_balls, segments
from motiongen.web.lanes import beside_each_other, on_one_spot

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]

Clear = tuple[float, float, float, float]

_VIEW = np.radians(40.0)
"""Angle of view, upwards: narrower than usual on pages, so that figures at the edge keep their proportions."""

_ELEVATION = np.radians(16.0)
_ASIDE, _ASIDE_OF_ALL = np.radians(30.0), np.radians(40.0)
"""Where the camera stands: so far above the ground, and so far aside of an actor's front; less for a row of them, as
those at its far end would get small."""

_NEAREST = 2 * STATURE
"""The camera comes no nearer by itself, however small the figure."""

_NEARBY = 5 * STATURE
"""Of the ways no more than this around the actors must be seen, or figures on a long way were specks."""

_SKY = (205, 219, 233)

_PATH_LEVEL, _POINT_RADIUS = 0.018, 0.03 * STATURE


@dataclass(frozen=True)
class Actor:
    """A clip to be shown.

    Attributes:
        motion: the clip.
        label: what to write over it.
        example: whether it is an example, which is drawn paler than what is made from it.
    """

    motion: Motion
    label: str
    example: bool


class Stage:
    """What a visitor sees in 3D. All methods may be called from any thread.

    A figure is about 1.7 high on the stage, whatever its clip's unit. To follow an actor, the whole stage is moved
    under a camera that stays where the visitor has put it: so the two never contend for it, and nothing waits for what
    the browser says of its camera.
    """

    def __init__(self, client: viser.ClientHandle, clear: Clear = (0.04, 0.06, 0.96, 0.94)) -> None:
        """Set up ground, light and camera in the visitor's own scene.

        Args:
            client: of the visitor.
            clear: left, top, right and bottom of the part of the picture that nothing lies over, as shares of its width
                and height from the top left corner.
        """
        self._clear = clear
        self._client = client
        self._lock = threading.RLock()
        self._parts: list[Part] = []
        self._figures: Figures | None = None
        self._marks: list[Marks] = []
        self._seconds = 0.0
        self._followed: int | None = None
        self._viewer = np.array([0.0, 0.0, 1.0])
        self._shift = np.zeros(2)
        self._anchor = np.zeros(2)
        self._paths = self._contacts = True
        self._points = np.zeros((0, 2))
        self._numbers = itertools.count()
        self._drawn: list[viser.SceneNodeHandle] = []
        with client.atomic():
            client.scene.set_up_direction("+y")
            self._world = client.scene.add_frame("/stage", show_axes=False)
            self._cast = client.scene.add_frame("/stage/cast", show_axes=False)
            _add_ground(client.scene)
            client.scene.add_light_hemisphere("/stage/light", ground_color=BACKDROP, intensity=0.8)
            client.scene.set_background_image(_sky())
            client.camera.fov = _VIEW

    def show(self, actors: Sequence[Actor], beside: bool = True) -> None:
        """Replace all that is on the stage.

        Args:
            actors: who is shown, from left to right.
            beside: each in a lane of its own beside the others, else all where they are in one world.
        """
        cast = bodies([actor.motion for actor in actors])
        places, viewer = (beside_each_other if beside and len(cast) > 1 else on_one_spot)(cast)
        scene = self._client.scene
        with self._lock, self._client.atomic():
            self._parts = [
                Part(body, actor.label, actor.example, place) for actor, body, place in zip(actors, cast, places)
            ]
            self._viewer = viewer
            for part in self._parts:
                part.move_to(self._seconds)
            self._cast.remove()
            name = f"/stage/cast-{next(self._numbers)}"  # a name of its own: what is removed is never what is added
            self._cast = scene.add_frame(name, show_axes=False)
            self._figures = Figures(scene, name, self._parts) if self._parts else None
            self._marks = [Marks(scene, f"{name}/{number}", part) for number, part in enumerate(self._parts)]
            self.paths, self.contacts = self._paths, self._contacts
            if self._followed is not None and self._followed >= len(actors):
                self._followed = None
            self.draw_path(self._points)
            self._go_along()

    def move_to(self, seconds: float) -> None:
        """Show every actor at its frame nearest to a time; one that is over stays on its last pose, in grey."""
        with self._lock, self._client.atomic():
            self._seconds = seconds
            changed = [part.move_to(seconds) for part in self._parts]
            if self._figures is None or not any(changed):
                return
            self._figures.pose()
            for marks in self._marks:
                marks.pose()
            self._go_along()

    def follow(self, number: int | None) -> None:
        """Let the camera turn to an actor and go along with it, from the side and distance that the visitor chooses.

        Args:
            number: of the actor, in the order of `show`; None: the camera stays where it is.
        """
        with self._lock, self._client.atomic():
            if number is not None and not 0 <= number < len(self._parts):
                number = None
            if number != self._followed:
                self._followed = number
                self._anchor = np.array(self._client.camera.look_at, dtype=np.float64)[::2]
                self._go_along()

    @property
    def paths(self) -> bool:
        """Whether the ways of the actors over the ground are shown."""
        return self._paths

    @paths.setter
    def paths(self, shown: bool) -> None:
        with self._lock, self._client.atomic():
            self._paths = shown
            for marks in self._marks:
                marks.show_way(shown)

    @property
    def contacts(self) -> bool:
        """Whether there is a mark under every foot that stands."""
        return self._contacts

    @contacts.setter
    def contacts(self, shown: bool) -> None:
        with self._lock, self._client.atomic():
            self._contacts = shown
            if self._figures is not None:
                self._figures.show_feet(shown)

    def draw_path(self, points: NDArray[np.floating]) -> None:
        """Show a path over the ground as `RootPath` means it: its points, and the smooth line through them.

        Args:
            points: (P, 2) x and z in the unit of the first actor, in its lane; P may be 0.
        """
        with self._lock, self._client.atomic():
            self._points = np.array(points, dtype=np.float64).reshape(-1, 2)
            for node in self._drawn:
                node.remove()
            self._drawn = []
            if not self._parts or not len(self._points):
                return
            first = self._parts[0]
            places: Array = first.body.to_stage(self._points) + first.place
            scene, colour = self._client.scene, SIDES[MARKED]
            balls = np.insert(places, 1, _PATH_LEVEL, axis=1)
            self._drawn.append(add_balls(scene, "/stage/path-points", balls, _POINT_RADIUS, colour))
            if (places != places[0]).any():
                line = segments(path_through(places).places, _PATH_LEVEL)
                self._drawn.append(
                    scene.add_line_segments("/stage/path", line, colour, thickness=4.0, thickness_units="screen")
                )

    def ground_point(self, origin: Sequence[float], direction: Sequence[float]) -> tuple[float, float] | None:
        """Where a line of sight meets the ground: (x, z) in the unit of the first actor, in its lane.

        Args:
            origin: (3,) where it begins, as a click on the scene says.
            direction: (3,) where it goes.

        Returns:
            None where it never meets the ground, or there is no actor.
        """
        with self._lock:
            if not self._parts or direction[1] >= -1e-6 * float(np.linalg.norm(direction)) or origin[1] <= 0:
                return None
            first = self._parts[0]
            hit = np.asarray(origin) - origin[1] / direction[1] * np.asarray(direction)
            x, z = first.body.to_clip(hit[::2] - self._shift - first.place).tolist()
            return x, z

    def frame_all(self) -> None:
        """Put the camera before the actors, so that all of them are seen, and their ways unless those are long."""
        with self._lock, self._client.atomic():
            if not self._parts:
                return
            self._move_world(np.zeros(2))
            camera = self._client.camera
            towards = _towards(self._viewer, min(_ASIDE, _ASIDE_OF_ALL / len(self._parts)))
            eye, target = _view_of(self._seen(), towards, camera.aspect, self._clear)
            camera.position = eye
            camera.look_at = target
            self._anchor = target[::2]
            self._go_along()

    def _seen(self) -> Array:
        """(P, 3) places that should be seen: those of the actors over time that are near to where they are now."""
        here = np.array([part.body.way[part.frame] + part.place for part in self._parts])
        places = np.concatenate([part.throughout() for part in self._parts])
        reach = _NEARBY + np.ptp(here, axis=0) / 2
        off = np.abs(places[:, ::2] - (here.min(axis=0) + here.max(axis=0)) / 2)
        return places[(off <= reach).all(axis=1)]

    def _go_along(self) -> None:
        """Move the world so that the actor that is followed stays before the camera."""
        if self._followed is not None:
            self._move_world(self._anchor - self._parts[self._followed].calm)

    def _move_world(self, shift: Array) -> None:
        self._shift = shift
        self._world.position = (float(shift[0]), 0.0, float(shift[1]))


def _towards(viewer: Array, aside_radians: float) -> Array:
    """(3,) the direction from which the camera looks: so much aside of the viewer's (3,), above the ground."""
    c, s = np.cos(aside_radians), np.sin(aside_radians)
    ground = np.array([c * viewer[0] + s * viewer[2], 0.0, c * viewer[2] - s * viewer[0]])
    return np.cos(_ELEVATION) * ground + np.array([0.0, np.sin(_ELEVATION), 0.0])


def _view_of(places: Array, towards: Array, aspect: float, clear: Clear) -> tuple[Array, Array]:
    """Where a camera must be (3,) that looks from the direction `towards` (3,), and at what (3,), to see all places.

    They come into the clear part of a picture that is `aspect` times as wide as it is high.
    """
    axes = cam.Camera.look_at(towards, np.zeros(3), 1.0, (0.0, 0.0)).axes
    inside = places @ axes.T  # (P, 3) right, up, forward
    half = np.tan(_VIEW / 2) * np.array([aspect, 1.0])
    left, top, right, bottom = clear
    most = half * [
        2 * right - 1,
        1 - 2 * top,
    ]  # (2,) how far right and up of its middle the picture is clear, per depth
    least = half * [2 * left - 1, 1 - 2 * bottom]
    # A place is seen where least * depth <= place - aim <= most * depth, with a depth of its own plus the distance.
    above = (inside[:, :2] - most * inside[:, 2:]).max(axis=0)
    below = (inside[:, :2] - least * inside[:, 2:]).min(axis=0)
    distance = max(float(((above - below) / (most - least)).max()), _NEAREST)
    aim = (above + below - (most + least) * distance) / 2
    target = aim @ axes[:2]
    return target + distance * towards, target


def _add_ground(scene: viser.SceneApi) -> None:
    scene.add_grid(
        "/stage/ground",
        plane="xz",
        infinite_grid=True,
        cell_size=STATURE / 4,
        section_size=STATURE,
        cell_color=mix(GRID, GROUND, 0.5),
        section_color=GRID,
        fade_distance=20 * STATURE,
        fade_strength=1.5,
        plane_color=GROUND,
        plane_opacity=1.0,
        shadow_opacity=0.25,
    )


def _sky() -> NDArray[np.uint8]:
    """(H, 2, 3) a pale sky over the backdrop."""
    share = np.linspace(0.0, 1.0, 128)[:, None, None] ** 0.7
    return (np.array(_SKY) + share * (np.array(BACKDROP) - np.array(_SKY))).astype(np.uint8).repeat(2, axis=1)
