"""What a user can ask of a synthesis besides its length. Small frozen records; they mean the same for every generator.

A generator says in its capabilities which of them it takes, and refuses the others before it starts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError, nearest_of
from motiongen.motion import Motion
from motiongen.skeleton import Skeleton, frozen_array

_FARTHEST = 1e9
"""Of a root path, in any unit: beyond, numbers no longer tell one step from the next."""


@dataclass(frozen=True)
class Constraint:
    """Base of all constraints."""

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """Raise MotionGenError unless this constraint fits a synthesis of `frames` frames on `skeleton`."""


@dataclass(frozen=True, eq=False)
class Keyframes(Constraint):
    """Poses that hold exactly at their frames.

    The joints' rotations and the root's height are held; where the root stands on the ground is not.

    Attributes:
        poses: frame of the synthesis -> a one-frame motion. `motiongen.adapt` brings poses of a like rig here.
        joints: names or shell-style patterns of the joints that are held; None: all.
    """

    poses: Mapping[int, Motion]
    joints: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check that there are poses, of one frame each."""
        if not self.poses:
            raise MotionGenError("Keyframes needs at least one pose; none came")
        for frame, pose in self.poses.items():
            if len(pose) != 1:
                raise MotionGenError(f"the key at frame {frame} must be one frame, not {len(pose)}; take one: clip[10]")
        object.__setattr__(self, "poses", MappingProxyType({int(f): p for f, p in sorted(self.poses.items())}))

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """Keys must lie within the synthesis and be poses of its skeleton."""
        for frame, pose in self.poses.items():
            if not 0 <= frame < frames:
                raise MotionGenError(f"there is no frame {frame} for a key; frames go from 0 to {frames - 1}")
            _check_skeleton(f"the key at frame {frame}", skeleton, pose)
        if self.joints is not None:
            skeleton.select(self.joints)


@dataclass(frozen=True)
class Loop(Constraint):
    """The synthesis can be played over and over: its end leads into its beginning in pose and velocity.

    Attributes:
        in_place: whether the character ends where it began; False lets it travel, None does what the examples do.
    """

    in_place: bool | None = None

    def __post_init__(self) -> None:
        """Check the type."""
        if self.in_place not in (True, False, None):
            raise MotionGenError(f"in_place of a loop must be true, false or null, not {self.in_place!r}")


@dataclass(frozen=True, eq=False)
class FixedJoints(Constraint):
    """Motion completion: some joints move exactly as given, the rest is synthesised.

    Attributes:
        motion: holds the given joints' motion, at least as long as the synthesis.
        joints: names or shell-style patterns of the given joints.
    """

    motion: Motion
    joints: tuple[str, ...]

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """The motion must be of the same skeleton and long enough, and the patterns must match."""
        _check_skeleton("the motion of the fixed joints", skeleton, self.motion)
        skeleton.select(self.joints)
        if len(self.motion) < frames:
            raise MotionGenError(
                f"the motion of the fixed joints has {len(self.motion)} frames, {frames} are asked for; ask for fewer"
            )


