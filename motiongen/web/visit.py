"""One visitor's page: everything on it is theirs alone, and goes when they leave."""

from __future__ import annotations

import threading
import time
from typing import Any

import viser

from motiongen.contact import contact_labels, foot_joints
from motiongen.motion import Motion
from motiongen.web.clip_tab import ClipTab, example_clip
from motiongen.web.desk import Belongings, Desk
from motiongen.web.jobs import JobQueue
from motiongen.web.latent_tab import LatentTab
from motiongen.web.limits import Limits
from motiongen.web.make_tab import MakeTab
from motiongen.web.stage import Actor, Stage
from motiongen.web.status import StatusBar
from motiongen.web.takes_tab import TakesTab, shown
from motiongen.web.timeline import Labels, Marks, Timeline
from motiongen.web.view_tab import ViewTab

_PANEL_WIDTH = 410
_CLEAR = (0.04, 0.06, 0.96, 0.68)
"""What neither the panels nor the timeline lie over: left, top, right and bottom, as shares of the picture."""

_TICK_SECONDS = 1 / 30
_TICKS_PER_REFRESH = 4
"""The slider and the progress bar follow this much more slowly than the figures."""

_SETTLING_TICKS, _OTHER_ASPECT = 150, 0.02
_MOST_CONTACT_ROWS = 6


class Visit:
    """A page as one visitor has it, from the moment that it is opened."""

    def __init__(self, client: viser.ClientHandle, jobs: JobQueue, limits: Limits, left: Belongings | None) -> None:
        """Build the page and begin to play.

        Args:
            client: the visitor's browser.
            jobs: does the work of all visitors.
            limits: how much is granted.
            left: what the visitor has left behind; None for the bundled clip.
        """
        self._desk = desk = Desk(client, jobs, limits)
        self._on_stage: tuple[list[Actor], bool] = [], True
        self._followed: int | None = None
        self._contacts: tuple[Motion, dict[str, Labels]] | None = None
        self._left = threading.Event()
        self._clips_at_first: list[int] = []
        self._values_at_first: dict[str, Any] = {}
        with desk.lock:  # whatever the visitor does waits until everything is there
            self._build(client)
            if left is None:
                desk.add_clip(example_clip())
                self._clips_at_first, self._values_at_first = list(map(id, desk.clips)), desk.values()
            else:
                desk.take_up(left)
                desk.say("Here again", _again(left), "green")
        threading.Thread(target=self._play, name="motiongen page", daemon=True).start()

    def _build(self, client: viser.ClientHandle) -> None:
        """Put everything on the page."""
        desk, gui = self._desk, client.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_WIDTH)
        self._status = StatusBar(desk)
        self._stage, self._timeline = Stage(client, _CLEAR), Timeline(gui, client.camera.image_width - _PANEL_WIDTH)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Clip", viser.Icon.RUN):
            clips = ClipTab(desk)
        with tabs.add_tab("Make", viser.Icon.WAND):
            self._make = MakeTab(desk, clips, self._stage, self._timeline)
        with tabs.add_tab("Latent", viser.Icon.ADJUSTMENTS):
            LatentTab(desk, self._make)
        with tabs.add_tab("Takes", viser.Icon.MOVIE):
            self._takes = TakesTab(desk)
        with tabs.add_tab("View", viser.Icon.EYE):
            self._view = ViewTab(desk, self._stage)
        desk.listen(self._show)

    def close(self) -> Belongings | None:
        """The visitor has left: stop what is made for them; returns what they are to find when they come again."""
        self._left.set()
        left = self._desk.leave()
        # An empty page that came while the one before was still held must not hide what that one leaves.
        same = list(map(id, left.clips)) == self._clips_at_first and left.values == self._values_at_first
        return None if same and not left.takes else left

    def _show(self) -> None:
        """Bring stage and timeline up to date."""
        everything, clip = shown(self._desk), self._desk.clip
        actors = [each.actor for each in everything]
        if (actors, self._view.beside) != self._on_stage:
            before, beside = self._on_stage
            self._on_stage = actors, self._view.beside
            self._stage.show(actors, self._view.beside)
            if len(actors) > len(before) or actors[:1] != before[:1] or beside != self._view.beside:
                self._stage.frame_all()
        followed = self._takes.number if self._view.follow and actors else None
        if followed != self._followed:
            self._followed = followed
            self._stage.follow(followed)
        if everything:
            motion = everything[self._takes.number].motion
            self._timeline.span(len(motion), motion.frame_rate)
        else:
            self._timeline.span(1, 30.0)
        if clip is None:
            self._timeline.mark(Marks())
        else:
            asked = self._make
            self._timeline.mark(Marks(clip.frame_rate, asked.keys.keys, asked.segment.segment, self._standing(clip)))

    def _standing(self, clip: Motion) -> dict[str, Labels]:
        """Name of each foot joint -> when it stands."""
        if self._contacts is None or self._contacts[0] is not clip:
            feet = foot_joints(clip)[:_MOST_CONTACT_ROWS]
            stands = contact_labels(clip, feet)
            self._contacts = clip, {clip.skeleton.names[foot]: stands[:, i] for i, foot in enumerate(feet)}
        return self._contacts[1]

    def _play(self) -> None:
        """Move the figures on until the visitor leaves."""
        now, ticks, aspect = time.monotonic(), 0, self._desk.client.camera.aspect
        while not self._left.wait(max(0.0, now + _TICK_SECONDS - time.monotonic())):
            before, now = now, time.monotonic()
            self._stage.move_to(self._timeline.advance(now - before))
            ticks += 1
            if ticks % _TICKS_PER_REFRESH == 0:
                self._timeline.refresh()
                self._status.refresh()
                # The picture gets narrower when the panel comes beside it; later on the visitor decides.
                if ticks < _SETTLING_TICKS and abs(self._desk.client.camera.aspect - aspect) > _OTHER_ASPECT:
                    aspect = self._desk.client.camera.aspect
                    self._stage.frame_all()


def _again(left: Belongings) -> str:
    """What to tell a visitor who has come again."""
    stopped = f" Stopped meanwhile: {', '.join(left.stopped)}." if left.stopped else ""
    return f"The page was loaded anew or had lost its connection. Clips, motions and fields are as they were.{stopped}"
