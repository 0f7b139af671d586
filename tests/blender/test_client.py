"""The extension's end of the pipe and its arithmetic, which need no Blender, against the library."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from motiongen import rotations as rot
from motiongen.commands.protocol import PROTOCOL, decode_array, encode_array, encode_motion
from motiongen.motion import Motion
from tests.conftest import ROOT
from tests.strategies import motions, random_quaternions


def load(name: str) -> ModuleType:
    """A module of the extension by itself: its package belongs to Blender."""
    path = ROOT / "blender" / "motiongen_blender" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"extension_{name}", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


client, frames = load("client"), load("frames")


@pytest.fixture
def program(tmp_path: Path) -> Callable[[str], str]:
    """A program that does what it is told to in Python."""
    if sys.platform == "win32":
        pytest.skip("scripts do not start by themselves here")

    def write(source: str) -> str:
        path = tmp_path / "motiongen"
        path.write_text(f"#!{sys.executable}\nimport json, sys, time\n{source}\n")
        path.chmod(0o755)
        return str(path)

    return write


def messages_until(worker: Any, kind: str) -> list[dict[str, Any]]:
    said: list[dict[str, Any]] = []
    end = time.monotonic() + 30
    while not any(message["type"] == kind for message in said):
        assert time.monotonic() < end, said
        said += worker.poll(0.1)
    return said


def test_the_protocol_is_the_workers() -> None:
    assert client.PROTOCOL == PROTOCOL


def test_the_arithmetic_is_the_librarys() -> None:
    rng = np.random.default_rng(0)
    a, b, v = random_quaternions(rng, 9, 4), random_quaternions(rng, 9, 4), rng.normal(size=(9, 4, 3))
    np.testing.assert_allclose(frames.multiply(a, b), rot.multiply(a, b), atol=1e-14)
    np.testing.assert_allclose(frames.rotate(a, v), rot.rotate(a, v), atol=1e-14)
    np.testing.assert_array_equal(frames.inverse(a), rot.inverse(a))
    np.testing.assert_array_equal(frames.continuous(a), rot.continuous(a))
    np.testing.assert_array_equal(frames.decode(encode_array(v)), v)
    np.testing.assert_array_equal(decode_array("v", frames.encode(v)), v)


@given(motion=motions())
def test_world_and_back(motion: Motion) -> None:
    skeleton, told = motion.skeleton, encode_motion(motion)
    translations = frames.local_translations(told, skeleton.offsets)
    np.testing.assert_allclose(translations, motion.local_translations)
    turned, places = frames.to_world(list(skeleton.parents), motion.rotations, translations)
    np.testing.assert_allclose(places, motion.positions, atol=1e-9 * skeleton.height)
    back, moved = frames.to_local(list(skeleton.parents), turned, places)
    np.testing.assert_allclose(rot.angle_between(back, motion.rotations), 0, atol=1e-7)
    np.testing.assert_allclose(moved, translations, atol=1e-9 * np.abs(places).max(initial=1))


def test_a_command_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "__file__", str(tmp_path / "x" / "client.py"))
    monkeypatch.setattr(client.sys, "platform", "linux")
    monkeypatch.setattr(client.Path, "home", lambda: tmp_path / "home")
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    with pytest.raises(client.WorkerError, match="preferences"):
        client.find_command()
    for place in (".venv/bin", "home/.local/bin", "path"):  # each goes before the one above
        (tmp_path / place).mkdir(parents=True)
        path = tmp_path / place / "motiongen"
        path.touch(mode=0o755)
        assert client.find_command() == str(path)
    chosen = tmp_path / "chosen"
    with pytest.raises(client.WorkerError, match="no file"):
        client.find_command(str(chosen))
    chosen.touch()
    assert client.find_command(str(chosen)) == str(chosen)


def test_what_is_asked_is_answered(program: Callable[[str], str]) -> None:
    worker = client.Worker(
        program("for line in sys.stdin: print(json.dumps({**json.loads(line), 'seen': 1}), flush=True)")
    )
    try:
        assert worker.poll() == []
        name = worker.ask("sample", text="ä")
        assert messages_until(worker, "sample") == [{"id": name, "type": "sample", "text": "ä", "seen": 1}]
        assert worker.ask("sample") != name
    finally:
        worker.stop()
    assert not worker.alive


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("sys.exit('motiongen: no such command')", "no such command"),
        ("print('usage: something else'); sys.exit(3)", "usage: something else"),
        ("sys.exit(3)", "exit code 3"),
        ('print(\'{"type": "hello", "protocol": 99}\', flush=True); time.sleep(60)', "protocol 99"),
    ],
)
def test_a_worker_that_ends_says_why(source: str, words: str, program: Callable[[str], str]) -> None:
    worker = client.Worker(program(source))
    worker.ask("sample")
    said = messages_until(worker, client.ENDED)
    worker.stop()
    assert words in said[-1]["message"]


def test_what_is_no_program_is_said_to_be_none(tmp_path: Path) -> None:
    with pytest.raises(client.WorkerError, match="does not start"):
        client.Worker(str(tmp_path))


def test_stopping_does_not_wait_for_the_work(program: Callable[[str], str]) -> None:
    worker = client.Worker(program("time.sleep(600)"))
    worker.ask("sample", filling="x" * 10**6)  # more than a pipe takes
    worker.stop()
    assert not worker.alive
