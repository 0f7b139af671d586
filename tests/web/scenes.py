"""A visitor's client without a browser: it takes what viser's would take, and remembers what is in the scene."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import viser


class Node:
    """A node of the scene: its first properties as attributes, and how many changes came since."""

    def __init__(self, scene: Scene, name: str, properties: dict[str, Any]) -> None:
        vars(self).update(properties, scene=scene, name=name, changes=0)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{self.name} has no {name}")

    def __setattr__(self, name: str, value: Any) -> None:
        assert self.scene.nodes.get(self.name) is self, f"{self.name} is no longer in the scene"
        getattr(self, name)
        vars(self)[name] = value
        vars(self)["changes"] += 1

    def remove(self) -> None:
        """Take it and all below it off the scene."""
        assert self.scene.nodes.get(self.name) is self, f"{self.name} is no longer in the scene"
        for name in [name for name in self.scene.nodes if f"{name}/".startswith(f"{self.name}/")]:
            del self.scene.nodes[name]


class Scene:
    """The scene of one visitor: `nodes` by their names. Calls that viser would not take raise TypeError."""

    def __init__(self) -> None:
        self.nodes: dict[str, Node] = {}

    def __getattr__(self, method: str) -> Callable[..., Any]:
        signature = inspect.signature(getattr(viser.SceneApi, method))

        def call(*arguments: Any, **named: Any) -> Node | None:
            bound = signature.bind(self, *arguments, **named)
            bound.apply_defaults()
            if not method.startswith("add_"):
                return None
            properties = {key: value for key, value in bound.arguments.items() if key not in ("self", "name")}
            name = bound.arguments["name"]
            assert name not in self.nodes, f"{name} is in the scene already"
            self.nodes[name] = Node(self, name, properties)
            return self.nodes[name]

        return call

    def ending(self, name: str) -> list[Node]:
        """The nodes whose names end so, in the order in which they came."""
        return [node for path, node in self.nodes.items() if path.endswith(f"/{name}")]

    @property
    def changes(self) -> int:
        """How many changes of nodes came."""
        return sum(node.changes for node in self.nodes.values())


class Camera:
    """The camera as viser has it: to move it moves what it looks at."""

    def __init__(self) -> None:
        self._position, self._look_at = np.array([3.0, 3.0, 3.0]), np.zeros(3)
        self.fov, self.aspect, self.written = 1.3, 1.5, 0

    @property
    def position(self) -> Any:
        """(3,) where it is."""
        return self._position

    @position.setter
    def position(self, place: Any) -> None:
        self._look_at = self._look_at + np.asarray(place) - self._position
        self._position = np.asarray(place)
        self.written += 1

    @property
    def look_at(self) -> Any:
        """(3,) what it looks at."""
        return self._look_at

    @look_at.setter
    def look_at(self, place: Any) -> None:
        self._look_at = np.asarray(place)
        self.written += 1


class Client:
    """What a stage needs of a visitor's client."""

    def __init__(self) -> None:
        self.scene, self.camera = Scene(), Camera()

    @contextlib.contextmanager
    def atomic(self) -> Iterator[None]:
        """Nothing is sent here."""
        yield
