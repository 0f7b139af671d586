"""`motiongen worker`: what goes in comes out, mistakes cost one line each, and work can be cancelled."""

from __future__ import annotations

import base64
import io
import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given
from omegaconf import OmegaConf

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.commands import worker
from motiongen.commands.protocol import (
    CONSTRAINT_SETTINGS,
    LIMITS,
    PROTOCOL,
    REQUESTS,
    decode_array,
    decode_motion,
    encode_array,
    encode_motion,
)
from motiongen.errors import MotionGenError
from motiongen.generators.base import Capabilities, Generator, Progress
from motiongen.generators.constraints import CONSTRAINTS, Constraint, FixedJoints, Keyframes, Loop, Segment
from motiongen.generators.options import Options
from motiongen.generators.registry import GeneratorSpec
from motiongen.motion import Motion
from tests.conftest import ROOT
from tests.strategies import motions

CLIP = mg.load(EXAMPLE_CLIP)[:160]


def answers(*requests: Any) -> list[dict[str, Any]]:
    """What the worker says to requests, given as lines or as what is in them; without its greeting."""
    lines = [each if isinstance(each, bytes) else json.dumps(each).encode() for each in requests]
    target = io.BytesIO()
    worker.serve(io.BytesIO(b"".join(line + b"\n" for line in lines)), target)
    said = [json.loads(line) for line in target.getvalue().splitlines()]
    assert said[0] == {"type": "hello", "id": None, "protocol": PROTOCOL, "version": mg.__version__, "limits": LIMITS}
    return said[1:]


def last(*requests: Any) -> dict[str, Any]:
    return answers(*requests)[-1]


def sample(**fields: Any) -> dict[str, Any]:
    return {"id": 1, "type": "sample", "examples": [encode_motion(CLIP)], "frames": 60, **fields}


def made(**fields: Any) -> list[Motion]:
    answer = last(sample(**fields))
    assert answer["type"] == "result", answer
    return [decode_motion("result", motion) for motion in answer["motions"]]


# -- arrays and motions


@given(motion=motions())
def test_a_motion_survives_the_way_to_the_last_bit(motion: Motion) -> None:
    back = decode_motion("motion", json.loads(json.dumps(encode_motion(motion))))
    assert back == motion.change_up("y")
    assert (back.name, back.notes) == (motion.name, motion.notes)


@pytest.mark.parametrize("shape", [(0, 3), (1,), (2, 3, 4)])
def test_an_array_may_come_in_half_the_bytes_or_as_lists(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    halved = {**encode_array(values), "dtype": "<f4"}
    halved["data"] = base64.b64encode(values.tobytes()).decode()
    np.testing.assert_array_equal(decode_array("x", halved), values)
    np.testing.assert_array_equal(decode_array("x", encode_array(values)), values)
    np.testing.assert_array_equal(decode_array("x", values.tolist()).reshape(shape), values)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"dtype": "<i4"}, "dtype of x must be one of"),
        ({"dtype": ["<f8"]}, "dtype of x must be one of"),
        ({"shape": [3, 3]}, "cannot have 16 bytes"),
        ({"shape": [-1, -2]}, "whole numbers"),
        ({"shape": [10**30]}, "cannot have 16 bytes"),
        ({"data": "%%%"}, "not base64"),
        ({"data": 3}, "text in base64"),
        ({"file": "x.npy"}, "no field 'file'"),
    ],
)
def test_arrays_that_are_none_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(MotionGenError, match=words):
        decode_array("x", {**encode_array([1.0, 2.0]), **change})


# -- requests of every kind


def test_a_sample_is_what_the_library_makes() -> None:
    fields: dict[str, Any] = {"count": 2, "seed": 5, "options": {"patch_size": 7}}
    twin = mg.create("genmm", patch_size=7).fit([CLIP]).sample(60, 2, 5)
    assert made(**fields) == twin


@pytest.mark.parametrize("kind", ["loop", "keyframes", "fixed_joints", "segment"])
def test_constraints_are_those_of_the_library(kind: str) -> None:
    settings, constraint = {
        "loop": ({"in_place": True}, Loop(in_place=True)),
        "keyframes": (
            {"clip": "held", "poses": [0, 30], "frames": [3, 40]},
            Keyframes({3: CLIP[0], 40: CLIP[30]}),
        ),
        "fixed_joints": ({"joints": ["*Leg*"]}, FixedJoints(CLIP, ("*Leg*",))),
        "segment": ({"start": 20, "stop": 70}, Segment(CLIP, 20, 70)),
    }[kind]
    frames = len(CLIP) if kind == "segment" else 60
    twin = mg.create("genmm").fit([CLIP]).sample(frames, constraints=[constraint])
    assert made(frames=frames, clips={"held": encode_motion(CLIP)}, constraints={kind: settings}) == twin


