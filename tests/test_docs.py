"""What README shows works: its commands are run, its links and pictures are there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.cli import main
from tests.conftest import ROOT

README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, flags=re.DOTALL)
COMMANDS = [
    line.split("  #")[0].strip()
    for language, block in BLOCKS
    if language == "sh"
    for line in block.splitlines()
    if line.startswith("motiongen ")
]
CONTROLS = re.findall(r"\| `(constraint=[^`]+)` \|", README)


@pytest.fixture
def clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clips that the commands name, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    clip = mg.load(EXAMPLE_CLIP)[:300]
    for name in ("walk", "a", "b", "c"):
        clip.save(f"{name}.bvh")
    Path("walks").mkdir()
    clip.save("walks/sample_0000.bvh")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.usefixtures("clips")
def test_commands_in_readme_work(command: str) -> None:
    arguments = shlex.split(command)[1:]
    if arguments[0] == "sample" and "--help" not in arguments:
        arguments += ["preview=none", *([] if "count" in command else ["count=1"])]
    assert main(arguments) == 0


@pytest.mark.parametrize("settings", CONTROLS)
@pytest.mark.usefixtures("clips")
def test_controls_in_readme_work(settings: str) -> None:
    assert main(["sample", "input=walk.bvh", "count=1", "preview=none", "output=out", *shlex.split(settings)]) == 0


@pytest.mark.usefixtures("clips")
def test_python_in_readme_works() -> None:
    for language, block in BLOCKS:
        if language == "python":
            exec(compile(block, "README.md", "exec"), {})
    assert len(mg.load("out.bvh")) == 600


@pytest.mark.parametrize(
    "page", [p.relative_to(ROOT).as_posix() for p in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"))]
)
def test_links_lead_somewhere(page: str) -> None:
    folder = (ROOT / page).parent
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", (ROOT / page).read_text())
    missing = [t for t in targets if not t.startswith(("http", "mailto")) and not (folder / t).exists()]
    assert missing == []


def test_there_is_something_to_test() -> None:
    assert len(COMMANDS) >= 7
    assert len(CONTROLS) >= 8
