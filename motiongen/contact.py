"""Feet and the ground: which joints are feet, and when they stand. For any skeleton, whatever its joints are called."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen import kinematics
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton

Array = NDArray[np.float64]
Labels = NDArray[np.bool_]

CONTACT_HEIGHT = 0.03
"""A foot joint touches the ground below this height over its own standing level, in skeleton heights."""

CONTACT_SPEED = 0.3
"""A foot joint stands below this speed, in skeleton heights per second."""

NEAR_GROUND = 0.1
"""A joint can stand on the ground where its standing level lies below this height over it, in skeleton heights."""

SPEED_SPAN_SECONDS = 1 / 30
"""Speeds are taken over about this time to either side, whatever the frame rate, or noise at a high one drowns them."""

# Of a joint's heights over time this one is its standing level: low, yet no single dip.
_STANDING_PERCENTILE = 5.0

# Shares of the time that a joint of unknown name, and one named as a hand, must stand to be a foot.
_STANDS_NOW_AND_THEN, _STANDS_MOSTLY = 0.1, 0.5

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_BEFORE = r"(?:left|right|front|fore|hind|back|rear|mid|l|r)*"
_AFTER = r"(?:base|end|nub|tip|joint|jnt|left|right|l|r)*"
_FOOT = re.compile(rf"{_BEFORE}(?:foot|feet|toes?|ankles?|heels?|hoof|hoofs|hooves|paws?){_AFTER}")
_BALL = re.compile(rf"{_BEFORE}balls?{_AFTER}")
_HAND = re.compile(rf"{_BEFORE}(?:hands?|palms?|wrists?|fingers?){_AFTER}")
_DIGIT = re.compile(r"thumb|index|middle|ring|pinky")
# What is worn on a foot or steers it from outside the body is none.
_NO_FOOT = frozenset({"ik", "pole", "target", "ctrl", "control", "wear", "print", "step"})


def foot_joints(motions: Motion | Sequence[Motion]) -> tuple[int, ...]:
    """The joints of the feet: ankles, feet and toes, ascending.

    Joints whose names say that they are feet (foot, toe, ankle, heel, hoof, paw; the ball below a foot) are taken as
    such. Rigs of four-legged animals often call the front feet hands: a hand that stands on the ground for half of the
    time or more is a foot too. Where no name says anything, the feet are the tips of limbs that come down and stand on
    the ground every now and then, with the joints above them that stay as near to it.

    Args:
        motions: one clip, or several of one skeleton; where names do not tell, all of them are looked at together.

    Returns:
        Joint indices; none where nothing comes near the ground.

    Raises:
        MotionGenError: if no motion came, or their skeletons differ in names or tree.
    """
    clips = [motions] if isinstance(motions, Motion) else list(motions)
    if not clips:
        raise MotionGenError("foot_joints needs at least one motion; none came")
    skeleton = clips[0].skeleton
    for clip in clips[1:]:
        if not skeleton.same_tree(clip.skeleton):
            raise MotionGenError(
                f"'{clip.name}' has another skeleton than '{clips[0].name}': {skeleton.difference(clip.skeleton)}"
            )
    named, hands = _named_feet(skeleton)
    candidates = hands if named else tuple(range(len(skeleton)))
    stands = np.zeros(len(skeleton))  # (J,) share of the time
    frames = sum(len(clip) for clip in clips)
    for clip in clips:
        stands[list(candidates)] += contact_labels(clip, candidates).sum(axis=0) / frames
    if named:
        return tuple(sorted({*named, *(j for j in hands if stands[j] >= _STANDS_MOSTLY)}))
    # A knee or a hip that comes down once in a while is no foot unless everything below it is down as often.
    down = stands >= _STANDS_NOW_AND_THEN
    return tuple(j for j in candidates if j != clips[0].root and all(down[k] for k in skeleton.subtree(j)))


def contact_labels(
    motion: Motion,
    feet: Sequence[int] | None = None,
    height: float = CONTACT_HEIGHT,
    speed: float = CONTACT_SPEED,
) -> Labels:
    """Whether each foot joint stands on the ground, (T, C).

    A joint does so where it is both low (`foot_heights` below `height`) and slow (in all three directions, by central
    differences over a thirtieth of a second to either side). A clip of a single frame has no speed: height decides.

    Args:
        motion: the clip.
        feet: (C,) the foot joints; `foot_joints(motion)` by default.
        height: largest height over the joint's own standing level, in skeleton heights.
        speed: largest speed in skeleton heights per second.

    Raises:
        MotionGenError: if there is no such joint or a threshold is negative.
    """
    if not (height >= 0 and speed >= 0):
        raise MotionGenError(f"contact thresholds must not be negative: height {height}, speed {speed}")
    feet = foot_joints(motion) if feet is None else feet
    return (foot_heights(motion, feet) < height) & (_speeds(motion, feet) < speed)


def foot_heights(motion: Motion, feet: Sequence[int]) -> Array:
    """Heights of the foot joints over their own standing levels, (T, C), in skeleton heights.

    A joint's standing level is the low end of its heights over the clip, because an ankle stands higher than a toe.
    Where that is too far above the ground (`NEAR_GROUND`: feet that dangle, the second half of a high jump), the joint
    never stands, and its height over the ground itself is given.

    Raises:
        MotionGenError: if there is no such joint.
    """
    heights = motion.positions[:, _checked(motion, feet), 1]  # (T, C)
    if heights.size == 0:
        return heights
    ground = kinematics.ground_height(motion)
    level = np.percentile(heights, _STANDING_PERCENTILE, axis=0)  # (C,)
    level[level - ground > NEAR_GROUND * motion.skeleton.height] = ground
    return (heights - level) / motion.skeleton.height


def _speeds(motion: Motion, feet: Sequence[int]) -> Array:
    """Speeds of joints by central differences, one-sided at the ends, (T, C), in skeleton heights per second."""
    positions = motion.positions[:, _checked(motion, feet)]  # (T, C, 3)
    frames = np.arange(len(motion))
    reach = max(1, round(SPEED_SPAN_SECONDS * motion.frame_rate))
    before, after = np.maximum(frames - reach, 0), np.minimum(frames + reach, len(motion) - 1)
    seconds = np.maximum(after - before, 1) / motion.frame_rate  # (T,)
    moved = np.linalg.norm(positions[after] - positions[before], axis=-1)
    return moved / (seconds[:, None] * motion.skeleton.height)


def _checked(motion: Motion, feet: Sequence[int]) -> list[int]:
    joints = len(motion.skeleton)
    for joint in feet:
        if not 0 <= joint < joints:
            raise MotionGenError(f"there is no joint {joint} in '{motion.name}'; its joints are 0 to {joints - 1}")
    return list(feet)


def _named_feet(skeleton: Skeleton) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The joints whose names call them feet, and those called hands."""
    words = [_words(name) for name in skeleton.names]
    # What every joint is called is the character's name, not the joint's.
    shared = frozenset.intersection(*words) if len(words) > 1 else frozenset()
    words = [w - shared for w in words]
    feet: list[int] = []
    hands: list[int] = []
    for joint, called in enumerate(words):
        if called & _NO_FOOT:
            continue
        is_foot = any(_FOOT.fullmatch(word) for word in called)
        is_ball = any(_BALL.fullmatch(word) for word in called) and any(a in feet for a in skeleton.ancestors(joint))
        if is_foot or is_ball:
            feet.append(joint)
        elif any(_HAND.fullmatch(word) for word in called) and not any(_DIGIT.search(word) for word in called):
            hands.append(joint)
    return tuple(feet), tuple(hands)


def _words(name: str) -> frozenset[str]:
    """The words of a joint's name in small letters, without its name space: rig:LeftToe_End gives left, toe, end."""
    return frozenset(word.lower() for word in _WORD.findall(re.split(r"[:|]", name)[-1]))
