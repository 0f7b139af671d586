"""From constraints to a plan: what is known of the result before it is made, and what it is held to.

Keys, given joints, a kept rest of a clip, the clip before and the clip after are all the same kind of knowledge: poses
at frames. `known` frames are held through all stages of the synthesis and put in exactly at its end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.features import FeatureLayout, to_features
from motiongen.generators.constraints import (
    Constraint,
    Continuation,
    FixedJoints,
    InBetween,
    Keyframes,
    Loop,
    Parts,
    Segment,
    Style,
)
from motiongen.generators.genmm.guidance import Guidance, Hold
from motiongen.motion import Motion

C = TypeVar("C", bound=Constraint)

CONTEXT_PATCHES = 2
"""How many patches of a neighbouring clip are held, so that what joins it is matched together with it."""

STYLE_NOISE = 0.25
"""Share of the usual noise that is added to the content of a style, so that seeds differ."""


@dataclass(frozen=True)
class Known:
    """Poses that the result has at some frames.

    Attributes:
        frames: (n,) ascending frames of the whole synthesis, context included.
        poses: (n frames) the poses there, with the translating joints of the result.
        joints: the joints that are known; None: all.
        ground: whether the place on the ground is known, too.
        dense: whether neighbouring frames are known, so that velocities are, too.
    """

    frames: NDArray[np.int64]
    poses: Motion
    joints: tuple[int, ...] | None = None
    ground: bool = True
    dense: bool = True


@dataclass(frozen=True)
class Plan:
    """What to make, in frames at the examples' rate.

    Attributes:
        frames: length of the result.
        lead: frames of context before it, cut off at the end.
        tail: frames of context after it, cut off at the end.
        known: poses that it has.
        loop: how it closes, if it does.
        parts: its skeletal parts, if they are matched apart.
        style: whose coarse movement it has, if any.
    """

    frames: int
    lead: int = 0
    tail: int = 0
    known: tuple[Known, ...] = field(default_factory=tuple)
    loop: Loop | None = None
    parts: Parts | None = None
    style: Style | None = None

    @property
    def total(self) -> int:
        """Frames to make, context included."""
        return self.lead + self.frames + self.tail

    def free_feet(self, layout: FeatureLayout) -> tuple[int, ...]:
        """The foot joints that hang from the root by joints that are all free to move."""
        fixed = {joint for known in self.known if known.dense for joint in known.joints or () if joint != layout.root}
        chains = {foot: {foot, *layout.skeleton.ancestors(foot)} for foot in layout.feet}
        return tuple(foot for foot, chain in chains.items() if not chain & fixed)

    def root_is_known(self, layout: FeatureLayout) -> bool:
        """Whether the root is among joints whose motion is given throughout."""
        return any(known.dense and layout.root in (known.joints or ()) for known in self.known)


def make_plan(frames: int, constraints: Sequence[Constraint], layout: FeatureLayout, rate: float, context: int) -> Plan:
    """Put constraints together.

    Args:
        frames: length of the result.
        constraints: what it must keep to, each checked by itself.
        layout: of the examples.
        rate: of the result in Hz; motions at another rate are resampled, clips to keep bit for bit must have it.
        context: frames of a neighbouring clip to hold.

    Raises:
        MotionGenError: if two of a kind come, or two that do not go together.
    """
    by_kind = _one_of_each(constraints)
    translating = tuple(sorted({layout.root, *layout.translating}))

    def fitting(motion: Motion) -> Motion:
        resampled = motion if math.isclose(motion.frame_rate, rate, rel_tol=1e-4) else motion.resample(rate)
        return resampled.with_translating(translating)

    known: list[Known] = []
    lead = tail = 0
    if (segment := _of(by_kind, Segment)) is not None:
        if not math.isclose(segment.motion.frame_rate, rate, rel_tol=1e-4):
            raise MotionGenError(
                f"the clip of the segment runs at {segment.motion.frame_rate:g} Hz and the result at {rate:g} Hz; "
                "only at one rate can its frames be kept"
            )
        kept = np.flatnonzero(~np.isin(np.arange(frames), np.arange(segment.start, segment.stop)))
        if len(kept):
            known.append(Known(kept, _frames_of(fitting(segment.motion), kept)))
    if (before := _of(by_kind, Continuation)) is not None:
        known.append(_end_of(fitting(before.motion), context))
        lead = len(known[-1].frames)
    if (between := _of(by_kind, InBetween)) is not None:
        start, end = _end_of(fitting(between.before), context), fitting(between.after)[:context]
        lead, tail = len(start.frames), len(end)
        after = np.arange(lead + frames, lead + frames + tail)
        known.append(Known(np.concatenate([start.frames, after]), _joined([start.poses, end])))
    if (fixed := _of(by_kind, FixedJoints)) is not None:
        given = fitting(fixed.motion)
        if len(given) < frames:
            raise MotionGenError(f"the motion of the fixed joints has {len(given)} frames at {rate:g} Hz, not {frames}")
        joints = layout.skeleton.select(fixed.joints)
        known.append(Known(np.arange(frames), given[:frames], joints, ground=layout.root in joints))
    if (keys := _of(by_kind, Keyframes)) is not None:
        joined = _joined([pose.with_translating(translating) for pose in keys.poses.values()])
        held = None if keys.joints is None else layout.skeleton.select(keys.joints)
        known.append(Known(np.array(list(keys.poses)) + lead, joined, held, ground=False, dense=False))
    return Plan(frames, lead, tail, tuple(known), _of(by_kind, Loop), _of(by_kind, Parts), _of(by_kind, Style))


def guidance_of(
    plan: Plan,
    layout: FeatureLayout,
    weights: NDArray[np.float64],
    stride: int,
    examples: Sequence[torch.Tensor],
    reach: int,
) -> Guidance:
    """The plan as weighted features at the working rate.

    Args:
        plan: what to make.
        layout: of the features.
        weights: (D,) what features are multiplied with for matching.
        stride: frames at the examples' rate to one at the working rate.
        examples: (T_i, D) weighted features of the examples at the working rate.
        reach: working frames to each side of a key that move as the example does there.
    """
    device = examples[0].device
    holds = [
        _hold(known, layout, weights, stride, device)
        if known.dense
        else _hold_keys(known, layout, weights, stride, examples, reach)
        for known in plan.known
    ]
    guess, detail = None, 0.0
    if plan.style is not None:
        content = to_features(plan.style.content[: plan.frames], layout)[::stride] * weights
        guess, detail = torch.from_numpy(content).to(device), plan.style.detail
    return Guidance(
        tuple(hold for hold in holds if len(hold.times)),
        plan.loop is not None,
        guess,
        detail,
        STYLE_NOISE if plan.style is not None else 1.0,
    )


def _hold(known: Known, layout: FeatureLayout, weights: NDArray[np.float64], stride: int, device: torch.device) -> Hold:
    """Known motion: the working frames among the known ones keep their features, steps included."""
    # Each unbroken run by itself: a step across a gap is none.
    runs = np.split(np.arange(len(known.frames)), np.flatnonzero(np.diff(known.frames) > 1) + 1)
    features = np.concatenate([to_features(_frames_of(known.poses, run), layout) for run in runs])
    on_grid = known.frames % stride == 0
    columns = _columns(known, layout)
    values = torch.from_numpy((features * weights)[on_grid][:, columns])
    times = torch.from_numpy(known.frames[on_grid] // stride)
    return Hold(times.to(device), values.to(device), torch.from_numpy(columns).to(device))


def _hold_keys(
    known: Known,
    layout: FeatureLayout,
    weights: NDArray[np.float64],
    stride: int,
    examples: Sequence[torch.Tensor],
    reach: int,
) -> Hold:
    """Known poses: around each key the example frames around the pose nearest to it are held.

    A pose alone says nothing of how it is moved through. Holding the example's way through it, and not the pose, keeps
    velocities the example's own; the pose itself is put in at the end.
    """
    columns = _columns(known, layout)
    posed = columns[~np.isin(columns, np.arange(layout.size)[layout.root_steps])]
    keys = torch.from_numpy((to_features(known.poses, layout) * weights)[:, posed]).to(examples[0])
    frames = torch.cat(list(examples))
    nearest = torch.cdist(keys, frames[:, posed]).argmin(dim=1).tolist()
    ends = np.cumsum([len(example) for example in examples])
    at = np.round(known.frames / stride).astype(np.int64)
    held: dict[int, int] = {}  # working frame -> frame of the examples, end to end
    for number, source in enumerate(nearest):
        which = int(np.searchsorted(ends, source, side="right"))
        first, last = int(ends[which]) - len(examples[which]), int(ends[which]) - 1
        gaps = [abs(int(at[number] - at[other])) for other in (number - 1, number + 1) if 0 <= other < len(at)]
        near = min([reach, *((gap - 1) // 2 for gap in gaps if gap > 0)])
        for offset in range(max(-near, first - source, -int(at[number])), min(near, last - source) + 1):
            held[int(at[number]) + offset] = source + offset
    times = torch.tensor(sorted(held), device=frames.device)
    values = frames[[held[int(time)] for time in times]][:, torch.from_numpy(columns)]
    return Hold(times, values, torch.from_numpy(columns).to(frames.device))


def _columns(known: Known, layout: FeatureLayout) -> NDArray[np.int64]:
    """The features of the known joints; contact labels are found anew."""
    joints = range(len(layout.skeleton)) if known.joints is None else known.joints
    columns = layout.joint_features(joints)
    return columns[columns < layout.contacts.start]


def _end_of(motion: Motion, context: int) -> Known:
    last = motion[-context:] if len(motion) > context else motion
    return Known(np.arange(len(last)), last)


def _joined(motions: Sequence[Motion]) -> Motion:
    """The frames of motions with the same translating joints, one after the other, where they stand."""
    return motions[0].replace(
        rotations=np.concatenate([motion.rotations for motion in motions]),
        translations=np.concatenate([motion.translations for motion in motions]),
    )


def _frames_of(motion: Motion, frames: NDArray[np.int64]) -> Motion:
    return motion.replace(rotations=motion.rotations[frames], translations=motion.translations[frames])


def _one_of_each(constraints: Sequence[Constraint]) -> dict[type[Constraint], Constraint]:
    kinds: dict[type[Constraint], Constraint] = {}
    for constraint in constraints:
        if type(constraint) in kinds:
            raise MotionGenError(f"there can be only one {type(constraint).__name__}; put them together in one")
        kinds[type(constraint)] = constraint
    neighbours = [kind for kind in (Segment, Continuation, InBetween) if kind in kinds]
    for first, second in ((a, b) for a in neighbours for b in (*neighbours, Loop, FixedJoints) if a is not b):
        if second in kinds:
            raise MotionGenError(f"{first.__name__} and {second.__name__} do not go together; leave one of them out")
    return kinds


def _of(kinds: dict[type[Constraint], Constraint], kind: type[C]) -> C | None:
    found = kinds.get(kind)
    return found if isinstance(found, kind) else None
