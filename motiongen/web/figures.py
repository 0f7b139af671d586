"""What the actors on the stage of the page are made of in the visitor's scene: solid figures, names, ways and feet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motiongen.render.figure import MIDDLE
from motiongen.render.palette import GROUND, PATH, SIDES, STILL, Colour, mix
from motiongen.web import shapes
from motiongen.web.body import STATURE, Body

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]
Colours = NDArray[np.uint8]

_PALE = 0.6
"""How much grey an example's colours have in them: what is made from it stands out."""

_SOME = 64  # frames that tell where an actor ever is
_FOOT_RADIUS = 0.045 * STATURE
_LABEL_OVER = 0.08 * STATURE

_WAY_LEVEL, _FOOT_LEVEL, _OUT_OF_SIGHT = 0.006, 0.012, -1e3
"""Heights over the ground: flat things lie one above the other, so that none flickers through another."""

_WAY_STEP = 0.03 * STATURE
_WAY_PIECES = 250
"""The way is drawn in steps that can just be seen, or longer ones where it would be more pieces than this."""

_GONE, _TO_COME = PATH, mix(PATH, GROUND, 0.5)


class Part:
    """The part that one clip plays on the stage: where, under what name, and how far it has come.

    Attributes:
        body: what its clip looks like.
        label: its name.
        example: whether it is an example, drawn paler than what is made from it.
        place: (2,) the x and z of its origin.
        frame: the one that it stands at.
        over: whether the clip has ended.
    """

    def __init__(self, body: Body, label: str, example: bool, place: Array) -> None:
        """Stand at the first frame."""
        self.body, self.label, self.example, self.place = body, label, example, place
        self.frame, self.over = 0, False
        self._lift = np.array([place[0], 0.0, place[1]], dtype=np.float32)

    def move_to(self, seconds: float) -> bool:
        """Stand at the frame nearest to a time, and say whether that is another than before."""
        before = self.frame, self.over
        self.frame, self.over = self.body.frame_at(seconds), self.body.over_at(seconds)
        return before != (self.frame, self.over)

    def limbs(self) -> tuple[Float32, Float32, Float32]:
        """Where the bones begin (B, 3), how they are turned (B, 4), wxyz, and their sizes (B, 3)."""
        upper, turns, sizes = self.body.limbs_at(self.frame)
        return upper + self._lift, turns, sizes

    def balls(self) -> Float32:
        """(E, 3) where the balls are."""
        return self.body.balls_at(self.frame) + self._lift

    def feet(self) -> Float32:
        """(C, 3) the ground under the feet that stand; far below it, out of sight, for the others."""
        places = self.body.nodes[self.frame, self.body.feet] + self._lift
        places[:, 1] = np.where(self.standing, _FOOT_LEVEL, _OUT_OF_SIGHT)
        return places

    def throughout(self) -> Float32:
        """(P, 3) where it is over time: a point for each node at some frames, and its name above."""
        body = self.body
        some = np.unique(np.linspace(0, len(body) - 1, _SOME).astype(int))
        names = np.insert(body.way[some], 1, body.top + 2 * _LABEL_OVER, axis=1)
        return np.concatenate([body.nodes[some].reshape(-1, 3), names]) + self._lift

    @property
    def standing(self) -> NDArray[np.bool_]:
        """(C,) which feet stand on the ground."""
        return self.body.standing[self.frame]

    @property
    def calm(self) -> Array:
        """(2,) the ground under it, x and z, without the sway of the body."""
        place: Array = self.body.calm[self.frame] + self.place
        return place

    def colours(self) -> tuple[Colours, Colours]:
        """(B, 3) of the limbs and (E, 3) of the balls; all in grey once the clip is over."""
        grey = 1.0 if self.over else _PALE if self.example else 0.0
        shades = {side: light(mix(colour, STILL, grey)) for side, colour in SIDES.items()}
        limbs = np.array([shades[side] for side in self.body.figure.sides.tolist()], dtype=np.uint8).reshape(-1, 3)
        balls = [limbs[bone] if bone >= 0 else shades[MIDDLE] for bone in self.body.joint_bones.tolist()]
        return limbs, np.array(balls, dtype=np.uint8)


