"""What the panel sets, kept with the scene, and what runs, kept with the window."""

import json
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

# Blender does not keep the texts of an enumeration's items alive; this list does.
GENERATORS: list[tuple[str, str, str]] = [
    ("genmm", "genmm", "Generative motion matching: new motion from one or a few actions, without training"),
    ("modi", "modi", "MoDi: motions from a trained network, on the skeleton that it was trained on"),
]
DESCRIBED: dict[str, dict[str, Any]] = {}
"""What the worker has said of each generator."""


def _generator_items(settings: Any, context: Any) -> list[tuple[str, str, str]]:
    return GENERATORS


class MotiongenExample(bpy.types.PropertyGroup):
    """An action to learn from."""

    action: PointerProperty(type=bpy.types.Action, name="Action")


class MotiongenOption(bpy.types.PropertyGroup):
    """An option of a generator; its name is the property that every group has."""

    generator: StringProperty()
    help: StringProperty()
    standard: StringProperty()
    value: StringProperty(name="Value", description="As JSON: a number, true, false, null, or a word")


class MotiongenSettings(bpy.types.PropertyGroup):
    """The panel's settings."""

    examples: CollectionProperty(type=MotiongenExample)
    active_example: IntProperty()
    generator: EnumProperty(items=_generator_items, name="Generator")
    options: CollectionProperty(type=MotiongenOption)
    frames: IntProperty(
        name="Frames", min=0, default=0, description="Length of each new action; 0: as the generator sees fit"
    )
    count: IntProperty(name="Count", min=1, max=100, default=1, description="How many new actions")
    seed: IntProperty(name="Seed", min=0, default=0, description="The same seed gives the same actions")
    loop: BoolProperty(name="Loop", description="The end leads into the beginning in pose and velocity")
    use_keys: BoolProperty(
        name="Hold Selected Keyframes", description="Poses of the current action that hold at their frames"
    )
    keep_bones: BoolProperty(
        name="Keep Selected Bones", description="Selected bones move exactly as in the current action"
    )
    use_segment: BoolProperty(
        name="Redo Preview Range", description="Only frames in the preview range of the current action are made anew"
    )


class MotiongenRun(bpy.types.PropertyGroup):
    """What is being made."""

    active: BoolProperty()
    share: FloatProperty(min=0.0, max=1.0)
    cancel: BoolProperty()
    message: StringProperty()


def remember_generators(described: list[dict[str, Any]], settings: MotiongenSettings) -> None:
    """Offer the generators that the worker has, with their options; values that were changed stay."""
    usable = [each for each in described if not each.get("error")]
    DESCRIBED.clear()
    DESCRIBED.update({each["name"]: each for each in usable})
    GENERATORS[:] = [(each["name"], each["name"], each["description"]) for each in usable]
    changed = {(o.generator, o.name): o.value for o in settings.options if o.value != o.standard}
    settings.options.clear()
    for each in usable:
        for described_option in each["options"]:
            option = settings.options.add()
            option.name, option.generator = described_option["name"], each["name"]
            option.help = described_option["help"] or ""
            option.standard = json.dumps(described_option["default"])
            option.value = changed.get((option.generator, option.name), option.standard)


def chosen_options(settings: MotiongenSettings) -> dict[str, Any]:
    """The options of the chosen generator that are not as they were."""
    return {
        option.name: parsed(option.value)
        for option in settings.options
        if option.generator == settings.generator and option.value != option.standard
    }


def parsed(text: str) -> Any:
    """A value as JSON, or a word without quotes."""
    try:
        return json.loads(text)
    except ValueError:
        return text


CLASSES = (MotiongenExample, MotiongenOption, MotiongenSettings, MotiongenRun)


def register() -> None:
    """Add the settings to scenes and windows."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.motiongen = PointerProperty(type=MotiongenSettings)
    bpy.types.WindowManager.motiongen = PointerProperty(type=MotiongenRun)


def unregister() -> None:
    """Take them away."""
    del bpy.types.WindowManager.motiongen
    del bpy.types.Scene.motiongen
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
