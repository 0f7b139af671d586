"""The command line as a person meets it: help, lists, mistakes. Whole runs are in `test_sample.py`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.cli import COMMANDS, main


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in ([], ["--help"], ["help"]):
        code, out, _ = run(capsys, *arguments)
        assert code == 0
        assert all(f"  {name} " in out for name in COMMANDS)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "--version")[1] == f"motiongen {mg.__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["list"], ["sample", "frmes=3"], ["info", "no-such-file.bvh"], ["info", str(EXAMPLE_CLIP)]],
)
def test_what_should_answer_at_once_imports_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys; from motiongen.cli import main; main(sys.argv[1:]);"
        "heavy = {'torch', 'scipy', 'matplotlib', 'PIL', 'tensorboard', 'rich'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["smaple"], ["no command 'smaple'", "did you mean 'sample'", "info"]),
        (["info"], ["required: clip", "motiongen info --help"]),
        (["info", "nothing.bvh"], ["nothing.bvh", "no such file"]),
        (["info", "clip.xyz"], [".xyz", ".bvh", ".npz"]),
        (["info", str(EXAMPLE_CLIP), "--up", "x"], ["--up", "'x'", "y", "z"]),
        (["convert", str(EXAMPLE_CLIP), "out.abc"], [".abc", ".bvh"]),
        (["convert", str(EXAMPLE_CLIP), "out.bvh", "--rate", "-3"], ["frame_rate must be a positive number", "-3"]),
        (["convert", str(EXAMPLE_CLIP), "out.bvh", "--to-unit", "m"], ["unit", "not known"]),
        (["render", str(EXAMPLE_CLIP), "out.mov"], [".mov", ".mp4", ".gif", ".png"]),
        (["render", str(EXAMPLE_CLIP), "out.gif", "--size", "big"], ["--size", "WIDTHxHEIGHT", "big"]),
        (["sample", "frmes=10"], ["unknown setting 'frmes'", "did you mean 'frames'"]),
        (["sample", "alpha=1"], ["unknown setting 'alpha'", "did you mean 'generator.alpha'"]),
        (["sample", "generator.alhpa=1"], ["unknown setting 'generator.alhpa'", "generator.alpha"]),
        (["sample", "generator=gemm"], ["no generator 'gemm'", "did you mean 'genmm'"]),
        (["sample", "generator.alpha=-1"], ["alpha must be at least 0, not -1"]),
        (["sample", "generator.patch_size=many"], ["patch_size must be of type int, not 'many'"]),
        (["sample", "frames=0"], ["frames must be a whole number of at least 1, not 0"]),
        (["sample", "frames=[1,2"], ["cannot read the setting 'frames=[1,2'"]),
        (["sample", "count=2.5"], ["count must be a whole number"]),
        (["sample", "seed=-1"], ["seed must be a whole number of at least 0, not -1"]),
        (["sample", "format=abc"], ["format must be one of bvh", "'abc'"]),
        (["sample", "preview=avi"], ["preview must be one of auto, mp4, gif, none", "'avi'"]),
        (["sample", "up=x"], ["up must be one of null, y, z", "'x'"]),
        (["sample", "input=nothing.bvh"], ["nothing.bvh", "no such file"]),
        (["sample", "input=[]"], ["names no clip"]),
        (["sample", "--frames", "3"], ["key=value", "no flag '--frames'"]),
    ],
)
def test_a_mistake_costs_one_line_and_leaves_nothing(
    arguments: list[str],
    words: list[str],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("motiongen: ")
    assert all(word in err for word in words), err
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_is_no_traceback(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("motiongen.commands.list.run", interrupted)
    assert run(capsys, "list") == (130, "", "motiongen: stopped\n")


def test_a_reader_that_leaves_early_is_no_error() -> None:
    done = subprocess.run(
        f"{sys.executable} -m motiongen.cli info {EXAMPLE_CLIP} --json | head -c 1",
        shell=True, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("{", "")


def test_info_draws_the_levels_of_a_skeleton(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "info", EXAMPLE_CLIP, "--levels")
    assert code == 0
    assert [line.split(":")[0] for line in out.splitlines() if line.startswith("level")] == [
        f"level {i}" for i in range(5)
    ]
    names = mg.load(EXAMPLE_CLIP).skeleton.names
    assert all(name in out for name in names)  # the finest level names every joint


def test_info_says_what_the_clip_is(capsys: pytest.CaptureFixture[str]) -> None:
    clip = mg.load(EXAMPLE_CLIP)
    code, out, _ = run(capsys, "info", EXAMPLE_CLIP)
    assert code == 0
    for word in (f"{len(clip)} at 30 Hz", "31", "Hips", "foot skate", "Foot", "jitter"):
        assert word in out
    facts = json.loads(run(capsys, "info", EXAMPLE_CLIP, "--json")[1])
    assert facts["frames"] == len(clip)
    assert facts["joint_names"] == list(clip.skeleton.names)
    assert facts["height"] == clip.skeleton.height
    assert facts["quality"]["foot_skate_heights_per_second"] > 0


def test_convert_does_what_it_is_asked(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    clip = mg.load(EXAMPLE_CLIP)
    out = tmp_path / "out.npz"
    assert (
        run(capsys, "convert", EXAMPLE_CLIP, out, "--rate", 15, "--unit", "in", "--to-unit", "cm", "--to-up", "z")[0]
        == 0
    )
    converted = mg.load(out)
    assert (converted.frame_rate, converted.unit, converted.up) == (15.0, "cm", "z")
    assert converted.skeleton.height == pytest.approx(2.54 * clip.skeleton.height)
    assert len(converted) == (len(clip) + 1) // 2
    mirrored = tmp_path / "mirrored.bvh"
    assert run(capsys, "convert", EXAMPLE_CLIP, mirrored, "--mirror")[0] == 0
    there = mg.load(mirrored).positions[:, clip.skeleton.index("LeftFoot")]
    here = clip.positions[:, clip.skeleton.index("RightFoot")]
    assert abs(there[:, 0] + here[:, 0]).max() < 0.02 * clip.skeleton.height


def test_render_draws_a_film_strip(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "strip.png"
    assert run(capsys, "render", EXAMPLE_CLIP, out)[0] == 0
    assert out.read_bytes().startswith(b"\x89PNG")


def test_completion_knows_commands_and_settings(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def complete(line: str) -> list[str]:
        monkeypatch.setenv("COMP_LINE", line)
        monkeypatch.setenv("COMP_POINT", str(len(line)))
        assert main(["-sc", "query=bash"]) == 0
        return capsys.readouterr().out.split()

    assert complete("motiongen ") == list(COMMANDS)
    assert complete("motiongen sa") == ["sample"]
    assert "frames=" in complete("motiongen sample ")
    assert complete("motiongen sample generator=") == ["generator=genmm", "generator=modi"]
    assert "generator.alpha=" in complete("motiongen sample generator.a")
    for name, command in COMMANDS.items():
        assert ("generator." in complete(f"motiongen {name} ")) == command.settings


def test_converting_says_what_is_not_expected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = mg.load(EXAMPLE_CLIP)[:10]
    named, nameless, out = tmp_path / "m.glb", tmp_path / "none.bvh", tmp_path / "out.glb"
    clip.replace(unit="m").save(named)
    clip.replace(unit=None).save(nameless)
    assert main(["convert", str(nameless), str(out)]) == 0
    assert "note: the unit is not known" in capsys.readouterr().out
    assert main(["convert", str(named), str(out), "--root-motion", "split"]) == 0
    assert "note: meshes and materials were not kept" in capsys.readouterr().out
    assert main(["convert", str(named), str(out), "--root-motion", "in-place"]) == 0
    assert "note" not in capsys.readouterr().out
