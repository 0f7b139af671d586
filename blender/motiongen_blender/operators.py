"""The operators: generate, cancel, refresh, and the list of examples."""

from __future__ import annotations

from typing import Any

import bpy

from . import armature as rigs
from . import settings as store
from .client import ENDED, Worker, WorkerError, find_command

POLL_SECONDS = 0.1
_worker: list[Worker] = []


def worker_of(context: bpy.types.Context) -> Worker:
    """The running worker, started where there is none.

    Raises:
        WorkerError: if there is no program to start.
    """
    if _worker and not _worker[0].alive:
        stop_worker()
    if not _worker:
        addon = context.preferences.addons.get(__package__)
        _worker.append(Worker(find_command(addon.preferences.command if addon and addon.preferences else "")))
    return _worker[0]


def stop_worker() -> None:
    """End the worker, if it runs."""
    while _worker:
        _worker.pop().stop()


def scene_rate(scene: bpy.types.Scene) -> float:
    """Frames per second."""
    return scene.render.fps / scene.render.fps_base


# -- the request


def request_of(context: bpy.types.Context, armature: bpy.types.Object) -> dict[str, Any]:
    """The request that the panel describes.

    Raises:
        RigError: if something that it needs is not there.
    """
    scene, wanted = context.scene, context.scene.motiongen
    current = armature.animation_data.action if armature.animation_data else None
    actions = [example.action for example in wanted.examples if example.action] or ([current] if current else [])
    needs_examples = store.DESCRIBED.get(wanted.generator, {}).get("needs_examples", wanted.generator != "modi")
    if needs_examples and not actions:
        raise rigs.RigError(f"'{armature.name}' has no action to learn from; give it one, or add some to the list")
    rate = scene_rate(scene)
    examples = [rigs.motion_of(armature, action, rate) for action in actions] if needs_examples else []
    constraints, frames = constraints_of(context, armature, current)
    clips = {}
    if any("clip" in values for values in constraints.values()):
        clips = {"current": rigs.motion_of(armature, current, rate)}
    return {
        "generator": wanted.generator,
        "options": store.chosen_options(wanted),
        "examples": examples,
        "clips": clips,
        "frames": frames or wanted.frames or None,
        "count": wanted.count,
        "seed": wanted.seed,
        "constraints": constraints,
    }


def constraints_of(
    context: bpy.types.Context, armature: bpy.types.Object, current: bpy.types.Action | None
) -> tuple[dict[str, dict[str, Any]], int | None]:
    """The constraints that the panel describes, and the length that they call for.

    Raises:
        RigError: if there is nothing to hold to.
    """
    scene, wanted = context.scene, context.scene.motiongen
    constraints: dict[str, dict[str, Any]] = {"loop": {}} if wanted.loop else {}
    if not (wanted.use_keys or wanted.keep_bones or wanted.use_segment):
        return constraints, None
    if current is None:
        raise rigs.RigError(f"'{armature.name}' has no current action to hold to; assign one")
    first, last = rigs.frame_range(current)
    if wanted.use_keys:
        keys = [frame - first for frame in rigs.selected_keys(current, armature)]
        if not keys:
            raise rigs.RigError("no keyframe of the current action is selected; select some in the dope sheet")
        constraints["keyframes"] = {"clip": "current", "poses": keys, "frames": keys}
    if wanted.keep_bones:
        names = rigs.selected_bones(armature)
        if not names:
            raise rigs.RigError("no bone is selected; select those to keep in pose mode")
        constraints["fixed_joints"] = {"clip": "current", "joints": names}
    if not wanted.use_segment:
        return constraints, last - first + 1 if wanted.keep_bones and not wanted.frames else None
    if not scene.use_preview_range:
        raise rigs.RigError("there is no preview range; set one in the timeline (P) over the frames to redo")
    start, stop = scene.frame_preview_start - first, scene.frame_preview_end + 1 - first
    constraints["segment"] = {"clip": "current", "start": start, "stop": stop}
    return constraints, last - first + 1


# -- operators


