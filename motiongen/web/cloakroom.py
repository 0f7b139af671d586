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
        with self._lock:
            mine = [each for each in self._kept if each[0] == ticket]
            if not mine:
                return None
            self._kept.remove(mine[-1])
        belongings = mine[-1][1]
        wait([belongings], PATIENCE_SECONDS)
        return belongings.result() if belongings.done() else None

    def forget(self, belongings: Coming) -> None:
        """Throw away what is there still."""
        with self._lock:
            self._kept = deque((each for each in self._kept if each[1] is not belongings), self._kept.maxlen)
