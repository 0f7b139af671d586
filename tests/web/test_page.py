"""The page in a real browser, used as its visitors do: everything is found by what is written on it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.motion import Motion
from motiongen.web.limits import Limits
from motiongen.web.server import Server
from tests.browser import chromium
from tests.web.visitors import Visitor

pytestmark = pytest.mark.xdist_group("browser")  # one server and one browser for all

CLIP = mg.load(EXAMPLE_CLIP)[100:160]
"""It gets on by half its height a second, so that it can follow a path."""

FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
ROUNDING = 2e-6
"""How much a rotation that goes through a text file may change."""

MANY_PIXELS = 25
"""Others than before where a figure has moved."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright, which drives the browser, is missing")
    program = chromium()
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        yield made
        made.close()


@pytest.fixture(scope="module")
def server(browser: Any) -> Iterator[Server]:
    with Server(port=0, limits=Limits(upload_bytes=2**20)) as made:
        yield made


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clips") / "walk.bvh"
    CLIP.save(path)
    return path


@pytest.fixture(scope="module")
def opened(browser: Any, server: Server, walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visitor]:
    made = Visitor(browser, server.address, tmp_path_factory.mktemp("downloads"))
    made.load(walk)
    made.sees("'walk' is loaded")
    made.press("Play / pause")
    yield made
    made.leave()


@pytest.fixture
def page(opened: Visitor) -> Iterator[Visitor]:
    """A page with a short clip that stands; whoever asks for something takes it back."""
    yield opened
    assert opened.broken == [], "no script on the page failed"


def turned(one: Motion, other: Motion) -> np.ndarray:
    """(T, J) how far joints are turned from each other, as one less the cosine of half the angle."""
    return 1 - np.abs((one.rotations * other.rotations).sum(axis=-1))


# -- looking


def test_a_clip_that_was_loaded_is_the_one_that_is_worked_on(page: Visitor) -> None:
    page.open("Clip")
    assert page.chosen("Clip") == "walk"
    page.sees("60 frames, 2.0 s at 30 Hz, 31 joints")


def test_figures_move_while_they_play_and_stand_while_they_do_not(page: Visitor) -> None:
    before = page.at_frame(0)
    assert np.ptp(before) > 100, "somebody is there"
    page.press("Play / pause")
    page.wait_for(lambda: page.differs(before) > MANY_PIXELS, "nobody moves")
    page.press("Play / pause")
    still = page.settled()
    page.page.wait_for_timeout(300)
    assert page.differs(still) == 0


def test_scrubbing_goes_to_a_frame_and_back(page: Visitor) -> None:
    def the_same_frame_is_the_same_picture() -> bool:
        early, late, again = page.at_frame(5), page.at_frame(45), page.at_frame(5)
        apart, back = (int((np.abs(each - early) > 20).sum()) for each in (late, again))
        return apart > MANY_PIXELS and back < apart / 4

    # The page draws more coarsely when it finds itself slow, which may be between two pictures.
    page.wait_for(the_same_frame_is_the_same_picture, "the figure does not go along with the slider")
    page.press("|<")
    for _ in range(5):
        page.press(">")
    page.wait_for(lambda: page.field("Frame").input_value() == "5", "five steps are not five frames")


# -- making


def test_the_length_is_said_in_seconds(page: Visitor) -> None:
    page.open("Make")
    page.sees("2.00 s at the clip's 30 Hz")
    page.type("Frames", 75)
    page.sees("2.50 s at the clip's 30 Hz")
    page.type("Frames", 60)
    page.sees("2.00 s at the clip's 30 Hz")


def test_motions_are_made_and_stand_beside_the_clip(page: Visitor) -> None:
    before = page.at_frame(0)
    page.make(seed=1, motions=3)
    assert page.chosen("Motion") == "seed 1, 1 of 3"
    page.wait_for(lambda: page.differs(before) > MANY_PIXELS, "nobody has come on the stage")
    page.press("Accept")
    page.wait_for(lambda: page.chosen("Motion") == "seed 1, 1 of 3 ✓", "it is not accepted")
    page.press("Reject the rest")
    page.make(seed=2)
    assert page.options("Motion") == ["walk", "seed 1, 1 of 3 ✓", "seed 2"]
    page.choose("Motion", "seed 1, 1 of 3 ✓")
    page.press("Reject")
    page.wait_for(lambda: page.options("Motion") == ["walk", "seed 2"], "it is not rejected")


def test_what_is_downloaded_is_what_the_library_makes(page: Visitor) -> None:
    page.make(seed=3)
    made = page.downloaded("BVH")
    (twin,) = mg.create("genmm").fit([CLIP]).sample(60, seed=3)
    assert made.allclose(twin, 1e-5)
    assert made.name == "seed_3"
    assert page.downloaded("GLB").positions == pytest.approx(made.positions, abs=1e-3)
    assert page.downloaded("NPZ").allclose(twin, 1e-5)


def test_a_preview_is_a_film_or_a_page(page: Visitor) -> None:
    page.make(seed=4)
    with Image.open(page.download("preview (GIF)")) as film:
        assert film.n_frames > 10
    assert "<canvas" in page.download("preview (page)").read_text(encoding="utf-8")


