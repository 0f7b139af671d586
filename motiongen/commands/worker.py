"""`motiongen worker`: motions on request, one JSON object a line in and out, for programs such as Blender.

`docs/protocol.md` is the manual. A thread reads, so that a request can be cancelled while it is worked on; the work is
done one request at a time. What anything else prints goes to standard error.
"""

from __future__ import annotations

import dataclasses
import json
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from typing import Any, BinaryIO

from motiongen import __version__
from motiongen.commands.arguments import Parser
from motiongen.commands.constraint_settings import read_constraints
from motiongen.commands.protocol import (
    LIMITS,
    PROTOCOL,
    REQUESTS,
    SentMotions,
    constraint_settings,
    decode_motion,
    encode_motion,
    filled,
    parse_line,
    size_of_result,
)
from motiongen.commands.settings import whole
from motiongen.errors import CancelledError, MotionGenError, nearest_of
from motiongen.generators.base import Progress
from motiongen.generators.options import check_offered, offered
from motiongen.generators.registry import GeneratorSpec, spec_of, specs

PROGRESS_SECONDS = 0.1
"""Progress is told no more often than this."""


def run(arguments: Sequence[str]) -> None:
    """Serve standard input until it ends."""
    Parser(
        prog="motiongen worker",
        description="Make motions on request: one JSON object a line, in and out; see docs/protocol.md.",
    ).parse_args(arguments)
    source, target = sys.stdin.buffer, sys.stdout.buffer
    with redirect_stdout(sys.stderr):
        serve(source, target)


def serve(source: BinaryIO, target: BinaryIO) -> None:
    """Answer the requests of `source` on `target` until the source ends; what was asked for by then is still made."""
    Worker(target).serve(source)


@dataclasses.dataclass
class Job:
    """A request that waits or is worked on."""

    id: str | int
    request: dict[str, Any]
    cancelled: threading.Event = dataclasses.field(default_factory=threading.Event)


class Worker:
    """Reads requests in a thread of its own and works on them one after the other."""

    def __init__(self, target: BinaryIO) -> None:
        """Answer on `target`."""
        self._target = target
        self._writing = threading.Lock()
        self._jobs: queue.Queue[Job | None] = queue.Queue()
        self._open: dict[str | int, Job] = {}

    def serve(self, source: BinaryIO) -> None:
        """Answer until the source ends."""
        self._tell("hello", None, protocol=PROTOCOL, version=__version__, limits=LIMITS)
        threading.Thread(target=self._read, args=(source,), daemon=True).start()
        while (job := self._jobs.get()) is not None:
            self._work(job)

    # -- the reading thread

    def _read(self, source: BinaryIO) -> None:
        try:
            while line := source.readline(LIMITS["line_bytes"] + 1):
                if len(line) > LIMITS["line_bytes"]:
                    while line and not line.endswith(b"\n"):
                        line = source.readline(2**20)
                    self._fail(None, f"a request of more than {LIMITS['line_bytes']} bytes came; send fewer frames")
                elif line.strip():
                    self._take(line)
        except OSError:
            pass  # nobody reads our answers any more: the end
        finally:
            self._jobs.put(None)

    def _take(self, line: bytes) -> None:
        """Queue the request of a line, or cancel another one."""
        name = None
        try:
            request = parse_line(line)
            name = _id_of(request)
            kind = request.pop("type", None)
            if not isinstance(kind, str) or kind not in REQUESTS:
                near = nearest_of(str(kind), REQUESTS) or ";"
                raise MotionGenError(f"there is no request {str(kind)[:60]!r}{near} there are {', '.join(REQUESTS)}")
            request = {**filled(f"request {kind}", request, REQUESTS[kind]), "type": kind}
            if kind == "cancel":
                self._cancel(name, request["target"])
            elif name in self._open:
                raise MotionGenError(f"the id {name!r} is in use; give every request its own")
            elif len(self._open) >= LIMITS["waiting"]:
                raise MotionGenError(f"{LIMITS['waiting']} requests wait already; send more when they are answered")
            else:
                self._open[name] = Job(name, request)
                self._jobs.put(self._open[name])
        except MotionGenError as error:
            self._fail(name, str(error))

    def _cancel(self, name: str | int, target: Any) -> None:
        job = self._open.get(target) if isinstance(target, (str, int)) else None
        if job is not None:
            job.cancelled.set()
        self._tell("result", name, found=job is not None)

    # -- the working thread

    def _work(self, job: Job) -> None:
        try:
            _stop_if(job)
            made = _ACTIONS[job.request["type"]](job.request, self._progress(job))
            self._open.pop(job.id)
            self._tell("result", job.id, **made)
        except CancelledError:
            self._open.pop(job.id)
            self._tell("cancelled", job.id)
        except MotionGenError as error:
            self._open.pop(job.id)
            self._fail(job.id, str(error))
        except OSError:
            raise  # nobody reads our answers any more
        except Exception as error:  # one request must not take the others down
            traceback.print_exc(file=sys.stderr)
            self._open.pop(job.id)
            self._fail(job.id, f"motiongen failed: {type(error).__name__}: {error}", mistake=False)

    def _progress(self, job: Job) -> Progress:
        told = -PROGRESS_SECONDS

        def advance(share: float) -> None:
            nonlocal told
            _stop_if(job)
            now = time.monotonic()
            if now - told >= PROGRESS_SECONDS:
                told = now
                self._tell("progress", job.id, share=min(max(float(share), 0.0), 1.0))

        return advance

    # -- answers

    def _fail(self, name: str | int | None, message: str, mistake: bool = True) -> None:
        self._tell("error", name, message=" ".join(message.split()), mistake=mistake)

    def _tell(self, kind: str, name: str | int | None, **fields: Any) -> None:
        line = json.dumps({"type": kind, "id": name, **fields}, allow_nan=False, separators=(",", ":"))
        with self._writing:
            self._target.write(line.encode("ascii") + b"\n")
            self._target.flush()


