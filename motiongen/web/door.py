"""Who may come in: what is asked of every request before anything of the page is given away.

Three things are kept out. A stranger, by a token where the machine can be reached from others. Another page in the
visitor's own browser, by the `Origin` that browsers put on what a page sends. And such a page under a name that was
made to lead to this machine, by the `Host` that it was asked for.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Protocol
from urllib.parse import parse_qs, quote, urlsplit

from motiongen.errors import MotionGenError

TOKEN_LETTERS = 16
"""A token shorter than this could be guessed."""

RETRY_SECONDS = 3

_TICKET = "[A-Za-z0-9_-]{32}"
_COOKIE = "Path=/; HttpOnly; SameSite=Lax"

_PORTS = {"http": 80, "https": 443}


class Headers(Protocol):
    """Of a request: every header may come more than once."""

    def get_all(self, key: str) -> list[str]:
        """What came under that name, in any case of letters; empty where nothing did."""


@dataclass(frozen=True)
class Answer:
    """An answer in place of the page."""

    status: HTTPStatus
    text: str
    headers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Door:
    """Decides about requests.

    Attributes:
        port: the port that is listened on; the cookie is named after it, as cookies know no ports.
        loopback: whether only this machine can reach the port. Requests must then name it by a loopback name.
        token: what a visitor must know, None for nothing.

    Raises:
        MotionGenError: if the token is too short.
    """

    port: int
    loopback: bool
    token: str | None

    def __post_init__(self) -> None:
        """Refuse a token that could be guessed."""
        if self.token is not None and len(self.token) < TOKEN_LETTERS:
            raise MotionGenError(
                f"the token has {len(self.token)} letters; give at least {TOKEN_LETTERS}, or none to have one made"
            )

    @property
    def query(self) -> str:
        """What stands behind the address of the page, "" where no token is needed."""
        return "" if self.token is None else f"?token={quote(self.token, safe='')}"

    @property
    def cookie(self) -> str:
        """`name=value` of the cookie that stands for the token."""
        # Cookies go to every port of a machine, so this one gives the token itself to no neighbour.
        key = hmac.new((self.token or "").encode(), f"motiongen:{self.port}".encode(), hashlib.sha256).hexdigest()
        return f"motiongen-{self.port}={key}"

    def ticket(self, headers: Headers) -> str | None:
        """What a visitor is known by when they come again, if they have been given one."""
        crumbs = (crumb.partition("=") for crumb in _crumbs(headers))
        tickets = [value for name, _, value in crumbs if name == self._ticket_name]
        return tickets[0] if len(tickets) == 1 and re.fullmatch(_TICKET, tickets[0]) else None

    def new_ticket(self) -> str:
        """A cookie with a ticket that nobody has."""
        return f"{self._ticket_name}={secrets.token_urlsafe(24)}; {_COOKIE}"

    @property
    def _ticket_name(self) -> str:
        return f"motiongen-{self.port}-visit"

    def answer(self, target: str, headers: Headers) -> Answer | None:
        """What to answer instead of the page, None if the request may come in.

        Args:
            target: path and query of the request.
            headers: its headers.
        """
        host = _only(headers.get_all("Host"))
        place = None if host is None else _place(f"http://{host}")
        if host is None or place is None:
            return _refusal("a request must say which host it is for.")
        if self.loopback and not is_loopback(place[0]):
            return _refusal(
                "this page is for the machine it runs on. Open it there as localhost or 127.0.0.1; `motiongen serve`",
                "lets other machines in if it is started with --host.",
            )
        if not _same_place(headers.get_all("Origin"), host):
            return _refusal("another page must not use this one.")
        _, mark, query = target.partition("?")
        websocket = "websocket" in map(str.lower, headers.get_all("Upgrade"))
        if self.token is not None:
            knows = _equal(parse_qs(query).get("token", [""])[0], self.token)
            if not knows and not any(_equal(crumb, self.cookie) for crumb in _crumbs(headers)):
                return _refusal(
                    "this page needs its token. Open the whole address that `motiongen serve` printed, with ?token=...",
                    "at its end.",
                )
            if knows and not websocket:
                return Answer(HTTPStatus.SEE_OTHER, "", {"Location": "/", "Set-Cookie": f"{self.cookie}; {_COOKIE}"})
        if mark and not websocket:
            # The page obeys its address: ?websocket= and ?playbackPath= would have another server draw on it, and run
            # its scripts here.
            return Answer(HTTPStatus.SEE_OTHER, "", {"Location": "/"})
        return None


def full(visitors: int) -> Answer:
    """What one visitor too many is told. The page that they see tries again by itself."""
    return Answer(
        HTTPStatus.SERVICE_UNAVAILABLE,
        f"motiongen: all places are taken ({visitors} visitors at once). This page tries again by itself.\n",
        {"Refresh": str(RETRY_SECONDS), "Retry-After": str(RETRY_SECONDS)},
    )


def page_headers(host: str = "") -> dict[str, str]:
    """Headers of everything that is given out: nothing of another site is loaded, connected to or drawn around it.

    Args:
        host: the `Host` of a request that the door has let through, for the WebSocket of the page.
    """
    sockets = f"ws://{host} wss://{host}" if host else ""
    policy = {
        # The page is one file that unpacks itself: scripts within it that make scripts, and workers made of blobs.
        "default-src": "'self' 'unsafe-inline' 'unsafe-eval' data: blob:",
        "connect-src": f"'self' {sockets} data: blob:",
        "object-src": "'none'",
        "base-uri": "'none'",
        "form-action": "'none'",
        "frame-ancestors": "'none'",
    }
    return {
        "Content-Security-Policy": "; ".join(f"{name} {sources}" for name, sources in policy.items()),
        "X-Frame-Options": "DENY",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


def is_loopback(name: str) -> bool:
    """Whether a host, as a name or as numbers, is this machine as only it can see itself."""
    if name.lower().rstrip(".") == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _place(url: str) -> tuple[str, int | None] | None:
    """Host and port of `scheme://host:port`, None if it is nothing of the kind."""
    if not re.fullmatch(r"[a-z]+://(\[[0-9A-Fa-f:.]+\]|[0-9A-Za-z._-]+)(:[0-9]{1,5})?", url):
        return None
    parts = urlsplit(url)
    try:
        return str(parts.hostname), parts.port or _PORTS.get(parts.scheme)
    except ValueError:  # a port beyond 65535
        return None


def _same_place(origins: list[str], host: str) -> bool:
    """Whether a request comes from the page at `host`, or from no page at all: programs send no origin."""
    if not origins:
        return True
    origin = _only(origins) or ""
    scheme = origin.partition(":")[0]
    place = _place(origin)
    return place is not None and scheme in _PORTS and place == _place(f"{scheme}://{host}")


def _refusal(*lines: str) -> Answer:
    return Answer(HTTPStatus.FORBIDDEN, "motiongen: " + "\n".join(lines) + "\n")


def _crumbs(headers: Headers) -> list[str]:
    """The cookies of a request, as `name=value`."""
    return [crumb.strip() for header in headers.get_all("Cookie") for crumb in header.split(";")]


def _only(values: list[str]) -> str | None:
    return values[0] if len(values) == 1 else None


def _equal(given: str, wanted: str) -> bool:
    """Whether two texts are equal, told in a time that does not show how much of them is."""
    return hmac.compare_digest(given.encode(errors="surrogatepass"), wanted.encode(errors="surrogatepass"))
