"""The documentation site: its pages' commands and programs run, its plug-in works, and it builds without a warning."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.cli import main
from tests.conftest import ROOT
from tests.test_docs import blocks, serve_for_a_moment
from tools import list_errors
from tools.list_errors import Message, find_messages

DOCS = ROOT / "docs"
PLUG_IN = DOCS / "examples" / "motiongen-shuffle"
PAGES = ["docs/install.md", "docs/start.md", *sorted(f"docs/tasks/{p.name}" for p in (DOCS / "tasks").glob("*.md"))]
LEARNT = [f"docs/tasks/{name}.md" for name in ("train", "edit", "evaluate")]
"""Pages whose clips are on the bundled model's skeleton; `evaluate` uses what `train` has made."""

NETWORK = ["network.channels=[8,8]", "network.latent_size=8", "network.mapping_layers=2", "network.deviation_group=2"]
SMALLER = {
    "sample": ["preview=none"],
    "latent": ["frames=16", "poses=2"],
    "edit": ["samples=60", "poses=2", "frames=16"],
    "evaluate": ["count=10", "resamples=2"],
    "train": [*NETWORK, "trainer.batch=4", "trainer.iterations=2", "trainer.measured=50"],
    "train.encoder": ["batch=2", "iterations=2"],
    "train.recogniser": ["channels=[4,8]", "batch=8", "iterations=2", "least_clips=2"],
}
"""What makes the pages' commands quick; settings that a page gives itself stay, but for `count`."""


def shown_commands(page: str) -> list[str]:
    """The commands of a page that are ours, in order, without what is said beside them."""
    lines = [line.split("  #")[0].strip() for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith(("motiongen ", "python -m train"))]


