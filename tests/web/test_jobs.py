"""The queue of work: turns, cancelling and limits, on work that waits to be let go."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from motiongen.errors import MotionGenError
from motiongen.generators.base import Progress
from motiongen.web.jobs import Job, JobQueue, State

PATIENCE_SECONDS = 30.0


class Gate:
    """Work that waits until it is let go, and hears when it is cancelled."""

    def __init__(self) -> None:
        self.began, self.released = threading.Event(), threading.Event()

    def __call__(self, progress: Progress) -> str:
        self.began.set()
        while not self.released.wait(0.001):
            progress(0.5)
        return "through"


class Desk:
    """Whoever owns jobs: keeps the jobs that are over, in the order in which they ended."""

    def __init__(self, queue: JobQueue) -> None:
        self.over: list[Job] = []
        self._queue = queue

    def submit(self, owner: object, title: str, work: Callable[[Progress], Any] | None = None, kind: str = "") -> Job:
        return self._queue.submit(owner, title, work or (lambda progress: title), self.over.append, kind)

    @property
    def titles(self) -> list[str]:
        return [job.title for job in self.over]


@pytest.fixture
def queue() -> Iterator[JobQueue]:
    made = JobQueue(seconds=PATIENCE_SECONDS, waiting=4)
    yield made
    made.close()


@pytest.fixture
def desk(queue: JobQueue) -> Desk:
    return Desk(queue)


@pytest.fixture
def gate(desk: Desk) -> Iterator[Gate]:
    """Work of somebody else that holds the queue up until it is let go."""
    held = Gate()
    desk.submit("somebody", "gate", held)
    assert held.began.wait(PATIENCE_SECONDS)
    yield held
    held.released.set()


def done(*jobs: Job) -> None:
    for job in jobs:
        assert job.wait(PATIENCE_SECONDS), f"{job.title} does not end"


def test_a_result_comes_back_and_the_share_grows(desk: Desk) -> None:
    shares = []

    def work(progress: Progress) -> int:
        for share in (0.0, 0.25, 2.0, -1.0):
            progress(share)
            shares.append(job_of[0].share)
        return 42

    started = threading.Event()
    job_of: list[Job] = []
    job = desk.submit("a", "work", lambda progress: started.wait(PATIENCE_SECONDS) and work(progress))
    job_of.append(job)
    started.set()
    done(job)
    assert (job.state, job.result, job.share, job.error) == (State.DONE, 42, 1.0, "")
    assert shares == [0.0, 0.25, 1.0, 0.0], "never beyond 0 to 1"
    assert desk.over == [job]


def test_owners_take_turns_however_many_jobs_each_has(desk: Desk, gate: Gate) -> None:
    jobs = [desk.submit("a", f"a{number}") for number in range(3)]
    jobs += [desk.submit("b", f"b{number}") for number in range(2)]
    jobs += [desk.submit("c", "c0")]
    gate.released.set()
    done(*jobs)
    assert desk.titles == ["gate", "a0", "b0", "c0", "a1", "b1", "a2"]


def test_who_comes_while_another_is_served_is_served_next(desk: Desk) -> None:
    gate = Gate()
    jobs = [desk.submit("a", "a0", gate), desk.submit("a", "a1"), desk.submit("a", "a2")]
    assert gate.began.wait(PATIENCE_SECONDS)
    jobs += [desk.submit("b", "b0"), desk.submit("b", "b1")]
    gate.released.set()
    done(*jobs)
    assert desk.titles == ["a0", "b0", "a1", "b1", "a2"]


def test_how_many_are_ahead_is_how_many_come_first(queue: JobQueue, desk: Desk, gate: Gate) -> None:
    jobs = [desk.submit(owner, f"{owner}{number}") for owner in "abc" for number in range(3)]
    jobs.append(desk.submit("somebody", "last"))
    ahead = {job.title: queue.ahead(job) for job in jobs}
    gate.released.set()
    done(*jobs)
    assert {title: place for place, title in enumerate(desk.titles) if title != "gate"} == ahead
    assert {queue.ahead(job) for job in jobs} == {0}, "nothing is ahead of what is over"


def test_one_job_runs_at_a_time(desk: Desk) -> None:
    running, most = [0], [0]
    lock = threading.Lock()

    def work(progress: Progress) -> None:
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        threading.Event().wait(0.002)
        with lock:
            running[0] -= 1

    done(*(desk.submit(owner, "work", work) for owner in "abcd" for _ in range(4)))
    assert most == [1]


def test_cancelling_ends_what_waits_at_once_and_what_runs_when_it_tells_how_far_it_is(
    queue: JobQueue, desk: Desk, gate: Gate
) -> None:
    first, second, third = (desk.submit("a", name) for name in ("first", "second", "third"))
    queue.cancel(second)
    assert second.wait(0)
    assert second.state is State.CANCELLED
    assert desk.over == [second], "while the gate is still held"
    (running,) = [desk.submit("b", "running", hold := Gate())]
    gate.released.set()
    assert hold.began.wait(PATIENCE_SECONDS)
    queue.cancel(running)
    done(first, third, running)
    assert [job.state for job in (first, running, third)] == [State.DONE, State.CANCELLED, State.DONE]
    assert not running.error
    queue.cancel(third)
    assert third.state is State.DONE, "what is over stays as it is"


def test_what_was_cancelled_has_no_result_even_where_it_never_told_how_far_it_is(queue: JobQueue) -> None:
    began, go_on = threading.Event(), threading.Event()

    def silent(progress: Progress) -> str:
        began.set()
        assert go_on.wait(PATIENCE_SECONDS)
        return "made"

    desk = Desk(queue)
    job = desk.submit("a", "silent", silent)
    assert began.wait(PATIENCE_SECONDS)
    queue.cancel(job)
    go_on.set()
    assert job.wait(PATIENCE_SECONDS)
    assert (job.state, job.result) == (State.CANCELLED, None)


def test_cancelling_all_is_of_one_owner_alone(queue: JobQueue, desk: Desk) -> None:
    gate = Gate()
    mine = [desk.submit("me", "mine", gate), desk.submit("me", "mine"), desk.submit("me", "mine")]
    other = desk.submit("other", "other")
    assert gate.began.wait(PATIENCE_SECONDS)
    queue.cancel_all("me")
    done(*mine, other)
    assert {job.state for job in mine} == {State.CANCELLED}
    assert other.state is State.DONE
    queue.cancel_all("nobody")


def test_work_that_takes_too_long_is_stopped() -> None:
    queue = JobQueue(seconds=0.01)
    job = Desk(queue).submit("a", "making 4 motions", Gate())
    done(job)
    assert job.state is State.FAILED
    assert job.error == "making 4 motions was stopped after 0.01 seconds, the most that is allowed"
    after = Desk(queue).submit("a", "after")
    done(after)
    assert after.state is State.DONE
    queue.close()


def test_work_of_a_kind_replaces_that_which_waits_and_not_that_which_runs(desk: Desk) -> None:
    gate = Gate()
    running = desk.submit("a", "running", gate, kind="latent")
    assert gate.began.wait(PATIENCE_SECONDS)
    others = desk.submit("b", "another's", kind="latent"), desk.submit("a", "of another kind", kind="load")
    plain = desk.submit("a", "plain"), desk.submit("a", "plain")
    replaced = [desk.submit("a", f"moved {number}", kind="latent") for number in range(20)]
    assert {job.state for job in replaced[:-1]} == {State.CANCELLED}
    gate.released.set()
    done(running, *others, *plain, replaced[-1])
    assert {job.state for job in (running, *others, *plain, replaced[-1])} == {State.DONE}


def test_too_many_of_one_owner_are_refused_and_another_is_not(desk: Desk, gate: Gate) -> None:
    waiting = [desk.submit("a", "work") for _ in range(4)]
    with pytest.raises(MotionGenError, match="4 jobs of yours wait already; cancel one"):
        desk.submit("a", "one too many")
    waiting.append(desk.submit("b", "another's"))
    gate.released.set()
    done(*waiting)
    again = desk.submit("a", "again")
    done(again)
    assert again.state is State.DONE


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MotionGenError("the clip is empty;\ngive another"), "the clip is empty; give another"),
        (KeyError("a bug"), "motiongen failed: KeyError: 'a bug'"),
        (MemoryError(), "motiongen failed: MemoryError: "),
        (RecursionError("deep"), "motiongen failed: RecursionError: deep"),
    ],
)
def test_what_goes_wrong_in_work_is_said_and_ends_nothing(
    desk: Desk, error: Exception, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def work(progress: Progress) -> None:
        raise error

    failed, after = desk.submit("a", "work", work), desk.submit("a", "after")
    done(failed, after)
    assert (failed.state, failed.error, failed.result) == (State.FAILED, words, None)
    assert after.state is State.DONE
    assert ("Traceback" in capsys.readouterr().err) == (not isinstance(error, MotionGenError)), "a bug leaves a trace"


def test_an_owner_who_fails_to_take_the_result_ends_nothing(
    queue: JobQueue, gate: Gate, capsys: pytest.CaptureFixture[str]
) -> None:
    def gone(job: Job) -> None:
        raise RuntimeError("the visitor has left")

    jobs = [queue.submit("a", "work", lambda progress: 1, gone) for _ in range(2)]
    waiting = queue.submit("a", "cancelled", lambda progress: 1, gone)
    queue.cancel(waiting)
    gate.released.set()
    done(*jobs, waiting)
    assert {job.state for job in jobs} == {State.DONE}
    assert capsys.readouterr().err.count("the visitor has left") >= 3


def test_work_may_queue_more_when_it_is_over(queue: JobQueue) -> None:
    chain: list[Job] = []
    over = threading.Event()

    def follow(job: Job) -> None:
        if job.result == 3:
            over.set()
        else:
            chain.append(queue.submit("a", "next", lambda progress, after=job.result + 1: after, follow))

    queue.submit("a", "first", lambda progress: 0, follow)
    assert over.wait(PATIENCE_SECONDS)
    assert [job.result for job in chain] == [1, 2, 3]


def test_closing_cancels_everything_and_takes_nothing_more() -> None:
    queue = JobQueue(seconds=PATIENCE_SECONDS)
    desk, gate = Desk(queue), Gate()
    jobs = [desk.submit("a", "running", gate), desk.submit("a", "waiting"), desk.submit("b", "waiting")]
    assert gate.began.wait(PATIENCE_SECONDS)
    queue.close()
    done(*jobs)
    assert {job.state for job in jobs} == {State.CANCELLED}
    with pytest.raises(MotionGenError, match="the server is closing"):
        desk.submit("a", "late")
    queue.close()
