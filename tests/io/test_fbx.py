"""FBX without Blender: what is missing is said in one line, and nothing is left behind. With it: tests/blender."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError


@pytest.fixture
def clip() -> mg.Motion:
    return mg.load(EXAMPLE_CLIP)[:10]


def fake(folder: Path, source: str) -> str:
    """A program that takes Blender's arguments."""
    path = folder / "blender"
    path.write_text(f"#!{sys.executable}\n{source}")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("named", "words"),
    [(None, "need Blender 4.2 or newer; install it"), ("/nowhere/blender", "MOTIONGEN_BLENDER=/nowhere/blender is no")],
)
def test_without_blender_one_line_says_what_to_do(
    clip: mg.Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str | None, words: str
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("MOTIONGEN_BLENDER", raising=False)
    if named:
        monkeypatch.setenv("MOTIONGEN_BLENDER", named)
    (tmp_path / "theirs.fbx").write_bytes(b"Kaydara")
    for ask in (lambda: clip.save(tmp_path / "new.fbx"), lambda: mg.load(tmp_path / "theirs.fbx")):
        with pytest.raises(MotionGenError, match=words) as error:
            ask()
        assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["theirs.fbx"]


def test_what_blender_cannot_do_is_passed_on(clip: mg.Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = "import sys\nprint('a warning', file=sys.stderr)\nsys.exit('no armature in it')"
    monkeypatch.setenv("MOTIONGEN_BLENDER", fake(tmp_path, source))
    with pytest.raises(MotionGenError, match=r"motion.glb: Blender cannot convert it \(no armature in it\)"):
        clip.save(tmp_path / "new.fbx")
    assert not (tmp_path / "new.fbx").exists()


def test_a_broken_rate_is_refused_before_blender_runs(clip: mg.Motion, tmp_path: Path) -> None:
    with pytest.raises(MotionGenError, match=r"whole frame rates, not 29\.5 Hz"):
        clip.replace(frame_rate=29.5).save(tmp_path / "new.fbx")
