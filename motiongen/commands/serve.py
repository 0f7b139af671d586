"""`motiongen serve`: the page in the browser."""

from __future__ import annotations

import signal
import threading
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from motiongen.commands.arguments import Parser
from motiongen.errors import MotionGenError
from motiongen.web.limits import MEBIBYTE, Limits

EVERY_INTERFACE = ("0.0.0.0", "::")


def run(arguments: Sequence[str]) -> None:
    """Serve the page until somebody stops it."""
    least = Limits()
    parser = Parser(
        prog="motiongen serve", description="Make motions in the browser: prints the address to open; Ctrl-C ends it."
    )
    parser.add_argument("--host", default="127.0.0.1", help="where to listen (default: %(default)s, this machine only)")
    parser.add_argument("--port", type=int, default=8080, help="0 for any that is free (default: %(default)s)")
    parser.add_argument("--token", help="what visitors must know (default: made where other machines can come in)")
    parser.add_argument("--open", action="store_true", help="open the page in this machine's browser")
    for name, value, help in (
        ("upload-mb", least.upload_bytes / MEBIBYTE, "size of a file that is sent, in MiB"),
        ("frames", least.frames, "frames of a clip, and of all that one request makes"),
        ("joints", least.joints, "joints of a clip"),
        ("seconds", least.seconds, "running time of one request"),
        ("visitors", least.visitors, "visitors at the same time"),
    ):
        parser.add_argument(f"--max-{name}", type=type(value), default=value, help=f"{help} (default: {value:g})")
    options = parser.parse_args(arguments)
    limits = Limits(
        upload_bytes=_bytes(options.max_upload_mb),
        frames=options.max_frames,
        joints=options.max_joints,
        seconds=options.max_seconds,
        visitors=options.max_visitors,
    )
    try:
        from motiongen.web.server import Server
    except ModuleNotFoundError as error:
        if error.name and error.name.startswith("motiongen"):
            raise
        raise MotionGenError(f"the page needs {error.name}: pip install 'motiongen[web]'") from error
    with Server(options.host, options.port, options.token, limits) as server, _stop_signals() as stop:
        everywhere = options.host in EVERY_INTERFACE
        elsewhere = " (from other machines, with this one's name in it)" if everywhere else ""
        print(f"open {server.address} in a browser{elsewhere}; Ctrl-C ends it", flush=True)
        if options.open:
            webbrowser.open(server.address)
        while not stop.wait(1.0):  # without a time, Windows would not hear Ctrl-C
            pass


def _bytes(mebibytes: float) -> int:
    if not 0 < mebibytes <= 1024:  # they are kept in memory
        raise MotionGenError(f"--max-upload-mb is {mebibytes:g}; it must be above 0 and at most 1024")
    return max(1, round(mebibytes * MEBIBYTE))


@contextmanager
def _stop_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C, or being asked to end, sets; a second one while we end is heard as usual."""
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
