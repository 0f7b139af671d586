"""The tab that says how the stage is looked at."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from motiongen.web.desk import Desk
from motiongen.web.stage import Stage

_BESIDE, _TOGETHER = "side by side", "on one spot"


class ViewTab:
    """Fields of the tab, in the container that is open when it is built."""

    def __init__(self, desk: Desk, stage: Stage) -> None:
        """Build the fields."""
        gui = desk.client.gui
        self._places = gui.add_dropdown("Motions", (_BESIDE, _TOGETHER))
        self._follow = gui.add_checkbox("Camera follows", False, hint="The motion that is chosen under Takes")
        self._paths = gui.add_checkbox("Ways over the ground", stage.paths)
        self._contacts = gui.add_checkbox("Standing feet", stage.contacts)
        self._shadows = gui.add_checkbox("Shadows", True, hint="Without them the page is quicker on a slow machine")
        everything = gui.add_button("See everything", icon=viser.Icon.MAXIMIZE, color="gray")
        lights = desk.client.scene.configure_default_lights
        fields: tuple[tuple[str, Any, Callable[[], None]], ...] = (
            ("places", self._places, desk.changed),
            ("follow", self._follow, desk.changed),
            ("paths", self._paths, lambda: setattr(stage, "paths", self._paths.value)),
            ("contacts", self._contacts, lambda: setattr(stage, "contacts", self._contacts.value)),
            ("shadows", self._shadows, lambda: lights(cast_shadow=self._shadows.value)),
        )
        for name, field, moved in fields:
            field.on_update(desk.act(moved))
            desk.keep_field(f"view/{name}", field, moved)
        everything.on_click(desk.act(stage.frame_all))

    @property
    def beside(self) -> bool:
        """Whether motions stand beside each other."""
        return bool(self._places.value == _BESIDE)

    @property
    def follow(self) -> bool:
        """Whether the camera goes along."""
        return bool(self._follow.value)
