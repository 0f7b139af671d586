"""Colours: the colour-blind safe hues of Okabe and Ito on a light neutral ground."""

from __future__ import annotations

from motiongen.render.figure import LEFT, MARKED, MIDDLE, RIGHT

Colour = tuple[int, int, int]

BACKDROP: Colour = (250, 250, 248)
GROUND: Colour = (236, 236, 233)
SEAM: Colour = (255, 255, 255)
GRID: Colour = (208, 208, 204)
INK: Colour = (60, 60, 60)
FAINT_INK: Colour = (132, 132, 130)
SHADOW: Colour = (70, 70, 72)
PATH: Colour = (0, 158, 115)
STILL: Colour = (168, 168, 166)
SIDES: dict[int, Colour] = {MIDDLE: (74, 74, 78), LEFT: (0, 114, 178), RIGHT: (213, 94, 0), MARKED: (170, 51, 119)}


def css(colour: Colour) -> str:
    """A colour as web pages write it."""
    return "#" + bytes(colour).hex()


def mix(first: Colour, second: Colour, share: float) -> Colour:
    """`first` with `share` (0 to 1) of `second` in it."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(first, second))
    return red, green, blue


def ramp(first: Colour, second: Colour, steps: int) -> list[Colour]:
    """`steps` colours from `first` to `second`, both included."""
    return [mix(first, second, step / (steps - 1)) for step in range(steps)]


def gif_colours() -> list[Colour]:
    """255 colours that every picture of an animation is made of; index 255 is left free for transparency.

    The same for all frames and files, so that colours neither flicker nor depend on what is in the first frame.
    """
    hues = [SIDES[LEFT], SIDES[RIGHT], PATH]
    edges = [colour for hue in hues for colour in ramp(hue, BACKDROP, 32)]
    crossings = [
        *ramp(SIDES[LEFT], SIDES[RIGHT], 10)[1:-1],
        *ramp(SIDES[LEFT], INK, 6)[1:],
        *ramp(SIDES[RIGHT], INK, 6)[1:],
    ]
    greys = ramp((0, 0, 0), BACKDROP, 254 - len(edges) - len(crossings))
    return [*edges, *crossings, *greys, SEAM]
