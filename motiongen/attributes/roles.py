"""Which joints of a biped are its arms, its ankles and the ends of its trunk, from names and the tree."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from motiongen.contact import foot_joints
from motiongen.errors import MotionGenError
from motiongen.mirror import counterparts
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton
from motiongen.stance import is_left

SIDES = ("left", "right")

_HAND = re.compile(r"hand|wrist|palm", re.IGNORECASE)


@dataclass(frozen=True)
class Arm:
    """The joints of an arm.

    Attributes:
        shoulder: where the upper arm begins.
        elbow: between upper arm and forearm.
        hand: where the forearm ends: the wrist.
    """

    shoulder: int
    elbow: int
    hand: int


@functools.lru_cache(maxsize=64)
def arm(skeleton: Skeleton, side: str) -> Arm:
    """The arm of a side, `left` or `right`.

    The hand is the first joint of that side that is called hand, wrist or palm. The two joints above it that bound two
    long bones of about equal length are elbow and shoulder, whatever they are called and whatever twist joints and
    collarbones there are.

    Raises:
        MotionGenError: if there is no such arm.
    """
    hands = {each: _hand(skeleton, each) for each in SIDES}
    chest = _meeting(skeleton, hands.values())
    chain = [j for j in (*skeleton.ancestors(hands[side]), hands[side]) if j > chest and chest in skeleton.ancestors(j)]
    if len(chain) < 3:
        raise MotionGenError(
            f"the {side} arm, above '{skeleton.names[hands[side]]}', has no shoulder and elbow; it needs two bones"
        )
    places = np.cumsum(np.linalg.norm(skeleton.offsets[chain], axis=-1))  # along the arm
    best = max(itertools.combinations(range(len(chain) - 1), 2), key=lambda pair: _like_an_arm(places, *pair))
    return Arm(chain[best[0]], chain[best[1]], chain[-1])


@functools.lru_cache(maxsize=1)
def ankles(motion: Motion) -> tuple[int, int]:
    """The left and the right ankle: the uppermost foot joint of each leg; never a hand, not even in a handstand.

    Raises:
        MotionGenError: if there are not two legs in a pair.
    """
    skeleton = motion.skeleton
    feet = set(foot_joints(motion)) - set(_called_hands(skeleton))
    found = [_uppermost(skeleton, _of_side(skeleton, sorted(feet), side)) for side in SIDES]
    if any(len(joints) != 1 for joints in found):
        raise MotionGenError(
            f"'{motion.name}' has {len(found[0])} left and {len(found[1])} right feet; this needs a biped with names "
            "such as LeftFoot and RightFoot"
        )
    return found[0][0], found[1][0]


def trunk(motion: Motion) -> tuple[int, int]:
    """The joints where the trunk begins and ends: where the legs meet and where the arms meet.

    Raises:
        MotionGenError: if there are no two arms and two legs, or nothing is between them.
    """
    skeleton = motion.skeleton
    hips = _meeting(skeleton, ankles(motion))
    chest = _meeting(skeleton, [_hand(skeleton, side) for side in SIDES])
    if hips == chest:
        raise MotionGenError(f"arms and legs of '{motion.name}' meet in '{skeleton.names[hips]}'; this needs a spine")
    return hips, chest


def _hand(skeleton: Skeleton, side: str) -> int:
    found = _uppermost(skeleton, _of_side(skeleton, _called_hands(skeleton), side))
    if len(found) != 1:
        raise MotionGenError(
            f"the skeleton has {len(found)} {side} hands; this needs a biped with names such as LeftHand and RightHand"
        )
    return found[0]


def _called_hands(skeleton: Skeleton) -> list[int]:
    return [j for j, name in enumerate(skeleton.names) if _HAND.search(re.split(r"[:|]", name)[-1])]


def _of_side(skeleton: Skeleton, joints: Iterable[int], side: str) -> list[int]:
    """Those of `joints` that are of a side and have a counterpart."""
    pairs = counterparts(skeleton)
    names = skeleton.names
    return [j for j in joints if pairs[j] != j and is_left(names[j], names[pairs[j]]) == (side == "left")]


def _uppermost(skeleton: Skeleton, joints: Sequence[int]) -> list[int]:
    """Those that hang from none of the others."""
    return [j for j in joints if not set(skeleton.ancestors(j)) & set(joints)]


def _meeting(skeleton: Skeleton, joints: Iterable[int]) -> int:
    """The lowest joint that all of `joints` hang from."""
    above = [skeleton.ancestors(joint) for joint in joints]
    return [together[0] for together in zip(*above) if len(set(together)) == 1][-1]


def _like_an_arm(places: np.ndarray, shoulder: int, elbow: int) -> float:
    """How much two bones of a chain, from shoulder to elbow and on to the end, are long and of one length."""
    upper, fore = places[elbow] - places[shoulder], places[-1] - places[elbow]
    return float(2 * min(upper, fore) - max(upper, fore))
