"""The page that plays clips: it holds the clips as they are, needs nothing else, and runs in a browser."""

from __future__ import annotations

import base64
import json
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.render import render_clips
from motiongen.render.figure import node_positions
from tests.browser import chromium
from tests.strategies import random_motion, random_skeleton


def clip(seed: int, frames: int, rate: float = 30.0, name: str = "clip") -> Motion:
    rng = np.random.default_rng(seed)
    return random_motion(rng, random_skeleton(rng, 9), frames=frames, smooth=True, name=name).replace(frame_rate=rate)


def data_of(page: str) -> dict[str, Any]:
    """What stands in the page's data block, as a browser finds it."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, flags=re.DOTALL)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_a_page_holds_every_frame_of_every_clip(tmp_path: Path) -> None:
    motions = [clip(0, 20), clip(1, 33, rate=60.0)]
    data = data_of(render_clips(motions, tmp_path / "player.html").read_text())
    for motion, shown in zip(motions, data["clips"]):
        nodes = np.frombuffer(base64.b64decode(shown["nodes"]), "<f4").reshape(-1, shown["count"], 3)
        assert (len(nodes), shown["frames"], shown["rate"]) == (len(motion), len(motion), motion.frame_rate)
        every = node_positions(motion)
        lengths = {round(float(d), 3) for d in _lengths(nodes, shown["bones"])}
        scale = np.ptp(every[..., 1]) / np.ptp(nodes[..., 1]) if np.ptp(nodes[..., 1]) else 1.0
        assert lengths  # bones have the lengths that they have in the clip, at one scale
        real = every[0] / scale
        distances = np.linalg.norm(real[:, None] - real[None], axis=-1)
        for length in lengths:
            assert np.abs(distances - length).min() < 5e-3
        assert len(shown["bones"]) == len(shown["radii"]) == len(shown["colours"])


class Tags(HTMLParser):
    """What elements a page has."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)


def _lengths(nodes: np.ndarray, bones: list[list[int]]) -> np.ndarray:
    ends = np.array(bones)
    return np.linalg.norm(nodes[0, ends[:, 0]] - nodes[0, ends[:, 1]], axis=-1)


def test_names_cannot_break_out_and_nothing_is_fetched(tmp_path: Path) -> None:
    evil = '</script><script>alert("&")</script>'
    page = render_clips([clip(0, 5, name=evil)], tmp_path / "player.html").read_text()
    assert data_of(page)["clips"][0]["label"] == evil
    parser = Tags()
    parser.feed(page)
    assert parser.seen.count("script") == 2
    assert not re.search(r"https?://|src=|import\(", page)


def test_only_so_many_seconds_are_held_and_what_has_no_meaning_is_refused(tmp_path: Path) -> None:
    page = render_clips([clip(0, 90)], tmp_path / "player.html", seconds=1.0).read_text()
    assert data_of(page)["clips"][0]["frames"] == 30
    for settings, words in (({"size": (640, 480)}, "fills its window"), ({"frame_rate": 10.0}, "no rate of its own")):
        with pytest.raises(MotionGenError, match=words):
            render_clips([clip(0, 5)], tmp_path / "none.html", **settings)
    assert not (tmp_path / "none.html").exists()


@pytest.mark.xdist_group("browser")
def test_it_runs_in_a_browser(tmp_path: Path) -> None:
    """Another moment is another picture, and the clock says which."""
    browser = chromium()
    page = render_clips([clip(0, 90)], tmp_path / "player.html")
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=1000", "--window-size=640,480"]

    def run(moment: str, *flags: str) -> str:
        given = [*command, *flags, f"{page.as_uri()}#{moment}"]
        return subprocess.run(given, check=False, capture_output=True, text=True, timeout=120).stdout

    assert '<output id="clock">1.50 / 2.97 s</output>' in run("1.5", "--dump-dom")
    pictures = []
    for moment in ("0", "1.5"):
        run(moment, f"--screenshot={tmp_path / moment}.png")
        with Image.open(tmp_path / f"{moment}.png") as picture:
            pictures.append(np.asarray(picture.convert("L"), dtype=np.int64)[:400])
    assert np.ptp(pictures[0]) > 50, "a figure on a light ground"
    assert (np.abs(pictures[0] - pictures[1]) > 30).sum() > 200
