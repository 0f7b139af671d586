"""What a motion must keep to, as fields: keys, a segment, kept joints, a path over the ground, a loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser

from motiongen.errors import MotionGenError
from motiongen.generators.constraints import Constraint, FixedJoints, Keyframes, Loop, RootPath, Segment
from motiongen.generators.genmm.parts import TRUNK, automatic_parts
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from motiongen.web.clip_tab import small
from motiongen.web.desk import Desk
from motiongen.web.fields import put
from motiongen.web.stage import Stage
from motiongen.web.timeline import Timeline
from motiongen.web.wishes import LOOPS

_BEGIN, _END = "Begin here", "End here"
_PATH_HINT = "Click on the ground, point after point; the character travels along the line."


class KeyFields:
    """Frames of the clip whose poses are held."""

    kind = Keyframes

    def __init__(self, desk: Desk, timeline: Timeline) -> None:
        """Build the fields."""
        self.keys: tuple[int, ...] = ()
        self._desk, self._timeline = desk, timeline
        gui = desk.client.gui
        self._folder = gui.add_folder("Keys", expand_by_default=False)
        with self._folder:
            self._list = gui.add_html(small("No keys yet."))
            toggle = gui.add_button(
                "Key at this frame", icon=viser.Icon.DIAMOND, color="gray", hint="Set it, or take it away"
            )
            clear = gui.add_button("Clear keys", icon=viser.Icon.TRASH, color="gray")
        toggle.on_click(desk.act(self._toggle))
        clear.on_click(desk.act(lambda: self._set(())))
        desk.keep("make/keys", lambda: self.keys, self._set)

    def show(self, clip: Motion | None, offered: Sequence[type[Constraint]]) -> None:
        """Fit the fields to a clip and to what a generator takes."""
        self._folder.visible = self.kind in offered
        if self.keys and (clip is None or self.keys[-1] >= len(clip)):
            self.keys = tuple(key for key in self.keys if clip is not None and key < len(clip))
        frames = ", ".join(map(str, self.keys))
        word = "frame" if len(self.keys) == 1 else "frames"
        self._list.content = small(f"The pose is held at {word} {frames}." if frames else "No keys yet.")

    def _toggle(self) -> None:
        self._set(tuple(sorted({*self.keys} ^ {frame_of_clip(self._desk, self._timeline)})))

    def _set(self, keys: tuple[int, ...]) -> None:
        self.keys = keys
        self._desk.changed()


class SegmentFields:
    """Frames of the clip that are made anew."""

    kind = Segment

    def __init__(self, desk: Desk, timeline: Timeline) -> None:
        """Build the fields."""
        self._desk, self._timeline = desk, timeline
        gui = desk.client.gui
        self._folder = gui.add_folder("Redo a segment", expand_by_default=False)
        with self._folder:
            self._on = gui.add_checkbox("Redo only this", False, hint="Every other frame stays as it is in the clip")
            self._bounds = gui.add_multi_slider("Frames", 0, 2, 1, (0, 1), min_range=1)
            self._said = gui.add_html("")
            self._here = gui.add_button_group("At this frame", (_BEGIN, _END))
        self._clip: Motion | None = None
        self._on.on_update(desk.act(desk.changed))
        self._bounds.on_update(desk.act(desk.changed))
        self._here.on_click(desk.act(self._set_bound))
        desk.keep_field("make/segment", self._on)
        desk.keep_field("make/segment bounds", self._bounds)

    @property
    def segment(self) -> tuple[int, int] | None:
        """First frame to redo and the first after them; None for no segment."""
        return self._marked if self._on.value and self._folder.visible else None

    @property
    def _marked(self) -> tuple[int, int]:
        start, stop = sorted(int(bound) for bound in self._bounds.value)
        return start, max(stop, start + 1)

    def show(self, clip: Motion | None, offered: Sequence[type[Constraint]]) -> None:
        """Fit the fields to a clip and to what a generator takes."""
        self._folder.visible = self.kind in offered and clip is not None and len(clip) > 2
        if clip is not self._clip and clip is not None:
            self._bounds.max = max(len(clip), 2)
            put(self._bounds, (len(clip) // 3, 2 * len(clip) // 3 + 1))
        self._clip = clip
        start, stop = self._marked
        self._said.content = small(f"Frames {start} to {stop - 1}: {stop - start} of them.")

    def _set_bound(self) -> None:
        """Move one end to where the timeline is."""
        frame, (start, stop) = frame_of_clip(self._desk, self._timeline), self._marked
        if self._here.value == _BEGIN:
            start, stop = frame, max(stop, frame + 1)
        else:
            start, stop = min(start, frame), frame + 1
        put(self._bounds, (start, stop))
        self._desk.changed()


class KeptFields:
    """Joints that move as in the clip."""

    kind = FixedJoints

    def __init__(self, desk: Desk) -> None:
        """Build the fields; the boxes come with a clip."""
        self._desk = desk
        self._skeleton: Skeleton | None = None
        gui = desk.client.gui
        self._folder = gui.add_folder("Keep joints", expand_by_default=False)
        with self._folder:
            gui.add_html(small("What is ticked moves exactly as in the clip; the rest is made anew."))
        self._boxes: list[tuple[viser.GuiCheckboxHandle, tuple[str, ...]]] = []
        self._joints: viser.GuiFolderHandle | None = None
        desk.keep("make/kept", lambda: [box.value for box, _ in self._boxes], self._tick)

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the joints that are ticked, by themselves or with their part."""
        if self._skeleton is None or not self._folder.visible:
            return ()
        ticked = {name for box, names in self._boxes if box.value for name in names}
        return tuple(name for name in self._skeleton.names if name in ticked)

    def show(self, clip: Motion | None, offered: Sequence[type[Constraint]]) -> None:
        """Fit the fields to a clip and to what a generator takes."""
        self._folder.visible = self.kind in offered and clip is not None
        if clip is None or (self._skeleton is not None and self._skeleton.names == clip.skeleton.names):
            return
        self._skeleton = clip.skeleton
        for box, _ in self._boxes:
            box.remove()
        if self._joints is not None:
            self._joints.remove()
        gui, names = self._desk.client.gui, clip.skeleton.names
        with self._folder:
            self._boxes = [
                (gui.add_checkbox(part, False, hint=f"{len(joints)} joints"), tuple(names[j] for j in joints))
                for part, joints in _apart(clip.skeleton).items()
            ]
            self._joints = gui.add_folder("Single joints", expand_by_default=False)
            with self._joints:
                self._boxes += [(gui.add_checkbox(name, False), (name,)) for name in names]

    def _tick(self, ticked: Sequence[bool]) -> None:
        for (box, _), value in zip(self._boxes, ticked):
            put(box, value)


