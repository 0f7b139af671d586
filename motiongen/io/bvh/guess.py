"""What a BVH file does not say, guessed from the poses; and what is odd about it, in words."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.io.bvh.header import shown
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]

POSES = 64
"""How many frames are looked at."""

UNCLEAR, UNCLEAR_WITH_FEET = 0.05, 0.6
"""Evidence for one axis over the other below which neither is believed. Upright bodies with feet come to 0.8 and more;
one that lies along an axis comes to 0.5 for that, so more is asked where there are feet to go by."""

ELSEWHERE = 1e-3
"""How far from its OFFSET, in skeleton heights, a joint may be held by its position channels before that is noted."""

FEET = re.compile(r"foot|feet|toe|ankle|hoof|paw", re.IGNORECASE)


# Statures of people, from a stooping one's to one with raised arms: what they are in each unit that is told apart.
STATURES = {"m": (1.2, 2.3), "cm": (120.0, 230.0)}


def sample(
    skeleton: Skeleton, rotations: Array, translations: Array, translating: tuple[int, ...]
) -> tuple[Array, list[str]]:
    """Where the body is in some frames.

    Returns:
        Positions (n, P, 3) in n frames, evenly spread and `POSES` at most, of the joints and end sites of the body:
        those below the joint that carries it, so without a root that stands still above the hips. And their names; an
        end site has that of its joint.
    """
    chosen = np.linspace(0, len(rotations) - 1, min(len(rotations), POSES)).astype(int)
    local = np.broadcast_to(skeleton.offsets, (len(chosen), len(skeleton), 3)).copy()
    local[:, list(translating)] = translations[chosen]
    turned, placed = kinematics.forward(skeleton, rotations[chosen], local)
    tips = list(skeleton.end_sites)
    ends = placed[:, tips] + rot.rotate(turned[:, tips], skeleton.end_site_offsets)
    still_root = len(skeleton) > 1 and len(translating) > 0 and 0 not in translating
    names = [*skeleton.names, *(skeleton.names[j] for j in tips)]
    return np.concatenate([placed, ends], axis=1)[:, still_root:], names[still_root:]


def up_axis(poses: Array, names: list[str]) -> tuple[str, list[str]]:
    """Which axis is up, "y" or "z", and a note unless it is clearly y.

    Two things speak for an axis: the body is above its feet along it, on average, as far as joints are called like
    feet; and its lowest point along it is near zero and steady, for that is the ground.
    """
    feet = [i for i, name in enumerate(names) if FEET.search(name)]
    evidence = np.zeros(3)
    if feet:
        above = poses.mean(axis=1) - poses[:, feet].mean(axis=1)  # (n, 3)
        evidence += (above / np.maximum(np.linalg.norm(above, axis=-1, keepdims=True), 1e-12)).mean(axis=0)
    lowest = poses.min(axis=1)  # (n, 3)
    size = max(float(np.median(np.ptp(poses, axis=1).max(axis=-1))), 1e-12)
    evidence -= np.minimum((np.abs(np.median(lowest, axis=0)) + lowest.std(axis=0)) / size, 1.0)
    lead = float(evidence[1] - evidence[2])
    if abs(lead) < (UNCLEAR_WITH_FEET if feet else UNCLEAR):
        return "y", ["the poses do not tell which axis is up; y is assumed"]
    return ("y", []) if lead > 0 else ("z", ["the poses tell that z is up; they are turned so that y is"])


def length_unit(skeleton: Skeleton, poses: Array, up: str) -> tuple[str | None, list[str]]:
    """What the lengths are in, judged by the tallest pose or else the rest pose; None where it is nobody's stature."""
    tallest = float(np.ptp(poses[..., "xyz".index(up)], axis=1).max())
    for stature in (tallest, skeleton.height):
        for unit, (low, high) in STATURES.items():
            if low <= stature <= high:
                return unit, [f"the unit is a guess: {stature:.4g} looks like a stature in {unit}"]
    return None, []


def odd_times(turning: Array, frame_rate: float) -> list[str]:
    """Notes on a first frame that is no part of the motion, and on a frame time that no motion has.

    Args:
        turning: (T,) how far the joints turn from the frame before, on average; 0 at first.
        frame_rate: in Hz.
    """
    notes = []
    if len(turning) > 10 and turning[1] > max(4 * turning[2:].max(), 0.03):
        notes.append("the first frame is far from all others, likely a rest pose that is no part of the motion")
    if frame_rate <= 2:
        notes.append(f"a frame lasts {1 / frame_rate:.3g} s, so these may be key poses rather than a motion")
    return notes


def still_root(skeleton: Skeleton, carrier: int) -> str:
    """A note on a joint 0 that stands still above the one that carries the character."""
    root, below = shown(skeleton.names[0]), shown(skeleton.names[carrier])
    return f"'{root}' stands still; '{below}' below it carries the character"


def odd_places(skeleton: Skeleton, offsets: Array, wandering: list[int]) -> list[str]:
    """Notes on joints that are elsewhere than their OFFSET says, or move in their parent's frame.

    Args:
        skeleton: as read, with what stands still as offsets.
        offsets: (J, 3) the OFFSETs of the file.
        wandering: the joints that move, those aside that carry the character.
    """
    notes = []
    apart = np.linalg.norm(skeleton.offsets - offsets, axis=-1) / skeleton.height  # (J,)
    apart[0] = 0.0
    if elsewhere := int((apart > ELSEWHERE).sum()):
        worst = int(apart.argmax())
        notes.append(
            f"position channels hold joints elsewhere than their OFFSET: {elsewhere} of them, "
            f"by up to {apart[worst]:.1%} of the height ('{shown(skeleton.names[worst])}'); the channels are taken"
        )
    if wandering:
        named = ", ".join(f"'{shown(skeleton.names[j])}'" for j in wandering[:4])
        more = f" and {len(wandering) - 4} more" if len(wandering) > 4 else ""
        notes.append(f"besides the root, joints move in their parents' frames: {named}{more}")
    if pointless := int((np.linalg.norm(skeleton.end_site_offsets, axis=-1) == 0).sum()):
        notes.append(f"{pointless} of {len(skeleton.end_sites)} end sites have no length")
    return notes
