"""Which frame is shown when: real time for every rate and length."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.errors import MotionGenError
from motiongen.render import schedule
from tests.render.figures import standing


@pytest.mark.parametrize(
    ("rates", "highest", "shown"),
    [
        ([30], 30, 30),
        ([60], 30, 30),
        ([120], 30, 30),
        ([24], 30, 24),
        ([50], 30, 25),
        ([24, 30], 30, 30),
        ([60], 15, 15),
        ([25], 15, 12.5),
        ([24], 15, 12),
        ([59.9988], 30, 30),  # a frame time of 0.016667 s
        ([29.97], 30, 29.97),
        ([1], 30, 8),  # key frames
        ([3.0], 15, 6),
    ],
)
def test_natural_rate(rates: list[float], highest: float, shown: float) -> None:
    assert schedule.natural_rate([standing(2, frame_rate=rate) for rate in rates], highest) == pytest.approx(shown)


RATES = st.sampled_from([1.0, 8.0, 12.5, 24.0, 29.97, 30.0, 59.9988, 120.0]) | st.floats(0.5, 240.0)


@given(st.lists(st.tuples(st.integers(1, 60), RATES), min_size=1, max_size=3), st.floats(2.0, 60.0))
def test_each_moment_shows_the_nearest_frame(clips: list[tuple[int, float]], rate: float) -> None:
    motions = [standing(frames, frame_rate=hertz) for frames, hertz in clips]
    shown = schedule.frames_at(motions, rate)
    moments = len(shown[0])
    longest = max(motion.duration for motion in motions)
    assert (moments - 1) / rate <= longest + 1e-6, "nothing is shown after the end"
    assert moments / rate > longest - 1e-6, "everything is shown"
    for motion, frames in zip(motions, shown):
        assert len(frames) == moments
        apart = np.abs(frames / motion.frame_rate - np.arange(moments) / rate)
        assert apart.max() <= 0.5 / motion.frame_rate + 1e-5


def test_a_clip_at_its_own_rate_is_shown_frame_by_frame() -> None:
    for hertz in (24.0, 30.0, 59.9988, 1 / 0.0333333):
        (frames,) = schedule.frames_at([standing(500, frame_rate=hertz)], hertz)
        np.testing.assert_array_equal(frames, np.arange(500))


@pytest.mark.parametrize(("seconds", "frames"), [(None, 100), (1.0, 30), (0.5, 15), (0.001, 1), (99.0, 100)])
def test_trimming(seconds: float | None, frames: int) -> None:
    motion = standing(100)
    assert schedule.trimmed(motion, seconds) == motion[:frames]


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_no_time_at_all_is_refused(seconds: float) -> None:
    with pytest.raises(MotionGenError, match="seconds must be a positive number"):
        schedule.trimmed(standing(3), seconds)
