"""Key poses: how far they lie from the examples, and how long a motion needs to flow into them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.generators.genmm.plan import Known
from motiongen.motion import Motion

Array = NDArray[np.float64]

FAR_DEGREES = 10.0
"""A key is far from the examples if their nearest pose is off by more than this, root mean square over the joints."""

SHARE_OF_STEP = 0.5
"""How much of the examples' largest step the way into a pose may add to a frame."""


def far_keys(known: Known, examples: tuple[Motion, ...], lead: int) -> tuple[str, ...]:
    """A sentence for each key whose pose the examples do not have; heading does not count."""
    joints = list(range(len(known.poses.skeleton))) if known.joints is None else list(known.joints)
    sentences = []
    for frame, pose in zip(known.frames, known.poses):
        apart = np.concatenate([_apart(example, pose)[:, joints] for example in examples])  # (T, C) radians
        nearest = int(np.argmin((apart**2).mean(axis=1)))
        degrees = np.degrees(apart[nearest])
        mean = float(np.sqrt((degrees**2).mean()))
        if mean > FAR_DEGREES:
            worst = int(np.argmax(degrees))
            sentences.append(
                f"the key at frame {frame - lead} is far from every example pose: {mean:.0f} degrees on average, "
                f"{degrees[worst]:.0f} at '{pose.skeleton.names[joints[worst]]}'"
            )
    return tuple(sentences)


def _apart(example: Motion, pose: Motion) -> Array:
    """(T, J) angles in radians between a pose and each frame of an example, the root's without its heading."""
    angles = rot.angle_between(example.rotations, pose.rotations)
    root = example.root
    ours, theirs = example.world_rotations[:, root], pose.world_rotations[:, root]
    across = rot.multiply(theirs, rot.inverse(ours))
    angles[:, root] = rot.angle_between(across, rot.heading(across))
    return angles


def easing_window(motion: Motion, known: Known, examples: tuple[Motion, ...], least: float) -> float:
    """Frames that the way into the known poses takes, so that it adds little to the examples' largest step.

    A half cosine that takes up a difference d within w frames moves at most pi d / 2 w a frame.

    Args:
        motion: the synthesis before it is corrected.
        known: the poses.
        examples: at the same frame rate; their largest step is what a viewer takes for granted.
        least: frames that it takes in any case.
    """
    joints = list(range(len(motion.skeleton))) if known.joints is None else list(known.joints)
    wrong = rot.angle_between(motion.rotations[known.frames][:, joints], known.poses.rotations[:, joints])
    turn = max(float(rot.angle_between(e.rotations[1:], e.rotations[:-1]).max(initial=0.0)) for e in examples)
    root = motion.root
    ours = motion.positions[known.frames] - motion.positions[known.frames][:, [root]]
    theirs = known.poses.positions - known.poses.positions[:, [root]]
    off = np.linalg.norm(ours - theirs, axis=-1)[:, joints]
    move = max(float(np.linalg.norm(np.diff(e.positions, axis=0), axis=-1).max(initial=0.0)) for e in examples)
    needs = [
        np.pi * float(distance.max()) / (2 * SHARE_OF_STEP * step)
        for distance, step in ((wrong, turn), (off, move))
        if step > 0
    ]
    return max([least, *needs])
