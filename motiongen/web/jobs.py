"""The queue of work: one job at a time, in turn between its owners, with progress, cancelling and a limit of time.

The work of a job runs in one thread of the queue. It is given a function to call with the share that is done; that is
where a job is stopped that was cancelled or takes too long, so that work which never calls it runs to its end.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections import OrderedDict, deque
from collections.abc import Callable
from enum import Enum
from typing import Any

from motiongen.errors import CancelledError, MotionGenError
from motiongen.generators.base import Progress

Work = Callable[[Progress], Any]


class State(Enum):
    """What has become of a job."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Job:
    """A piece of work that waits, runs or is over.

    Attributes:
        owner: whose it is.
        title: what to call it.
        state: what has become of it.
        share: how much of it is done, 0 to 1.
        result: what the work returned, once it is done.
        error: one line on why it failed, once it has.
    """

    def __init__(self, owner: object, title: str, work: Work, finished: Callable[[Job], None], kind: str) -> None:
        """Describe the job; `JobQueue.submit` does it."""
        self.owner, self.title, self.kind = owner, title, kind
        self.state = State.WAITING
        self.share = 0.0
        self.result: Any = None
        self.error = ""
        self._work, self._finished = work, finished
        self._unwanted = threading.Event()
        self._over = threading.Event()

    def stop(self) -> None:
        """Ask work that runs to stop when it next tells how far it is."""
        self._unwanted.set()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until it is over; whether it is."""
        return self._over.wait(seconds)

    def run(self, seconds: float) -> None:
        """Do the work, stop it after `seconds`, and tell the owner what has become of it."""
        deadline = time.monotonic() + seconds

        def advance(share: float) -> None:
            if self._unwanted.is_set():
                raise CancelledError
            if time.monotonic() > deadline:
                raise MotionGenError(f"{self.title} was stopped after {seconds:g} seconds, the most that is allowed")
            self.share = min(max(float(share), 0.0), 1.0)

        self.state = State.RUNNING
        try:
            advance(0.0)
            result = self._work(advance)
            if self._unwanted.is_set():
                raise CancelledError
            self.result, self.share, self.state = result, 1.0, State.DONE
        except CancelledError:
            self.state = State.CANCELLED
        except MotionGenError as error:
            self.error, self.state = " ".join(str(error).split()), State.FAILED
        except Exception as error:  # one job must not take the others down
            traceback.print_exc()
            self.error, self.state = f"motiongen failed: {type(error).__name__}: {error}", State.FAILED
        self.close()

    def close(self) -> None:
        """Tell the owner that it is over, whatever has become of it."""
        if self.state is State.WAITING:
            self.state = State.CANCELLED
        try:
            self._finished(self)
        except Exception:  # the owner may have left meanwhile
            traceback.print_exc()
        finally:
            self._over.set()


class JobQueue:
    """Jobs of several owners, worked on one after the other; owners take turns."""

    def __init__(self, seconds: float, waiting: int = 4) -> None:
        """Start the thread.

        Args:
            seconds: how long a job may run.
            waiting: how many jobs of one owner may wait.
        """
        self._seconds, self._most_waiting = seconds, waiting
        self._changed = threading.Condition()
        self._waiting: OrderedDict[object, deque[Job]] = OrderedDict()  # owner -> jobs; the next owner first
        self._running: Job | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="motiongen jobs", daemon=True)
        self._thread.start()

    def submit(self, owner: object, title: str, work: Work, finished: Callable[[Job], None], replace: str = "") -> Job:
        """Queue a job.

        Args:
            owner: whose it is.
            title: what to call it in messages.
            work: takes a function to call with the share done, and returns the result.
            finished: called in the queue's thread when the job is over, whatever has become of it.
            replace: jobs of this kind replace those of the same owner that still wait; empty: none does.

        Raises:
            MotionGenError: if too many jobs of this owner wait, or the queue is closed.
        """
        job = Job(owner, title, work, finished, replace)
        with self._changed:
            if self._closed:
                raise MotionGenError("the server is closing; start it again")
            line = self._waiting.setdefault(owner, deque())
            if self._running is not None and self._running.owner in self._waiting:
                self._waiting.move_to_end(self._running.owner)  # behind whoever has come since it was served
            outdated = [each for each in line if replace and each.kind == replace]
            if len(line) - len(outdated) >= self._most_waiting:
                raise MotionGenError(f"{len(line)} jobs of yours wait already; cancel one, or wait until one is done")
            for each in outdated:
                line.remove(each)
            line.append(job)
            self._changed.notify_all()
        for each in outdated:
            each.close()
        return job

    def ahead(self, job: Job) -> int:
        """How many jobs will be worked on before this one, as far as is known now."""
        with self._changed:
            lines = [list(line) for line in self._waiting.values()]
            running = int(self._running is not None)
        in_turn = [line[turn] for turn in range(max(map(len, lines), default=0)) for line in lines if turn < len(line)]
        return running + in_turn.index(job) if job in in_turn else 0

    def cancel(self, job: Job) -> None:
        """Cancel a job: at once where it waits, else when its work next tells how far it is."""
        with self._changed:
            line = self._waiting.get(job.owner, deque())
            waiting = job in line
            if waiting:
                line.remove(job)
                if not line:
                    del self._waiting[job.owner]
        if waiting:
            job.close()
        else:
            job.stop()

    def cancel_all(self, owner: object) -> None:
        """Cancel all jobs of an owner."""
        with self._changed:
            jobs = list(self._waiting.get(owner, ()))
            if self._running is not None and self._running.owner is owner:
                jobs.append(self._running)
        for job in jobs:
            self.cancel(job)

    def close(self) -> None:
        """Cancel everything; the thread ends when what runs has stopped."""
        with self._changed:
            self._closed = True
            owners = {*self._waiting, *([self._running.owner] if self._running else [])}
            self._changed.notify_all()
        for owner in owners:
            self.cancel_all(owner)

    def _serve(self) -> None:
        while (job := self._next()) is not None:
            job.run(self._seconds)
            with self._changed:
                self._running = None
            del job  # and with it what it has made, which may be waited long for the next one

    def _next(self) -> Job | None:
        """The next job: the first of the owner who was served longest ago; None when the queue is closed."""
        with self._changed:
            while not self._closed and not any(self._waiting.values()):
                self._changed.wait()
            if self._closed:
                return None
            owner = next(owner for owner, line in self._waiting.items() if line)
            job = self._waiting[owner].popleft()
            self._waiting.move_to_end(owner)
            if not self._waiting[owner]:
                del self._waiting[owner]
            self._running = job
            return job
