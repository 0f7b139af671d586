"""The timeline of a page: where the motions are in time, how fast they go, and what is marked on the clip."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from motiongen.render import palette
from motiongen.render.figure import MARKED
from motiongen.web.fields import put

SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x")

_START, _BACK, _PLAY, _ON, _END = "|<", "<", "Play / pause", ">", ">|"
_HOTKEYS: dict[str, Any] = {_PLAY: "space", _BACK: "pageup", _ON: "pagedown", _START: "home", _END: "end"}
"""The arrow keys are viser's, for its camera."""
_LEAST_WIDTH, _WIDTH, _MARGIN = 340, 640, 15
_BEFORE_SLIDER, _AFTER_SLIDER = 120, 66
"""Where the slider begins and ends in the window, in pixels: the strip above it is to be in line with it."""

_KEY_ROW, _ROW = 18, 6
"""Heights of the strip's rows, in pixels."""

Labels = NDArray[np.bool_]


@dataclass(frozen=True)
class Marks:
    """What is marked on the clip.

    Attributes:
        frame_rate: of the clip, in Hz.
        keys: frames that are held.
        segment: first frame to redo and the first after them, or None.
        contacts: name of a foot joint -> (T,) whether it stands.
    """

    frame_rate: float = 30.0
    keys: Sequence[int] = ()
    segment: tuple[int, int] | None = None
    contacts: dict[str, Labels] = field(default_factory=dict)


class Timeline:
    """A window below the stage with a slider over the frames, and a clock that moves it."""

    def __init__(self, gui: viser.GuiApi, room: float) -> None:
        """Build the window, in the lower left corner of the page.

        Args:
            gui: of the visitor.
            room: how wide it may be, in pixels.
        """
        self._lock = threading.RLock()
        self._seconds, self._frames, self._rate = 0.0, 1, 30.0
        self._marks = Marks()
        self.playing = True
        panel = gui.add_panel()
        with panel.add_tab("Timeline", viser.Icon.PLAYER_PLAY):
            self._strip = gui.add_html("")
            self._slider = gui.add_slider("Frame", 0, 1, 1, 0)
            self._buttons = gui.add_button_group("", (_START, _BACK, _PLAY, _ON, _END))
            self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1x")
        panel.float(x=_MARGIN, y=-_MARGIN, width=min(max(room - 2 * _MARGIN, _LEAST_WIDTH), _WIDTH))
        self._slider.on_update(self._slid)
        self._buttons.on_click(lambda _: self._press(self._buttons.value))
        for label, hotkey in _HOTKEYS.items():
            gui.add_command(label, hotkey=hotkey).on_trigger(self._pressing(label))

    # -- what others ask

    @property
    def seconds(self) -> float:
        """Where the motions are."""
        return self._seconds

    @property
    def frame(self) -> int:
        """Likewise, in frames of the timeline."""
        return min(round(self._seconds * self._rate), self._frames - 1)

    def span(self, frames: int, frame_rate: float) -> None:
        """Cover `frames` frames at `frame_rate` Hz."""
        with self._lock:
            self._frames, self._rate = max(frames, 1), frame_rate
            self._seconds = min(self._seconds, self._last)
            self._slider.max = max(self._frames - 1, 1)
            self._show()
            self._draw()

    def mark(self, marks: Marks) -> None:
        """Show what is marked on the clip."""
        with self._lock:
            self._marks = marks
            self._draw()

    def go(self, seconds: float) -> None:
        """Go to a moment and stay there."""
        with self._lock:
            self._pause()
            self._seconds = min(max(seconds, 0.0), self._last)
            self._show()

    def advance(self, seconds: float) -> float:
        """Let time pass where it plays, from the end back to the beginning; returns where the motions are."""
        with self._lock:
            if self.playing and self._last > 0:
                self._seconds += seconds * float(self._speed.value.removesuffix("x"))
                if self._seconds > self._last:
                    self._seconds %= self._last
            return self._seconds

    def refresh(self) -> None:
        """Move the slider to where the motions are."""
        with self._lock:
            if self.playing:
                self._show()

    # -- what the visitor does

    @property
    def _last(self) -> float:
        return (self._frames - 1) / self._rate

    def _slid(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:  # and not our own moving it along
            with self._lock:
                self._seconds = min(max(float(self._slider.value) / self._rate, 0.0), self._last)
                self._pause()

    def _pressing(self, button: str) -> Callable[[Any], None]:
        return lambda _: self._press(button)

    def _press(self, button: str) -> None:
        steps = {_BACK: -1, _ON: 1}
        with self._lock:
            if button == _PLAY:
                self._pause(self.playing)
            elif button in steps:
                self.go((self.frame + steps[button]) / self._rate)
            else:
                self.go(0.0 if button == _START else self._last)

    def _pause(self, paused: bool = True) -> None:
        if self.playing == paused:
            self.playing = not paused
            self._show()  # while it plays the slider lags behind
            self._draw()

    # -- drawing

    def _show(self) -> None:
        put(self._slider, self.frame)

    def _draw(self) -> None:
        self._strip.content = strip(self._marks, self._frames, self._rate, "" if self.playing else "paused")


def strip(marks: Marks, frames: int, frame_rate: float, said: str = "") -> str:
    """What is marked on a clip, over `frames` frames at `frame_rate` Hz, as HTML, with a word in its middle."""
    whole = frames / frame_rate * marks.frame_rate  # the span in frames of the clip
    grey, key, band = palette.css(palette.FAINT_INK), palette.css(palette.SIDES[MARKED]), palette.css(palette.PATH)
    rows = []
    if marks.segment is not None:
        place = f"{_along(*marks.segment, whole)};top:0;bottom:0;background:{band};opacity:.25"
        rows.append(f'<div title="to be redone" style="position:absolute;{place}"></div>')
    for number, (name, stands) in enumerate(marks.contacts.items()):
        look = f"top:{_KEY_ROW + _ROW * number}px;height:4px;border-radius:2px;background:{grey}"
        rows += [
            f'<div title="{html.escape(name)} stands" style="position:absolute;{_along(*run, whole)};{look}"></div>'
            for run in runs(stands)
            if run[0] < whole
        ]
    look = f"top:4px;width:9px;height:9px;margin-left:-5px;transform:rotate(45deg);background:{key}"
    rows += [
        f'<div title="key at frame {frame}" style="position:absolute;left:{100 * frame / whole:.3f}%;{look}"></div>'
        for frame in marks.keys
        if frame < whole
    ]
    height = _KEY_ROW + 4 + _ROW * len(marks.contacts)
    return (
        f'<div style="margin:4px {_AFTER_SLIDER}px 0 {_BEFORE_SLIDER}px">'
        f'<div style="position:relative;height:{height}px;border-radius:4px;background:rgba(128,128,128,.12);'
        f'overflow:hidden">{"".join(rows)}</div>'
        f'<div style="display:flex;justify-content:space-between;font-size:11px;color:{grey}">'
        f"<span>0 s</span><span>{said}</span><span>{(frames - 1) / frame_rate:.2f} s at {frame_rate:g} Hz</span>"
        "</div></div>"
    )


def _along(start: float, stop: float, whole: float) -> str:
    """Where frames `start` to `stop` of `whole` stand, as CSS."""
    return f"left:{100 * start / whole:.3f}%;width:{100 * max(min(stop, whole) - start, 0) / whole:.3f}%"


def runs(stands: Labels) -> list[tuple[int, int]]:
    """(start, stop) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
