"""Who may come in, decided from path and headers alone."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.errors import MotionGenError
from motiongen.web.door import Answer, Door, full, page_headers

TOKEN = "a-long-enough-token"
TICKET = "Ab3-_" * 6 + "xy"


class Headers(dict):
    """Header -> its values."""

    def get_all(self, key: str) -> list[str]:
        return self.get(key, [])


def answer(door: Door, target: str = "/", **headers: str | list[str]) -> Answer | None:
    given = {"Host": "127.0.0.1:8080", **headers}
    return door.answer(
        target, Headers({name: [text] if isinstance(text, str) else text for name, text in given.items()})
    )


def status(*arguments: Any, **headers: Any) -> int | None:
    answered = answer(*arguments, **headers)
    return None if answered is None else int(answered.status)


OPEN = Door(8080, loopback=True, token=None)
WITH_TOKEN = Door(8080, loopback=False, token=TOKEN)


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8080", "localhost", "LOCALHOST:9000", "[::1]:8080", "127.1.2.3", "localhost."]
)
def test_names_of_this_machine_are_let_in_on_loopback_at_any_port(host: str) -> None:
    assert answer(OPEN, Host=host) is None


STRANGE_HOSTS = [
    "",
    "a b",
    "evil.example",
    "evil.example:8080",
    "localhost.evil.example",
    "127.0.0.1@evil.example",
    "192.168.0.4:8080",
    "0.0.0.0:8080",
    "2130706433",
    "127.0.0.1:99999",
    "127.0.0.1/",
    "127.0.0.1;x",
    "[::1",
    "localhost:8080:8080",
]


@pytest.mark.parametrize("host", STRANGE_HOSTS)
def test_other_names_are_kept_out_on_loopback(host: str) -> None:
    assert status(OPEN, Host=host) == 403


@pytest.mark.parametrize("hosts", [[], ["localhost", "localhost"], ["localhost", "evil.example"]])
def test_a_request_has_one_host(hosts: list[str]) -> None:
    assert status(OPEN, Host=hosts) == 403
    assert status(WITH_TOKEN, f"/?token={TOKEN}", Host=hosts) == 403


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080"),
        ("http://localhost:9000", "localhost:9000"),
        ("http://localhost", "localhost:80"),
        ("https://localhost", "localhost"),
        ("http://[::1]:8080", "[::1]:8080"),
    ],
)
def test_the_page_itself_may_connect(origin: str, host: str) -> None:
    assert answer(OPEN, Origin=origin, Host=host) is None


STRANGE_ORIGINS = [
    "",
    "null",
    "file://",
    "http://evil.example",
    "http://127.0.0.1",
    "http://127.0.0.1:8081",
    "http://localhost:8080",
    "ftp://127.0.0.1:8080",
    "127.0.0.1:8080",
    "http://127.0.0.1:8080/",
    "http://127.0.0.1:8080@evil.example",
]


@pytest.mark.parametrize("origin", STRANGE_ORIGINS)
def test_other_pages_may_not(origin: str) -> None:
    assert status(OPEN, Origin=origin) == 403
    assert status(WITH_TOKEN, f"/?token={TOKEN}", Origin=origin) == 403


def test_a_request_has_at_most_one_origin() -> None:
    assert status(OPEN, Origin=["http://127.0.0.1:8080", "http://127.0.0.1:8080"]) == 403


def test_with_a_token_nothing_is_given_without_it() -> None:
    for target in ("/", "/index.html", "/anything", "/?token=", f"/?token={TOKEN[:-1]}", f"/?token={TOKEN}x", "/?t=1"):
        assert status(WITH_TOKEN, target) == 403
        assert status(WITH_TOKEN, target, Upgrade="websocket") == 403


def test_the_right_token_gives_a_cookie_which_lets_in() -> None:
    given = answer(WITH_TOKEN, f"/?token={TOKEN}")
    assert given.status == 303
    assert given.headers["Location"] == "/"
    cookie, *marks = given.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Lax", "Path=/"} == set(marks)
    assert cookie.startswith("motiongen-8080=")
    assert TOKEN not in cookie
    assert answer(WITH_TOKEN, Cookie=cookie) is None
    assert answer(WITH_TOKEN, Cookie=f"a=b; {cookie};c=d", Upgrade="websocket") is None
    assert answer(WITH_TOKEN, Cookie=["a=b", cookie]) is None
    assert status(WITH_TOKEN, Cookie=cookie[:-1]) == 403
    assert status(WITH_TOKEN, Cookie=cookie.replace("8080", "8081")) == 403
    assert status(Door(8081, False, TOKEN), Cookie=cookie.replace("8080", "8081")) == 403
    assert status(Door(8080, False, TOKEN + "!"), Cookie=cookie) == 403


def test_a_program_may_give_the_token_with_the_handshake() -> None:
    assert answer(WITH_TOKEN, f"/?token={TOKEN}", Upgrade="WebSocket") is None


@given(token=st.text(st.characters(exclude_categories=["Cs"]), min_size=16, max_size=40))
def test_the_query_of_the_address_holds_the_token_whatever_its_letters(token: str) -> None:
    door = Door(8080, loopback=True, token=token)
    assert door.query.isascii()
    assert status(door, f"/{door.query}") == 303
    assert token not in door.cookie


@pytest.mark.parametrize("query", ["websocket=ws://evil.example", "playbackPath=http://evil.example/x", "", "token=x"])
def test_the_page_is_never_opened_with_a_query(query: str) -> None:
    given = answer(OPEN, f"//evil.example?{query}")
    assert given.status == 303
    assert given.headers == {"Location": "/"}
    cookie = WITH_TOKEN.cookie
    assert answer(WITH_TOKEN, f"/?{query}", Cookie=cookie).headers == {"Location": "/"}


def test_a_short_token_is_refused() -> None:
    with pytest.raises(MotionGenError, match="has 15 letters; give at least 16"):
        Door(8080, loopback=True, token="x" * 15)
    with pytest.raises(MotionGenError, match="has 0 letters"):
        Door(8080, loopback=False, token="")


def test_refusals_say_what_to_do_and_repeat_nothing() -> None:
    refused = answer(WITH_TOKEN, "/?token=<script>", Cookie="<script>")
    assert "motiongen serve" in refused.text
    assert "script" not in refused.text
    assert "evil" not in answer(OPEN, Host="evil.example").text
    assert "--host" in answer(OPEN, Host="evil.example").text
    assert "3 visitors" in full(3).text
    assert full(3).headers["Refresh"]


def test_pages_are_told_to_load_nothing_from_elsewhere() -> None:
    headers = page_headers("localhost:8080")
    policy = dict(rule.split(" ", 1) for rule in headers["Content-Security-Policy"].split("; "))
    assert policy["frame-ancestors"] == "'none'"
    assert policy["connect-src"] == "'self' ws://localhost:8080 wss://localhost:8080 data: blob:"
    assert not any("*" in sources or "http" in sources for sources in policy.values())
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"


# -- who was here before


def test_a_ticket_is_known_again() -> None:
    cookies = {OPEN.new_ticket() for _ in range(10)}
    assert len(cookies) == 10
    for cookie in cookies:
        crumb, *marks = cookie.split("; ")
        assert {"HttpOnly", "SameSite=Lax", "Path=/"} == set(marks)
        known = OPEN.ticket(Headers({"Cookie": [f"a=b; {crumb}", "c=d"]}))
        assert f"motiongen-8080-visit={known}" == crumb
        assert Door(8081, True, None).ticket(Headers({"Cookie": [crumb]})) is None, "cookies know no ports"


@pytest.mark.parametrize(
    "cookie",
    [
        [],
        [""],
        ["motiongen-8080-visit"],
        ["motiongen-8080-visit="],
        [f"motiongen-8080-visit={TICKET}x"],
        [f"motiongen-8080-visit={TICKET[:-1]}"],
        [f"motiongen-8080-visit={TICKET[:-1]}%"],
        [f"motiongen-8080-visit={TICKET}; motiongen-8080-visit={TICKET[::-1]}"],
    ],
)
def test_what_is_no_ticket_is_none(cookie: list[str]) -> None:
    assert OPEN.ticket(Headers({"Cookie": [f"motiongen-8080-visit={TICKET}"]})) == TICKET
    assert OPEN.ticket(Headers({"Cookie": cookie})) is None
