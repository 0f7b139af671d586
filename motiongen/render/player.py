"""A page with clips in it that plays by itself: no server, no network, nothing to install."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motiongen import files
from motiongen.motion import Motion
from motiongen.render import palette, schedule
from motiongen.render.figure import Figure
from motiongen.render.stage import Actor, cast
from motiongen.render.strip import checked_labels

_PAGE = Path(__file__).with_name("player.html")


def write_player(
    motions: Sequence[Motion], path: str | Path, labels: Sequence[str] | None = None, seconds: float | None = None
) -> Path:
    """Write an HTML page that shows clips side by side, each frame as it is, at the clips' own rates.

    It can be turned, zoomed, scrubbed and slowed down, and holds all it needs. With `#1.5` behind its address it stands
    still at second 1.5.

    Args:
        motions: the clips, in order, one panel each.
        path: where to write.
        labels: what to write above each clip; by default the clips' names.
        seconds: how much of each clip to show; by default all of it.

    Returns:
        The path written to. The file appears there complete, or not at all.

    Raises:
        MotionGenError: if an argument is out of range, or the file cannot be written.
    """
    labels = checked_labels(motions, labels)
    shown = [schedule.trimmed(motion, seconds) for motion in motions]
    actors = cast(shown, labels, [np.arange(len(motion)) for motion in shown])
    colours = {name: getattr(palette, name) for name in ("BACKDROP", "GROUND", "GRID", "INK", "FAINT_INK", "PATH")}
    data = {
        "clips": [_clip(actor, motion.frame_rate) for actor, motion in zip(actors, shown)],
        "colours": {name.lower(): palette.css(colour) for name, colour in colours.items()},
    }
    # "<" in a name must not end the script that the data stands in.
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    page = _PAGE.read_text(encoding="utf-8").replace("$TITLE", html.escape(", ".join(labels))).replace("$DATA", text)
    path = Path(path)
    with files.atomic_write(path) as file:
        file.write(page.encode("utf-8", "replace"))
    return path


def _clip(actor: Actor, frame_rate: float) -> dict[str, Any]:
    """A clip as the page reads it: the nodes that something is drawn at, as base64 of (T, N, 3) float32."""
    figure: Figure = actor.figure
    drawn = figure.drawn
    place = np.zeros(actor.nodes.shape[1], dtype=np.int64)
    place[drawn] = np.arange(len(drawn))
    return {
        "label": actor.label,
        "rate": frame_rate,
        "frames": len(actor.nodes),
        "nodes": base64.b64encode(actor.nodes[:, drawn].astype("<f4").tobytes()).decode(),
        "count": len(drawn),
        "bones": place[figure.bones].tolist(),
        "radii": np.round(figure.radii, 5).tolist(),
        "colours": [palette.css(palette.SIDES[side]) for side in figure.sides.tolist()],
        "balls": place[figure.balls].tolist(),
        "ballRadii": np.round(figure.ball_radii, 5).tolist(),
        "ballColours": [palette.css(palette.SIDES[side]) for side in figure.ball_sides.tolist()],
        "root": int(place[figure.root]),
        "front": np.round(actor.front, 4).tolist(),
    }
