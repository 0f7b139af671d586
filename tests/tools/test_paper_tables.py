"""The paper's tables on tiny clips: real runs, restarted and checked against plain ways to the same figures."""

from __future__ import annotations

import csv
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError
from motiongen.generators.registry import spec_of
from motiongen.metrics import one_clip_metrics
from tests.conftest import ROOT
from tools.paper_tables import cells, examples, long_outputs, measure, published, tables
from tools.paper_tables.__main__ import SECTIONS, main
from tools.paper_tables.cells import Cells, NotMeasuredError, code_version, content_of
from tools.paper_tables.examples import CLIPS, SETS, Examples
from tools.paper_tables.long_outputs import fit_line, in_own_process, peak_memory

# -- tiny clips under the names of the real ones


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    whole = mg.load(EXAMPLE_CLIP)
    (folder / "characters").mkdir()
    for number, name in enumerate(CLIPS):
        whole[60 * number : 60 * number + 64].save(folder / "characters" / f"{name}.bvh")
    (folder / "bandai-namco").mkdir()
    packed = folder / "packed"
    packed.mkdir()
    for number, name in enumerate((examples._DANCE, *examples._WALKS, "dataset-1_bow_active_001")):
        whole[20 * number : 20 * number + 40].save(packed / f"{name}.bvh")
    with tarfile.open(folder / "bandai-namco" / "dataset-1.tar.xz", "w:xz") as archive:
        archive.add(packed, "dataset-1")
    return folder


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examples, "_DANCE_PIECES", ((0, 14), (5, 13), (8, 15), (20, 14), (25, 12)))
    monkeypatch.setattr(examples, "LONG_EXAMPLE", (CLIPS[0], 50))
    monkeypatch.setattr(long_outputs, "LONG_EXAMPLE", (CLIPS[0], 50))
    monkeypatch.setattr(long_outputs, "FRAMES", (60, 120))
    monkeypatch.setattr(long_outputs, "REPEATS", 1)
    monkeypatch.setattr(tables, "LENGTHS", (2,))
    monkeypatch.setattr(tables, "JOINTS", (9, 31, 40))
    settings = published.TABLE_4["genmm"]
    kept = {name: settings[name] for name in ("α not used", "p = 5")}
    monkeypatch.setattr(tables, "TABLE_4", {"genmm": kept})


@pytest.fixture
def run(data: Path, tmp_path: Path) -> Callable[..., int]:
    def call(*more: str) -> int:
        return main(["genmm", "--data", str(data), "--out", str(tmp_path / "out"), "--seeds", "2", *more])

    return call


