"""The tab where motions are asked for: the generator, its options, and what the motions must keep to."""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import Any

import viser

from motiongen.errors import MotionGenError
from motiongen.generators.base import Generator, Progress
from motiongen.generators.options import Options
from motiongen.generators.registry import GeneratorSpec, specs
from motiongen.motion import Motion
from motiongen.web.ask_fields import KeptFields, KeyFields, LoopFields, PathFields, SegmentFields
from motiongen.web.clip_tab import ClipTab, small
from motiongen.web.desk import Desk
from motiongen.web.fields import OptionFields, put
from motiongen.web.stage import Stage
from motiongen.web.timeline import Timeline
from motiongen.web.wishes import MOST_TAKES, Take, Wish, make_takes

_OPTIONS = "make/options/"


class MakeTab:
    """Fields of the tab, in the container that is open when it is built."""

    def __init__(self, desk: Desk, clips: ClipTab, stage: Stage, timeline: Timeline) -> None:
        """Build the fields."""
        self._desk, self._clips = desk, clips
        self._specs = usable_specs()
        self._made: tuple[Any, Generator] | None = None
        self._clip: Motion | None = None
        self._chosen: list[Callable[[], None]] = []
        gui = desk.client.gui
        self._name = gui.add_dropdown("Generator", tuple(self._specs))
        self._about = gui.add_html("")
        self._frames = gui.add_number("Frames", 1, min=1, max=desk.limits.frames, step=1, hint="Length of each motion")
        self._length = gui.add_html("")
        self._count = gui.add_slider("Motions", 1, MOST_TAKES, 1, 2, hint="How many to make")
        self._seed = gui.add_number("Seed", 0, min=0, step=1, hint="The same seed gives the same motions")
        self._compare = gui.add_checkbox("A seed for each", False, hint="To compare seeds: this one, the next, ...")
        make = gui.add_button("Make motions", icon=viser.Icon.WAND)
        desk.keep("make/generator", lambda: self._name.value, self._go_back_to)  # first: the other fields depend on it
        asked = {"frames": self._frames, "count": self._count, "seed": self._seed, "compare": self._compare}
        for name, field in asked.items():
            desk.keep_field(f"make/{name}", field)
        self.loop = LoopFields(desk)
        self.keys = KeyFields(desk, timeline)
        self.segment = SegmentFields(desk, timeline)
        self.kept = KeptFields(desk)
        self.path = PathFields(desk, stage)
        self._folder = gui.add_folder("Options", expand_by_default=False)
        self._options: OptionFields | None = None
        self._choose()
        self._name.on_update(desk.act(self._choose))
        self._frames.on_update(desk.act(self._show_length))
        make.on_click(desk.act(self._make))
        desk.listen(self._show)

    # -- what other parts of the page ask

    @property
    def spec(self) -> GeneratorSpec:
        """The generator that is chosen."""
        return self._specs[self._name.value]

    @property
    def frames(self) -> int:
        """How long motions are to be."""
        return int(self._frames.value)

    def on_choice(self, told: Callable[[], None]) -> None:
        """Call `told` when another generator is chosen, and now."""
        self._chosen.append(told)
        told()

    def generator(self) -> Callable[[], Generator]:
        """What makes, or finds, the generator with the options and examples of now; to be called in a job.

        Raises:
            MotionGenError: if a field holds what its option cannot be, or the generator needs a clip and has none.
        """
        spec, options = self.spec, self.options()
        examples = () if spec.capabilities.needs_training else self._clips.examples
        if not examples and not spec.capabilities.needs_training:
            raise MotionGenError(f"{spec.name} learns from clips, and there is none; load one first")
        key = (spec.name, options, *map(id, examples))

        def find() -> Generator:
            if self._made is None or self._made[0] != key:
                generator = spec.create(options)
                self._made = (key, generator.fit(examples) if examples else generator)
            return self._made[1]

        return find

    def options(self) -> Options:
        """The generator's options as the fields say."""
        if self._options is None:
            return self.spec.options_type().build({})
        return self._options.options()

    # -- what the visitor does

    def _choose(self) -> None:
        """Go over to the generator that is chosen, and to the length that is usual for it."""
        self._show_generator()
        if self.spec.capabilities.needs_training:
            self._desk.start(f"loading {self.spec.name}", self._load, self._loaded, "load")
        elif self._desk.clip is not None:
            put(self._frames, len(self._desk.clip))
        self._tell()  # last: whatever others make of it comes after the length

    def _go_back_to(self, name: str) -> None:
        """Likewise on a page that takes the place of another one; the length comes from there."""
        put(self._name, name)
        self._show_generator()
        self._tell()

    def _show_generator(self) -> None:
        """Show the fields of the generator that is chosen."""
        spec = self.spec
        self._about.content = small(html.escape(spec.description))
        if self._options is not None:
            self._desk.set_aside(_OPTIONS)
            self._options.remove()
        with self._folder:
            self._options = OptionFields(self._desk.client.gui, spec.options_type())
        for name, field in self._options.fields.items():
            self._desk.keep_field(f"{_OPTIONS}{spec.name}/{name}", field)

    def _tell(self) -> None:
        """Tell the others which generator is chosen."""
        for told in self._chosen:
            told()
        self._show()

    def _load(self, progress: Progress) -> Generator:
        return self.generator()()

    def _loaded(self, generator: Generator) -> None:
        if self.spec.capabilities.needs_training:
            put(self._frames, generator.usual_frames)
            self._show_length()

    def _make(self) -> None:
        wish, find, limits = self._wish(), self.generator(), self._desk.limits
        clip = None if self.spec.capabilities.needs_training else self._desk.clip

        def work(progress: Progress) -> list[Take]:
            generator = find()
            progress(0.0)
            return make_takes(generator, clip, wish, limits, progress)

        title = f"making {wish.count} motion{'s' if wish.count > 1 else ''}"
        self._desk.start(title, work, self._desk.show_takes)

    def _wish(self) -> Wish:
        offered = self.spec.capabilities.constraints
        segment = self.segment.segment
        frames = self.frames
        if segment is not None and self._desk.clip is not None:
            frames = len(self._desk.clip)  # all of it comes back, with the segment made anew
        return Wish(
            frames=frames,
            count=int(self._count.value),
            seed=int(self._seed.value),
            compare=bool(self._compare.value),
            keys=self.keys.keys if self.keys.kind in offered else (),
            segment=segment,
            kept=self.kept.kept,
            path=self.path.points if self.path.kind in offered else (),
            loop=self.loop.loop,
        )

    # -- showing

    def _show(self) -> None:
        clip, offered = self._desk.clip, self.spec.capabilities.constraints
        if clip is not self._clip and clip is not None and not self.spec.capabilities.needs_training:
            put(self._frames, min(len(clip), self._desk.limits.frames))
        self._clip = clip
        self._frames.disabled = self.segment.segment is not None
        for fields in (self.loop, self.keys, self.segment, self.kept, self.path):
            fields.show(clip, offered)
        self._show_length()

    def _show_length(self) -> None:
        """Say how long the motions will be in time, where it is known what that many frames are."""
        said, clip, made = "", self._desk.clip, self._made
        if not self.spec.capabilities.needs_training:
            said = f"{self.frames / clip.frame_rate:.2f} s at the clip's {clip.frame_rate:g} Hz" if clip else ""
        elif made is not None and made[0][0] == self.spec.name:
            said = f"{self.frames / made[1].frame_rate:.2f} s at {made[1].frame_rate:g} Hz"
        self._length.content = small(said) if said else ""


def usable_specs() -> dict[str, GeneratorSpec]:
    """The generators that can be loaded, by name."""
    usable = {}
    for name, spec in specs().items():
        try:
            spec.generator_type(), spec.options_type()
        except MotionGenError:
            continue  # `motiongen list` says why
        usable[name] = spec
    return usable
