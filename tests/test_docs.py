"""What the pages show works: their commands and programs are run, their links and pictures are there."""

from __future__ import annotations

import contextlib
import re
import shlex
import threading
from pathlib import Path
from typing import cast

import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.cli import main
from motiongen.generators.modi.encoder import FORMAT, WEIGHTS, new_network, save_tensors
from motiongen.generators.modi.model_files import fingerprint
from tests.checkpoints import random_checkpoint
from tests.conftest import ROOT


def blocks(page: str, language: str) -> list[str]:
    """The blocks of a page in one language."""
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)


def commands(page: str) -> list[str]:
    """The commands of a page, without what is said beside them."""
    lines = [line.split("  #")[0].strip() for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith("motiongen ")]


README, APPLICATIONS, LATENT = "README.md", "docs/applications.md", "docs/latent.md"
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
def test_commands_work(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = shlex.split(command)[1:]
    if arguments[0] == "sample" and "--help" not in arguments:
        arguments += ["preview=none", *([] if "count" in command else ["count=1"])]
    if arguments[0] == "serve":
        serve_for_a_moment(monkeypatch)
        arguments += ["--port", "0"]
    assert main(arguments) == 0


def serve_for_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `motiongen serve` end as soon as it has begun."""
    pytest.importorskip("viser", reason="the extra web is not installed")
    stopped = threading.Event()
    stopped.set()
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    monkeypatch.setattr("motiongen.commands.serve._stop_signals", lambda: contextlib.nullcontext(stopped))


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


@pytest.fixture
def figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clips on the bundled model's skeleton, under the names that the page takes, and an encoder without training."""
    monkeypatch.chdir(tmp_path)
    model = mg.create("modi")
    for name, motion in zip(("walk", "run"), model.sample(frames=64, count=2, seed=0)):
        motion.save(f"{name}.bvh")
    network = new_network(model)
    notes = {"format": FORMAT, "model": fingerprint(model)}
    Path("runs/encoder").mkdir(parents=True)
    save_tensors(Path("runs/encoder") / WEIGHTS, notes, network.state_dict())


SMALLER = {
    "latent": ["frames=16", "poses=2"],
    "invert": ["inversion.steps=2", "inversion.candidates=2"],
    "edit": ["samples=60", "poses=2", "frames=16"],
    "sample": ["preview=none", "frames=16"],
}
"""What makes the page's commands quick."""


@pytest.mark.parametrize("command", [line for line in commands(LATENT) if "task=clusters" not in line])
@pytest.mark.usefixtures("figures")
def test_commands_of_the_latent_space_work(command: str) -> None:
    arguments = shlex.split(command)[1:]
    given = {argument.partition("=")[0] for argument in arguments}
    more = [each for each in SMALLER[arguments[0]] if each.partition("=")[0] not in given - {"samples"}]
    assert main([*arguments, *more]) == 0


@pytest.mark.usefixtures("figures")
def test_programs_of_the_latent_space_work() -> None:
    names: dict[str, object] = {}
    for block in blocks(LATENT, "python"):
        smaller = block.replace("10_000", "60").replace("3000", "50").replace("steps=100", "steps=2")
        exec(compile(smaller, LATENT, "exec"), names)
    assert len(cast(list[float], names["scores"])) == 3
    assert Path("crowd.png").exists()


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
