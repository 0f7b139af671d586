"""A server as a stranger meets it: who comes in, what becomes of them, and where it listens."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("viser", reason="the page needs the extra 'web'")

import viser
from websockets.exceptions import InvalidStatus

import motiongen.web.server
from motiongen.errors import MotionGenError
from motiongen.web.limits import Limits
from motiongen.web.server import Server
from tests.web.pages import Page, page, visits_under_way
from tests.web.wire import Deaf, get, hear, hear_the_end, visitor, wait_until

TOKEN = "a-long-enough-token"
PROTOCOL = f"viser-v{viser.__version__}"

pytestmark = pytest.mark.usefixtures("forgotten_pages")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with Server(port=0, visit=Page) as server:
        yield server


@pytest.fixture(scope="module")
def guarded() -> Iterator[Server]:
    with Server(port=0, token=TOKEN, visit=Page) as server:
        yield server


def refused(server: Server, query: str = "", **settings: Any) -> int:
    """Status that a handshake is refused with."""
    with pytest.raises(InvalidStatus) as error, visitor(server, query, **settings):
        pass
    return error.value.response.status_code


# -- the door


def test_the_page_is_given_out_with_its_headers(server: Server) -> None:
    status, headers, text = get(server)
    assert status == 200
    assert "<html" in text.lower()
    assert "'none'" in headers["Content-Security-Policy"]
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["Referrer-Policy"] == "no-referrer"
    status, headers, _ = get(server, "/../../pyproject.toml")
    assert status == 404
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_another_page_of_the_same_browser_is_kept_out(server: Server) -> None:
    own = server.address.rstrip("/")
    assert refused(server, origin="http://evil.example") == 403
    assert refused(server, origin=own.replace("127.0.0.1", "localhost")) == 403
    assert get(server, Origin="http://evil.example")[0] == 403
    for origin in (own, None):
        with visitor(server, origin=origin) as connection:
            assert hear(connection, "GuiSliderMessage")


def test_a_name_made_to_lead_here_is_kept_out(server: Server) -> None:
    assert get(server, host="evil.example")[0] == 403
    assert get(server, host="evil.example", Origin="http://evil.example")[0] == 403
    assert get(server, host="localhost:9000")[0] == 200


def test_with_a_token_nobody_comes_in_without(guarded: Server) -> None:
    assert guarded.address.endswith(f"/?token={TOKEN}")
    for path in ("/", "/?token=wrong", "/index.html"):
        status, headers, text = get(guarded, path)
        assert status == 403
        assert "motiongen serve" in text
        assert headers["X-Frame-Options"] == "DENY"
    assert refused(guarded) == 403
    assert refused(guarded, "?token=wrong") == 403
    assert refused(guarded, additional_headers={"Cookie": f"motiongen={TOKEN}"}) == 403

    status, headers, _ = get(guarded, f"/?token={TOKEN}")
    assert (status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"].partition(";")[0]
    assert get(guarded, Cookie=cookie)[0] == 200
    with visitor(guarded, additional_headers={"Cookie": cookie}) as connection:
        assert hear(connection, "GuiSliderMessage")
    with visitor(guarded, f"?token={TOKEN}") as connection:
        assert hear(connection, "GuiSliderMessage")
    assert refused(guarded, f"?token={TOKEN}", origin="http://evil.example") == 403


def test_the_token_is_in_no_log(guarded: Server, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    get(guarded, f"/?token={TOKEN}")
    with visitor(guarded, f"?token={TOKEN}", logger=logging.getLogger("quiet").getChild("child")):
        page()
    theirs = [record.getMessage() for record in caplog.records if record.name.startswith(("motiongen", "websockets.s"))]
    assert not any(TOKEN in text for text in theirs)


def test_other_machines_come_in_with_a_token_only() -> None:
    with Server(host="0.0.0.0", port=0, visit=Page) as first, Server(host="0.0.0.0", port=0, visit=Page) as second:
        assert first.address.startswith("http://127.0.0.1:")
        tokens = [server.address.partition("?token=")[2] for server in (first, second)]
        assert tokens[0] != tokens[1]
        assert min(map(len, tokens)) >= 32
        assert get(first)[0] == 403
        assert get(first, f"/?token={tokens[1]}")[0] == 403
        assert get(first, f"/?token={tokens[0]}", host="a-name-of-this-machine:8080")[0] == 303


def test_one_visitor_too_many_is_told_so() -> None:
    with Server(port=0, limits=Limits(visitors=2), visit=Page) as server:
        with visitor(server), visitor(server):
            wait_until(lambda: len(Page.all) == 2)
            assert refused(server) == 503
            status, headers, text = get(server)
            assert status == 503
            assert "2 visitors" in text
            assert headers["Refresh"]
        wait_until(lambda: get(server)[0] == 200)
        with visitor(server) as connection:
            assert hear(connection, "GuiSliderMessage")


def test_who_knocks_while_the_last_place_is_taken_is_sent_away() -> None:
    codes: list[int] = []

    class Knocking:
        subprotocol = PROTOCOL

        async def close(self, code: int, _reason: str) -> None:
            codes.append(code)

    async def stay(_: Any) -> None:
        await full._guard._handle(stay, Knocking())

    with Server(port=0, limits=Limits(visitors=1), visit=Page) as full:
        asyncio.run(full._guard._handle(stay, Knocking()))
    assert codes == [1013]


def test_a_page_of_another_version_is_sent_away(server: Server, capfd: pytest.CaptureFixture[str]) -> None:
    with visitor(server, version="0.0.0", greet=False) as connection:
        assert hear_the_end(connection) == 1002  # which viser's page shows
    assert capfd.readouterr() == ("", "")


# -- coming and going


def test_a_visit_is_made_and_closed_once_for_everyone_who_comes(server: Server) -> None:
    with visitor(server), visitor(server):
        wait_until(lambda: len(Page.all) == 2)
        assert len({visit.client.client_id for visit in Page.all}) == 2
        assert [visit.closed for visit in Page.all] == [0, 0]
    wait_until(lambda: all(visit.closed for visit in Page.all))
    assert [visit.closed for visit in Page.all] == [1, 1]


def test_who_leaves_while_their_visit_is_made_is_not_forgotten(recwarn: pytest.WarningsRecorder) -> None:
    begun, go_on, made = threading.Event(), threading.Event(), []

    def slowly(client: viser.ClientHandle, *_: Any) -> SimpleNamespace:
        begun.set()
        assert go_on.wait(10)
        client.gui.add_button("too late")
        made.append(SimpleNamespace(closed=0))
        return SimpleNamespace(close=lambda: setattr(made[0], "closed", made[0].closed + 1))

    with Server(port=0, visit=slowly) as server:
        with visitor(server):
            assert begun.wait(5)
        wait_until(lambda: not server._seats)
        go_on.set()
        wait_until(lambda: made and made[0].closed)
    assert made[0].closed == 1
    assert not recwarn.list


def ticket(server: Server) -> dict[str, Any]:
    """Settings of the connection of a page that was given a ticket."""
    _, headers, _ = get(server)
    return {"additional_headers": {"Cookie": headers["Set-Cookie"].partition(";")[0]}}


def left_for(server: Server, **settings: Any) -> Any:
    """What a visitor who comes is given, who leaves again."""
    before = len(Page.all)
    with visitor(server, **settings):
        wait_until(lambda: len(Page.all) > before)
        return Page.all[-1].left


def test_who_comes_again_finds_what_they_left_and_nobody_else_does() -> None:
    with Server(port=0, visit=Page) as server:
        mine, yours = ticket(server), ticket(server)
        assert [left_for(server, **mine) for _ in range(3)] == [None, "0;", "0;1;"]
        assert left_for(server, **yours) is None
        assert left_for(server) is None, "without a ticket"
        assert left_for(server) is None
        assert left_for(server, **mine) == "0;1;2;"


def test_who_has_a_ticket_keeps_it(server: Server) -> None:
    settings = ticket(server)
    assert "Set-Cookie" not in get(server, **settings["additional_headers"])[1]
    assert "Set-Cookie" in get(server, Cookie="motiongen-1-visit=x")[1]


def test_a_second_page_of_the_same_browser_is_one_of_its_own(server: Server) -> None:
    settings = ticket(server)
    with visitor(server, **settings):
        wait_until(lambda: Page.all)
        assert left_for(server, **settings) is None


def test_what_was_left_is_forgotten_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motiongen.web.server, "KEPT_SECONDS", 0.0)
    with Server(port=0, visit=Page) as server:
        settings = ticket(server)
        for _ in range(2):
            assert left_for(server, **settings) is None
            wait_until(lambda: not (server._seats or server._cloakroom._kept))


def test_what_makes_a_page_fail_is_given_once(capfd: pytest.CaptureFixture[str]) -> None:
    def make(client: viser.ClientHandle, jobs: object, limits: Limits, left: Any) -> Page:
        made = Page(client, jobs, limits, left)
        if left:
            raise ValueError(left)
        return made

    with Server(port=0, visit=make) as server:
        settings = ticket(server)
        assert [left_for(server, **settings) for _ in range(3)] == [None, "0;", None]


def test_who_leaves_before_their_page_is_there_again_loses_nothing() -> None:
    go_on = threading.Event()

    def make(client: viser.ClientHandle, jobs: object, limits: Limits, left: Any) -> Page:
        made = Page(client, jobs, limits, left)
        if client.client_id == 1:
            assert go_on.wait(10)
            raise ValueError("nobody is there any more")
        return made

    with Server(port=0, visit=make) as server:
        settings = ticket(server)
        assert [left_for(server, **settings) for _ in range(2)] == [None, "0;"]
        wait_until(lambda: not server._seats)
        go_on.set()
        assert left_for(server, **settings) == "0;"


def test_closing_the_server_closes_every_visit_and_its_work() -> None:
    with Server(port=0, visit=Page) as server:
        with visitor(server) as connection:
            page()
            server.close()
            assert hear_the_end(connection) == 1001
        server.close()  # does no harm
        with pytest.raises(OSError, match="refused"):
            get(server)
        with pytest.raises(MotionGenError, match="closing"):
            server._jobs.submit("me", "work", lambda progress: None, lambda job: None)
    assert page().closed == 1


def test_closing_does_not_wait_for_who_does_not_answer(capfd: pytest.CaptureFixture[str]) -> None:
    with Server(port=0, visit=Page) as server, Deaf(server):
        page()
        server.close()
        assert not server._guard.viser._websock_server._server_thread.is_alive()
    assert capfd.readouterr() == ("", "")


def test_a_visit_that_fails_says_so(capfd: pytest.CaptureFixture[str]) -> None:
    def fail(client: viser.ClientHandle, *_: Any) -> Page:
        if client.client_id == 0:
            raise ValueError("no\nsuch thing")
        visit = Page(client, *_)
        visit.close = lambda: 1 / 0
        return visit

    with Server(port=0, visit=fail) as server, visitor(server) as connection, visitor(server):
        notice = hear(connection, "NotificationShowMessage")["props"]
        assert notice["body"] == "ValueError: no such thing"
        assert notice["color"] == "red"
        page()
    wait_until(lambda: not visits_under_way())
    trace = capfd.readouterr().err
    assert trace.count("ValueError: no\nsuch thing") == 1
    assert trace.count("ZeroDivisionError") == 1


# -- where it listens


def test_a_port_in_use_is_not_changed_for_another(server: Server) -> None:
    port = int(server.address.rstrip("/").rpartition(":")[2])
    with pytest.raises(MotionGenError, match=f"port {port} of 127.0.0.1 is in use"):
        Server(port=port, visit=Page)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"port": 65536}, "0 to 65535"),
        ({"port": -1}, "0 to 65535"),
        ({"host": "203.0.113.7"}, "cannot listen on port 0 of '203.0.113.7'"),
        ({"host": "no such host"}, "cannot listen"),
        ({"host": "a" * 100}, "cannot listen"),
        ({"token": "short"}, "at least 16"),
        ({"host": "0.0.0.0", "token": ""}, "at least 16"),
    ],
)
def test_bad_places_and_tokens_are_refused_in_one_line(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(MotionGenError, match=message) as error:
        Server(**{"port": 0, "visit": Page, **settings})
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not socket.has_ipv6, reason="this machine has no IPv6")
def test_loopback_has_an_address_of_six_too() -> None:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no IPv6")
    with Server(host="::1", port=0, visit=Page) as server:
        assert server.address.startswith("http://[::1]:")
        assert get(server)[0] == 200


def test_nothing_is_printed_and_nothing_is_left_replaced(capfd: pytest.CaptureFixture[str]) -> None:
    import rich
    import websockets.asyncio.server

    before = rich.print, websockets.asyncio.server.serve
    with Server(port=0, visit=Page) as server, visitor(server):
        page()
    assert (rich.print, websockets.asyncio.server.serve) == before
    assert capfd.readouterr() == ("", "")


def test_a_viser_that_cannot_be_guarded_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped = []
    other = SimpleNamespace(stop=lambda: stopped.append(True))
    monkeypatch.setattr(viser, "ViserServer", lambda **_: other)
    with pytest.raises(RuntimeError, match="is guarded"):
        Server(port=0, visit=Page)
    assert stopped == [True]
