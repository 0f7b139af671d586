"""motiongen in Blender: new actions from an armature's own, made by the motiongen program in its own environment."""

bl_info = {
    "name": "motiongen",
    "author": "The motiongen authors",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > motiongen",
    "description": "New motion from your own actions, on the same rig",
    "category": "Animation",
}


def register() -> None:
    """Add everything to Blender."""
    from . import operators, panel, settings

    for module in (settings, operators, panel):
        module.register()


def unregister() -> None:
    """Take everything away again."""
    from . import operators, panel, settings

    for module in (panel, operators, settings):
        module.unregister()