@dataclass(frozen=True, eq=False)
class RootPath(Constraint):
    """The character travels along a path over the ground, as the examples travel.

    The path is a smooth curve through the points that begins and ends straight; a point given twice in a row is a
    corner, and a path that ends at its first point is closed. The line that the body sways about lies on it, corners
    rounded; the body keeps its angle to the direction of travel, or faces where it is told to, which makes feet slide
    where the examples never go that way.

    Strides stay as long as the examples'. To arrive with the last frame the motion is played at 0.8 to 1.25 times
    their pace. If that is not enough it keeps their pace: on a path too long it gets as far as it gets, on one too
    short it goes straight on beyond the end, and round a closed one it goes on. The notes of the motion say what
    happened, how many frames would do, and how far the character was from the path. It goes together with `Parts` and,
    on a closed path, with `Loop`.

    Attributes:
        points: (P, 2) places on the ground (x, z), in the unit of the examples, at least two.
        facing_radians: (P,) heading at each point, counter-clockwise from +z seen from above; None: as the examples
            move. Between points it turns the shorter way; of a point given twice the first heading counts.
    """

    points: NDArray[np.float64]
    facing_radians: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Check the shapes and freeze the arrays."""
        points = frozen_array(self.points, (-1, 2), "points of the root path")
        if len(points) < 2:
            raise MotionGenError(f"a root path needs at least two points, not {len(points)}")
        if (points == points[0]).all():
            raise MotionGenError(f"a root path needs two different points; all {len(points)} are {points[0].tolist()}")
        if np.abs(points).max() > _FARTHEST:
            raise MotionGenError(f"a point of the root path is {np.abs(points).max():g} away; nothing goes so far")
        object.__setattr__(self, "points", points)
        if self.facing_radians is not None:
            facing = frozen_array(self.facing_radians, (len(points),), "facing_radians of the root path")
            object.__setattr__(self, "facing_radians", facing)

    @property
    def closed(self) -> bool:
        """Whether the path ends where it begins and goes round."""
        return bool((self.points[0] == self.points[-1]).all())


@dataclass(frozen=True, eq=False)
class Segment(Constraint):
    """Redo some frames of a clip and keep every other one bit for bit.

    Attributes:
        motion: the clip, as long as the synthesis.
        start: the first frame to redo.
        stop: the first frame after those to redo.
    """

    motion: Motion
    start: int
    stop: int

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """The clip must be as long as the synthesis, and the frames must lie in it."""
        _check_skeleton("the clip of the segment", skeleton, self.motion)
        if len(self.motion) != frames:
            raise MotionGenError(
                f"the clip of the segment has {len(self.motion)} frames; ask for as many, not {frames}"
            )
        whole = all(isinstance(bound, int) and not isinstance(bound, bool) for bound in (self.start, self.stop))
        if not (whole and 0 <= self.start < self.stop <= frames):
            raise MotionGenError(
                f"the segment {self.start}:{self.stop} does not lie in a clip with frames 0 to {frames - 1}"
            )


PART_PRESETS = ("auto", "arms", "upper_lower")


@dataclass(frozen=True)
class Parts(Constraint):
    """Skeletal parts, matched and blended apart (GenMM section 3.3).

    Attributes:
        joints: name of the part -> names or shell-style patterns of its joints; parts may overlap. Empty: the preset.
        preset: parts that are found on any skeleton. auto: the trunk, and each limb; arms: each limb without feet, and
            all the rest together; upper_lower: the limbs with feet together, and all the rest together. What hangs
            together shares the joint where it does.
        examples: name of a given part -> numbers of the examples that its motion is taken from, 0 for the first that
            was given to `fit`. Parts that are not named take it from all. With this a creature moves one part as one
            character does and another part as another (section 3.4); see `motiongen.reassembly`.
    """

    joints: Mapping[str, Sequence[str]] = field(default_factory=dict)
    examples: Mapping[str, Sequence[int]] = field(default_factory=dict)
    preset: str = "auto"

    def __post_init__(self) -> None:
        """Freeze the mappings."""
        parts = {str(name): tuple(patterns) for name, patterns in self.joints.items()}
        object.__setattr__(self, "joints", MappingProxyType(parts))
        examples = {str(name): tuple(int(number) for number in numbers) for name, numbers in self.examples.items()}
        object.__setattr__(self, "examples", MappingProxyType(examples))

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """Every pattern must match, the parts together must hold every joint, and examples are given for parts."""
        if self.preset not in PART_PRESETS:
            raise MotionGenError(
                f"there is no preset of parts '{self.preset}'{nearest_of(self.preset, PART_PRESETS)}; there are "
                f"{', '.join(PART_PRESETS)}"
            )
        for name, numbers in self.examples.items():
            if name not in self.joints:
                known = ", ".join(self.joints) or "none"
                raise MotionGenError(f"examples are given for part '{name}'; the parts that are given: {known}")
            if not numbers or min(numbers) < 0:
                raise MotionGenError(f"part '{name}' needs numbers of examples, 0 and more, not {list(numbers)}")
        held = {joint for patterns in self.joints.values() for joint in skeleton.select(patterns)}
        left = [name for joint, name in enumerate(skeleton.names) if joint not in held]
        if self.joints and left:
            raise MotionGenError(f"the parts must hold every joint; '{left[0]}' and {len(left) - 1} more are in none")


@dataclass(frozen=True, eq=False)
class Continuation(Constraint):
    """Go on from the end of a clip: the synthesis begins with the frame after its last one.

    Attributes:
        motion: the clip to go on from.
    """

    motion: Motion

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """The clip must be of the same skeleton."""
        _check_skeleton("the clip to go on from", skeleton, self.motion)


@dataclass(frozen=True, eq=False)
class InBetween(Constraint):
    """Lead from the end of one clip to the beginning of another.

    Attributes:
        before: the clip that the synthesis follows.
        after: the clip that follows the synthesis, where it stands in the world.
    """

    before: Motion
    after: Motion

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """Both clips must be of the same skeleton."""
        _check_skeleton("the clip before", skeleton, self.before)
        _check_skeleton("the clip after", skeleton, self.after)


@dataclass(frozen=True, eq=False)
class Style(Constraint):
    """Style by content, after GANimator: coarse movement from a clip, detail from the examples.

    Attributes:
        content: the clip whose coarse movement is taken, at least as long as the synthesis.
        detail: how coarse, as a share of full resolution between 0 and 1: below it movement is the content's, above it
            the examples'.
    """

    content: Motion
    detail: float = 0.25

    def __post_init__(self) -> None:
        """Check the share."""
        if not isinstance(self.detail, (int, float)) or not 0 < self.detail <= 1:
            raise MotionGenError(f"the detail of a style must lie above 0 and at most at 1, not {self.detail!r}")

    def check(self, skeleton: Skeleton, frames: int) -> None:
        """The content must be of the same skeleton and long enough."""
        _check_skeleton("the content", skeleton, self.content)
        if len(self.content) < frames:
            raise MotionGenError(f"the content has {len(self.content)} frames, {frames} are asked for; ask for fewer")


CONSTRAINTS: tuple[type[Constraint], ...] = (
    Keyframes,
    Loop,
    FixedJoints,
    RootPath,
    Segment,
    Continuation,
    InBetween,
    Style,
    Parts,
)


def _check_skeleton(what: str, skeleton: Skeleton, motion: Motion) -> None:
    if found := skeleton.difference(motion.skeleton, ignoring=motion.translating):
        raise MotionGenError(f"{what} has another skeleton than the examples: {found}")
