"""The clock of a page, and what is marked on its strip."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.web.timeline import SPEEDS, Marks, Timeline, runs, strip
from tests.web.fakes import Gui, Handle


def timeline(frames: int = 31, rate: float = 30.0) -> tuple[Timeline, Gui]:
    gui = Gui()
    made = Timeline(gui, 700)
    made.span(frames, rate)
    return made, gui


def slider(gui: Gui) -> Handle:
    return gui["Frame"]


def press(gui: Gui, button: str) -> None:
    gui[""].move(button)


# -- the clock


def test_time_passes_while_it_plays_and_stands_while_it_does_not() -> None:
    made, gui = timeline()
    assert made.playing
    assert [made.advance(0.25) for _ in range(3)] == [0.25, 0.5, 0.75]
    press(gui, "Play / pause")
    assert [made.advance(0.25) for _ in range(3)] == [0.75] * 3
    press(gui, "Play / pause")
    assert made.advance(0.1) == pytest.approx(0.85)


@given(st.lists(st.floats(0, 0.5), max_size=40), st.integers(2, 200), st.floats(1, 240))
def test_it_never_leaves_its_span_and_goes_round(steps: list[float], frames: int, rate: float) -> None:
    made, _ = timeline(frames, rate)
    last = (frames - 1) / rate
    total = 0.0
    for step in steps:
        now = made.advance(step)
        total += step
        assert 0 <= now <= last + 1e-12
        assert 0 <= made.frame < frames
        round_the_clock = min(abs(now - total % last), last - abs(now - total % last))
        assert round_the_clock <= 1e-6 * max(total, 1.0)


@pytest.mark.parametrize("speed", SPEEDS)
def test_it_goes_as_fast_as_it_is_told(speed: str) -> None:
    made, gui = timeline(301)
    gui["Speed"].move(speed)
    assert made.advance(1.0) == pytest.approx(float(speed[:-1]))


def test_a_clip_of_one_frame_stands() -> None:
    made, gui = timeline(1)
    assert [made.advance(1.0), made.advance(0.1)] == [0.0, 0.0]
    assert made.frame == 0
    assert slider(gui).max >= 1, "or the slider breaks"
    press(gui, ">|")
    assert made.seconds == 0.0


def test_it_begins_at_the_usual_speed() -> None:
    made, _ = timeline(301)
    assert made.advance(1.0) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("start", "button", "frame"),
    [(0, "|<", 0), (9, "|<", 0), (0, "<", 0), (9, "<", 8), (9, ">", 10), (30, ">", 30), (9, ">|", 30), (30, "<", 29)],
)
def test_steps_stop_it_at_a_frame(start: int, button: str, frame: int) -> None:
    made, gui = timeline()
    made.go(start / 30.0)
    made.playing = True
    press(gui, button)
    assert (made.frame, made.playing, slider(gui).value) == (frame, False, frame)
    assert made.seconds == pytest.approx(frame / 30.0)


def test_stepping_through_a_clip_meets_every_frame() -> None:
    made, gui = timeline(200, 29.97)
    press(gui, "|<")
    met = [made.frame]
    for _ in range(199):
        press(gui, ">")
        met.append(made.frame)
    assert met == list(range(200))


def test_what_is_shown_when_it_stops_is_where_it_stands() -> None:
    made, gui = timeline()
    made.advance(0.5)
    assert slider(gui).value == 0, "while it plays the slider is moved by `refresh`"
    gui[""].move("Play / pause")
    assert (made.playing, slider(gui).value) == (False, made.frame)
    assert made.frame == 15


def test_a_visitor_who_drags_the_slider_stops_it_there() -> None:
    made, gui = timeline()
    slider(gui).move(17)
    assert (made.frame, made.playing, made.seconds) == (17, False, pytest.approx(17 / 30))
    slider(gui).move(10**9)
    assert made.frame == 30
    slider(gui).move(-5)
    assert made.frame == 0


def test_the_slider_follows_without_stopping_it() -> None:
    made, gui = timeline()
    made.advance(0.5)
    made.refresh()
    assert slider(gui).value == 15
    slider(gui).move(15, visitor=None)  # as viser tells of our own change
    assert made.playing
    made.playing = False
    slider(gui).value = 3
    made.refresh()
    assert slider(gui).value == 3, "while it stands the visitor may drag it"


def test_a_shorter_span_brings_it_back_to_its_end() -> None:
    made, gui = timeline(100)
    made.go(99 / 30)
    made.span(11, 30.0)
    assert (made.frame, slider(gui).max, slider(gui).value) == (10, 10, 10)
    made.span(11, 60.0)
    assert made.frame == 10


def test_keys_of_the_keyboard_do_what_the_buttons_do() -> None:
    made, gui = timeline()
    made.go(9 / 30)
    for label, frame in ((">", 10), ("<", 9), (">|", 30), ("|<", 0)):
        _command(gui, label).move()
        assert made.frame == frame
    _command(gui, "Play / pause").move()
    assert made.playing


def _command(gui: Gui, label: str) -> Handle:
    (found,) = [handle for handle in gui.handles if handle.kind == "command" and handle.label == label]
    return found


# -- the strip


class Tags(HTMLParser):
    """Which tags a page has, with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, {name: value or "" for name, value in attrs}))

    @property
    def titled(self) -> list[tuple[str, dict[str, str]]]:
        """Each mark's title, and its style."""
        split = [(attrs["title"], attrs["style"]) for _, attrs in self.found if "title" in attrs]
        return [(title, dict(re.findall(r"([\w-]+):([^;]+)", style))) for title, style in split]


