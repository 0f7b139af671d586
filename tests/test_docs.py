"""What the pages show works: their commands and programs are run, their links and pictures are there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.cli import main
from tests.checkpoints import random_checkpoint
from tests.conftest import ROOT


def blocks(page: str, language: str) -> list[str]:
    """The blocks of a page in one language."""
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)


def commands(page: str) -> list[str]:
    """The commands of a page, without what is said beside them."""
    lines = [line.split("  #")[0].strip() for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith("motiongen ")]


README, APPLICATIONS = "README.md", "docs/applications.md"
COMMANDS = [command for page in (README, APPLICATIONS) for command in commands(page)]
CONTROLS = re.findall(r"\| `(constraint=[^`]+)` \|", (ROOT / README).read_text())


@pytest.fixture
def clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clips that the pages name, in an empty folder: pieces of the bundled one."""
    monkeypatch.chdir(tmp_path)
    clip = mg.load(EXAMPLE_CLIP)
    for name in ("walk", "giant", "old", "idle", "turn_left", "turn_right", "a", "b", "c", "before", "after"):
        clip[:300].save(f"{name}.bvh")
    clip[::60].replace(frame_rate=1.0).save("edited-keys.bvh")
    for folder in ("walks", "waves", "clips"):
        Path(folder).mkdir()
        clip[:200].save(f"{folder}/sample_0000.bvh")
    random_checkpoint(Path("runs/first/best"), clip.skeleton)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.usefixtures("clips")
def test_commands_work(command: str) -> None:
    arguments = shlex.split(command)[1:]
    if arguments[0] == "sample" and "--help" not in arguments:
        arguments += ["preview=none", *([] if "count" in command else ["count=1"])]
    assert main(arguments) == 0


@pytest.mark.parametrize("settings", CONTROLS)
@pytest.mark.usefixtures("clips")
def test_controls_in_readme_work(settings: str) -> None:
    assert main(["sample", "input=walk.bvh", "count=1", "preview=none", "output=out", *shlex.split(settings)]) == 0


@pytest.mark.parametrize(("page", "written", "frames"), [(README, "out", 600), (APPLICATIONS, "chunk_000009", 150)])
@pytest.mark.usefixtures("clips")
def test_programs_work(page: str, written: str, frames: int) -> None:
    """The blocks of a page one after the other, as one reads them."""
    names: dict[str, object] = {}
    for block in blocks(page, "python"):
        exec(compile(block, page, "exec"), names)
    assert len(mg.load(f"{written}.bvh")) == frames


def test_every_constraint_has_its_command_and_its_program() -> None:
    page = (ROOT / APPLICATIONS).read_text()
    for config in (ROOT / "configs" / "constraint").glob("*.yaml"):
        shown = [c for c in commands(APPLICATIONS) if re.search(rf"constraint=\S*\b{config.stem}\b", c)]
        assert shown, f"{APPLICATIONS} has no command with constraint={config.stem}"
        assert f"mg.{config.stem.title().replace('_', '')}(" in page


@pytest.mark.parametrize(
    "page", [p.relative_to(ROOT).as_posix() for p in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"))]
)
def test_links_lead_somewhere(page: str) -> None:
    folder, text = (ROOT / page).parent, (ROOT / page).read_text()
    targets = re.findall(r"\]\(([^)\s]+)[^)]*\)", text)
    files = [target.split("#")[0] for target in targets if not target.startswith(("http", "mailto", "#"))]
    assert [file for file in files if not (folder / file).exists()] == []
    titles = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in re.findall(r"^#+ (.+)$", text, re.M)}
    assert {target[1:] for target in targets if target.startswith("#")} <= titles


def test_there_is_something_to_test() -> None:
    assert len(commands(README)) >= 7
    assert len(commands(APPLICATIONS)) >= 14
    assert len(CONTROLS) >= 8