def test_a_key_holds_its_pose(page: Visitor) -> None:
    page.type("Frame", 20)
    page.open("Make")
    page.unfold("Keys", "Key at this frame")
    page.press("Key at this frame")
    page.sees("The pose is held at frame 20.")
    page.make(seed=10)
    apart = turned(page.downloaded(), CLIP).max(axis=1)
    assert apart[20] < ROUNDING
    assert apart.max() > 1e-3, "elsewhere it moves otherwise"
    page.open("Make")
    page.press("Clear keys")
    page.sees("No keys yet.")


def test_a_loop_ends_where_it_begins(page: Visitor) -> None:
    page.open("Make")
    page.choose("Loop", "in place")
    page.make(seed=11)
    made = page.downloaded()
    steps = turned(made[1:], made[:-1]).max(axis=1)
    assert turned(made[-1:], made[:1]).max() <= 2 * steps.max(), "the seam is a step like the others"
    ground = made.positions[:, 0, [0, 2]]
    paces = np.linalg.norm(np.diff(ground, axis=0), axis=1)
    assert np.linalg.norm(ground[-1] - ground[0]) <= 2 * paces.max()
    page.open("Make")
    page.choose("Loop", "no")


def test_only_the_segment_is_made_anew(page: Visitor) -> None:
    page.open("Make")
    page.unfold("Redo a segment", "Redo only this")
    page.tick("Redo only this")
    page.make(seed=12)
    apart = turned(page.downloaded(), CLIP).max(axis=1)
    assert apart[:20].max() < ROUNDING
    assert apart[41:].max() < ROUNDING
    assert apart[20:41].max() > 1e-4
    page.open("Make")
    page.tick("Redo only this")


def test_a_part_that_is_kept_moves_as_in_the_clip(page: Visitor) -> None:
    page.open("Make")
    page.unfold("Keep joints", "LeftShoulder")
    page.tick("LeftShoulder")
    page.make(seed=13)
    apart = turned(page.downloaded(), CLIP).max(axis=0)
    names = CLIP.skeleton.names
    kept = [names.index(name) for name in ("LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand")]
    assert apart[kept].max() < ROUNDING
    assert apart[names.index("RightArm")] > 1e-4
    page.open("Make")
    page.tick("LeftShoulder")


def test_a_path_is_drawn_by_clicks_and_gone_along(page: Visitor) -> None:
    page.open("View")
    page.press("See everything")
    page.open("Make")
    page.unfold("Path", "Draw by clicking on the ground")
    page.tick("Draw by clicking on the ground")
    page.page.wait_for_timeout(1000)  # until the page knows that it is to listen
    before = page.settled()
    for number, place in enumerate([(330, 440), (400, 430), (430, 380)], start=1):
        page.page.mouse.click(*place)
        page.sees(re.compile(rf"^{number} points?, about"))
    page.wait_for(lambda: page.differs(before) > 3, "the line is not drawn")
    page.make(seed=14)
    bend = _bend(page.downloaded())
    assert bend > 3 * _bend(CLIP), "it turns as the line does"
    page.open("Make")
    page.press("Clear path")
    page.sees("Click on the ground, point after point; the character travels along the line.")
    page.tick("Draw by clicking on the ground")
    page.page.mouse.click(330, 440)
    page.make(seed=15)
    assert _bend(page.downloaded()) < bend / 2, "the path is gone, and clicks draw nothing"


def _bend(motion: Motion) -> float:
    """How far the root's way goes from the straight line between its ends, as a share of that line."""
    way = motion.positions[:, 0, [0, 2]]
    along = (way[-1] - way[0]) / np.linalg.norm(way[-1] - way[0])
    off = (way - way[0]) @ np.array([along[1], -along[0]])
    return float(np.abs(off).max() / np.linalg.norm(way[-1] - way[0]))


