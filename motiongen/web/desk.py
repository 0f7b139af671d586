"""What the parts of one visitor's page share: clips, takes, work under way, messages, and what is left behind."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import viser

from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.web.fields import put
from motiongen.web.jobs import Job, JobQueue, State, Work
from motiongen.web.limits import Limits
from motiongen.web.screening import fits
from motiongen.web.wishes import Take

Colour = Literal["red", "green"]
_MESSAGE_SECONDS = 12.0


@dataclass(frozen=True)
class Belongings:
    """What a visitor leaves behind, for the page that takes the place of this one.

    Attributes:
        clips: those that were loaded.
        chosen: which of them was worked on.
        takes: those that were made.
        values: what else was kept, by name.
        stopped: titles of the work that was under way.
    """

    clips: Sequence[Motion]
    chosen: int
    takes: Sequence[Take]
    values: Mapping[str, Any]
    stopped: Sequence[str]


class Desk:
    """The state of one visit. Whoever changes it calls `changed`, and all parts of the page show what there is.

    Attributes:
        client: the visitor's browser.
        limits: how much is granted.
        lock: held while anything here is read or changed.
        clips: those that were loaded.
        takes: those that were made and not rejected.
        jobs: those of this visitor that are not over.
    """

    def __init__(self, client: viser.ClientHandle, queue: JobQueue, limits: Limits) -> None:
        """Begin with nothing on the desk."""
        self.client, self.limits = client, limits
        self.lock = threading.RLock()
        self.clips: list[Motion] = []
        self.takes: list[Take] = []
        self.jobs: list[Job] = []
        self._queue = queue
        self._chosen = 0
        self._kept: dict[str, tuple[Callable[[], Any], Callable[[Any], None]]] = {}
        self._awaited: dict[str, Any] = {}
        self._listeners: list[Callable[[], None]] = []

    # -- clips and takes

    @property
    def clip(self) -> Motion | None:
        """The clip that is looked at and worked on."""
        return self.clips[self._chosen] if self.clips else None

    def add_clip(self, motion: Motion) -> None:
        """Take in a clip and work on it.

        Raises:
            MotionGenError: if there are too many.
        """
        if len(self.clips) >= self.limits.clips:
            raise MotionGenError(f"there are {len(self.clips)} clips already; remove one first")
        names = {clip.name for clip in self.clips}
        name, number = motion.name, 2
        while name in names:
            name, number = f"{motion.name} {number}", number + 1
        self.clips.append(motion.replace(name=name))
        self.choose(len(self.clips) - 1)

    def choose(self, number: int) -> None:
        """Work on another clip."""
        self._chosen = number
        self.changed()

    def remove_clip(self) -> None:
        """Forget the clip that is worked on."""
        if self.clips:
            del self.clips[self._chosen]
            self.choose(max(self._chosen - 1, 0))

    def show_takes(self, takes: Sequence[Take]) -> None:
        """New takes in place of those that were not accepted."""
        self.takes = [take for take in self.takes if take.accepted] + list(takes)
        self.changed()

    def swap(self, before: Take | None, after: Take) -> None:
        """A take in the place of another one, or beside the others where that one has gone or was accepted."""
        if any(each is before for each in self.takes):
            self.takes = [after if each is before else each for each in self.takes]
        else:
            self.takes = [*self.takes, after]
        self.changed()

    def accept(self, take: Take) -> None:
        """Keep a take."""
        self.takes = [replace(each, accepted=True) if each is take else each for each in self.takes]
        self.changed()

    def reject(self, take: Take) -> None:
        """Throw a take away."""
        self.takes = [each for each in self.takes if each is not take]
        self.changed()

    # -- telling each other

    def listen(self, shown: Callable[[], None]) -> None:
        """Call `shown` whenever something has changed."""
        self._listeners.append(shown)

    def changed(self) -> None:
        """Show everything as it is now."""
        for shown in self._listeners:
            shown()

    def act(self, do: Callable[[], Any]) -> Callable[[Any], None]:
        """What to do when the visitor clicks: `do`, one at a time, and a message if it goes wrong."""

        def acted(event: Any) -> None:
            if getattr(event, "client_id", 0) is None:
                return  # the page itself moved the control
            with self.lock:
                try:
                    do()
                except MotionGenError as error:
                    self.say("That does not go", str(error))
                except Exception as error:
                    traceback.print_exc()
                    self.say("motiongen failed", f"{type(error).__name__}: {error}")

        return acted

    def say(self, title: str, text: str, colour: Colour = "red") -> None:
        """Show a message on the page."""
        self.client.add_notification(
            title=title, body=" ".join(text.split()), color=colour, auto_close_seconds=_MESSAGE_SECONDS
        )

    # -- leaving and coming again

    def keep(self, name: str, read: Callable[[], Any], write: Callable[[Any], None]) -> None:
        """Have something be there again on the page that takes the place of this one.

        Args:
            name: the same on both pages. What is kept anew under a name takes the place of what was.
            read: gives it, when the visitor leaves.
            write: takes it; called at once if it is waited for already.
        """
        self._kept[name] = read, write
        if name in self._awaited:
            write(self._awaited.pop(name))

    def keep_field(self, name: str, field: Any, then: Callable[[], None] = lambda: None) -> None:
        """Likewise for the value of a field, where it still fits; `then` does what moving the field does."""

        def write(value: Any) -> None:
            if fits(field, list(value) if isinstance(value, tuple) else value):
                put(field, value)
                then()

        self.keep(name, lambda: field.value, write)

    def set_aside(self, names: str) -> None:
        """Put what is kept under names that begin so aside, until something is kept under them anew."""
        for name in [each for each in self._kept if each.startswith(names)]:
            read, _ = self._kept.pop(name)
            self._awaited.setdefault(name, read())

    def values(self) -> dict[str, Any]:
        """What is kept, by name."""
        return {**self._awaited, **{name: read() for name, (read, _) in self._kept.items()}}

    def leave(self) -> Belongings:
        """Stop all work, and give what is to be kept."""
        with self.lock:
            stopped = [job.title for job in self.jobs]
            left = Belongings(tuple(self.clips), self._chosen, tuple(self.takes), self.values(), stopped)
        self.cancel()
        return left

    def take_up(self, left: Belongings) -> None:
        """Go on with what was left behind; parts of the page that come later find theirs when they come."""
        self.clips, self.takes = list(left.clips), list(left.takes)
        self.choose(left.chosen)
        self._awaited = dict(left.values)
        for name in list(self._kept):
            if name in self._kept and name in self._awaited:  # what comes before may change what there is
                _, write = self._kept[name]
                write(self._awaited.pop(name))
        self.changed()

    # -- work

    def start(self, title: str, work: Work, then: Callable[[Any], None], kind: str = "") -> Job:
        """Queue work.

        Args:
            title: what it is, as in "making 4 motions".
            work: takes a function to call with the share done, and returns the result. It must not touch the desk.
            then: what to do with the result.
            kind: work of this kind replaces that which still waits; empty: none does.

        Raises:
            MotionGenError: if too much waits already.
        """
        with self.lock:  # which the job's end waits for
            job = self._queue.submit(self, title, work, lambda job: self._finished(job, then), kind)
            self.jobs.append(job)
        return job

    def cancel(self) -> None:
        """Stop all work of this visitor."""
        self._queue.cancel_all(self)

    def ahead(self, job: Job) -> int:
        """How many jobs, of whomever, come before this one."""
        return self._queue.ahead(job)

    def _finished(self, job: Job, then: Callable[[Any], None]) -> None:
        with self.lock:
            self.jobs = [each for each in self.jobs if each is not job]
        if job.state is State.DONE:
            self.act(lambda: then(job.result))(None)
        elif job.state is State.FAILED:
            self.say("That does not go", job.error)
