"""The tab of a latent space: sliders that move one motion through it, with the figure moving along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import viser
from numpy.typing import NDArray

from motiongen.attributes import attributes
from motiongen.errors import MotionGenError
from motiongen.generators.base import Progress
from motiongen.generators.options import Options
from motiongen.motion import Motion
from motiongen.web.clip_tab import small
from motiongen.web.desk import Desk
from motiongen.web.fields import put, spoken
from motiongen.web.make_tab import MakeTab
from motiongen.web.places import STARTS, Place, Space, code_of, space_of
from motiongen.web.wishes import Take

_FARTHEST, _STEP = 3.0, 0.1
"""How far a slider goes along a direction, in deviations: nearly as far as motions of training are."""

_FARTHEST_FROM_MEAN = 1.5

_OF_SPACE = "latent/space/"


@dataclass(frozen=True, eq=False)
class _Inverted:
    """The code of a clip, and the name and options of the generator whose code it is."""

    clip: Motion
    by: tuple[str, Options]
    code: NDArray[Any]


class LatentTab:
    """Fields of the tab, in the container that is open when it is built."""

    def __init__(self, desk: Desk, make: MakeTab) -> None:
        """Build the fields; those of the directions come with a generator."""
        self._desk, self._make = desk, make
        self._take: Take | None = None
        self._inverted: _Inverted | None = None
        self._space: Space | None = None
        self._coming_again = False
        self._strengths: dict[str, viser.GuiSliderHandle] = {}
        gui = desk.client.gui
        self._about = gui.add_html(small("Choose a generator with a latent space under Make, such as modi."))
        self._fields = gui.add_folder(None, visible=False)
        with self._fields:
            self._build(gui)
        make.on_choice(self._chosen)

    def _build(self, gui: viser.GuiApi) -> None:
        act = self._desk.act
        self._start = gui.add_dropdown("Start from", STARTS)
        self._seed = gui.add_number("Seed", 0, min=0, step=1)
        invert = gui.add_button(
            "Invert the clip", icon=viser.Icon.TARGET, color="gray", hint="Find the place whose motion is like the clip"
        )
        self._truncation = gui.add_slider(
            "Away from the mean", 0.0, _FARTHEST_FROM_MEAN, 0.05, 1.0, hint="Truncation: 0 is the mean motion"
        )
        with gui.add_folder("Towards another seed", expand_by_default=False):
            self._end_seed = gui.add_number("Seed", 1, min=0, step=1)
            self._share = gui.add_slider("How far", 0.0, 1.0, 0.02, 0.0)
        self._detail = gui.add_folder("Detail of another seed", expand_by_default=False)
        with self._detail:
            self._detail_seed = gui.add_number("Seed", 2, min=0, step=1)
            self._coarse = gui.add_slider("Layers kept", 0, 1, 1, 1, hint="The finer layers take the other's code")
        self._more = gui.add_folder("More or less of", expand_by_default=True)
        keep = gui.add_button("Keep this motion", icon=viser.Icon.THUMB_UP)
        reset = gui.add_button("Back to the start", icon=viser.Icon.RESTORE, color="gray")
        moving: dict[str, Any] = {
            "start": self._start,
            "seed": self._seed,
            "truncation": self._truncation,
            "end seed": self._end_seed,
            "share": self._share,
            "detail seed": self._detail_seed,
        }
        for name, field in moving.items():
            field.on_update(act(self._move))
            self._desk.keep_field(f"latent/{name}", field)
        self._coarse.on_update(act(self._move))  # kept when it is known how many layers there are
        self._desk.keep("latent/shown", lambda: (self._take, self._inverted, self._space is not None), self._go_back_to)
        invert.on_click(act(self._invert))
        keep.on_click(act(self._keep))
        reset.on_click(act(self._reset))

    # -- another generator

    def _chosen(self) -> None:
        spaced = self._make.spec.capabilities.has_latent_space
        self._about.visible, self._fields.visible = not spaced, spaced
        self._space = None
        if spaced:
            find: Any = self._make.generator()
            title = f"loading {self._make.spec.name}"
            self._desk.start(title, lambda progress: space_of(find()), self._ready, "space")

    def _ready(self, space: Space) -> None:
        """Show sliders for the layers and directions of the generator."""
        if not self._fields.visible:
            return  # another one has been chosen meanwhile
        self._space = space
        self._desk.set_aside(_OF_SPACE)
        self._detail.visible, self._more.visible = space.layers > 1, bool(space.directions)
        self._coarse.max = max(space.layers, 1)
        put(self._coarse, self._coarse.max)
        own = f"{_OF_SPACE}{self._make.spec.name}/"
        if space.layers:
            self._desk.keep_field(f"{own}layers", self._coarse)
        for slider in self._strengths.values():
            slider.remove()
        summaries = {name: each.summary for name, each in attributes().items()}
        gui = self._desk.client.gui
        with self._more:
            self._strengths = {
                name: gui.add_slider(spoken(name), -_FARTHEST, _FARTHEST, _STEP, 0.0, hint=summaries.get(name))
                for name in space.directions
            }
        for name, slider in self._strengths.items():
            slider.on_update(self._desk.act(self._move))
            self._desk.keep_field(f"{own}more of {name}", slider)
        gone = self._coming_again and not any(each is self._take for each in self._desk.takes)
        self._coming_again = False
        if not gone:
            self._move()

    def _go_back_to(self, shown: tuple[Take | None, _Inverted | None, bool]) -> None:
        """Where another page was; a motion that was kept or made way for others there does not come again."""
        self._take, self._inverted, self._coming_again = shown

    # -- what the visitor does

    @property
    def _by(self) -> tuple[str, Options]:
        return self._make.spec.name, self._make.options()

    def _place(self) -> Place:
        return Place(
            start=self._start.value,
            seed=int(self._seed.value),
            end_seed=int(self._end_seed.value),
            share=float(self._share.value),
            detail_seed=int(self._detail_seed.value),
            coarse_layers=int(self._coarse.value),
            truncation=float(self._truncation.value),
            strengths={name: float(slider.value) for name, slider in self._strengths.items()},
        )

    def _move(self) -> None:
        """Make the motion of where the sliders stand, and show it in place of the last one."""
        space = self._space
        if space is None or not self._fields.visible:
            return
        place, find, frames = self._place(), self._make.generator(), self._make.frames
        found = self._inverted
        code = found.code if found is not None and found.clip is self._desk.clip and found.by == self._by else None

        def work(progress: Progress) -> Take:
            generator: Any = find()
            (motion,) = generator.decode(code_of(generator, place, code, space)[None], frames)
            return Take(motion.replace(name="latent"), place.label)

        self._desk.start("moving through the latent space", work, self._show, "latent")

    def _show(self, take: Take) -> None:
        before, self._take = self._take, take
        self._desk.swap(before, take)

    def _invert(self) -> None:
        clip, by, find = self._desk.clip, self._by, self._make.generator()
        if clip is None:
            raise MotionGenError("there is no clip to invert; load one first")

        def work(progress: Progress) -> NDArray[Any]:
            generator: Any = find()
            return generator.invert(clip, progress=progress)

        def then(code: NDArray[Any]) -> None:
            self._inverted = _Inverted(clip, by, code)
            put(self._start, STARTS[1])
            self._move()

        self._desk.start("inverting the clip", work, then)

    def _keep(self) -> None:
        if self._take is None:
            raise MotionGenError("there is no motion to keep yet; move a slider")
        self._desk.accept(self._take)
        self._take = None

    def _reset(self) -> None:
        for field, value in ((self._truncation, 1.0), (self._share, 0.0), (self._coarse, self._coarse.max)):
            put(field, value)
        for slider in self._strengths.values():
            put(slider, 0.0)
        self._move()
