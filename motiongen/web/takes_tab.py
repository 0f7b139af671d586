"""The tab of takes: look at what was made, accept, reject, go on from one, download."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from motiongen.errors import MotionGenError
from motiongen.generators.base import Progress
from motiongen.motion import Motion
from motiongen.web.clip_tab import described, small
from motiongen.web.desk import Desk
from motiongen.web.fields import put
from motiongen.web.stage import Actor
from motiongen.web.uploads import file_bytes, file_name, written
from motiongen.web.wishes import Take

_NONE = "none yet"
FILES = ("BVH", "GLB", "NPZ", "preview (GIF)", "preview (page)")
_PREVIEWS = {"preview (GIF)": ".gif", "preview (page)": ".html"}
_PREVIEW_SECONDS, _PREVIEW_RATE = 10.0, 12.0


@dataclass(frozen=True, eq=False)
class Shown:
    """A motion on the stage.

    Attributes:
        label: what it is called in lists and above its head.
        motion: itself.
        take: that it is, or None for the clip.
    """

    label: str
    motion: Motion
    take: Take | None = None

    @property
    def actor(self) -> Actor:
        """As the stage takes it."""
        return Actor(self.motion, self.label, example=self.take is None)


class TakesTab:
    """Fields of the tab, in the container that is open when it is built."""

    def __init__(self, desk: Desk) -> None:
        """Build the fields."""
        self._desk = desk
        self._looked_at: Motion | None = None
        self._known: list[Motion] = []
        gui = desk.client.gui
        self._choice = gui.add_dropdown("Motion", (_NONE,), hint="What the buttons below are for")
        self._about = gui.add_html("")
        self._decide = gui.add_button_group("Decide", ("Accept", "Reject", "Reject the rest"))
        self._go_on = gui.add_button(
            "Work on this", icon=viser.Icon.ARROW_FORWARD_UP, color="gray", hint="It becomes a clip among the others"
        )
        self._kind = gui.add_dropdown("File", FILES)
        self._download = gui.add_button("Download", icon=viser.Icon.DOWNLOAD)
        self._choice.on_update(desk.act(desk.changed))
        self._decide.on_click(desk.act(self._decided))
        self._go_on.on_click(desk.act(lambda: desk.add_clip(self._selected().motion)))
        self._download.on_click(desk.act(self._send))
        desk.keep_field("takes/motion", self._choice)
        desk.keep_field("takes/file", self._kind)
        desk.listen(self._show)

    @property
    def number(self) -> int:
        """Which of `shown` is chosen."""
        options = self._choice.options
        return options.index(self._choice.value) if self._choice.value in options else 0

    def _selected(self) -> Shown:
        """What is chosen.

        Raises:
            MotionGenError: if there is nothing yet.
        """
        everything = shown(self._desk)
        if not everything:
            raise MotionGenError("there is no motion yet; load a clip, or make some")
        return everything[min(self.number, len(everything) - 1)]

    def _decided(self) -> None:
        take, word = self._selected().take, self._decide.value
        if word == "Reject the rest":
            self._desk.show_takes([])
        elif take is None:
            raise MotionGenError("this is the clip; choose one of the motions that were made")
        elif word == "Accept":
            self._desk.accept(take)
        else:
            self._desk.reject(take)

    def _send(self) -> None:
        motion, kind, client = self._selected().motion, self._kind.value, self._desk.client
        suffix = _PREVIEWS.get(kind, f".{kind.lower()}")

        def work(progress: Progress) -> bytes:
            return preview_bytes(motion, suffix, progress) if kind in _PREVIEWS else file_bytes(motion, suffix)

        def then(content: bytes) -> None:
            client.send_file_download(file_name(motion, suffix), content, save_immediately=True)
            self._desk.say("Sent", file_name(motion, suffix), "green")

        self._desk.start(f"writing {file_name(motion, suffix)}", work, then)

    def _show(self) -> None:
        before, everything = self.number, shown(self._desk)
        motions = [each.motion for each in everything]
        labels = tuple(each.label for each in everything) or (_NONE,)
        # New takes are looked at first, then whatever was looked at before; where that has gone, the next.
        known = {id(motion) for motion in self._known}
        new = [i for i, each in enumerate(everything) if each.take is not None and id(each.motion) not in known]
        if new or self._choice.options != labels:
            same = [i for i, motion in enumerate(motions) if motion is self._looked_at]
            self._choice.options = labels
            put(self._choice, labels[[*new, *same, min(before, len(labels) - 1)][0]])
        self._known = motions
        self._looked_at = motions[self.number] if motions else None
        self._about.content = small(described(self._looked_at) if self._looked_at else "Nothing has been made yet.")


def shown(desk: Desk) -> list[Shown]:
    """What stands on the stage: the clip, and the takes of its size of body, accepted ones first."""
    clip = [Shown(desk.clip.name, desk.clip)] if desk.clip is not None else []
    takes = sorted(desk.takes, key=lambda take: not take.accepted)
    labels = [each.label for each in clip]
    for take in takes:
        label, number = f"{take.label}{' ✓' if take.accepted else ''}", 2
        while label in labels:
            label, number = f"{take.label} ({number}){' ✓' if take.accepted else ''}", number + 1
        labels.append(label)
    return clip + [Shown(label, take.motion, take) for label, take in zip(labels[len(clip) :], takes)]


def preview_bytes(motion: Motion, suffix: str, progress: Progress) -> bytes:
    """A film or a page of the first seconds of a motion."""
    from motiongen.render import render_clips

    rate = _PREVIEW_RATE if suffix == ".gif" else None
    return written(
        suffix,
        lambda path: render_clips([motion], path, frame_rate=rate, seconds=_PREVIEW_SECONDS, progress=progress),
    )