class Figures:
    """The solid figures of all actors, and the marks under their feet: a frame of them all is a handful of messages.

    Whoever calls holds the stage's lock.
    """

    def __init__(self, scene: viser.SceneApi, name: str, parts: Sequence[Part]) -> None:
        """Add the nodes below `name`, one for all limbs, one for all balls, one for all feet."""
        self._parts = parts
        self._stretching = any(part.body.stretching for part in parts)
        self._grey, self._marked = self._over(), True
        positions, turns, sizes = self._limbs()
        limbs, balls = self._colours()
        self._limb_node = self._foot_node = None
        if len(positions):
            self._limb_node = scene.add_batched_meshes_simple(
                f"{name}/limbs",
                *shapes.limb(),
                batched_wxyzs=turns,
                batched_positions=positions,
                batched_scales=sizes,
                batched_colors=limbs,
                lod="off",
            )
        radii = np.concatenate([part.body.joint_radii for part in parts])
        self._ball_node = _add_unturned(scene, f"{name}/balls", shapes.ball(), self._balls(), radii, balls)
        if any(len(part.body.feet) for part in parts):
            feet, colours = self._feet(), np.concatenate([_foot_colours(part.body) for part in parts])
            radii = np.full(len(feet), _FOOT_RADIUS)
            self._foot_node = _add_unturned(scene, f"{name}/feet", shapes.disc(), feet, radii, colours, shadow=False)

    def pose(self) -> None:
        """Stand as the parts stand now."""
        if self._limb_node is not None:
            positions, turns, sizes = self._limbs()
            self._limb_node.batched_positions = positions
            self._limb_node.batched_wxyzs = turns
            if self._stretching:
                self._limb_node.batched_scales = sizes
        self._ball_node.batched_positions = self._balls()
        marked = any(part.standing.any() for part in self._parts)
        if self._foot_node is not None and (marked or self._marked):
            self._foot_node.batched_positions = self._feet()
        self._marked = marked
        if self._grey != self._over():
            self._grey = self._over()
            limbs, balls = self._colours()
            if self._limb_node is not None:
                self._limb_node.batched_colors = limbs
            self._ball_node.batched_colors = balls

    def show_feet(self, shown: bool) -> None:
        """Show or hide the marks under standing feet."""
        if self._foot_node is not None:
            self._foot_node.visible = shown

    def _limbs(self) -> tuple[Float32, Float32, Float32]:
        positions, turns, sizes = zip(*(part.limbs() for part in self._parts))
        return np.concatenate(positions), np.concatenate(turns), np.concatenate(sizes)

    def _balls(self) -> Float32:
        return np.concatenate([part.balls() for part in self._parts])

    def _feet(self) -> Float32:
        return np.concatenate([part.feet() for part in self._parts])

    def _over(self) -> list[bool]:
        return [part.over for part in self._parts]

    def _colours(self) -> tuple[Colours, Colours]:
        limbs, balls = zip(*(part.colours() for part in self._parts))
        return np.concatenate(limbs), np.concatenate(balls)