class MOTIONGEN_OT_generate(bpy.types.Operator):
    """Make new actions for this armature, like those it has"""

    bl_idname = "motiongen.generate"
    bl_label = "Generate"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With an armature, and nothing being made."""
        chosen = context.object
        return chosen is not None and chosen.type == "ARMATURE" and not context.window_manager.motiongen.active

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        """Start, and look again from time to time, so that Blender goes on."""
        if not self._begin(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(POLL_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: Any) -> set[str]:
        """Take what the worker says; all other events pass. Escape asks for the end."""
        if event.type == "ESC" and event.value == "PRESS":
            context.window_manager.motiongen.cancel = True
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        ended: set[str] | None = {"CANCELLED"}
        try:
            ended = self._advance(context, 0.0)
        finally:  # a fault of ours must not leave the timer ticking
            if ended is not None:
                self._stop_looking(context)
        for area in context.screen.areas if context.screen else ():
            if area.type == "VIEW_3D":
                area.tag_redraw()
        return {"PASS_THROUGH"} if ended is None else ended

    def execute(self, context: bpy.types.Context) -> set[str]:
        """From a script: wait for the end."""
        if not self._begin(context):
            return {"CANCELLED"}
        while (ended := self._advance(context, POLL_SECONDS)) is None:
            pass
        return ended

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender is closing, or opens another file."""
        self._stop_looking(context)
        stop_worker()

    def _stop_looking(self, context: bpy.types.Context) -> None:
        context.window_manager.motiongen.active = False
        context.window_manager.event_timer_remove(self._timer)

    def _begin(self, context: bpy.types.Context) -> bool:
        run, armature = context.window_manager.motiongen, context.object
        try:
            request = request_of(context, armature)
            self._worker = worker_of(context)
        except (rigs.RigError, WorkerError) as error:
            self.report({"ERROR"}, str(error))
            run.message = str(error)
            return False
        current = armature.animation_data.action if armature.animation_data else None
        # By name: what Blender hands out does not outlive an undo.
        self._armature = armature.name
        self._start = rigs.frame_range(current)[0] if current else context.scene.frame_start
        self._base = current.name if current else armature.name
        self._id = self._worker.ask("sample", **request)
        run.active, run.cancel, run.share, run.message = True, False, 0.0, ""
        self._asked_to_cancel = False
        return True

    def _advance(self, context: bpy.types.Context, timeout: float) -> set[str] | None:
        """Take the worker's messages; returns how it ended, or None while it goes on."""
        run = context.window_manager.motiongen
        if run.cancel and not self._asked_to_cancel:
            self._asked_to_cancel = True
            self._worker.ask("cancel", target=self._id)
        for message in self._worker.poll(timeout):
            if message["type"] == ENDED or message.get("id") == self._id:
                if message["type"] == "progress":
                    run.share = message["share"]
                    continue
                run.active = False
                return self._end(context, message)
        return None

    def _end(self, context: bpy.types.Context, message: dict[str, Any]) -> set[str]:
        run = context.window_manager.motiongen
        if message["type"] == "result":
            try:
                names = self._keep(context, message["motions"])
            except rigs.RigError as error:
                message = {"type": "error", "message": str(error)}
            else:
                credit = f"; {message['credit']}" if message["credit"] else ""
                run.message = f"{', '.join(names)} in {message['seconds']:.1f} s{credit}"
                self.report({"INFO"}, run.message)
                return {"FINISHED"}
        stopped = message["type"] == "cancelled"
        run.message = "cancelled" if stopped else message["message"]
        self.report({"INFO" if stopped else "ERROR"}, run.message)
        return {"CANCELLED"}

    def _keep(self, context: bpy.types.Context, motions: list[dict[str, Any]]) -> list[str]:
        """Make actions of the motions and assign the first; returns their names."""
        armature = context.scene.objects.get(self._armature)
        if armature is None or armature.type != "ARMATURE":
            raise rigs.RigError(f"'{self._armature}' is no longer there")
        rate = scene_rate(context.scene)
        actions = [
            rigs.action_of(armature, motion, f"{self._base} {motion['name']}", self._start, rate) for motion in motions
        ]
        rigs.assign(armature, actions[0])
        return [action.name for action in actions]


class MOTIONGEN_OT_cancel(bpy.types.Operator):
    """Stop what is being made"""

    bl_idname = "motiongen.cancel"
    bl_label = "Cancel"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Leave word; the one that waits for the worker passes it on."""
        context.window_manager.motiongen.cancel = True
        return {"FINISHED"}


class MOTIONGEN_OT_refresh(bpy.types.Operator):
    """Ask motiongen which generators and options there are"""

    bl_idname = "motiongen.refresh"
    bl_label = "Load Generators and Options"
    timeout_seconds = 60.0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With nothing being made, whose answers this would swallow."""
        return not context.window_manager.motiongen.active

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask and wait: it takes as long as motiongen takes to start."""
        try:
            worker = worker_of(context)
            described = self._answer(worker, worker.ask("generators"))
        except WorkerError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        store.remember_generators(described["generators"], context.scene.motiongen)
        return {"FINISHED"}

    def _answer(self, worker: Worker, asked: int) -> dict[str, Any]:
        for _ in range(round(self.timeout_seconds / POLL_SECONDS)):
            for message in worker.poll(POLL_SECONDS):
                if message["type"] == ENDED or (message.get("id") == asked and message["type"] == "error"):
                    raise WorkerError(message["message"])
                if message.get("id") == asked and message["type"] == "result":
                    return message
        raise WorkerError(f"motiongen has not answered for {self.timeout_seconds:g} s; see whether it runs by itself")


class MOTIONGEN_OT_add_example(bpy.types.Operator):
    """Add the armature's current action to the examples"""

    bl_idname = "motiongen.add_example"
    bl_label = "Add Current Action"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With an action."""
        return bool(context.object and context.object.animation_data and context.object.animation_data.action)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it, once."""
        examples, action = context.scene.motiongen.examples, context.object.animation_data.action
        if all(example.action != action for example in examples):
            examples.add().action = action
        return {"FINISHED"}


class MOTIONGEN_OT_remove_example(bpy.types.Operator):
    """Take the chosen action off the list of examples; it stays in the file"""

    bl_idname = "motiongen.remove_example"
    bl_label = "Remove Action"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it."""
        wanted = context.scene.motiongen
        wanted.examples.remove(wanted.active_example)
        wanted.active_example = max(0, min(wanted.active_example, len(wanted.examples) - 1))
        return {"FINISHED"}


CLASSES = (
    MOTIONGEN_OT_generate,
    MOTIONGEN_OT_cancel,
    MOTIONGEN_OT_refresh,
    MOTIONGEN_OT_add_example,
    MOTIONGEN_OT_remove_example,
)


def register() -> None:
    """Register the operators."""
    for each in CLASSES:
        bpy.utils.register_class(each)


def unregister() -> None:
    """End the worker and take the operators away."""
    stop_worker()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
