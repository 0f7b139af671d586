"""Run by a Blender with a window: its own loop, timers and events, and what becomes of the button.

blender --factory-startup --enable-event-simulate --python in_window.py -- FOLDER EXTENSION COMMAND

Leaves `window.json` in FOLDER.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

SECONDS = 0.02


def view() -> Any:
    """The context of the first window's 3D view, which a timer does not have."""
    window = bpy.context.window_manager.windows[0]
    area = next(each for each in window.screen.areas if each.type == "VIEW_3D")
    return bpy.context.temp_override(window=window, area=area, region=area.regions[-1])


def generate(found: dict[str, Any], escape: bool = False) -> Iterator[None]:
    """Press the button and go on with the window until the action is there, or until Escape has been heard."""
    run, window = bpy.context.window_manager.motiongen, bpy.context.window_manager.windows[0]
    actions = len(bpy.data.actions)
    with view():
        bpy.ops.ed.undo_push(message="before")
        found["began"] = list(bpy.ops.motiongen.generate("INVOKE_DEFAULT"))
    found["active"], found["turns"], found["under_way"] = run.active, 0, 0
    while run.active:
        yield
        found["turns"] += 1
        found["under_way"] += 0 < run.share < 1
        if escape and run.share:
            window.event_simulate(type="ESC", value="PRESS", x=10, y=10)
            escape = False
    found["message"], found["new_actions"] = run.message, len(bpy.data.actions) - actions


def steps(found: dict[str, Any]) -> Iterator[None]:
    """One after the other; Blender goes on at each `yield`."""
    import inside

    with view():
        animated = inside.animate(inside.make_rig("plain")).name
    settings = bpy.context.scene.motiongen
    settings.frames, settings.count = 60, 2
    yield from generate(found["made"])
    rig = bpy.data.objects["plain"]
    found["made"]["assigned"] = rig.animation_data.action.name != animated
    with view():
        bpy.ops.ed.undo()
    yield
    found["undone"] = [bpy.data.objects["plain"].animation_data.action.name == animated, len(bpy.data.actions)]
    settings = bpy.context.scene.motiongen
    settings.frames, settings.count = 1000, 100
    yield from generate(found["escaped"], escape=True)


def main(folder: Path, extension: Path, command: str) -> None:
    """Take the steps by a timer, write what was found, and quit."""
    sys.path[:0] = [str(extension.parent), str(Path(__file__).parent)]
    import motiongen_blender
    from motiongen_blender import operators

    motiongen_blender.register()
    operators.find_command = lambda chosen: command
    found: dict[str, Any] = {"version": bpy.app.version_string, "made": {}, "escaped": {}}
    taken = steps(found)

    def take() -> float | None:
        try:
            next(taken)
        except StopIteration:
            motiongen_blender.unregister()
            (folder / "window.json").write_text(json.dumps(found))
            with view():
                bpy.ops.wm.quit_blender()
            return None
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)
        return SECONDS

    bpy.app.timers.register(take, first_interval=1.0, persistent=True)


if __name__ == "__main__":
    out, source, program = sys.argv[sys.argv.index("--") + 1 :]
    main(Path(out), Path(source), program)
