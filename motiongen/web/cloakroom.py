"""What visitors have left behind: a page that is loaded again, or lost its connection, goes on where it was."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import Future, wait
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motiongen.web.desk import Belongings

    Coming = Future[Belongings | None]

PATIENCE_SECONDS = 10.0
"""How long who comes again waits until what they left is there."""


class Cloakroom:
    """Belongings, each under the ticket of its owner."""

    def __init__(self, places: int) -> None:
        """Keep those of the last `places` visitors who left."""
        self._lock = threading.Lock()
        self._kept: deque[tuple[str, Coming]] = deque(maxlen=places)

    def keep(self, ticket: str, belongings: Coming) -> None:
        """Take in what somebody leaves behind, or will have left once it is known."""
        with self._lock:
            self._kept.append((ticket, belongings))

    def fetch(self, ticket: str) -> Belongings | None:
        """What was left last under a ticket; it is given out once. None if there is nothing, or it does not come."""
        while (belongings := self._taken(ticket)) is not None:
            wait([belongings], PATIENCE_SECONDS)
            if not belongings.done():
                return None
            if (left := belongings.result()) is not None:
                return left
        return None

    def _taken(self, ticket: str) -> Coming | None:
        with self._lock:
            mine = [each for each in self._kept if each[0] == ticket]
            if not mine:
                return None
            self._kept.remove(mine[-1])
            return mine[-1][1]

    def forget(self, belongings: Coming | None) -> None:
        """Throw away what is there still."""
        with self._lock:
            self._kept = deque((each for each in self._kept if each[1] is not belongings), self._kept.maxlen)
