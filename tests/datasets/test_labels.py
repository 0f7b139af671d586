"""What names tell."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.datasets.labels import HELD_BACK, TRAINING, LabelPattern, split_of
from motiongen.errors import MotionGenError

WORDS = st.text(st.characters(exclude_characters="_/{}", exclude_categories=["Cs"]), min_size=1, max_size=8)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


@given(st.lists(WORDS, min_size=3, max_size=3))
def test_labels_come_back_out_of_a_name_made_of_them(words: list[str]) -> None:
    pattern = LabelPattern("set-2_{content}_{style}_{number}")
    expected = dict(zip(("content", "style", "number"), words))
    name = pattern.text.format(**expected)
    assert pattern.labels_of(name) == expected
    assert pattern.labels_of(f"some/folder/{name}") == expected
    assert pattern.labels_of(f"{name}_more_of_it"[: len(name)]) == expected
    assert pattern.labels_of(f"x{name}") == {}


def test_slashes_take_in_folders() -> None:
    pattern = LabelPattern("{style}/walk_{number}")
    assert pattern.labels_of("all/old/walk_3") == {"style": "old", "number": "3"}
    assert pattern.labels_of("walk_3") == {}


@pytest.mark.parametrize("text", ["", "plain", "{}", "{a b}", "{a}_{a}", "{1}", "{a:>3}"])
def test_patterns_that_say_nothing_are_refused(text: str) -> None:
    with pytest.raises(MotionGenError, match="label pattern"):
        LabelPattern(text)


@given(NAMES, st.floats(0, 1), st.floats(0, 1))
def test_a_clip_held_back_stays_so_when_more_are(name: str, share: float, other: float) -> None:
    less, more = sorted((share, other))
    assert split_of(name, less) == TRAINING or split_of(name, more) == HELD_BACK
    assert split_of(name, 0.0) == TRAINING
    assert split_of(name, 1.0) == HELD_BACK
    assert split_of(f"any/folder/{name}", share) == split_of(name, share)


def test_the_share_held_back_is_the_one_asked_for() -> None:
    held = [split_of(f"clip_{i}", 0.1) for i in range(20_000)].count(HELD_BACK)
    assert abs(held - 2000) < 200  # more than four standard deviations


def test_which_clips_are_held_back_never_changes() -> None:
    """It may not depend on the machine, the version of Python or the run: models are compared by these."""
    assert [i for i in range(60) if split_of(f"clip_{i}", 0.1) == HELD_BACK] == [5, 21, 24, 29, 59]