def records(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# -- whole runs


def test_everything_is_measured_once_and_written_the_same_again(
    run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run() == 0
    lines = capsys.readouterr().err.splitlines()
    measured = [line.partition(" s: ")[2] for line in lines if not line.startswith("known: ")]
    # Where tables share a cell, the first measures it.
    assert {line.partition("known: ")[2] for line in lines if line.startswith("known: ")} <= set(measured)
    assert len(set(measured)) == len(measured) > 25
    out = tmp_path / "out"
    page = (out / "tables.md").read_text(encoding="utf-8")
    for name in SECTIONS:
        rows = records(out / f"{name}.csv")
        assert rows
        assert all(row["generator"] == "genmm" for row in rows)
    assert "not been measured" not in page
    assert cells.machine() in page
    assert code_version() in page
    for plot in ("table4.png", "figure9.png"):
        assert (out / plot).read_bytes().startswith(b"\x89PNG")
        assert f"({plot})" in page
    assert [row["frames"] for row in records(out / "figure9.csv")] == ["60", "120"]
    assert [row["joints"] for row in records(out / "table3.csv")] == ["9"] * 3 + ["31"] * 3 + ["40"] * 3
    several = records(out / "table2.csv")
    assert len(several) == len(SETS) * 4
    assert all(float(row["least_coverage_percent"]) <= float(row["coverage_percent"]) + 1e-9 for row in several)

    assert run() == 0
    again = capsys.readouterr().err
    assert again.count("known:") == len(again.splitlines())
    assert (out / "tables.md").read_text(encoding="utf-8") == page


def test_figures_are_those_of_the_metrics(run: Callable[..., int], data: Path, tmp_path: Path) -> None:
    assert run("--only", "table1") == 0
    clip = mg.load(data / "characters" / f"{CLIPS[1]}.bvh")
    generator = mg.create("genmm", standing_feet="free").fit([clip])
    made = [generator.sample(2 * len(clip), seed=seed)[0] for seed in (0, 1)]
    plain = one_clip_metrics([clip], made)
    row = records(tmp_path / "out" / "table1.csv")[1]
    assert row["example"] == CLIPS[1]
    assert float(row["coverage_percent"]) == pytest.approx(100 * plain.coverage)
    for name in ("set_diversity", "global_patch_distance", "local_patch_distance"):
        assert float(row[name]) == pytest.approx(getattr(plain, name))
    assert 0 < float(row["seconds"]) <= float(row["median_seconds"])


def test_a_run_that_was_ended_goes_on(run: Callable[..., int], monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0

    def counted(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == 3:
            raise KeyboardInterrupt
        return one_clip_metrics(*arguments)

    monkeypatch.setattr(measure, "one_clip_metrics", counted)
    with pytest.raises(KeyboardInterrupt):
        run("--only", "table1")
    assert run("--only", "table1") == 0
    assert calls == len(CLIPS) + 1  # the one that was ended, again


def test_what_is_not_asked_for_is_shown_if_it_is_known(run: Callable[..., int], tmp_path: Path) -> None:
    page = tmp_path / "out" / "tables.md"
    assert run("--only", "table1") == 0
    assert [name for name in SECTIONS if f"{name} has not been measured" in page.read_text()] == [*SECTIONS][1:]
    assert run("--only", "table4") == 0
    assert "## Table 1" in page.read_text()
    assert "table2 has not been measured" in page.read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--only", "table9"), "there is no 'table9'"),
        (("--seeds", "1"), "--seeds must be 2 or more, not 1"),
        (("--generators", "genm"), "there is no generator 'genm'"),
        (("--data", "nowhere"), "nowhere/characters/Salsa-Dancing-6.bvh: there is no such file"),
    ],
)
def test_mistakes_are_told_in_one_line(
    run: Callable[..., int], capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    assert run(*arguments) == 2
    told = capsys.readouterr().err
    assert words in told
    assert len(told.splitlines()) == 1


# -- parts


def test_every_published_setting_is_one_of_the_generator() -> None:
    for generator, settings in published.TABLE_4.items():
        defaults = spec_of(generator).options_type()()
        changed = [spec_of(generator).options_type().build(dict(options)) for options, _ in settings.values()]
        assert changed[0] == defaults
        assert len({repr(options) for options in changed}) == len(settings)


def test_an_archive_without_a_clip_is_refused(data: Path, tmp_path: Path) -> None:
    (tmp_path / "bandai-namco").mkdir()
    archive = tmp_path / "bandai-namco" / "dataset-1.tar.xz"
    with tarfile.open(archive, "w:xz") as packed:
        packed.add(data / "packed" / f"{examples._DANCE}.bvh", "dance.bvh")
    with pytest.raises(MotionGenError, match="holds no clip dataset-1_dance-short_normal_001, dataset-1_walk_active"):
        Examples(tmp_path).several("dance", 2)
    archive.write_bytes(b"no archive")
    with pytest.raises(MotionGenError, match="cannot be unpacked"):
        Examples(tmp_path).several("walks", 2)


def test_a_result_is_known_for_its_own_settings_and_code_alone(tmp_path: Path) -> None:
    def give(value: int) -> Callable[[], dict[str, int]]:
        return lambda: {"value": value}

    first = Cells(tmp_path, "code")
    assert first.get({"a": 1}, give(1)) == {"value": 1}
    assert first.get({"a": 1}, give(2)) == {"value": 1}
    assert first.get({"a": 2}, give(3)) == {"value": 3}
    assert Cells(tmp_path, "changed").get({"a": 1}, give(4)) == {"value": 4}
    assert Cells(tmp_path, "code").get({"a": 1}, give(5)) == {"value": 1}
    assert first.measured == 2
    first.measuring = False
    with pytest.raises(NotMeasuredError):
        first.get({"a": 3}, give(6))


def test_the_code_is_all_that_figures_depend_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "motiongen", tmp_path / "copy", ignore=shutil.ignore_patterns("__pycache__"))
    before = code_version()
    monkeypatch.setattr(cells, "_SOURCE", tmp_path / "copy")
    assert code_version() == before
    for name, counts in (
        ("cli.py", False),
        ("render/video.py", False),
        ("features.py", True),
        ("metrics/costs.py", True),
    ):
        path = tmp_path / "copy" / name
        text = path.read_text(encoding="utf-8")
        path.write_text(text + "\n", encoding="utf-8")
        assert (code_version() != before) == counts
        path.write_text(text, encoding="utf-8")


def test_clips_are_known_by_what_they_hold() -> None:
    clip = mg.load(EXAMPLE_CLIP)[:20]
    assert content_of(clip.replace(name="another")) == content_of(clip)
    turned = clip.rotations.copy()
    turned[7, 3] *= -1  # the same pose, and still other numbers
    others = [clip[:19], clip.replace(rotations=turned), clip.replace(frame_rate=31.0)]
    assert len({content_of(other) for other in (clip, *others)}) == 4


def test_points_on_a_line_are_on_their_line() -> None:
    random = np.random.default_rng(0)
    across = random.uniform(0, 1e5, 12)
    line = fit_line(across, 3e-5 * across + 0.25)
    assert (line.slope, line.intercept, line.determination) == pytest.approx((3e-5, 0.25, 1.0))
    noisy = 3e-5 * across + random.normal(size=12)
    line = fit_line(across, noisy)
    residual = noisy - line.slope * across - line.intercept
    assert residual.sum() == pytest.approx(0, abs=1e-9)  # the normal equations
    assert residual @ across == pytest.approx(0, abs=1e-4)
    assert line.determination == pytest.approx(np.corrcoef(across, noisy)[0, 1] ** 2)


def test_a_process_tells_its_own_peak_of_memory() -> None:
    ballast = np.ones(2**27)  # 1 GiB
    clip = mg.load(EXAMPLE_CLIP)[:40]
    found = in_own_process("genmm", clip, 60, code_version())
    assert peak_memory() > ballast.nbytes
    assert 0 < found["peak_before_mib"] <= found["peak_mib"] < ballast.nbytes / 2**20
    with pytest.raises(MotionGenError, match="the code has changed since the measurement began"):
        in_own_process("genmm", clip, 60, "another code")


def test_the_real_examples_are_what_the_paper_asks_for(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    found = Examples(shared_data)
    for name in SETS:
        five = found.several(name, 5)
        clips = five.load()
        assert len(clips) == 5
        assert all(120 <= len(clip) <= 220 and clip.frame_rate == pytest.approx(30) for clip in clips)
        assert all(clip.skeleton.names == clips[0].skeleton.names for clip in clips)
        assert five.frames == sum(len(clip) for clip in clips)
        two = found.several(name, 2)
        assert [content_of(clip) for clip in two.load()] == [content_of(clip) for clip in clips[:2]]
        assert two.content != five.content
    assert [found.single(name).joints for name in CLIPS] == [65, 65, 65, 40]
    small = found.with_joints(CLIPS[0], 24)
    assert len(small.load()[0].skeleton) == small.joints == 24
    assert small.content not in {found.with_joints(CLIPS[0], 25).content, found.single(CLIPS[0]).content}
