"""The tab of clips: load some, choose one, see what is in it."""

from __future__ import annotations

import html
from collections.abc import Sequence

import viser

from motiongen import io
from motiongen.assets import EXAMPLE_CLIP
from motiongen.generators.base import Progress
from motiongen.motion import Motion
from motiongen.web.desk import Desk
from motiongen.web.fields import put
from motiongen.web.uploads import SUFFIXES, read_upload

_NONE = "none yet"


class ClipTab:
    """Fields of the tab, in the container that is open when it is built."""

    def __init__(self, desk: Desk) -> None:
        """Build the fields."""
        self._desk = desk
        gui = desk.client.gui
        kinds = ", ".join(suffix[1:].upper() for suffix in SUFFIXES)
        most = f"{kinds}, at most {desk.limits.upload_bytes / 2**20:g} MiB"
        self._upload = gui.add_upload_button(
            "Load a clip", icon=viser.Icon.UPLOAD, mime_type=",".join(SUFFIXES), hint=most
        )
        bundled = gui.add_button(
            "Bundled clip", icon=viser.Icon.RUN, hint="CMU subject 1: jumping forward and turning round", color="gray"
        )
        self._choice = gui.add_dropdown("Clip", (_NONE,), hint="What keys, segments and kept joints are taken from")
        self._all = gui.add_checkbox(
            "Learn from all clips of this rig", False, visible=False, hint="All of them are examples, not this one only"
        )
        self._facts = gui.add_html("")
        self._remove = gui.add_button("Remove this clip", icon=viser.Icon.TRASH, color="gray", visible=False)
        self._upload.on_upload(desk.act(self._read))
        bundled.on_click(desk.act(lambda: desk.add_clip(example_clip())))
        self._choice.on_update(desk.act(lambda: desk.choose(self._choice.options.index(self._choice.value))))
        self._all.on_update(desk.act(desk.changed))
        self._remove.on_click(desk.act(desk.remove_clip))
        desk.keep_field("clip/all", self._all)
        desk.listen(self._show)

    @property
    def examples(self) -> tuple[Motion, ...]:
        """The clips to learn from: the one that is worked on first."""
        clip = self._desk.clip
        if clip is None:
            return ()
        return (clip, *self._others(clip)) if self._all.value else (clip,)

    def _others(self, clip: Motion) -> Sequence[Motion]:
        """The other clips of the same rig."""
        return [
            each
            for each in self._desk.clips
            if each is not clip and clip.skeleton.difference(each.skeleton, ignoring=each.translating) is None
        ]

    def _read(self) -> None:
        """Read what was sent, in the queue as all work is."""
        desk, sent = self._desk, self._upload.value

        def work(progress: Progress) -> Motion:
            return read_upload(sent.name, sent.content, desk.limits)

        def then(motion: Motion) -> None:
            desk.add_clip(motion)
            desk.say(f"'{motion.name}' is loaded", described(motion), "green")

        desk.start("reading a clip", work, then)

    def _show(self) -> None:
        clips, clip = self._desk.clips, self._desk.clip
        self._choice.options = tuple(each.name for each in clips) or (_NONE,)
        put(self._choice, clip.name if clip else _NONE)
        self._facts.content = facts(clip) if clip else small("Load a clip of your own rig, or take the bundled one.")
        self._all.visible = clip is not None and len(self._others(clip)) > 0
        self._remove.visible = clip is not None


def example_clip() -> Motion:
    """The clip that comes with the package."""
    return io.load(EXAMPLE_CLIP)


def described(motion: Motion) -> str:
    """How long a clip is, and of how many joints, in one line."""
    seconds = len(motion) / motion.frame_rate
    return f"{len(motion)} frames, {seconds:.1f} s at {motion.frame_rate:g} Hz, {len(motion.skeleton)} joints"


def facts(motion: Motion) -> str:
    """What is in a clip, and what is odd about it, as HTML."""
    height = f"{motion.skeleton.height:.3g} {motion.unit or 'units'} tall"
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in motion.notes)
    return small(f"{described(motion)}, {height}<ul style='margin:4px 0;padding-left:18px'>{notes}</ul>")


def small(text: str) -> str:
    """Small print, as HTML."""
    return f"<div style='margin:2px 12px 6px;font-size:12px;line-height:1.45;opacity:.8'>{text}</div>"
