"""Skeletal parts (section 3.3, Fig. 3): overlapping sub-trees that are matched and blended apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motiongen.generators.constraints import Parts
from motiongen.skeleton import Skeleton

LIMB_SHARE = 0.08
"""How much of all bone length a branch must have to be a limb; anything smaller stays with what it hangs from."""


TRUNK = "trunk"


def skeletal_parts(skeleton: Skeleton, parts: Parts, feet: Sequence[int] = ()) -> dict[str, tuple[int, ...]]:
    """Name -> joints of each part, as given, or by a preset where none are; `feet` are the skeleton's foot joints."""
    if parts.joints:
        return {name: skeleton.select(patterns) for name, patterns in parts.joints.items()}
    found = automatic_parts(skeleton)
    if parts.preset == "auto":
        return found
    legs = [name for name, joints in found.items() if name != TRUNK and set(joints[1:]) & set(feet)]
    arms = [name for name in found if name != TRUNK and name not in legs]
    if parts.preset == "arms":
        return {"body": _together(found, [TRUNK, *legs]), **{arm: found[arm] for arm in arms}}
    return {"upper": _together(found, [TRUNK, *arms]), "lower": _together(found, legs)} if legs else found


def _together(parts: dict[str, tuple[int, ...]], names: Sequence[str]) -> tuple[int, ...]:
    return tuple(sorted({joint for name in names for joint in parts[name]}))


def automatic_parts(skeleton: Skeleton) -> dict[str, tuple[int, ...]]:
    """The trunk, and each limb with the trunk joint that it hangs from, which both share.

    A limb is a branch that holds `LIMB_SHARE` of the bone length. The trunk is what joins the limbs: the joints that
    have at least two limbs below them in different branches, those between them, and all branches too small for a
    limb. Names, joint order and what the limbs do play no part. A skeleton without branches is one part.
    """
    length = _branch_lengths(skeleton)
    long = length >= LIMB_SHARE * length[0]
    inner = [j for j in range(len(skeleton)) if sum(bool(long[c]) for c in skeleton.children[j]) >= 2]
    if not inner:
        return {TRUNK: tuple(range(len(skeleton)))}
    trunk = {0, *inner, *(above for joint in inner for above in skeleton.ancestors(joint))}
    limbs = [
        child for joint in sorted(trunk) for child in skeleton.children[joint] if child not in trunk and long[child]
    ]
    below = {joint for limb in limbs for joint in skeleton.subtree(limb)}
    parts = {TRUNK: tuple(j for j in range(len(skeleton)) if j not in below)}
    for limb in limbs:
        parts[skeleton.names[limb]] = (skeleton.parents[limb], *skeleton.subtree(limb))
    return parts


def _branch_lengths(skeleton: Skeleton) -> np.ndarray:
    """(J,) total length of the bones of each joint's subtree, its own bone and end sites included."""
    bones = np.linalg.norm(skeleton.offsets, axis=-1)
    bones[[*skeleton.ancestors(skeleton.body), skeleton.body]] = 0.0  # they place the body, and are no bones
    np.add.at(bones, list(skeleton.end_sites), np.linalg.norm(skeleton.end_site_offsets, axis=-1))
    for joint in reversed(range(1, len(skeleton))):
        bones[skeleton.parents[joint]] += bones[joint]
    return bones


def overlaps(parts: Sequence[Sequence[int]]) -> set[int]:
    """The joints that more than one part holds."""
    seen: set[int] = set()
    twice: set[int] = set()
    for part in parts:
        twice |= seen & set(part)
        seen |= set(part)
    return twice