def run_command(line: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """The exit code of a command, made smaller."""
    words = shlex.split(line)
    trained = words[0] == "python"
    name = words[2] if trained else words[1]
    given = words[3:] if trained else words[2:]
    keys = {word.partition("=")[0] for word in given} - {"count"}
    if name == "serve":
        serve_for_a_moment(monkeypatch)
        given = [*given, "--port", "0"]
    if "--help" not in given:
        given = [*given, *(setting for setting in SMALLER.get(name, []) if setting.partition("=")[0] not in keys)]
    if not trained:
        return main([name, *given])
    monkeypatch.setattr(sys, "argv", [name, *given])
    module = importlib.import_module("train.__main__" if name == "train" else name)
    code: int = module.main(given) if name == "train.recogniser" else module.main()
    return code


def run_programs(page: str) -> dict[str, Any]:
    """What the programs of a page, one after the other, have made."""
    names: dict[str, Any] = {}
    for block in blocks(page, "python"):
        exec(compile(block, page, "exec"), names)
    return names


@pytest.fixture
def clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clips that the pages name, in an empty folder: pieces of the bundled one."""
    monkeypatch.chdir(tmp_path)
    clip = mg.load(EXAMPLE_CLIP)
    for name in ("walk", "a", "giant", "loop"):
        clip[:300].save(f"{name}.bvh")
    clip[::60].replace(frame_rate=1.0).save("edited-keys.bvh")
    other = clip[100:300]
    names = tuple(f"Bip01_{name}" for name in other.skeleton.names)
    skeleton = mg.Skeleton(names, other.skeleton.parents, other.skeleton.offsets)
    other.replace(skeleton=skeleton, file_layout=None).save("elephant.bvh")
    Path("clips").mkdir()
    clip[:200].save("clips/one.bvh")


@pytest.fixture(scope="module")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with clips of the bundled model's, labelled by their names."""
    folder = tmp_path_factory.mktemp("learnt")
    (folder / "clips").mkdir()
    for number, motion in enumerate(mg.create("modi", clean_feet=False).sample(frames=96, count=40, seed=0)):
        motion.save(folder / "clips" / f"{('walk', 'run')[number % 2]}_{number}.bvh")
    mg.load(folder / "clips" / "walk_0.bvh")[:64].save(folder / "walk.bvh")
    return folder


@pytest.mark.parametrize("page", [page for page in PAGES if page not in LEARNT])
@pytest.mark.usefixtures("clips")
def test_pages_do_what_they_show(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for line in shown_commands(page):
        assert run_command(line, monkeypatch) == 0, line
    run_programs(page)


def test_pages_on_learning_do_what_they_show(learnt: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(learnt)
    for page in LEARNT:
        for line in shown_commands(page):
            assert run_command(line, monkeypatch) == 0, line
        run_programs(page)


def test_there_is_something_to_test() -> None:
    assert sum(len(shown_commands(page)) for page in PAGES) >= 25
    assert sum(len(blocks(page, "python")) for page in PAGES) >= 7


# -- the plug-in


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the plug-in is installed, by pip."""
    source, folder = tmp_path_factory.mktemp("source") / "plug-in", tmp_path_factory.mktemp("site")
    for path in PLUG_IN.rglob("*"):  # a copy, so that nothing is left behind by the build
        if path.is_file() and "__pycache__" not in path.parts:
            target = source / path.relative_to(PLUG_IN)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(folder), str(source)], check=True, capture_output=True)
    return folder


@pytest.fixture
def installed(site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The plug-in, installed for this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(site)
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "motiongen_shuffle"]:
        del sys.modules[name]


@pytest.mark.usefixtures("installed")
def test_the_page_on_plug_ins_does_what_it_shows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = shown_commands("docs/plugin.md")
    for line in lines:
        assert run_command(line, monkeypatch) == 0, line
    assert re.search(r"^  shuffle +Pieces of the examples", capsys.readouterr().out, re.MULTILINE)
    assert [len(mg.load(f"motiongen-out/sample_000{k}.bvh")) for k in (0, 1)] == [300, 300]
    motion = run_programs("docs/plugin.md")["motion"]
    clip = mg.load(EXAMPLE_CLIP)
    assert (len(motion), motion.skeleton, motion.frame_rate) == (300, clip.skeleton, clip.frame_rate)


def test_the_plug_in_passes_its_own_tests_and_those_of_the_contract(site: Path) -> None:
    tests = [str(PLUG_IN / "tests"), "tests/generators/test_contract.py", "-k", "shuffle and not configuration"]
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--import-mode=importlib", *tests]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(site)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.findall(r"(\d+) passed", done.stdout)[0]) >= 10


@pytest.mark.parametrize(
    "path",
    ["pyproject.toml", "motiongen_shuffle/__init__.py", "motiongen_shuffle/generator.py", "tests/test_shuffle.py"],
)
def test_the_page_shows_the_plug_in_as_it_is(path: str) -> None:
    assert f"\n{(PLUG_IN / path).read_text()}```" in (DOCS / "plugin.md").read_text()


# -- the messages


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return find_messages()


def test_the_list_of_messages_is_that_of_the_source(messages: list[Message]) -> None:
    written = (DOCS / "errors.md").read_text(encoding="utf-8")
    assert written == list_errors.page(messages), "messages have changed: python -m tools.list_errors docs/errors.md"


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("motiongen/cli.py", "there is no command '<arguments>'"),
        ("motiongen/io/bvh/header.py", "<path>:<line>: '<word>' begins the file; a BVH file begins with HIERARCHY"),
        ("motiongen/io/glb/container.py", "it does not begin with 'glTF'"),
        ("motiongen/commands/render.py", "--size must be WIDTHxHEIGHT"),
    ],
)
def test_messages_are_found_however_they_are_raised(messages: list[Message], source: str, text: str) -> None:
    assert any(message.source == source and message.text.startswith(text) for message in messages)


def test_every_module_that_raises_is_in_the_list(messages: list[Message]) -> None:
    raising = {
        path.relative_to(ROOT).as_posix()
        for folder in list_errors.SOURCES
        for path in (ROOT / folder).rglob("*.py")
        if re.search(r"raise MotionGenError\(\s*f?\"[^{]", path.read_text(encoding="utf-8"))
    }
    assert raising - {message.source for message in messages} == set()
    assert len(raising) > 40


# -- the site


def pages_of(entry: Any) -> Iterator[str]:
    """The pages in a part of the site's table of contents."""
    if isinstance(entry, str):
        yield entry
    else:
        for part in entry.values() if isinstance(entry, dict) else entry:
            yield from pages_of(part)


def test_the_contents_name_every_page() -> None:
    contents = set(pages_of(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]))
    there = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    assert contents == {page for page in there if not page.startswith(("results/", "examples/"))}


def test_the_reference_names_modules_that_there_are() -> None:
    named = [m for page in (DOCS / "api").glob("*.md") for m in re.findall(r"^::: (\S+)$", page.read_text(), re.M)]
    assert [name for name in named if importlib.util.find_spec(name) is None] == []
    assert len(named) == len(set(named)) > 30


@pytest.mark.skipif(
    not all(importlib.util.find_spec(name) for name in ("mkdocs", "material", "mkdocstrings")),
    reason="building the site needs the extra 'docs': pip install '.[docs]'",
)
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for page in ("index.html", "tasks/vary/index.html", "api/motion/index.html", "errors/index.html"):
        assert (tmp_path / "site" / page).is_file()
