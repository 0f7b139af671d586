"""Stick figures: clips side by side as a video, a GIF or a film strip, exactly as they are.

    from motiongen.render import film_strip, render_clips
    render_clips([example, *samples], "preview.mp4", labels=["example", "sample 0", "sample 1"])

Drawn with Pillow by a perspective camera of our own; nothing needs a display or a graphics card.
"""

from motiongen.render.clips import SUFFIXES, render_clips
from motiongen.render.strip import film_strip

__all__ = ["SUFFIXES", "film_strip", "render_clips"]
