"""A visit that only keeps what came of it."""

from __future__ import annotations

import threading
from typing import Any, ClassVar

import viser

from motiongen.web.limits import Limits
from tests.web.wire import say, wait_until


class Page:
    """Has a widget of every kind."""

    all: ClassVar[list[Page]] = []

    def __init__(self, client: viser.ClientHandle, jobs: object, limits: Limits, left: Any = None) -> None:
        self.client, self.closed, self.heard, self.left = client, 0, [], left
        gui = client.gui
        self.widgets: dict[str, Any] = {
            "slider": gui.add_slider("slider", 0.0, 1.0, 0.1, 0.5),
            "steps": gui.add_slider("steps", 0, 10, 1, 5),
            "number": gui.add_number("number", 3.0),
            "seed": gui.add_number("seed", 3, min=0),
            "text": gui.add_text("text", "before"),
            "check": gui.add_checkbox("check", False),
            "choice": gui.add_dropdown("choice", ("a", "b")),
            "group": gui.add_button_group("group", ("x", "y")),
            "vector": gui.add_vector3("vector", (0.0, 0.0, 0.0), min=(-1.0, -1.0, -1.0)),
            "range": gui.add_multi_slider("range", 0, 10, 1, (2, 8)),
            "button": gui.add_button("button"),
            "off": gui.add_button("off", disabled=True),
            "upload": gui.add_upload_button("upload"),
        }
        self.command = gui.add_command("command")
        self.command.on_trigger(lambda _: self.heard.append(("command", None)))
        for name, widget in self.widgets.items():
            listen = widget.on_upload if name == "upload" else getattr(widget, "on_click", None) or widget.on_update
            listen(lambda event, name=name: self.heard.append((name, event.target.value)))
        client.scene.on_click()(lambda event: self.heard.append(("scene", event.ray_direction)))
        Page.all.append(self)

    def close(self) -> Any:
        self.closed += 1
        return f"{self.left or ''}{self.client.client_id};"

    def uuid(self, name: str) -> str:
        return self.widgets[name]._impl.uuid

    def kept_bytes(self) -> int:
        """What viser keeps of files on their way."""
        uploads = self.client.gui._current_file_upload_states.values()
        return sum(len(part) for upload in uploads for part in upload["parts"].values())


def visits_under_way() -> list[threading.Thread]:
    """Threads in which visits are made or closed."""
    return [thread for thread in threading.enumerate() if thread.name == "motiongen visit"]


def page() -> Page:
    """The page of the visitor who came last."""
    wait_until(lambda: Page.all)
    return Page.all[-1]


def update(connection: Any, visit: Page, name: str, value: Any) -> None:
    say(connection, "GuiUpdateMessage", uuid=visit.uuid(name), updates={"value": value})


def forget_pages() -> None:
    """Wait until nobody comes or goes, and forget who was there."""
    wait_until(lambda: not visits_under_way())
    Page.all.clear()
