"""What a body cannot do, over a set of motions."""

from __future__ import annotations

import numpy as np
import pytest

from motiongen.errors import MotionGenError
from motiongen.metrics.physical import bone_stretch, measure_physical
from motiongen.quality import foot_skate, jitter, penetration
from tests.datasets.clips import FIGURE, stride

FEET = (4, 6)


def test_the_figures_are_means_over_the_motions() -> None:
    motions = [stride(seed) for seed in range(4)]
    found = measure_physical(motions, FEET)
    skates = [skate for motion in motions if (skate := foot_skate(motion, FEET)) is not None]
    assert found.foot_skate_heights_per_second == pytest.approx(np.mean(skates))
    assert found.jitter_heights_per_second_cubed == pytest.approx(np.mean([jitter(m) for m in motions]))
    assert found.penetration_heights == pytest.approx(np.mean([penetration(m) for m in motions]))
    assert found.bone_stretch == pytest.approx(0, abs=1e-9)


def test_motions_too_short_have_no_jitter() -> None:
    found = measure_physical([stride(0)[:2]], ())
    assert found.jitter_heights_per_second_cubed is None
    assert found.foot_skate_heights_per_second is None


def test_a_bone_that_stretches_is_found() -> None:
    """Of two lengths, a and b, half of the time each, the deviation is half of their difference."""
    motion = stride(1).with_translating([FIGURE.index("Head")])
    translations = motion.translations.copy()
    translations[::2, 1] *= 1.2
    stretched = motion.replace(translations=translations)
    assert bone_stretch(stretched) == pytest.approx(0.1 / 1.1, rel=1e-6)


def test_no_motion_is_refused() -> None:
    with pytest.raises(MotionGenError, match="at least one motion"):
        measure_physical([], FEET)
