"""Files: true to time, whole or not there, and mistakes said in one line before anything is drawn."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.render import SUFFIXES, film_strip, render_clips, video
from motiongen.render.clips import build_movie
from motiongen.render.figure import LEFT, MARKED
from motiongen.render.palette import GROUND, SIDES, gif_colours
from motiongen.render.stage import Panel
from tests.render.figures import changed, pixels, spider, standing, walking

SMALL = {"size": (160, 80), "supersample": 1}
DRAWN = [suffix for suffix in SUFFIXES if suffix != ".html"]  # that page has tests of its own


@pytest.mark.parametrize(("hertz", "rate"), [(30.0, None), (24.0, None), (120.0, None), (25.0, 16.0), (30.0, 33.0)])
def test_gif_is_true_to_time(tmp_path: Path, hertz: float, rate: float | None) -> None:
    clip = walking(round(2 * hertz), frame_rate=hertz)
    path = render_clips([clip], tmp_path / "a.gif", frame_rate=rate, size=(64, 64), supersample=1)
    movie = build_movie([clip], size=(64, 64), frame_rate=rate, highest_rate=15.0)
    with Image.open(path) as gif:
        assert gif.n_frames == movie.length
        assert gif.size == (64, 64)
        assert gif.info["loop"] == 0
        shown = 0.0
        for frame in range(gif.n_frames):
            gif.seek(frame)
            assert shown == pytest.approx(1000 * frame / movie.frame_rate, abs=5.0), "to half a hundredth of a second"
            shown += gif.info["duration"]
    assert shown == pytest.approx(2000, abs=1000 / movie.frame_rate)


def test_gif_shows_the_pictures_in_its_colours(tmp_path: Path) -> None:
    """Frames are stored as differences; read back by Pillow, they are the pictures."""
    clips = [walking(40), standing(10)]
    path = render_clips(clips, tmp_path / "a.gif", **SMALL)
    movie = build_movie(clips, highest_rate=15.0, **SMALL)
    palette = Image.new("P", (1, 1))
    palette.putpalette([channel for colour in gif_colours() for channel in colour])
    with Image.open(path) as gif:
        for frame, picture in enumerate(movie.pictures()):
            gif.seek(frame)
            wanted = picture.quantize(palette=palette, dither=Image.Dither.NONE)
            np.testing.assert_array_equal(pixels(gif), pixels(wanted))
            assert np.abs(pixels(wanted) - pixels(picture)).mean() < 3, "every colour has one like it"


def test_gif_of_one_frame(tmp_path: Path) -> None:
    with Image.open(render_clips([standing(1)], tmp_path / "a.gif", **SMALL)) as gif:
        assert gif.n_frames == 1


def read_mp4(path: Path) -> tuple[dict[str, Any], list[np.ndarray]]:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra 'video' is not installed")
    frames = ffmpeg.read_frames(str(path))
    meta = next(frames)
    width, height = meta["size"]
    return meta, [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames]


@pytest.mark.parametrize(("hertz", "rate", "shown"), [(60.0, None, 30.0), (24.0, None, 24.0), (30.0, 12.5, 12.5)])
def test_mp4_is_true_to_time(tmp_path: Path, hertz: float, rate: float | None, shown: float) -> None:
    pytest.importorskip("imageio_ffmpeg", reason="the extra 'video' is not installed")
    clips = [walking(round(hertz), frame_rate=hertz), standing(5, frame_rate=hertz)]
    path = render_clips(clips, tmp_path / "a.mp4", frame_rate=rate, size=(161, 79), supersample=1)
    meta, frames = read_mp4(path)
    movie = build_movie(clips, size=(161, 79), frame_rate=shown, supersample=1)
    assert meta["fps"] == pytest.approx(shown, rel=1e-3)
    assert meta["size"] == (162, 80), "odd sides grow by a pixel"
    assert len(frames) == movie.length
    for moment in (0, movie.length - 1):
        error = np.abs(frames[moment][:79, :161].astype(int) - pixels(movie.picture(moment)))
        assert error.mean() < 3


def test_without_the_extra_mp4_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(
        MotionGenError, match=r"pip install 'motiongen\[video\]'; \.gif and \.png work without"
    ) as error:
        render_clips([standing()], tmp_path / "a.mp4")
    assert "\n" not in str(error.value)
    render_clips([standing(2)], tmp_path / "a.gif", **SMALL)
    assert [file.name for file in tmp_path.iterdir()] == ["a.gif"]


@pytest.mark.parametrize("suffix", DRAWN)
def test_a_failure_leaves_what_was_there(tmp_path: Path, suffix: str) -> None:
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg", reason="the extra 'video' is not installed")
    old = tmp_path / f"old{suffix}"
    old.write_bytes(b"what was there")

    def stop(share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    for path in (old, tmp_path / f"new{suffix}"):
        with pytest.raises(KeyboardInterrupt):
            render_clips([walking(20)], path, supersample=1, progress=stop)
    assert [file.name for file in tmp_path.iterdir()] == [old.name]
    assert old.read_bytes() == b"what was there"


def test_an_encoder_that_fails_is_a_mistake_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra 'video' is not installed")
    real = ffmpeg.write_frames
    monkeypatch.setattr(ffmpeg, "write_frames", lambda *args, **kinds: real(*args, **(kinds | {"codec": "nonsense"})))
    with pytest.raises(MotionGenError) as error:
        render_clips([walking(60)], tmp_path / "a.mp4", size=(640, 480))
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", DRAWN)
def test_progress_goes_from_nothing_to_all(tmp_path: Path, suffix: str) -> None:
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg", reason="the extra 'video' is not installed")
    shares: list[float] = []
    render_clips([walking(20)], tmp_path / f"a{suffix}", supersample=1, progress=shares.append)
    assert len(shares) > 1
    assert (np.diff(shares) > 0).all()
    assert shares[-1] == 1.0


CLIP = standing(3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"path": "a.avi"}, r"one of \.mp4, \.gif, \.png, \.html, not '\.avi'"),
        ({"path": "a.mp5"}, r"did you mean '\.mp4'"),
        ({"path": "a"}, "not no suffix"),
        ({"path": "missing/a.gif"}, "the folder .* does not exist"),
        ({"motions": []}, "at least one clip"),
        ({"motions": [], "path": "a.png"}, "at least one clip"),
        ({"labels": ["a", "b"]}, "1 clips need as many labels; 2 came"),
        ({"size": (20, 20)}, "panels need at least 48"),
        ({"size": (100000, 100)}, "at most 8192"),
        ({"size": (100, 30), "path": "a.png"}, "too small for 1 rows of 3 poses"),
        ({"frame_rate": 0.0}, "frame_rate must be above 0 and at most 50 Hz for .gif, not 0.0"),
        ({"frame_rate": float("nan")}, "frame_rate"),
        ({"frame_rate": 60.0}, "at most 50 Hz"),
        ({"frame_rate": 500.0, "path": "a.mp4"}, "at most 240 Hz"),
        ({"frame_rate": 10.0, "path": "a.png"}, "leave it out"),
        ({"seconds": -1.0}, "seconds must be a positive number"),
        ({"supersample": 0}, "from 1 to 8, not 0"),
        ({"supersample": 2.5}, "a whole number"),
    ],
)
def test_mistakes_cost_one_line(tmp_path: Path, call: dict[str, Any], message: str) -> None:
    if call.get("path") == "a.mp4":
        pytest.importorskip("imageio_ffmpeg", reason="the extra 'video' is not installed")
    arguments = {"motions": [CLIP], "path": "a.gif"} | call
    motions, path = arguments.pop("motions"), tmp_path / arguments.pop("path")
    drawn: list[float] = []
    with pytest.raises(MotionGenError, match=message) as error:
        render_clips(motions, path, progress=drawn.append, **arguments)
    assert "\n" not in str(error.value)
    assert not drawn
    assert list(tmp_path.iterdir()) == []


def test_labels_are_written() -> None:
    plain, named = (build_movie([CLIP], [label]).picture(0) for label in ("", "example"))
    touched = np.argwhere(changed(plain, named))
    assert len(touched) > 50
    assert touched.max(axis=0)[0] < 40
    assert touched.max(axis=0)[1] < 120
    assert not changed(build_movie([CLIP]).picture(0), build_movie([CLIP], [CLIP.name]).picture(0)).any()


def test_pictures_stream(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each picture is drawn when the last one has been taken: no heap of them."""
    order: list[str] = []

    def take(path: Path, pictures: Any, size: tuple[int, int], frame_rate: float) -> None:
        for _ in pictures:
            order.append("taken")
        path.write_bytes(b"")

    monkeypatch.setitem(video.KINDS, ".gif", dataclasses.replace(video.KINDS[".gif"], write=take))
    render_clips([walking(8)], tmp_path / "a.gif", progress=lambda share: order.append("drawn"), **SMALL)
    assert order == ["taken", "drawn"] * (len(order) // 2)


def test_upper_case_suffixes_are_fine(tmp_path: Path) -> None:
    assert render_clips([CLIP], str(tmp_path / "A.GIF"), **SMALL).is_file()


# -- film strips


def cells(strip: Image.Image, width: int, cell: int, poses: int) -> list[np.ndarray]:
    """The pictures of the poses without the times below, from the right."""
    colours = pixels(strip)[:-30]
    return [colours[:, width - (i + 1) * cell : width - i * cell] for i in range(poses)]


def test_a_strip_has_as_many_poses_as_asked_for() -> None:
    """A figure that stands still fills equal cells: each further pose adds one."""
    strips = [film_strip([standing(60)], [""], poses=poses) for poses in range(1, 8)]
    widths = [strip.width for strip in strips]
    assert len(set(np.diff(widths))) == 1
    cell = int(np.diff(widths)[0])
    shown = cells(strips[-1], widths[-1], cell, 7)
    for other in shown[1:-1]:
        np.testing.assert_array_equal(shown[0][:, 30:-30], other[:, 30:-30])
    dark = (shown[0].min(axis=-1) < 120).any(axis=0)
    assert dark[cell // 4 : -cell // 4].any(), "each holds a figure"


@pytest.mark.parametrize(("frames", "poses", "shown"), [(91, 4, [0, 30, 60, 90]), (50, 1, [0]), (7, 3, [0, 3, 6])])
def test_a_strip_shows_frames_evenly_from_first_to_last(
    monkeypatch: pytest.MonkeyPatch, frames: int, poses: int, shown: list[int]
) -> None:
    clip, drawn, paint = turning(frames), [], Panel.paint_figure

    def watch(panel: Panel, picture: Image.Image, moment: int) -> None:
        drawn.append(panel.actor.nodes[moment])
        paint(panel, picture, moment)

    monkeypatch.setattr(Panel, "paint_figure", watch)
    film_strip([clip], poses=poses)
    assert len(drawn) == len(shown)
    for nodes, frame in zip(drawn, shown):
        np.testing.assert_allclose(nodes[: len(clip.skeleton)] * clip.skeleton.height, clip.positions[frame], atol=1e-9)


def turning(frames: int) -> Motion:
    """The stiff figure turning on the spot, by a third of a turn."""
    motion = standing(frames)
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.linspace(0, 2, frames))
    return motion.replace(rotations=rotations)


@pytest.mark.parametrize("clip", [standing(), spider()], ids=["tall", "wide"])
def test_the_cells_of_a_strip_are_as_narrow_as_the_figure(clip: Motion) -> None:
    narrow, wide = (film_strip([clip[:poses]], [""], poses=poses) for poses in (1, 2))
    cell = wide.width - narrow.width
    columns = np.flatnonzero((pixels(narrow).min(axis=-1)[:-30] < 130).any(axis=0))
    assert 0.65 * cell < columns[-1] - columns[0] < cell


def test_a_strip_of_few_frames_shows_each_once() -> None:
    assert film_strip([standing(3)], poses=10).size == film_strip([standing(3)], poses=3).size


def test_a_strip_has_a_row_for_each_clip_and_its_label() -> None:
    one, two = film_strip([CLIP], ["wide"]), film_strip([CLIP, CLIP], ["wide", "slim"])
    assert (two.width, two.height) == (one.width, 2 * one.height)
    upper, lower = (two.crop((0, row * one.height, one.width, (row + 1) * one.height)) for row in (0, 1))
    assert not changed(upper, one).any()
    touched = np.argwhere(changed(upper, lower))
    assert len(touched) > 5
    assert touched[:, 1].max() < 60, "only the label differs, on the left"


@pytest.mark.parametrize("size", [(600, 400), (600, 900), (1999, 150)])
def test_a_strip_fits_into_the_size_given(size: tuple[int, int]) -> None:
    strip = film_strip([walking(40), standing(9)], size=size)
    assert strip.width <= size[0]
    assert strip.height <= size[1]
    assert strip.width > 0.8 * size[0] or strip.height > 0.8 * size[1]


def test_a_strip_as_a_file_is_the_strip(tmp_path: Path) -> None:
    with Image.open(render_clips([CLIP], tmp_path / "a.png", labels=["x"])) as picture:
        assert not changed(picture, film_strip([CLIP], ["x"])).any()


@pytest.mark.parametrize("poses", [0, 65, 2.5])
def test_strips_of_no_or_too_many_poses_are_refused(poses: Any) -> None:
    with pytest.raises(MotionGenError, match="poses must be a whole number from 1 to 64"):
        film_strip([CLIP], poses=poses)


def painted(picture: Image.Image, side: int) -> np.ndarray:
    """(H, W) where a picture has the colour of a side, paler or not."""
    ground, hue = np.array(GROUND), np.array(SIDES[side])
    share = (pixels(picture) - ground) @ (hue - ground) / ((hue - ground) @ (hue - ground))
    off = np.linalg.norm(pixels(picture) - ground - share[..., None] * (hue - ground), axis=-1)
    return (share > 0.4) & (off < 12)


def test_moments_are_the_poses_that_are_shown() -> None:
    clip = turning(91)
    evenly = film_strip([clip, clip], poses=4)
    assert not changed(evenly, film_strip([clip, clip], moments=[[0, 30, 60, 90]] * 2)).any()
    uneven = film_strip([clip, clip], moments=[[0, 30, 60, 90], [0, 31]])
    assert changed(evenly.crop((0, 220, *evenly.size)), uneven.crop((0, 220, *evenly.size))).any()


@pytest.mark.parametrize("frames", [[], [3, 3], [5, 2], [-1, 4], [0, 10]])
def test_moments_that_are_not_there_are_refused(frames: list[int]) -> None:
    with pytest.raises(MotionGenError, match="ascending frames from 0 to 9"):
        film_strip([standing(10)], moments=[frames])
    with pytest.raises(MotionGenError, match="as many lists of moments; 2 came"):
        film_strip([standing(10)], moments=[frames, frames])


def test_marked_frames_have_a_colour_of_their_own_and_others_stay() -> None:
    clip, marked = standing(4), np.array([False, True, False, True])
    plain = film_strip([clip, clip], poses=4)
    both = film_strip([clip, clip], poses=4, marked=[None, marked])
    assert not changed(plain, film_strip([clip, clip], poses=4, marked=[None, np.zeros(4, dtype=bool)])).any()
    touched = changed(plain, both)
    assert not touched[:220].any(), "the first clip has no marks"
    columns = np.flatnonzero(touched.any(axis=0))
    assert len(np.flatnonzero(np.diff(columns) > 20)) == 1, "two of the four figures"
    assert painted(plain, MARKED).sum() < 10
    assert painted(both, MARKED).sum() > 300


def test_marked_joints_colour_the_bones_that_they_turn() -> None:
    clip = standing(1)
    marks = np.zeros((1, len(clip.skeleton)), dtype=bool)
    marks[0, [clip.skeleton.index(name) for name in ("LeftLeg", "LeftFoot")]] = True
    plain, one = (film_strip([clip], poses=1, marked=[mark]) for mark in (None, marks))
    touched = np.flatnonzero(changed(plain, one).any(axis=1))
    figure = np.flatnonzero((pixels(plain)[:190].min(axis=-1) < 130).any(axis=1))
    assert touched.min() > figure.mean() - 8, "the leg is the lower half"
    assert painted(plain, LEFT).sum() > painted(one, LEFT).sum() > 100, "the left arm keeps its colour"


def test_marks_of_another_shape_are_refused() -> None:
    for shape in ((9,), (10, 2), (9, 9), ()):
        with pytest.raises(MotionGenError, match=r"must have the shape \(10,\) or \(10, 9\), not"):
            film_strip([standing(10)], marked=[np.zeros(shape, dtype=bool)])
    with pytest.raises(MotionGenError, match="as many entries in marked; 2 came"):
        film_strip([standing(10)], marked=[None, None])


def test_seconds_shorten_what_is_shown() -> None:
    clip: Motion = walking(90)
    assert not changed(film_strip([clip], seconds=1.0), film_strip([clip[:30]])).any()
    assert build_movie([clip], seconds=1.0).length == 30
