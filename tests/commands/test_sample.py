"""`motiongen sample` from end to end, on a small clip."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP, config_folder
from motiongen.cli import main
from tests.strategies import random_motion, random_skeleton


@pytest.fixture
def clips(tmp_path: Path) -> list[Path]:
    """Two clips of one skeleton."""
    rng = np.random.default_rng(0)
    skeleton = random_skeleton(rng, 6, depth_first=True)
    paths = []
    for name, frames in (("a b", 60), ("c", 80)):
        clip = random_motion(rng, skeleton, frames=frames, translating=(0,), smooth=True)
        paths.append(tmp_path / "clips" / f"{name}.bvh")
        paths[-1].parent.mkdir(exist_ok=True)
        clip.save(paths[-1])
    return paths


def test_the_bundled_clip_with_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process of its own, as a person would: motions, preview, film strip, report, configuration."""
    command = [sys.executable, "-m", "motiongen.cli", "sample"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")  # not a terminal: no progress bar
    folder = tmp_path / "motiongen-out"
    names = {path.name for path in folder.iterdir()}
    assert {f"sample_{i:04d}.bvh" for i in range(4)} <= names
    assert {"report.json", "report.md", "config.yaml", "film_strip.png"} <= names
    assert names & {"preview.mp4", "preview.gif"}
    assert all(name in done.stdout for name in names)
    example, sample = mg.load(EXAMPLE_CLIP), mg.load(folder / "sample_0000.bvh")
    assert len(sample) == 2 * len(example)
    assert sample.skeleton == example.skeleton
    report = json.loads((folder / "report.json").read_text())
    assert report["metrics"]["coverage"] > 0.99
    assert report["run"]["seed"] == 0
    assert report["run"]["versions"]["motiongen"] == mg.__version__
    assert len(report["syntheses"]) == 4
    assert report["examples"]["cmu_01_01"]["foot_skate_heights_per_second"] > 0
    assert {path.name for path in tmp_path.iterdir()} == {"motiongen-out"}


def sample(*arguments: object) -> int:
    return main(["sample", "preview=none", *(str(argument) for argument in arguments)])


def test_frames_count_seed_and_output(clips: list[Path], tmp_path: Path) -> None:
    arguments = [f"input={clips[1]}", "frames=42", "count=3"]
    assert sample(*arguments, "seed=0", f"output={tmp_path / 'a'}") == 0
    assert sample(*arguments, "seed=0", f"output={tmp_path / 'b'}") == 0
    assert sample(*arguments, "seed=1", f"output={tmp_path / 'c'}") == 0
    texts = {run: [(tmp_path / run / f"sample_{i:04d}.bvh").read_bytes() for i in range(3)] for run in "abc"}
    assert texts["a"] == texts["b"]
    assert texts["a"] != texts["c"]
    assert len(set(texts["a"])) == 3
    assert all(len(mg.load(tmp_path / "a" / f"sample_{i:04d}.bvh")) == 42 for i in range(3))


def test_lists_folders_and_odd_names_of_inputs(clips: list[Path], tmp_path: Path) -> None:
    listed, folder = f"input=['{clips[0]}',{clips[1]}]", f"input={clips[0].parent}"
    for number, given in enumerate((listed, folder)):
        assert sample(given, "count=1", f"output={tmp_path / str(number)}") == 0
    assert (tmp_path / "0" / "sample_0000.bvh").read_bytes() == (tmp_path / "1" / "sample_0000.bvh").read_bytes()
    assert len(mg.load(tmp_path / "0" / "sample_0000.bvh")) == 2 * (60 + 80)
    assert sample(f"input={clips[0]}", "count=1", f"output={tmp_path / 'with space (1)'}") == 0
    assert (tmp_path / "with space (1)" / "sample_0000.bvh").exists()


def test_the_saved_configuration_repeats_the_run(clips: list[Path], tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert sample(f"input={clips[1]}", "frames=30", "generator.alpha=0.2", "seed=9", f"output={first}") == 0
    config = OmegaConf.load(first / "config.yaml")
    assert (config.generator.alpha, config.seed) == (0.2, 9)
    settings = {key: value for key, value in config.items() if key not in ("generator", "output", "preview")}
    options = {f"generator.{key}": value for key, value in config.generator.items() if key != "name"}
    again = [f"{key}={'null' if value is None else value}" for key, value in (settings | options).items()]
    assert sample(*again, f"generator={config.generator.name}", f"output={second}") == 0
    assert (first / "sample_0000.bvh").read_bytes() == (second / "sample_0000.bvh").read_bytes()


def test_results_can_be_npz_and_a_preview_a_gif(clips: list[Path], tmp_path: Path) -> None:
    arguments = [f"input={clips[1]}", "frames=20", "count=2", "format=npz", "preview=gif", f"output={tmp_path / 'o'}"]
    assert main(["sample", *map(str, arguments)]) == 0
    assert len(mg.load(tmp_path / "o" / "sample_0001.npz")) == 20
    assert (tmp_path / "o" / "preview.gif").read_bytes().startswith(b"GIF89a")


def test_an_earlier_runs_motions_are_named_not_removed(
    clips: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [f"input={clips[1]}", "frames=20", f"output={tmp_path / 'o'}"]
    assert sample(*arguments, "count=3") == 0
    assert sample(*arguments, "count=1") == 0
    assert "from an earlier run, left as they were: sample_0001.bvh, sample_0002.bvh" in capsys.readouterr().out


CONFIGURATIONS = {
    "sample": ("generator", "constraint"),
    "stream": ("generator",),
    "latent": ("generator", "task"),
    "invert": ("generator",),
    "edit": ("generator",),
    "evaluate": ("generator",),
    "encoder": (),
    "recogniser": (),
    "train": ("generator", "network", "trainer", "experiment"),
}
"""The groups of choices that each has."""


def test_every_configuration_and_every_group_is_known() -> None:
    assert {path.stem for path in config_folder().glob("*.yaml")} == set(CONFIGURATIONS)
    groups = {path.name for path in config_folder().iterdir() if path.is_dir() and path.name != "hydra"}
    assert groups == {group for groups in CONFIGURATIONS.values() for group in groups}


@pytest.mark.parametrize(
    ("name", "group"), [(name, group) for name, groups in CONFIGURATIONS.items() for group in groups]
)
def test_every_configuration_composes_with_every_choice(name: str, group: str) -> None:
    import hydra

    choices = [path.stem for path in (config_folder() / group).glob("*.yaml")]
    assert choices
    with hydra.initialize_config_dir(str(config_folder().resolve()), version_base="1.3"):
        plain = hydra.compose(name)
        for choice in choices:
            config = hydra.compose(name, overrides=[f"{group}={choice}"])
            if group == "constraint":  # these fill `constraints`
                assert list(config.constraints) == [choice]
            elif group == "generator":
                assert config.generator.name == choice
            elif group == "experiment":  # these change `network`
                assert config.network.keys() == plain.network.keys()
                assert config.network != plain.network
            elif group == "task":  # these lie at the top
                assert config.task == choice
            else:
                assert config[group].keys() == plain[group].keys()


def test_help_and_job_show_the_settings(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--help", "--cfg=job"):
        assert main(["sample", flag]) == 0
        out = capsys.readouterr().out
        assert "patch_size: 11" in out
        assert "frames: null" in out


def test_parts_of_two_characters_make_one(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for name, joints in (("body", 6), ("tail", 4)):
        motion = random_motion(rng, random_skeleton(rng, joints), frames=60, translating=(0,), smooth=True, name=name)
        motion.save(tmp_path / f"{name}.bvh")
    body, tail = (mg.load(tmp_path / f"{name}.bvh", up="y") for name in ("body", "tail"))
    top = tail.skeleton.names[tail.skeleton.children[0][0]]
    part = f"{{clips: {tmp_path}/tail.bvh, joints: {top}, attach: {body.skeleton.names[2]}, prefix: tail_}}"
    settings = ["up=y", "frames=70", "count=1", f"output={tmp_path / 'o'}"]
    assert sample(f"input=[{tmp_path}/body.bvh,{part}]", *settings) == 0
    made = mg.load(tmp_path / "o" / "sample_0000.bvh", up="y")
    assert set(made.skeleton.names) >= {*body.skeleton.names, f"tail_{top}"}
    assert "none of them knows the whole character" in (tmp_path / "o" / "report.md").read_text()


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("{clips: a.bvh, joint: Head}", ["no setting 'joint'", "did you mean 'joints'"]),
        ("{joints: Head}", ["needs clips"]),
    ],
)
def test_a_part_that_says_the_wrong_thing_is_refused(
    clips: list[Path], part: str, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert sample(f"input=[{clips[1]},{part}]") == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words)


def test_a_glb_character_comes_back_as_one(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.glb"
    mg.load(EXAMPLE_CLIP)[100:160].save(theirs)
    common = [f"input={theirs}", "frames=20", "count=1", "preview=none"]
    assert main(["sample", *common, f"output={tmp_path / 'as_it_came'}"]) == 0
    made = mg.load(tmp_path / "as_it_came" / "sample_0000.glb")
    assert len(made) == 20
    assert "of 2 animations" in made.notes[0], "the file's own is there still"
    assert main(["sample", *common, "format=bvh", f"output={tmp_path / 'as_asked'}"]) == 0
    assert (tmp_path / "as_asked" / "sample_0000.bvh").is_file()
