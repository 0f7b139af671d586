"""The picture of the page of `motiongen serve`: a clip and takes of several seeds, in a real browser.

    python -m tools.serve_picture docs/pictures/serve.png [--chromium PATH] [--clip FILE] [--frame N]

Needs the extras `web` and `test` (Playwright) and a Chromium.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from PIL import Image

from motiongen.errors import MotionGenError
from motiongen.files import atomic_path
from motiongen.web.server import Server

WINDOW = {"width": 1400, "height": 840}
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SETTLING_SECONDS = 8.0
"""Drawing without a graphics card takes its time, labels most of all."""


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("picture", type=Path)
    parser.add_argument("--chromium", default=shutil.which("chromium") or shutil.which("google-chrome"))
    parser.add_argument("--clip", type=Path, help="in place of the bundled clip")
    parser.add_argument("--frame", type=int, default=268)
    parser.add_argument("--takes", type=int, default=3)
    options = parser.parse_args(arguments)
    if options.chromium is None:
        raise MotionGenError("there is no Chromium on this machine; name one with --chromium")
    from playwright.sync_api import sync_playwright

    with Server(port=0) as server, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=options.chromium, args=FLAGS)
        page = browser.new_page(viewport=WINDOW)
        page.goto(server.address)
        if options.clip is not None:
            load(page, options.clip)
        make_takes(page, options.takes)
        go_to(page, options.frame)
        content = page.screenshot()
        browser.close()
    with atomic_path(options.picture) as path:
        Image.open(io.BytesIO(content)).convert("RGB").save(path, "png", optimize=True)


def load(page: Any, clip: Path) -> None:
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Load a clip").click()
    chooser.value.set_files(clip)
    page.get_by_text("is loaded").wait_for()


def make_takes(page: Any, count: int) -> None:
    page.get_by_role("tab", name="Make").click()
    page.get_by_label("A seed for each").click()
    fill(page, "Motions", count)
    page.get_by_role("button", name="Make motions").click()
    page.get_by_role("tab", name="Takes").click()
    page.locator("input[role=combobox][value='seed 0']").wait_for()
    page.get_by_role("tab", name="Make").click()


def go_to(page: Any, frame: int) -> None:
    """Stand still at a frame, with no message over the stage."""
    page.get_by_role("button", name="Play / pause").click()
    time.sleep(1.0)
    fill(page, "Frame", frame)
    time.sleep(SETTLING_SECONDS)
    for cross in page.locator(".mantine-Notification-closeButton").all():
        cross.click()
    time.sleep(SETTLING_SECONDS)


def fill(page: Any, label: str, value: int) -> None:
    """Type a number into the field beside a label."""
    named = page.locator("p").filter(has_text=re.compile(f"^{label}$")).locator("visible=true").first
    field = named.locator("xpath=following::input[not(@type='hidden')][1]")
    field.fill(str(value))
    field.press("Enter")
    field.blur()
    time.sleep(0.5)


if __name__ == "__main__":
    try:
        main()
    except MotionGenError as error:
        sys.exit(f"serve_picture: {error}")
