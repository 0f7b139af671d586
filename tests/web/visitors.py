"""A visitor in a real browser, who finds things on the page by what is written on them."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import motiongen as mg
from motiongen.motion import Motion

WINDOW = {"width": 1040, "height": 700}
STAGE = {"x": 0, "y": 0, "width": 660, "height": 700}
"""The part of the window beside the panel."""

_ONLY_THE_STAGE = ".mantine-Notifications-root, [data-floating-window] { visibility: hidden !important; }"

PATIENCE_SECONDS = 180.0
_STILL = 20
"""Differences of two pictures below this, of 255, are none."""

_NOTHING_MOVES = "*, *::before, *::after { transition: none !important; animation: none !important; }"


class Visitor:
    """One page, with its own everything."""

    def __init__(self, browser: Any, address: str, folder: Path) -> None:
        self._folder = folder
        self._context = browser.new_context(viewport=WINDOW, device_scale_factor=0.25, accept_downloads=True)
        self._context.set_default_timeout(1000 * PATIENCE_SECONDS)
        self.page = self._context.new_page()
        self.broken: list[str] = []
        self.page.on("pageerror", lambda error: self.broken.append(str(error)))
        self.page.goto(address)
        self._arrive()
        self.sees("688 frames")  # of the bundled clip, which comes last

    def _arrive(self) -> None:
        self.page.add_style_tag(content=_NOTHING_MOVES)

    def load_again(self) -> None:
        """As by the browser's button."""
        self.page.reload()
        self._arrive()

    def leave(self) -> None:
        """Close the page."""
        self._context.close()

    # -- what is written

    def sees(self, text: str) -> None:
        """Wait until a text is seen."""
        self.page.get_by_text(text).locator("visible=true").first.wait_for()

    def text(self) -> str:
        """All that is written on the page."""
        return str(self.page.locator("body").inner_text())

    def ready(self) -> None:
        """Wait until nothing is worked on any more."""
        self.sees("Ready.")

    def field(self, label: str, number: int = 0) -> Any:
        """The input beside a label."""
        named = self.page.locator("p").filter(has_text=re.compile(f"^{re.escape(label)}$")).locator("visible=true")
        return named.nth(number).locator("xpath=following::input[not(@type='hidden')][1]")

    def wait_for(self, true: Callable[[], Any], what: str) -> None:
        """Wait until something is true."""
        end = time.monotonic() + PATIENCE_SECONDS
        while not true():
            assert time.monotonic() < end, what
            self.page.wait_for_timeout(50)

    # -- what is done

    def rest(self) -> None:
        """Let the page send what was done: within 50 ms, by its own clock, it keeps the last message only."""
        self.page.evaluate("new Promise((done) => setTimeout(done, 60))")

    def press(self, label: str) -> None:
        """Click on a button."""
        self.rest()
        self.page.get_by_role("button", name=label, exact=True).locator("visible=true").first.click()

    def open(self, tab: str) -> None:
        """Open a tab; a click on one that is drawn anew meanwhile does not count."""
        handle = self.page.get_by_role("tab", name=tab, exact=True)

        def opened() -> bool:
            handle.click()
            return handle.get_attribute("aria-selected") == "true"

        self.wait_for(opened, f"the tab {tab} does not open")

    def unfold(self, folder: str, inside: str) -> None:
        """Open a folder of the tab that is open, unless what is inside is seen already."""
        if not self.page.get_by_text(inside, exact=True).locator("visible=true").count():
            self.page.get_by_text(folder, exact=True).locator("visible=true").first.click()
        self.sees(inside)

    def choose(self, label: str, option: str) -> None:
        """Take an option of a list."""
        self.rest()
        self.page.get_by_role("combobox", name=label, exact=True).locator("visible=true").click()
        self.page.get_by_role("option", name=option, exact=True).locator("visible=true").click()

    def type(self, label: str, value: Any) -> None:
        """Put text or a number into a field."""
        self.rest()
        field = self.field(label)
        field.fill(str(value))
        field.press("Enter")
        field.blur()

    def tick(self, label: str) -> None:
        """Tick a box."""
        self.rest()
        self.page.get_by_role("checkbox", name=label, exact=True).first.click()

    def load(self, path: Path) -> None:
        """Send a file."""
        self.open("Clip")
        with self.page.expect_file_chooser() as chooser:
            self.press("Load a clip")
        chooser.value.set_files(path)

    def make(self, seed: int, motions: int = 1) -> None:
        """Have motions made, wait for them, and look at the first."""
        self.open("Make")
        self.type("Motions", motions)
        self.type("Seed", seed)
        self.press("Make motions")
        self.open("Takes")
        self.wait_for(lambda: self.chosen("Motion").startswith(f"seed {seed}"), f"seed {seed} does not come")

    def chosen(self, label: str) -> str:
        """What a list stands at."""
        return str(self.page.get_by_role("combobox", name=label, exact=True).locator("visible=true").input_value())

    def options(self, label: str) -> list[str]:
        """What a list offers."""
        field = self.page.get_by_role("combobox", name=label, exact=True).locator("visible=true")
        field.click()
        offered = self.page.get_by_role("option").locator("visible=true")
        offered.first.wait_for()
        texts = [str(text) for text in offered.all_inner_texts()]
        field.press("Escape")
        offered.first.wait_for(state="hidden")
        return texts

    def download(self, kind: str) -> Path:
        """The file that comes when the button is pressed."""
        self.open("Takes")
        self.choose("File", kind)
        with self.page.expect_download() as coming:
            self.press("Download")
        path = self._folder / coming.value.suggested_filename
        coming.value.save_as(path)
        return path

    def downloaded(self, kind: str = "BVH") -> Motion:
        """Likewise, as a motion."""
        return mg.load(self.download(kind))

    # -- what is seen

    def picture(self) -> NDArray[np.int64]:
        """(H, W) how bright the stage is."""
        with Image.open(io.BytesIO(self.page.screenshot(clip=STAGE, style=_ONLY_THE_STAGE))) as picture:
            return np.asarray(picture.convert("L"), dtype=np.int64)

    def differs(self, before: NDArray[np.int64]) -> int:
        """How many of the stage's pixels are others than they were."""
        return int((np.abs(self.picture() - before) > _STILL).sum())

    def at_frame(self, number: int) -> NDArray[np.int64]:
        """The picture of a frame."""
        self.type("Frame", number)
        self.page.wait_for_timeout(500)  # until the figure has heard of it
        return self.settled()

    def settled(self) -> NDArray[np.int64]:
        """The picture once it stands still."""
        seen = [self.picture()]

        def still() -> bool:
            seen.append(self.picture())
            return int((np.abs(seen[-1] - seen[-2]) > _STILL).sum()) == 0

        self.wait_for(still, "the picture does not come to rest")
        return seen[-1]