def shares(title: str, marks: Marks, frames: int, rate: float) -> list[tuple[float, float]]:
    """Where marks of that title begin, and how wide they are, as shares of the strip."""
    found = [style for each, style in Tags(strip(marks, frames, rate)).titled if title in each]
    percent = [[float(style[side].rstrip("%px")) for side in ("left", "width")] for style in found]
    return [(round(left / 100, 5), round(width / 100, 5)) for left, width in percent]


def test_marks_lie_where_their_frames_are_in_time() -> None:
    """On a strip of 200 frames at 30 Hz, a clip of 100 at 15 Hz takes all of it, and one of 100 at 30 Hz half."""
    stands = np.zeros(100, dtype=bool)
    stands[[0, 1, 2, 50, 99]] = True
    for rate, whole in ((30.0, 200), (15.0, 100)):
        marks = Marks(rate, (0, 50), (25, 75), {"LeftToe": stands})
        assert [left for left, _ in shares("key", marks, 200, 30.0)] == [0.0, 50 / whole]
        assert shares("redone", marks, 200, 30.0) == [(25 / whole, 50 / whole)]
        runs_ = [(0.0, 3 / whole), (50 / whole, 1 / whole), (99 / whole, 1 / whole)]
        assert shares("LeftToe stands", marks, 200, 30.0) == runs_


def test_feet_have_rows_of_their_own() -> None:
    stands = np.ones(10, dtype=bool)
    marks = Tags(strip(Marks(contacts=dict.fromkeys("abc", stands)), 10, 30.0)).titled
    tops = [style["top"] for _, style in marks]
    assert len(set(tops)) == 3
    assert {style["width"] for _, style in marks} == {"100.000%"}


@given(
    st.integers(1, 500),
    st.lists(st.integers(0, 1000), max_size=5),
    st.tuples(st.integers(0, 1000), st.integers(1, 500)),
    st.lists(st.booleans(), max_size=1000),
)
def test_nothing_lies_beyond_the_strip(
    frames: int, keys: list[int], segment: tuple[int, int], stands: list[bool]
) -> None:
    marks = Marks(25.0, keys, (segment[0], sum(segment)), {"foot": np.array(stands, dtype=bool)})
    for _, style in Tags(strip(marks, frames, 30.0)).titled:
        left, width = float(style["left"][:-1]), float(style["width"][:-1]) if "%" in style["width"] else 0.0
        assert left >= 0
        assert width >= 0
        assert left + width <= 100 + 1e-2 or width == 0


def test_names_cannot_break_out_of_the_strip() -> None:
    evil = "\"><script>alert('x')</script><img src=x onerror=alert(1)>"
    page = Tags(strip(Marks(contacts={evil: np.ones(3, dtype=bool)}), 3, 30.0))
    assert {tag for tag, _ in page.found} == {"div", "span"}
    assert [title for title, _ in page.titled] == [f"{evil} stands"]


def test_the_strip_shows_what_is_marked_and_how_long_it_is() -> None:
    made, gui = timeline(91, 30.0)
    made.mark(Marks(keys=(3,)))
    (drawn,) = [handle.content for handle in gui.handles if handle.kind == "html"]
    assert "key at frame 3" in drawn
    assert "3.00 s at 30 Hz" in drawn
    made.span(31, 30.0)
    (drawn,) = [handle.content for handle in gui.handles if handle.kind == "html"]
    assert "key at frame 3" in drawn
    assert "1.00 s at 30 Hz" in drawn


@given(st.lists(st.booleans(), max_size=60))
def test_runs_are_the_longest_stretches(stands: list[bool]) -> None:
    found = runs(np.array(stands, dtype=bool))
    covered = [False] * len(stands)
    for start, stop in found:
        assert start < stop
        assert all(stands[start:stop])
        assert start == 0 or not stands[start - 1]
        assert stop == len(stands) or not stands[stop]
        covered[start:stop] = [True] * (stop - start)
    assert covered == stands
