"""The tab of a latent space: sliders that move one motion through it, with the figure moving along."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import viser
from numpy.typing import NDArray

from motiongen.attributes import attributes
from motiongen.errors import MotionGenError
from motiongen.generators.base import Progress
from motiongen.motion import Motion
from motiongen.web.clip_tab import small
from motiongen.web.desk import Desk
from motiongen.web.fields import put, spoken
from motiongen.web.make_tab import MakeTab
from motiongen.web.places import STARTS, Place, code_of
from motiongen.web.wishes import Take

if TYPE_CHECKING:
    from motiongen.generators.modi.directions import Direction
    from motiongen.generators.modi.generator import MoDi

_FARTHEST, _STEP = 3.0, 0.1
"""How far a slider goes along a direction, in deviations: nearly as far as motions of training are."""

_FARTHEST_FROM_MEAN = 1.5

_OF_SPACE = "latent/space/"


class LatentTab:
    """Fields of the tab, in the container that is open when it is built."""

    def __init__(self, desk: Desk, make: MakeTab) -> None:
        """Build the fields; those of the directions come with a generator."""
        self._desk, self._make = desk, make
        self._take: Take | None = None
        self._inverted: tuple[Motion, NDArray[Any]] | None = None
        self._directions: dict[str, tuple[Direction, viser.GuiSliderHandle]] = {}
        self._layers = 0
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
        with gui.add_folder("Detail of another seed", expand_by_default=False):
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
        self._desk.keep("latent/shown", lambda: (self._take, self._inverted), self._go_back_to)
        invert.on_click(act(self._invert))
        keep.on_click(act(self._keep))
        reset.on_click(act(self._reset))

    # -- another generator

    def _chosen(self) -> None:
        spaced = self._make.spec.capabilities.has_latent_space
        self._about.visible, self._fields.visible = not spaced, spaced
        if spaced:
            find = self._make.generator()
            self._desk.start(f"loading {self._make.spec.name}", lambda progress: _known(find()), self._ready, "latent")

    def _ready(self, known: tuple[int, Mapping[str, Direction]]) -> None:
        """Show sliders for the layers and directions of the generator."""
        if not self._fields.visible:
            return  # another one has been chosen meanwhile
        self._layers, directions = known
        self._desk.set_aside(_OF_SPACE)
        self._coarse.max = self._layers
        put(self._coarse, self._layers)
        self._desk.keep_field(f"{_OF_SPACE}layers", self._coarse)
        for _, slider in self._directions.values():
            slider.remove()
        summaries = {name: each.summary for name, each in attributes().items()}
        gui = self._desk.client.gui
        with self._more:
            self._directions = {
                name: (
                    direction,
                    gui.add_slider(spoken(name), -_FARTHEST, _FARTHEST, _STEP, 0.0, hint=summaries.get(name)),
                )
                for name, direction in directions.items()
            }
        for name, (_, slider) in self._directions.items():
            slider.on_update(self._desk.act(self._move))
            self._desk.keep_field(f"{_OF_SPACE}more of {name}", slider)
        self._move()

    def _go_back_to(self, shown: tuple[Take | None, tuple[Motion, NDArray[Any]] | None]) -> None:
        self._take, self._inverted = shown

    # -- what the visitor does

    def _place(self) -> Place:
        return Place(
            start=self._start.value,
            seed=int(self._seed.value),
            end_seed=int(self._end_seed.value),
            share=float(self._share.value),
            detail_seed=int(self._detail_seed.value),
            coarse_layers=int(self._coarse.value),
            truncation=float(self._truncation.value),
            strengths={name: float(slider.value) for name, (_, slider) in self._directions.items()},
        )

    def _move(self) -> None:
        """Make the motion of where the sliders stand, and show it in place of the last one."""
        if not (self._layers and self._fields.visible):
            return
        place, find, frames = self._place(), self._make.generator(), self._make.frames
        clip, inverted = self._desk.clip, self._inverted
        code = inverted[1] if inverted is not None and inverted[0] is clip else None
        directions = {name: direction for name, (direction, _) in self._directions.items()}

        def work(progress: Progress) -> Take:
            generator: Any = find()
            (motion,) = generator.decode(code_of(generator, place, code, directions)[None], frames)
            return Take(motion.replace(name="latent"), place.label)

        self._desk.start("moving through the latent space", work, self._show, "latent")

    def _show(self, take: Take) -> None:
        before, self._take = self._take, take
        self._desk.swap(before, take)

    def _invert(self) -> None:
        clip, find = self._desk.clip, self._make.generator()
        if clip is None:
            raise MotionGenError("there is no clip to invert; load one first")

        def work(progress: Progress) -> NDArray[Any]:
            generator: Any = find()
            return inverted(generator, clip, progress)

        def then(code: NDArray[Any]) -> None:
            self._inverted = clip, code
            put(self._start, STARTS[1])
            self._move()

        self._desk.start("inverting the clip", work, then)

    def _keep(self) -> None:
        if self._take is None:
            raise MotionGenError("there is no motion to keep yet; move a slider")
        self._desk.accept(self._take)
        self._take = None

    def _reset(self) -> None:
        for field, value in ((self._truncation, 1.0), (self._share, 0.0), (self._coarse, self._layers)):
            put(field, value)
        for _, slider in self._directions.values():
            put(slider, 0.0)
        self._move()


def _known(generator: Any) -> tuple[int, dict[str, Direction]]:
    """How many layers a generator's codes have, and the directions that came with it."""
    from motiongen.generators.modi.directions import kept_directions, load_direction

    kept = kept_directions(generator)
    return generator.latent_layers, {name: load_direction(path, generator) for name, path in kept.items()}


def inverted(generator: MoDi, clip: Motion, progress: Progress) -> NDArray[Any]:
    """(L, S) the code whose motion is most like the first window of a clip."""
    from motiongen.generators.modi.inversion import InversionOptions, invert

    return invert(generator, clip, InversionOptions(windows=1), progress).codes[0]