class PathFields:
    """A path over the ground, drawn by clicks."""

    kind = RootPath

    def __init__(self, desk: Desk, stage: Stage) -> None:
        """Build the fields."""
        self.points: tuple[tuple[float, float], ...] = ()
        self._desk, self._stage = desk, stage
        self._clip: Motion | None = None
        gui = desk.client.gui
        self._folder = gui.add_folder("Path", expand_by_default=False)
        with self._folder:
            self._list = gui.add_html(small(_PATH_HINT))
            self._draw = gui.add_checkbox("Draw by clicking on the ground", False)
            undo = gui.add_button("Take back a point", icon=viser.Icon.ARROW_BACK_UP, color="gray")
            close = gui.add_button("Close the round", icon=viser.Icon.CIRCLE_DASHED, color="gray")
            clear = gui.add_button("Clear path", icon=viser.Icon.TRASH, color="gray")
        self._draw.on_update(desk.act(self._listen))
        undo.on_click(desk.act(lambda: self._set(self.points[:-1])))
        close.on_click(desk.act(lambda: self._set((*self.points, *self.points[:1]))))
        clear.on_click(desk.act(lambda: self._set(())))
        desk.keep("make/path", lambda: self.points, self._set)

    def show(self, clip: Motion | None, offered: Sequence[type[Constraint]]) -> None:
        """Fit the fields to a clip and to what a generator takes."""
        self._folder.visible = self.kind in offered and clip is not None
        if clip is not self._clip:  # whose ground the points lie on, in its unit
            self._clip, self.points = clip, ()
            self._draw_points()
        if not self._folder.visible and self._draw.value:
            put(self._draw, False)
            self._listen()
        length = float(np.linalg.norm(np.diff(np.array(self.points).reshape(-1, 2), axis=0), axis=1).sum())
        unit = (clip.unit if clip is not None else None) or "units"
        count = f"{len(self.points)} point{'s' if len(self.points) != 1 else ''}"
        said = f"{count}, about {length:.4g} {unit} long." if self.points else _PATH_HINT
        self._list.content = small(said)

    def _draw_points(self) -> None:
        self._stage.draw_path(np.array(self.points).reshape(-1, 2))

    def _set(self, points: tuple[tuple[float, float], ...]) -> None:
        self.points = points
        self._draw_points()
        self._desk.changed()

    def _listen(self) -> None:
        """Take clicks on the stage while the box is ticked."""
        scene = self._desk.client.scene
        if not self._draw.value:
            scene.remove_click_callback()
            return

        @scene.on_click()
        def clicked(event: viser.SceneClickEvent) -> None:
            point = self._stage.ground_point(event.ray_origin, event.ray_direction)
            if point is not None and self._draw.value:  # the page may not have heard yet that it is to stop
                self._desk.act(lambda: self._set((*self.points, point)))(event)


class LoopFields:
    """Whether the end leads into the beginning."""

    kind = Loop

    def __init__(self, desk: Desk) -> None:
        """Build the field."""
        self._field = desk.client.gui.add_dropdown(
            "Loop", tuple(LOOPS), hint="The end leads into the beginning; it ends where it began, or travels on"
        )
        desk.keep_field("make/loop", self._field)

    @property
    def loop(self) -> str:
        """One of `LOOPS`."""
        return self._field.value if self._field.visible else next(iter(LOOPS))

    def show(self, clip: Motion | None, offered: Sequence[type[Constraint]]) -> None:
        """Fit the field to what a generator takes."""
        self._field.visible = self.kind in offered


def frame_of_clip(desk: Desk, timeline: Timeline) -> int:
    """The frame of the clip that the timeline is at.

    Raises:
        MotionGenError: if there is no clip, or it is over by then.
    """
    clip = desk.clip
    if clip is None:
        raise MotionGenError("there is no clip to take frames of; load one first")
    frame = round(timeline.seconds * clip.frame_rate)
    if frame >= len(clip):
        raise MotionGenError(f"the clip is over here: it has {len(clip)} frames; go to one of them")
    return frame


def _apart(skeleton: Skeleton) -> dict[str, tuple[int, ...]]:
    """Name -> joints of the trunk and of each limb, none of them in two."""
    parts = automatic_parts(skeleton)
    trunk = set(parts[TRUNK])
    return {
        name: joints if name == TRUNK else tuple(j for j in joints if j not in trunk) for name, joints in parts.items()
    }