# -- what goes wrong


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("broken.bvh", b"HIERARCHY\nROOT Hips {", "'broken.bvh'"),
        ("notes.txt", b"hello", "'notes.txt' is no clip that can be read"),
        ("large.bvh", bytes(2**20 + 1), "MiB"),
    ],
)
def test_a_wrong_file_is_a_message(page: Visitor, tmp_path: Path, name: str, content: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    page.load(path)
    page.sees(words)
    page.ready()
    assert page.chosen("Clip") == "walk"


def test_a_name_is_shown_and_never_run(page: Visitor, tmp_path: Path, walk: Path) -> None:
    name = "<img src=x onerror='window.ran=1'><b>bold"
    path = tmp_path / f"{name}.bvh"
    path.write_bytes(walk.read_bytes())
    page.load(path)
    page.wait_for(lambda: page.chosen("Clip") == name, "it is not loaded")
    page.make(seed=20)
    page.open("Make")
    assert page.page.evaluate("window.ran") is None
    page.open("Clip")
    page.press("Remove this clip")
    page.wait_for(lambda: page.chosen("Clip") == "walk", "it is not removed")


def test_what_does_not_go_is_a_message(page: Visitor) -> None:
    page.open("Make")
    page.unfold("Options", "Alpha")
    page.type("Alpha", "much")
    page.press("Make motions")
    page.sees("alpha must be a number or nothing, not 'much'")
    page.type("Alpha", "0.01")
    page.make(seed=21)


def test_work_can_be_cancelled(page: Visitor) -> None:
    page.make(seed=22)
    page.open("Make")
    page.unfold("Options", "Alpha")
    page.type("Iterations", 2000)
    page.type("Motions", 8)
    page.type("Seed", 23)
    page.press("Make motions")
    page.sees(re.compile("^Making 8 motions: "))
    page.press("Cancel")
    page.ready()
    page.open("Takes")
    assert page.chosen("Motion") == "seed 22"
    page.open("Make")
    page.type("Iterations", 5)
    page.make(seed=24)


# -- several


def test_two_visitors_see_nothing_of_each_other(
    page: Visitor, browser: Any, server: Server, walk: Path, tmp_path: Path
) -> None:
    page.make(seed=30)
    other = Visitor(browser, server.address, tmp_path)
    path = tmp_path / "theirs.bvh"
    path.write_bytes(walk.read_bytes())
    other.open("Clip")
    assert other.options("Clip") == [mg.load(EXAMPLE_CLIP).name]
    other.load(path)
    other.sees("'theirs' is loaded")
    other.make(seed=31)
    assert other.options("Motion") == ["theirs", "seed 31"]
    assert page.options("Motion") == ["walk", "seed 30"]
    assert "theirs" not in page.text()
    assert "seed 30" not in other.text()
    other.leave()
    page.make(seed=32)


# -- a latent space


@pytest.fixture
def with_modi(page: Visitor) -> Iterator[Visitor]:
    page.open("Make")
    page.choose("Generator", "modi")
    page.open("Takes")
    page.wait_for(lambda: "seed 0" in page.options("Motion"), "the first motion does not come")
    page.ready()
    page.choose("Motion", "seed 0")
    page.sees(re.compile("^64 frames"))
    yield page
    page.open("Latent")
    page.press("Back to the start")
    page.open("Make")
    page.choose("Generator", "genmm")
    page.open("Takes")
    page.press("Reject the rest")
    page.open("Clip")
    page.choose("Clip", "walk")


def test_sliders_move_a_motion_through_the_latent_space(with_modi: Visitor) -> None:
    page = with_modi
    before = page.at_frame(10)
    page.open("Latent")
    page.type("Hand height", 3)
    page.wait_for(lambda: page.differs(before) > MANY_PIXELS, "the figure does not go along")
    page.open("Takes")
    page.wait_for(lambda: "seed 0, hand_height +3.0" in page.options("Motion"), "it is not called by its place")
    page.open("Latent")
    page.press("Keep this motion")
    page.open("Takes")
    page.wait_for(lambda: page.chosen("Motion") == "seed 0, hand_height +3.0 ✓", "it is not kept")
    page.press("Reject")
    page.wait_for(lambda: not any("✓" in each for each in page.options("Motion")), "it is not thrown away")


def test_a_clip_is_found_in_the_latent_space(with_modi: Visitor) -> None:
    page = with_modi
    page.make(seed=40)
    page.press("Work on this")
    page.open("Clip")
    page.wait_for(lambda: page.chosen("Clip") == "seed_40", "it has not become a clip")
    page.open("Latent")
    page.press("Invert the clip")
    page.wait_for(lambda: page.chosen("Start from") == "the clip", "the clip is not found")
    page.open("Takes")
    page.wait_for(lambda: any(each.startswith("clip") for each in page.options("Motion")), "its motion does not come")
    page.open("Latent")
    page.choose("Start from", "a seed")
    page.open("Clip")
    page.press("Remove this clip")
    page.wait_for(lambda: page.chosen("Clip") == "walk", "it is not removed")


# -- coming again


@pytest.mark.parametrize("lost", [False, True], ids=["loaded", "lost"])
def test_a_page_that_is_loaded_anew_or_was_cut_off_goes_on(with_modi: Visitor, server: Server, lost: bool) -> None:
    page = with_modi
    page.open("Make")
    page.type("Frames", 44)
    page.type("Seed", 50)
    page.open("Latent")
    page.type("Hip height", 1.5)
    page.open("Takes")
    page.wait_for(lambda: any("hip_height +1.5" in each for each in page.options("Motion")), "the slider has no effect")
    before = page.options("Motion"), page.chosen("Motion")
    if lost:
        server._guard.viser._websock_server.disconnect_all_clients()
    else:
        page.load_again()
    page.sees("Here again")
    page.ready()
    page.open("Takes")
    page.wait_for(lambda: (page.options("Motion"), page.chosen("Motion")) == before, "motions are missing")
    page.open("Make")
    assert page.chosen("Generator") == "modi"
    assert [page.field(label).input_value() for label in ("Frames", "Seed")] == ["44", "50"]
    page.open("Latent")
    page.wait_for(lambda: page.field("Hip height").input_value() in ("1.5", "1.50"), "the slider is back at zero")
    page.make(seed=51)
