"""The panel in the sidebar of the 3D view, and the preferences."""

import bpy
from bpy.props import StringProperty

from .client import WorkerError, find_command


class MotiongenPreferences(bpy.types.AddonPreferences):
    """Where motiongen is."""

    bl_idname = __package__

    command: StringProperty(
        name="motiongen", subtype="FILE_PATH", description="The motiongen program; empty: found by itself"
    )

    def draw(self, context: bpy.types.Context) -> None:
        """The path, and what it leads to."""
        self.layout.prop(self, "command")
        try:
            self.layout.label(text=f"Uses {find_command(self.command)}", icon="CHECKMARK")
        except WorkerError as error:
            self.layout.label(text=str(error), icon="ERROR")


class MOTIONGEN_UL_examples(bpy.types.UIList):
    """The actions to learn from."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_name, index=0) -> None:
        """One action."""
        layout.prop(item, "action", text="")


class MOTIONGEN_PT_panel(bpy.types.Panel):
    """Everything for a new action."""

    bl_idname = "MOTIONGEN_PT_panel"
    bl_label = "motiongen"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "motiongen"

    def draw(self, context: bpy.types.Context) -> None:
        """From the examples down to the button."""
        layout, wanted, run = self.layout, context.scene.motiongen, context.window_manager.motiongen
        if context.object is None or context.object.type != "ARMATURE":
            layout.label(text="Select an armature", icon="ARMATURE_DATA")
            return
        layout.label(text="Examples" if wanted.examples else "Example: the current action")
        row = layout.row()
        row.template_list("MOTIONGEN_UL_examples", "", wanted, "examples", wanted, "active_example", rows=2, maxrows=6)
        buttons = row.column(align=True)
        buttons.operator("motiongen.add_example", icon="ADD", text="")
        buttons.operator("motiongen.remove_example", icon="REMOVE", text="")
        column = layout.column(align=True)
        for name in ("generator", "frames", "count", "seed"):
            column.prop(wanted, name)
        column = layout.column(align=True)
        for name in ("loop", "use_keys", "keep_bones", "use_segment"):
            column.prop(wanted, name)
        if run.active:
            row = layout.row()
            row.progress(factor=run.share, text=f"{run.share:.0%}")
            row.operator("motiongen.cancel", icon="X", text="")
        else:
            layout.operator("motiongen.generate", icon="PLAY")
        if run.message:
            layout.label(text=run.message)


class MOTIONGEN_PT_options(bpy.types.Panel):
    """The options of the chosen generator."""

    bl_idname = "MOTIONGEN_PT_options"
    bl_label = "Options"
    bl_parent_id = "MOTIONGEN_PT_panel"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "motiongen"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """A field for each."""
        wanted = context.scene.motiongen
        for option in wanted.options:
            if option.generator == wanted.generator:
                self.layout.prop(option, "value", text=option.name)
        self.layout.operator("motiongen.refresh", icon="FILE_REFRESH")


CLASSES = (MotiongenPreferences, MOTIONGEN_UL_examples, MOTIONGEN_PT_panel, MOTIONGEN_PT_options)


def register() -> None:
    """Register panel and preferences."""
    for each in CLASSES:
        bpy.utils.register_class(each)


def unregister() -> None:
    """Take them away."""
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
