"""Parts whose motion is taken from some of the examples only, and creatures put together from several characters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import motiongen as mg
from motiongen import MotionGenError
from motiongen import rotations as rot
from motiongen.reassembly import PartSource, assemble
from tests.strategies import random_motion, random_skeleton

CHAIN = random_skeleton(np.random.default_rng(3), 6)
UPPER, LOWER = (0, 1, 2), (3, 4, 5)


def clip(moving: tuple[int, ...], seed: int) -> mg.Motion:
    """A clip in which only some joints move."""
    motion = random_motion(np.random.default_rng(seed), CHAIN, frames=90, translating=(0,), smooth=True)
    still = [joint for joint in range(len(CHAIN)) if joint not in moving]
    rotations = motion.rotations.copy()
    rotations[:, still] = rotations[:1, still]
    return motion.replace(rotations=rot.continuous(rotations))


def turned(motion: mg.Motion, joints: tuple[int, ...]) -> float:
    return float(rot.angle_between(motion.rotations, motion.rotations[:1])[:, list(joints)].max())


def parts(first: list[int], second: list[int]) -> mg.Parts:
    joints = {"first": [CHAIN.names[j] for j in UPPER], "second": [CHAIN.names[j] for j in LOWER]}
    return mg.Parts(joints, {"first": first, "second": second})


def test_each_part_moves_as_in_the_examples_it_is_taken_from() -> None:
    generator = mg.create("genmm", standing_feet="free").fit([clip(UPPER, 1), clip(LOWER, 2)])
    moving = generator.sample(120, constraints=[parts([0], [1])])[0]
    assert turned(moving, UPPER) > 0.2
    assert turned(moving, LOWER) > 0.2
    still = generator.sample(120, constraints=[parts([1], [0])])[0]
    assert turned(still, UPPER) < 1e-3
    assert turned(still, LOWER) < 1e-3


def test_all_examples_for_all_parts_is_what_parts_alone_say() -> None:
    generator = mg.create("genmm").fit([clip(UPPER, 1), clip(LOWER, 2)])
    alone = mg.Parts(parts([0], [0]).joints)
    ours, theirs = (generator.sample(80, constraints=[each])[0] for each in (parts([0, 1], [0, 1]), alone))
    assert ours.allclose(theirs)


def test_a_part_alone_is_the_frames_of_its_example_whichever_number_that_has() -> None:
    """One patch, which must give back the example's frames bit by bit."""
    clips = [clip(UPPER, 1), clip(LOWER, 2), clip(LOWER, 5)]
    generator = mg.create("genmm", patch_size=90, standing_feet="free").fit(clips)
    motion = generator.sample(90, constraints=[parts([0], [2])])[0]
    np.testing.assert_allclose(
        np.abs((motion.rotations[:, LOWER] * clips[2].rotations[:, LOWER]).sum(axis=-1)), 1.0, atol=1e-9
    )


@pytest.mark.parametrize(
    ("examples", "words"),
    [
        ({"first": [0], "tail": [1]}, r"examples are given for part 'tail'; the parts that are given: first, second"),
        ({"first": []}, r"part 'first' needs numbers of examples, 0 and more, not \[\]"),
        ({"first": [-1]}, r"not \[-1\]"),
        ({"first": [2]}, r"part 'first' is to be taken from example 2; there are 2, the first is 0"),
    ],
)
def test_mistakes_are_refused(examples: dict[str, list[int]], words: str) -> None:
    generator = mg.create("genmm").fit([clip(UPPER, 1), clip(LOWER, 2)])
    with pytest.raises(MotionGenError, match=words):
        generator.sample(80, constraints=[mg.Parts(parts([0], [1]).joints, examples)])


def test_a_creature_of_two_characters_moves_as_both(tmp_path: Path) -> None:
    body = clip(UPPER, 1)
    other = random_skeleton(np.random.default_rng(8), 5)
    tail = random_motion(np.random.default_rng(9), other, frames=70, translating=(0,), smooth=True, name="tail")
    root = other.children[0][0]
    hung = PartSource(tail, joints=other.names[root], attach=CHAIN.names[2], prefix="tail_", overlap=())
    creature = assemble([PartSource(body), hung])
    generator = mg.create("genmm", standing_feet="free").fit(creature.clips)
    motion = generator.sample(100, constraints=[creature.constraint])[0]
    for part, clips in zip(creature.parts, creature.examples):
        own = list(part.joints)
        widest = rot.angle_between(clips[0].rotations, clips[0].rotations[:1])[:, own].max()
        assert rot.angle_between(motion.rotations, motion.rotations[:1])[:, own].max() > 0.5 * widest
    motion.save(tmp_path / "creature.bvh")
    np.testing.assert_allclose(mg.load(tmp_path / "creature.bvh", up="y").positions, motion.positions, atol=1e-4)
