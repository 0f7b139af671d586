"""The plug-in does what it says."""

import numpy as np
import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP


@pytest.fixture(scope="module")
def clip() -> mg.Motion:
    """The clip that comes with motiongen."""
    return mg.load(EXAMPLE_CLIP)


def test_lengths_and_seeds(clip: mg.Motion) -> None:
    """A seed decides everything."""
    generator = mg.create("shuffle").fit([clip])
    first, second = generator.sample(frames=200, count=2, seed=3)
    assert len(first) == len(second) == 200
    assert first != second
    assert generator.sample(frames=200, seed=3) == [first]


def test_no_joint_jumps_more_than_in_the_example(clip: mg.Motion) -> None:
    """Seams are eased."""
    made = mg.create("shuffle", choices=1).fit([clip]).sample(frames=600)[0]
    largest = np.linalg.norm(np.diff(clip.positions, axis=0), axis=-1).max()
    assert np.linalg.norm(np.diff(made.positions, axis=0), axis=-1).max() <= 1.5 * largest


def test_short_clips_are_refused(clip: mg.Motion) -> None:
    """A mistake costs one line."""
    with pytest.raises(mg.MotionGenError, match="give a longer clip"):
        mg.create("shuffle", piece_seconds=5).fit([clip[:100]])