class Marks:
    """The name over an actor, and its way over the ground. Whoever calls holds the stage's lock."""

    def __init__(self, scene: viser.SceneApi, name: str, part: Part) -> None:
        """Add the nodes below `name`."""
        self._part, body, place = part, part.body, part.place
        self._label = scene.add_label(
            f"{name}/label",
            self._text(),
            position=self._over_head(),
            anchor="bottom-center",
            font_screen_scale=1.2,
        )
        self._frames = _way_frames(body)
        self._gone = self._pieces_gone()
        self._way = None
        if len(self._frames) > 1:
            self._way = scene.add_line_segments(
                f"{name}/way",
                segments(body.way[self._frames] + place, _WAY_LEVEL),
                self._way_colours(),
                thickness=3.0,
                thickness_units="screen",
            )

    def pose(self) -> None:
        """Stand as the part stands now."""
        self._label.text = self._text()
        self._label.position = self._over_head()
        gone = self._pieces_gone()
        if self._way is not None and gone != self._gone:
            self._gone = gone
            self._way.colors = self._way_colours()

    def show_way(self, shown: bool) -> None:
        """Show or hide the way over the ground."""
        if self._way is not None:
            self._way.visible = shown

    def _text(self) -> str:
        return f"{self._part.label} (over)" if self._part.over else self._part.label

    def _over_head(self) -> tuple[float, float, float]:
        x, z = self._part.calm.tolist()
        return x, self._part.body.top + _LABEL_OVER, z

    def _pieces_gone(self) -> int:
        """How many pieces of the way lie behind it."""
        return int(np.searchsorted(self._frames[1:], self._part.frame, side="right"))

    def _way_colours(self) -> Colours:
        """(P - 1, 2, 3) of the pieces of the way: strong as far as it is gone, faint from there on."""
        colours = np.empty((len(self._frames) - 1, 2, 3), dtype=np.uint8)
        colours[: self._gone], colours[self._gone :] = _GONE, _TO_COME
        return colours


def _add_unturned(
    scene: viser.SceneApi,
    name: str,
    mesh: shapes.Mesh,
    places: Array | Float32,
    radii: Array,
    colours: Colours,
    shadow: bool = True,
) -> viser.BatchedMeshHandle:
    """A node of one mesh at many places (N, 3), in many sizes (N,) and colours (N, 3) or (3,)."""
    return scene.add_batched_meshes_simple(
        name,
        *mesh,
        batched_wxyzs=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (len(places), 1)),
        batched_positions=places,
        batched_scales=radii.astype(np.float32),
        batched_colors=colours,
        lod="off",
        cast_shadow=shadow,
    )


def add_balls(scene: viser.SceneApi, name: str, places: Array, radius: float, colour: Colour) -> viser.SceneNodeHandle:
    """Balls of one radius and colour at places (P, 3)."""
    colours = np.array(light(colour), dtype=np.uint8)
    return _add_unturned(scene, name, shapes.ball(), places, np.full(len(places), radius), colours)


def light(colour: Colour) -> Colour:
    """A colour of the palette as light: the page takes the colours of a batch for amounts of light."""
    red, green, blue = (round(255 * (part / 255) ** 2.2) for part in colour)
    return red, green, blue


def segments(line: Array | Float32, level: float) -> Float32:
    """(P - 1, 2, 3) the pieces of a line through ground places (P, 2) at a height over the ground."""
    points = np.insert(line, 1, level, axis=1).astype(np.float32)
    return np.stack([points[:-1], points[1:]], axis=1)


def _foot_colours(body: Body) -> Colours:
    """(C, 3) of the marks under the feet: as the bones that end there."""
    sides = {int(lower): int(side) for (_, lower), side in zip(body.figure.bones, body.figure.sides)}
    colours = [light(SIDES[sides.get(foot, MIDDLE)]) for foot in body.feet.tolist()]
    return np.array(colours, dtype=np.uint8).reshape(-1, 3)


def _way_frames(body: Body) -> NDArray[np.int64]:
    """The frames at which the way has gone on by a step that can be seen, with the first and the last."""
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(body.way.astype(float), axis=0), axis=1))])
    step = max(_WAY_STEP, gone[-1] / _WAY_PIECES)
    if gone[-1] < step:
        return np.zeros(1, dtype=np.int64)
    return np.union1d(np.flatnonzero(np.diff(np.floor(gone / step), prepend=-1.0)), [len(body) - 1])