def _id_of(request: dict[str, Any]) -> str | int:
    name = request.pop("id", None)
    if isinstance(name, bool) or not isinstance(name, (str, int)) or len(str(name)) > 100:
        raise MotionGenError("a request needs an 'id', a number or a short text, by which its answers are known")
    return name


def _stop_if(job: Job) -> None:
    if job.cancelled.is_set():
        raise CancelledError


# -- what can be asked for


def _generators(request: dict[str, Any], progress: Progress) -> dict[str, Any]:
    return {"generators": [_described(spec) for spec in specs().values()]}


def _described(spec: GeneratorSpec) -> dict[str, Any]:
    """What a client needs to know to offer a generator; one that cannot be loaded says why."""
    described: dict[str, Any] = {"name": spec.name, "description": spec.description, "error": spec.error}
    try:
        kind = spec.options_type()
        capabilities = spec.capabilities
    except MotionGenError as error:
        return {**described, "error": str(error)}
    return {
        **described,
        "needs_examples": not capabilities.needs_training,
        "constraints": sorted(_setting_name(each.__name__) for each in capabilities.constraints),
        "options": [dataclasses.asdict(option) for option in offered(kind)],
    }


def _setting_name(name: str) -> str:
    """FixedJoints -> fixed_joints."""
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")


def _sample(request: dict[str, Any], progress: Progress) -> dict[str, Any]:
    begun = time.perf_counter()
    name, options = request["generator"], request["options"]
    if not isinstance(name, str) or not isinstance(options, dict):
        raise MotionGenError("generator must be a name, and options an object in braces")
    spec = spec_of(name)
    check_offered(spec.options_type(), options)
    built = spec.options_type().build(options)
    settings = constraint_settings(request["constraints"])
    examples, clips = _motions(request)
    if not examples and not spec.capabilities.needs_training:
        raise MotionGenError(f"{name} works from examples, and none came; send at least one")
    if request["frames"] is not None:
        size_of_result(request["frames"], request["count"])
    seed = whole("seed", request["seed"], 0)
    progress(0.0)
    generator = spec.create(built)
    if examples:
        generator.fit(examples)
    progress(0.0)
    constraints = read_constraints(settings, SentMotions(examples, generator.frame_rate, clips=clips))
    asked = generator.usual_frames if request["frames"] is None else request["frames"]
    frames, count = size_of_result(asked, request["count"])
    motions = generator.sample(frames, count, seed, constraints, progress)
    return {
        "motions": [encode_motion(motion) for motion in motions],
        "credit": generator.credit,
        "seconds": time.perf_counter() - begun,
    }


def _motions(request: dict[str, Any]) -> tuple[list[Any], dict[str, Any]]:
    """The examples and the named clips of a request."""
    examples, clips = request["examples"], request["clips"]
    if not isinstance(examples, list) or not isinstance(clips, dict):
        raise MotionGenError("examples must be motions in brackets, and clips an object of motions by name")
    if len(examples) + len(clips) > LIMITS["motions"]:
        raise MotionGenError(f"{len(examples) + len(clips)} motions came; at most {LIMITS['motions']} are taken")
    return (
        [decode_motion(f"example {index}", motion) for index, motion in enumerate(examples)],
        {name: decode_motion(f"clip '{name[:60]}'", motion) for name, motion in clips.items()},
    )


_ACTIONS: dict[str, Callable[[dict[str, Any], Progress], dict[str, Any]]] = {
    "generators": _generators,
    "sample": _sample,
}
