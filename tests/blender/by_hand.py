"""What Blender's window does with the extension, done by hand where there is no window.

The operators are Blender's own; the events, the timer and the layout are stood in for, and Blender's loop is not run.
"""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import bpy

NOTHING = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")
TICK = SimpleNamespace(type="TIMER", value="NOTHING")
ESCAPE = SimpleNamespace(type="ESC", value="PRESS")
ESCAPE_LET_GO = SimpleNamespace(type="ESC", value="RELEASE")


class Manager:
    """A window manager's timers and modal operators."""

    def __init__(self) -> None:
        """None of either."""
        self.motiongen = bpy.context.window_manager.motiongen
        self.timers: list[Any] = []
        self.handlers: list[Any] = []

    def event_timer_add(self, seconds: float, window: Any) -> Any:
        """A timer that ticks by hand."""
        self.timers.append(object())
        return self.timers[-1]

    def event_timer_remove(self, timer: Any) -> None:
        """It must be there."""
        self.timers.remove(timer)

    def modal_handler_add(self, operator: Any) -> None:
        """Note the operator."""
        self.handlers.append(operator)


def press(operators: Any, what_comes: Any) -> dict[str, Any]:
    """Press Generate, and let `what_comes` (operator, context) yield events until the operator ends."""
    button, manager = operators.MOTIONGEN_OT_generate, Manager()
    shown = {name: getattr(bpy.context, name) for name in ("scene", "object", "preferences", "window", "screen")}
    context = SimpleNamespace(window_manager=manager, **shown)
    waits: list[float] = []
    passed: set[str] = set()
    found: dict[str, Any] = {}

    def instead(operator: Any, _: bpy.types.Context) -> set[str]:
        found["began"] = list(button.invoke(operator, context, NOTHING))
        found["timers"], found["handlers"] = len(manager.timers), len(manager.handlers)
        worker = operator._worker
        poll = worker.poll
        worker.poll = lambda timeout=0.0: waits.append(timeout) or poll(timeout)
        try:
            for event in what_comes(operator, context):
                if (ended := operator.modal(context, event)) != {"PASS_THROUGH"}:
                    return ended
                passed.add(event.type)
        except KeyError as error:
            found["fault"] = str(error)
        finally:
            worker.poll = poll
        return {"CANCELLED"}

    usual, actions = button.execute, len(bpy.data.actions)
    button.execute = instead
    try:
        found["ended"] = list(bpy.ops.motiongen.generate())
    finally:
        button.execute = usual
    return {
        **found,
        "waits": sorted(set(waits)),
        "passed": sorted(passed),
        "left": len(manager.timers),
        "active": manager.motiongen.active,
        "message": manager.motiongen.message,
        "new_actions": len(bpy.data.actions) - actions,
    }


def ticks(operator: Any, context: Any) -> Any:
    """The mouse moves and the timer ticks."""
    while True:
        yield from (NOTHING, ESCAPE_LET_GO, TICK)
        time.sleep(0.01)


def escape(operator: Any, context: Any) -> Any:
    """As soon as there is progress, Escape is pressed."""
    run, pressed = context.window_manager.motiongen, False
    for event in ticks(operator, context):
        if run.share and not pressed:
            pressed = True
            yield ESCAPE
        yield event


def fault(operator: Any, context: Any) -> Any:
    """The worker's answer cannot be understood."""
    operator._worker.poll = lambda timeout: [{"id": operator._id, "type": "progress"}]
    yield TICK


def closing(operator: Any, context: Any) -> Any:
    """Blender closes."""
    yield TICK
    operator.cancel(context)


def presses(operators: Any) -> dict[str, Any]:
    """Everything that can become of a press of the button."""
    settings = bpy.context.scene.motiongen
    settings.frames, settings.count = 60, 2
    found = {"ticks": press(operators, ticks)}
    settings.frames, settings.count = 1000, 100
    found["escape"] = press(operators, escape)
    found["fault"] = press(operators, fault)
    found["closing"] = press(operators, closing)
    found["closing"]["worker"] = len(operators._worker)
    return found


# -- panels


class Layout:
    """A layout that takes what this Blender's own would take, and notes it."""

    def __init__(self, noted: list[str]) -> None:
        """With a list to note in."""
        self.noted = noted

    def __getattr__(self, name: str) -> Any:
        """A function of Blender's layout."""
        known = bpy.types.UILayout.bl_rna.functions[name].parameters

        def draw(*given: Any, **named: Any) -> Layout:
            assert set(named) <= set(known.keys()), (name, named)
            assert "icon" not in named or named["icon"] in known["icon"].enum_items, named
            if name == "prop":
                assert given[1] in given[0].bl_rna.properties, given
            if name == "operator":
                module, operator = given[0].split(".")
                getattr(getattr(bpy.ops, module), operator).get_rna_type()
            self.noted.append(" ".join([name, *(each for each in given[:2] if isinstance(each, str))]))
            return Layout(self.noted)

        return draw


def drawn(panel: Any) -> list[str]:
    """What a panel draws."""
    noted: list[str] = []
    panel.draw(SimpleNamespace(layout=Layout(noted)), bpy.context)
    return noted


def panels(module: Any) -> dict[str, list[str]]:
    """What is shown without an armature, with one, and while something is being made."""
    run, chosen = bpy.context.window_manager.motiongen, bpy.context.object
    found = {"ready": drawn(module.MOTIONGEN_PT_panel), "options": drawn(module.MOTIONGEN_PT_options)}
    run.active = True
    found["busy"] = drawn(module.MOTIONGEN_PT_panel)
    run.active, bpy.context.view_layer.objects.active = False, None
    found["no armature"] = drawn(module.MOTIONGEN_PT_panel)
    bpy.context.view_layer.objects.active = chosen
    return found