def test_generators_come_with_options_that_a_client_may_send_back() -> None:
    described = {each["name"]: each for each in last({"id": "g", "type": "generators"})["generators"]}
    assert described["genmm"]["needs_examples"]
    assert set(described["genmm"]["constraints"]) == set(CONSTRAINT_SETTINGS)
    assert not described["modi"]["needs_examples"]
    for each in described.values():
        options = {option["name"]: option["default"] for option in each["options"]}
        assert options
        worker.spec_of(each["name"]).options_type().build(options)


def test_settings_of_constraints_are_those_of_the_configuration() -> None:
    assert len(CONSTRAINT_SETTINGS) == len(CONSTRAINTS)
    for kind, settings in CONSTRAINT_SETTINGS.items():
        config = OmegaConf.load(ROOT / "configs" / "constraint" / f"{kind}.yaml")
        values = {key: ... if OmegaConf.is_missing(config, key) else config[key] for key in config}
        assert values == settings, kind


def test_progress_comes_before_the_result_and_carries_its_id() -> None:
    said = answers(sample(id="mine"))
    assert [each["id"] for each in said] == ["mine"] * len(said)
    assert [each["type"] for each in said] == ["progress"] * (len(said) - 1) + ["result"]
    assert len(said) > 1


def test_the_manual_tells_of_every_request_and_every_limit() -> None:
    manual = (ROOT / "docs" / "protocol.md").read_text(encoding="utf-8")
    for word in (*REQUESTS, *CONSTRAINT_SETTINGS, *LIMITS, *REQUESTS["sample"], *encode_motion(CLIP)):
        assert f"`{word}`" in manual, word


# -- mistakes


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (b"{", "one line of JSON"),
        (b"\xff\xfe", "one line of JSON"),
        (b"[1]", "a JSON object"),
        (b"[" * 100_000, "one line of JSON"),
        (b'{"id": 1, "type": "sample", "seed": NaN}', "NaN"),
        ({"type": "generators"}, "needs an 'id'"),
        ({"id": {}, "type": "generators"}, "needs an 'id'"),
        ({"id": 1}, "there is no request"),
        ({"id": 1, "type": "sampel"}, "did you mean 'sample'"),
        ({"id": 1, "type": "cancel"}, "needs the field 'target'"),
        ({"id": 1, "type": "generators", "x": 1}, "no field 'x'"),
        ({"id": 1, "type": "sample"}, "works from examples"),
        (sample(generator="gemm"), "did you mean 'genmm'"),
        (sample(generator=3), "generator must be a name"),
        (sample(options={"alpah": 1}), "did you mean 'alpha'"),
        (sample(generator="modi", options={"checkpoint": "/etc"}), "names a file"),
        (sample(examples="clip.bvh"), "motions in brackets"),
        (sample(examples=["clip.bvh"]), "example 0 must be a JSON object, not clip.bvh"),
        (sample(examples=[{**encode_motion(CLIP), "parents": None}]), "parents of example 0"),
        (sample(examples=[{**encode_motion(CLIP), "frame_rate": "30"}]), "frame_rate of example 0"),
        (sample(examples=[{**encode_motion(CLIP), "name": 3}]), "must be text"),
        (sample(examples=[{**encode_motion(CLIP), "names": ["a"] * 1001}]), "at most 1000"),
        (sample(frames=0), "frames must be"),
        (sample(count=101), "at most 100 motions"),
        (sample(frames=200_000, count=2), "at most 200000 in all"),
        (sample(seed="x"), "seed must be"),
        (sample(constraints={"lop": {}}), "did you mean 'loop'"),
        (sample(constraints={"loop": {"x": 1}}), "constraint loop has no field 'x'"),
        (sample(constraints={"segment": {"start": 1}}), "needs the field 'stop'"),
        (sample(constraints={"segment": {"clip": "a.bvh", "start": 1, "stop": 2}}), "there is no clip a.bvh"),
        (sample(constraints={"keyframes": {"frames": [70], "poses": [0]}}), "no frame 70"),
    ],
)
def test_a_mistake_costs_one_line_and_the_next_request_is_answered(request_: Any, words: str) -> None:
    said = answers(request_, {"id": "next", "type": "generators"})
    errors = [each for each in said if each["type"] == "error"]
    assert len(errors) == 1
    assert words in errors[0]["message"]
    assert "\n" not in errors[0]["message"]
    assert errors[0]["mistake"]
    assert said[-1]["id"] == "next" or said[-2]["id"] == "next"
    assert any(each["type"] == "result" and each["id"] == "next" for each in said)


def test_a_line_too_long_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, "line_bytes", 200)
    said = answers(sample(), {"id": 2, "type": "generators"})
    assert [(each["type"], each["id"]) for each in said] == [("error", None), ("result", 2)]
    assert "more than 200 bytes" in said[0]["message"]


