"""`motiongen serve` as a person meets it: one line with the address, one for a mistake, and an end without a trace."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from motiongen.commands.serve import run
from motiongen.errors import MotionGenError
from tests.conftest import ROOT

SERVE = [sys.executable, "-c", "import sys; from motiongen.cli import run_command; run_command('serve', sys.argv[1:])"]


@contextmanager
def serving(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server that runs, and the line that it printed."""
    pytest.importorskip("viser", reason="the page needs the extra 'web'")
    command = [*SERVE, "--port", "0", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            yield process, process.stdout.readline()
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_the_address_and_ends_when_it_is_asked_to(number: signal.Signals) -> None:
    with serving() as (process, line):
        address = re.fullmatch(r"open (http://127\.0\.0\.1:\d+/) in a browser; Ctrl-C ends it\n", line)[1]
        from tests.web import wire  # which needs viser

        server = SimpleNamespace(address=address)
        assert wire.get(server)[0] == 200
        with wire.visitor(server) as connection:
            process.send_signal(number)
            assert wire.hear_the_end(connection) == 1001
        assert process.wait(timeout=10) == 0
        assert (process.stdout.read(), process.stderr.read()) == ("", "")


def test_other_machines_need_the_token_of_the_address() -> None:
    with serving("--host", "0.0.0.0", "--max-visitors", "1") as (_, line):
        address = re.search(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}(?= )", line)[0]
        from tests.web import wire  # which needs viser

        server = SimpleNamespace(address=address)
        assert wire.get(server)[0] == 403
        assert wire.get(server, f"/?{address.partition('?')[2]}")[0] == 303


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--port", "70000"], "the port is 70000; it must be 0 to 65535"),
        (["--port", "x"], "invalid int value: 'x'"),
        (["--host", "203.0.113.7", "--port", "0"], "cannot listen on port 0 of '203.0.113.7'"),
        (["--token", "short", "--port", "0"], "the token has 5 letters; give at least 16"),
        (["--max-upload-mb", "0"], "--max-upload-mb is 0; it must be above 0"),
        (["--max-upload-mb", "nan"], "--max-upload-mb is nan"),
        (["--max-upload-mb", "5000"], "at most 1024"),
        (["--max-frames", "0"], "the limit on frames is 0"),
        (["--max-joints", "-3"], "the limit on joints is -3"),
        (["--max-seconds", "nan"], "the limit on seconds is nan"),
        (["--max-visitors", "0"], "the limit on visitors is 0"),
        (["--max-visitors", "1.5"], "invalid int value"),
        (["--share"], "unrecognized arguments: --share"),
    ],
)
def test_mistakes_cost_one_line(arguments: list[str], message: str) -> None:
    pytest.importorskip("viser", reason="the page needs the extra 'web'")
    with pytest.raises(MotionGenError, match=message) as error:
        run(arguments)
    assert "\n" not in str(error.value)


def test_a_port_in_use_is_a_mistake() -> None:
    pytest.importorskip("viser", reason="the page needs the extra 'web'")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(MotionGenError, match=f"port {port} of 127.0.0.1 is in use; choose another with --port"):
            run(["--port", str(port)])


def test_without_viser_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("motiongen.web.server", "motiongen.web.guard", "motiongen.web.screening"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MotionGenError, match=re.escape("the page needs viser: pip install 'motiongen[web]'")):
        run(["--port", "0"])


def test_help_needs_no_viser() -> None:
    code = "import sys; sys.modules['viser'] = None; from motiongen.commands.serve import run; run(['--help'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "--max-upload-mb" in done.stdout
    assert "this machine only" in " ".join(done.stdout.split())
