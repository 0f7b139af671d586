"""How a BVH file is laid out: what a motion does not hold and a written file should repeat."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, Context, Decimal
from typing import Any

from motiongen.errors import MotionGenError

POSITION_CHANNELS = ("Xposition", "Yposition", "Zposition")
ROTATION_CHANNELS = ("Xrotation", "Yrotation", "Zrotation")
CHANNELS = POSITION_CHANNELS + ROTATION_CHANNELS

# What a joint gets whose channels no file has chosen.
DEFAULT_ROTATION = ("Zrotation", "Yrotation", "Xrotation")
DEFAULT_ROOT = POSITION_CHANNELS + DEFAULT_ROTATION

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""How a number may be spelled in a file."""

# Frame times, in seconds, that a file may claim.
SHORTEST, LONGEST = Decimal("0.000001"), Decimal(3600)

ROOMY = Context(prec=60)


def position_axes(channels: tuple[str, ...]) -> tuple[int, ...]:
    """The axes (0, 1, 2) of the position channels among `channels`, in order."""
    return tuple(POSITION_CHANNELS.index(c) for c in channels if c in POSITION_CHANNELS)


def rotation_axes(channels: tuple[str, ...]) -> tuple[int, ...]:
    """The axes (0, 1, 2) of the rotation channels among `channels`, in order."""
    return tuple(ROTATION_CHANNELS.index(c) for c in channels if c in ROTATION_CHANNELS)


@dataclass(frozen=True)
class EndSiteLayout:
    """One end site: the joint it hangs from, how many child joints are listed before it, and its name if it has one."""

    joint: str
    children_before: int
    name: str = ""


@dataclass(frozen=True)
class BvhLayout:
    """What a BVH file chose freely.

    It speaks of joints by name, so that it serves whatever joints a changed motion still has.

    Attributes:
        channels: the channels of each joint, in order.
        end_sites: where the end sites stand, in order.
        frame_time: the frame time as the file spells it.
        frame_rate: the rate in Hz that this was read as; the spelling is repeated for this rate only.
    """

    channels: dict[str, tuple[str, ...]]
    end_sites: tuple[EndSiteLayout, ...]
    frame_time: str
    frame_rate: float

    def to_dict(self) -> dict[str, Any]:
        """The layout as plain data that JSON can hold."""
        return {
            "channels": [[name, *channels] for name, channels in self.channels.items()],
            "end_sites": [[site.joint, site.children_before, site.name] for site in self.end_sites],
            "frame_time": self.frame_time,
            "frame_rate": self.frame_rate,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> BvhLayout:
        """The layout of plain data as `to_dict` gives it.

        Raises:
            MotionGenError: if the data is not of that form.
        """
        try:
            channels = {str(name): tuple(str(c) for c in listed) for name, *listed in data["channels"]}
            sites = tuple(EndSiteLayout(str(joint), int(n), str(name)) for joint, n, name in data["end_sites"])
            layout = cls(channels, sites, str(data["frame_time"]), float(data["frame_rate"]))
            rate_of(layout.frame_time)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise MotionGenError(f"a BVH layout must hold {', '.join(cls.__annotations__)} ({error})") from None
        if any(c not in CHANNELS or listed.count(c) > 1 for listed in channels.values() for c in listed):
            raise MotionGenError(f"the channels of a BVH layout must be different ones of {', '.join(CHANNELS)}")
        return layout


def rate_of(frame_time: str) -> float:
    """The frame rate in Hz that a frame time in seconds, as spelled in a file, stands for.

    That is the whole number N, or the broadcast rate N * 1000 / 1001, whose reciprocal gives the very digits of the
    text when rounded or cut to as many; else simply the reciprocal.

    Raises:
        MotionGenError: if the text is no number between a microsecond and an hour.
    """
    try:
        # The plus cuts it to the 28 digits that are calculated with.
        seconds = +Decimal(frame_time if NUMBER.fullmatch(frame_time) else 0)
    except ArithmeticError:
        seconds = Decimal(0)
    if not SHORTEST <= seconds <= LONGEST:
        raise MotionGenError(f"the frame time is '{frame_time}'; give seconds, from {SHORTEST} to {LONGEST}")
    for thousandths in (1000, 1001):
        rate = round(thousandths / seconds / 1000)
        exact = Decimal(thousandths) / (1000 * rate) if rate else Decimal(0)
        if seconds in (exact.quantize(seconds, way, ROOMY) for way in (ROUND_HALF_EVEN, ROUND_DOWN)):
            return rate * 1000 / thousandths
    return 1 / float(seconds)


def spelled(frame_rate: float) -> str:
    """The shortest frame time with six decimals or more that is read back as `frame_rate`, or as nearly as can be.

    Raises:
        MotionGenError: if a file cannot hold the rate.
    """
    if not float(SHORTEST) <= 1 / frame_rate <= float(LONGEST):
        slowest, fastest = f"{1 / float(LONGEST):.2g}", f"{1 / float(SHORTEST):g}"
        raise MotionGenError(f"a BVH file holds rates from {slowest} to {fastest} Hz, not {frame_rate:g}; resample it")
    spellings = [f"{1 / frame_rate:.{digits}f}" for digits in range(6, 21)]
    return next((text for text in spellings if float(text) and rate_of(text) == frame_rate), spellings[-1])
