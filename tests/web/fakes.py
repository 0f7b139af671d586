"""A page that is not there: it keeps what is put on it, and a test may move its fields as a visitor does."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any


class Handle:
    """A field, a button or a container, with whatever it was made of as its attributes."""

    def __init__(self, kind: str, label: str | None, value: Any, settings: dict[str, Any]) -> None:
        self.kind, self.label, self.value, self.removed, self.visible = kind, label, value, False, True
        self._heard: list[Callable[[Any], None]] = []
        self.__dict__.update(settings)

    def remove(self) -> None:
        self.removed = True

    def on_update(self, heard: Callable[[Any], None]) -> None:
        self._heard.append(heard)

    on_click = on_upload = on_trigger = on_update

    def move(self, value: Any = None, visitor: int | None = 7) -> None:
        """Give it a value, as a visitor or, with `visitor` None, as the page itself."""
        if value is not None:
            self.value = value
        for heard in self._heard:
            heard(SimpleNamespace(client_id=visitor, target=self))

    def add_tab(self, label: str, icon: Any = None) -> Handle:
        return self

    def __enter__(self) -> Handle:
        return self

    def __exit__(self, *_: object) -> None: ...

    def float(self, **place: int) -> None: ...


class Gui:
    """Stands for `viser.GuiApi`: every `add_...` keeps a `Handle`."""

    def __init__(self) -> None:
        self.handles: list[Handle] = []

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("add_"):
            raise AttributeError(name)

        def add(label: Any = None, *values: Any, **settings: Any) -> Handle:
            handle = _made(name.removeprefix("add_"), label, values, settings)
            self.handles.append(handle)
            return handle

        return add

    def __getitem__(self, label: str) -> Handle:
        """The field or button of that label that was not removed."""
        (found,) = [each for each in self.handles if each.label == label and not each.removed]
        return found


def _made(kind: str, label: Any, values: tuple[Any, ...], settings: dict[str, Any]) -> Handle:
    """A handle with the names that viser gives to what it is made of."""
    if kind == "html":
        return Handle(kind, None, None, {"content": label})
    if kind in ("dropdown", "button_group"):
        (options,) = values
        value = settings.get("initial_value")
        return Handle(kind, label, options[0] if value is None else value, {"options": options, **settings})
    if kind == "slider":
        least, most, step, value = values
        return Handle(kind, label, value, {"min": least, "max": most, "step": step, **settings})
    return Handle(kind, label, values[0] if values else None, settings)


class Client:
    """Stands for `viser.ClientHandle`: keeps what it is told."""

    def __init__(self) -> None:
        self.gui = Gui()
        self.said: list[SimpleNamespace] = []
        self.sent: dict[str, bytes] = {}

    def add_notification(self, title: str, body: str, color: str, **settings: Any) -> None:
        self.said.append(SimpleNamespace(title=title, body=body, colour=color))

    def send_file_download(self, name: str, content: bytes, **settings: Any) -> None:
        self.sent[name] = content