# -- cancelling, and what fails, on a generator that waits to be told


class Slow(Generator):
    """Works until it is let go."""

    capabilities: ClassVar[Capabilities] = Capabilities()
    began: ClassVar[threading.Event]
    released: ClassVar[threading.Event]

    @property
    def frame_rate(self) -> float:
        return 30.0

    def _fit(self, motions: tuple[Motion, ...]) -> None:
        print("this is printed, and no answer")

    def _sample(
        self, frames: int, count: int, seed: int, constraints: tuple[Constraint, ...], progress: Progress
    ) -> list[Motion]:
        if seed == 666:
            raise KeyError("a bug\nof two lines")
        self.began.set()
        while not self.released.wait(0.01):
            progress(0.5)
        return [self.examples[0][:frames]] * count


class Conversation:
    """A worker in threads, and both ends of its pipes."""

    def __init__(self) -> None:
        read, write = os.pipe()
        self.requests = os.fdopen(write, "wb", buffering=0)
        self.said: queue.Queue[dict[str, Any]] = queue.Queue()
        self._source = os.fdopen(read, "rb")
        self._thread = threading.Thread(target=worker.serve, args=(self._source, self), daemon=True)
        self._thread.start()

    def write(self, line: bytes) -> None:
        self.said.put(json.loads(line))

    def flush(self) -> None: ...

    def ask(self, *requests: Mapping[str, Any]) -> None:
        self.requests.write(b"".join(json.dumps(each).encode() + b"\n" for each in requests))

    def until(self, kinds: Sequence[str], name: Any) -> dict[str, Any]:
        while (message := self.said.get(timeout=30))["type"] not in kinds or message["id"] != name:
            pass
        return message

    def end(self) -> None:
        self.requests.close()
        self._thread.join(timeout=30)
        assert not self._thread.is_alive()
        self._source.close()


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[Conversation]:
    Slow.began, Slow.released = threading.Event(), threading.Event()
    spec = GeneratorSpec("slow", "slow", "motiongen.generators.options:Options", "")
    monkeypatch.setattr(GeneratorSpec, "generator_type", lambda self: Slow)
    monkeypatch.setattr(GeneratorSpec, "options_type", lambda self: Options)
    monkeypatch.setattr(worker, "spec_of", lambda name: spec)
    conversation = Conversation()
    yield conversation
    Slow.released.set()
    conversation.end()


def test_what_runs_and_what_waits_can_be_cancelled(slow: Conversation) -> None:
    slow.ask(sample(id=1), sample(id=2), sample(id=3))
    assert Slow.began.wait(30)
    slow.ask({"id": 4, "type": "cancel", "target": 2}, {"id": 5, "type": "cancel", "target": 1})
    assert slow.until(["result"], 4)["found"]
    assert slow.until(["cancelled", "result"], 1)["type"] == "cancelled"
    assert slow.until(["cancelled", "result"], 2)["type"] == "cancelled"
    Slow.released.set()
    assert slow.until(["cancelled", "result"], 3)["type"] == "result"
    slow.ask({"id": 6, "type": "cancel", "target": 1}, sample(id=1))
    assert not slow.until(["result"], 6)["found"]
    assert slow.until(["result"], 1)["motions"], "an id that was answered is free again"


def test_an_id_in_use_and_too_many_requests_are_refused(slow: Conversation) -> None:
    slow.ask(*(sample(id=number) for number in range(LIMITS["waiting"] + 1)), sample(id=0))
    assert "wait already" in slow.until(["error"], LIMITS["waiting"])["message"]
    assert "in use" in slow.until(["error"], 0)["message"]


def test_a_bug_is_said_to_be_one_and_ends_nothing(slow: Conversation, capsys: pytest.CaptureFixture[str]) -> None:
    slow.ask(sample(id=1, seed=666), sample(id=2))
    failed = slow.until(["error"], 1)
    assert not failed["mistake"]
    assert "KeyError" in failed["message"]
    assert "\n" not in failed["message"]
    Slow.released.set()
    assert slow.until(["result"], 2)["motions"]
    assert "Traceback" in capsys.readouterr().err


def test_the_program_speaks_nothing_but_json() -> None:
    program = "import sys; from motiongen.commands.worker import run; run(sys.argv[1:])"
    requests = [{"id": 1, "type": "generators"}, sample(id=2, frames=40)]
    text = "".join(json.dumps(each) + "\n" for each in requests)
    ended = subprocess.run(
        [sys.executable, "-c", program], input=text, check=False, capture_output=True, text=True, cwd=ROOT, timeout=120
    )
    assert ended.returncode == 0, ended.stderr
    said = [json.loads(line) for line in ended.stdout.splitlines()]
    assert [each["id"] for each in said if each["type"] == "result"] == [1, 2]
