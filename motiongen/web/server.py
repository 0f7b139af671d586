"""The server of the page: a place to listen, one queue of work for all, and a visit for everyone who comes."""

from __future__ import annotations

import asyncio
import errno
import secrets
import socket
import threading
import traceback
import weakref
from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol

import viser

from motiongen.errors import MotionGenError
from motiongen.web.cloakroom import Cloakroom
from motiongen.web.desk import Belongings
from motiongen.web.door import Door, is_loopback
from motiongen.web.guard import Guard
from motiongen.web.jobs import JobQueue
from motiongen.web.limits import Limits

TITLE = "motiongen"
BRAND_COLOUR = (0, 114, 178)

KEPT_SECONDS = 15 * 60.0
"""How long a visitor's belongings are kept after they have left."""


class Leaving(Protocol):
    """What is told when a visitor leaves."""

    def close(self) -> Belongings | None:
        """Free everything; returns what they are to find when they come again."""


MakeVisit = Callable[[viser.ClientHandle, JobQueue, Limits, Belongings | None], Leaving]
"""Makes the page of a visitor, who has left the last named behind when they were here before."""


class Server:
    """Gives out the page from the moment it is made until it is closed.

    Attributes:
        address: what to open in a browser, with the token where one is needed.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 8080,
        token: str | None = None,
        limits: Limits | None = None,
        visit: MakeVisit | None = None,
    ) -> None:
        """Listen.

        Args:
            host: name or number of the network interface. Others than this machine's own are only let in with a token.
            port: 0 for any that is free.
            token: what visitors must know; None makes one where it is needed.
            limits: how much visitors may ask for; None for what `Limits` says.
            visit: makes the page of a visitor, in a thread of its own; None for `Visit`.

        Raises:
            MotionGenError: if it cannot listen there, or the token is too short.
        """
        self._limits = limits or Limits()
        self._make = visit or _visit
        self._seats: dict[int, _Seat] = {}
        self._cloakroom = Cloakroom(self._limits.visitors)
        self._closed = False
        listener = _listen(host, port)
        number, port = listener.getsockname()[:2]
        loopback = is_loopback(number)
        try:
            door = Door(port, loopback, token if loopback or token is not None else secrets.token_urlsafe(24))
            self._guard = Guard(listener, door, self._limits, TITLE)
        except BaseException:
            listener.close()
            raise
        self.address = f"http://{_shown(number)}:{port}/{door.query}"
        self._jobs = JobQueue(self._limits.seconds, self._limits.waiting)
        self._guard.viser.gui.configure_theme(
            dark_mode=False, show_logo=False, show_share_button=False, brand_color=BRAND_COLOUR
        )
        # A page that hears of this together with its first camera takes it into account; later ones may be too late.
        self._guard.viser.scene.set_up_direction("+y")
        self._guard.viser.on_client_disconnect(self._left)
        self._guard.viser.on_client_connect(self._came)

    def __enter__(self) -> Server:
        """The server itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """Send all visitors away, stop their work, and listen no more."""
        if self._closed:
            return
        self._closed = True
        for seat in list(self._seats.values()):
            seat.leave()
            seat.clear()
        self._jobs.close()
        self._guard.stop()

    # Both run in the one thread of viser's event loop, so that nobody leaves before they came. Neither may wait.

    async def _came(self, client: viser.ClientHandle) -> None:
        if self._closed or client.client_id not in self._guard.viser.get_clients():
            return
        seat = self._seats[client.client_id] = _Seat(client, self._guard.admit(client))
        _start(self._receive, seat)

    async def _left(self, client: viser.ClientHandle) -> None:
        seat = self._seats.pop(client.client_id, None)
        if seat is None:
            return
        seat.leave()
        if seat.ticket is not None:  # before it is cleared: they may come again in the next moment
            self._cloakroom.keep(seat.ticket, seat.belongings)
            # What is given out or makes room for others must not live on for the timer's sake.
            known = weakref.ref(seat.belongings)
            asyncio.get_running_loop().call_later(KEPT_SECONDS, lambda: self._cloakroom.forget(known()))
        _start(self._clear, seat)

    def _receive(self, seat: _Seat) -> None:
        left = None if seat.ticket is None else self._cloakroom.fetch(seat.ticket)
        seat.take(lambda: self._make(seat.client, self._jobs, self._limits, left), left)

    def _clear(self, seat: _Seat) -> None:
        seat.clear()
        self._guard.release(seat.client)


class _Seat:
    """One visitor's: a visit that is being made, is there, or is over.

    Attributes:
        client: the visitor's browser.
        ticket: by which they are known when they come again; None for never.
        belongings: what they leave behind, as soon as it is known.
    """

    def __init__(self, client: viser.ClientHandle, ticket: str | None) -> None:
        self.client, self.ticket = client, ticket
        self.belongings: Future[Belongings | None] = Future()
        self._lock = threading.Lock()
        self._visit: Leaving | None = None
        self._left = False

    def take(self, make: Callable[[], Leaving], left: Belongings | None) -> None:
        """Make the visit; it is closed at once if the visitor has left meanwhile.

        Args:
            make: the visit.
            left: what it is made of, None for nothing.
        """
        try:
            visit = make()
        except Exception as error:
            # What failed because they left may be tried again with the same; what failed by itself must not.
            self.belongings.set_result(left if self._left else None)
            if not self._left:
                traceback.print_exception(error)
                self.client.add_notification("This page failed", _one_line(error), color="red")
            return
        with self._lock:
            if not self._left:
                self._visit = visit
                return
        self.belongings.set_result(_close(visit))

    def leave(self) -> None:
        """Note that the visitor has left."""
        with self._lock:
            self._left = True

    def clear(self) -> None:
        """Close the visit of somebody who has left, now or as soon as it is made."""
        with self._lock:
            visit, self._visit = self._visit, None
        if visit is not None:
            self.belongings.set_result(_close(visit))


def _start(do: Callable[..., None], *arguments: object) -> None:
    threading.Thread(target=do, args=arguments, name="motiongen visit", daemon=True).start()


def _visit(client: viser.ClientHandle, jobs: JobQueue, limits: Limits, left: Belongings | None) -> Leaving:
    from motiongen.web.visit import Visit

    return Visit(client, jobs, limits, left)


def _close(visit: Leaving) -> Belongings | None:
    try:
        return visit.close()
    except Exception as error:  # the others must be closed all the same
        traceback.print_exception(error)
        return None


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def _listen(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        MotionGenError: if the port is in use, or the host is none of this machine's.
    """
    if not 0 <= port <= 65535:
        raise MotionGenError(f"the port is {port}; it must be 0 to 65535, 0 for any that is free")
    try:
        places = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, *_, place = min(places, key=lambda place: place[0] != socket.AF_INET)
        return socket.create_server(place[:2], family=family)
    except (OSError, UnicodeError) as error:
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            raise MotionGenError(
                f"port {port} of {host} is in use; choose another with --port, 0 for any that is free"
            ) from None
        reason = getattr(error, "strerror", None) or error
        raise MotionGenError(f"cannot listen on port {port} of '{host}': {reason}") from None


def _shown(number: str) -> str:
    """What to call an interface in an address: where all are meant, the one that this machine reaches itself by."""
    number = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(number, number)
    return f"[{number}]" if ":" in number else number
