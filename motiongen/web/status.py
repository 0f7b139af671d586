"""The line above the tabs that says what is being worked on, how far it is, and lets it be cancelled."""

from __future__ import annotations

import html

import viser

from motiongen.web.clip_tab import small
from motiongen.web.desk import Desk
from motiongen.web.fields import put
from motiongen.web.jobs import State


class StatusBar:
    """A line of text, a bar and a button; the last two only while something is worked on."""

    def __init__(self, desk: Desk) -> None:
        """Build them."""
        self._desk = desk
        gui = desk.client.gui
        self._text = gui.add_html(small("Ready."))
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, color="red", visible=False)
        self._cancel.on_click(desk.act(desk.cancel))
        self._shown = ""

    def refresh(self) -> None:
        """Show how things stand."""
        with self._desk.lock:
            jobs = list(self._desk.jobs)
        text = "Ready."
        if jobs:
            job = next((each for each in jobs if each.state is State.RUNNING), jobs[0])
            put(self._bar, round(100 * job.share))
            text = f"{job.title[:1].upper()}{job.title[1:]}: "
            text += f"{job.share:.0%}" if job.state is State.RUNNING else f"waiting, {self._desk.ahead(job)} before it"
            text += f", and {len(jobs) - 1} more" if len(jobs) > 1 else ""
        if text != self._shown:
            self._shown = text
            self._text.content = small(html.escape(text))
            self._bar.visible = self._cancel.visible = bool(jobs)
