"""Work on many things at once, the results in order."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from motiongen.errors import MotionGenError

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 4
"""Things handed out for each process before the oldest result is waited for, which bounds what is held in memory."""


def in_order(work: Callable[[T], R], things: Iterable[T], workers: int) -> Iterator[R]:
    """`work` done on each thing by so many processes; by this one if that is 1.

    Processes are spawned, not forked: a fork of a process with threads, such as those of NumPy or torch, may hang.

    Raises:
        MotionGenError: if a process dies.
    """
    if workers == 1:
        yield from map(work, things)
        return
    pending: deque[Future[R]] = deque()
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_leave_with_parent)
    try:
        for thing in things:
            pending.append(pool.submit(work, thing))
            if len(pending) >= AHEAD * workers:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    except BrokenProcessPool:
        raise MotionGenError("a worker process died, likely for lack of memory; use fewer workers") from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_with_parent() -> None:
    """End this process when the one that spawned it ends in whatever way; it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        with contextlib.suppress(Exception):
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
