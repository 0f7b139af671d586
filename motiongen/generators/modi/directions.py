"""Directions of the latent space along which a motion gets more of an attribute (section 4.4)."""

from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.assets import BUNDLED_MODEL
from motiongen.attributes import Attribute
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.base import Progress
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.model_files import SUFFIX, check_origin, fingerprint, not_one, read_model_file

Array = NDArray[np.float64]
Codes = NDArray[np.float32]

FORMAT = 1

FOLDER = "directions"
"""Where a checkpoint keeps directions of its own, by name."""

SHARE = 0.3
"""The samples with the highest scores, and those with the lowest, that the boundary is to part."""

HELD_OUT = 0.2
"""The share of the samples that the boundary is judged by and not learnt from."""

PENALTIES = (0.01, 0.03, 0.1, 0.3, 1.0)
"""What the support vector machine may take a sample on the wrong side for; cross-validation chooses."""

FEWEST = 10
"""Samples on each side of the boundary at least."""

NOTHING = 1e-6
"""Parts of a unit vector shorter than this are rounding."""

BATCH = 8
"""Motions that are made at once to be scored."""

MEASURED = 40
"""Samples by which a step along a new direction is measured."""


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction of W, with what is known of it. A step of strength 1 is one deviation of random codes along it.

    Attributes:
        name: of the attribute that it is for.
        normal: (S,) the unit normal of the boundary, to the side where the attribute is strong.
        spread: the deviation of random codes along the normal; the paper's step, the normal itself, has the strength
            1 / spread.
        accuracy: the share of held-out samples with high or low scores that are on their side of the boundary.
        score_mean: mean score of the samples.
        score_deviation: the deviation of their scores.
        samples: how many samples it was learnt from, with those held out.
        change: mean change of the score for a step of strength 1, in `score_deviation`; None where it was not measured.
        orthogonal_to: the names of the directions that it is orthogonal to.

    Raises:
        MotionGenError: if the name is none of an attribute, or a number is not finite.
    """

    name: str
    normal: Codes
    spread: float
    accuracy: float
    score_mean: float
    score_deviation: float
    samples: int
    change: float | None = None
    orthogonal_to: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check what a file may have wrong."""
        if not self.name.isidentifier():  # files are named after it
            raise MotionGenError(f"a direction's name must be letters, digits and _, not '{self.name}'")
        if not (
            np.isfinite(self.normal).all() and np.isfinite([self.spread, self.accuracy, self.score_deviation]).all()
        ):
            raise MotionGenError(f"the direction '{self.name}' holds numbers that are not finite")

    def to_dict(self) -> dict[str, Any]:
        """All but the normal, as plain data."""
        return {
            field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "normal"
        } | {"orthogonal_to": list(self.orthogonal_to)}


def learn_direction(
    generator: MoDi,
    attribute: Attribute,
    samples: int = 2000,
    seed: int = 0,
    orthogonal_to: Sequence[Attribute] = (),
    progress: Progress = lambda share: None,
) -> Direction:
    """The direction of an attribute, from random samples of the generator, and what a step along it does.

    Args:
        generator: whose latent space it is.
        attribute: what there is to be more of.
        samples: how many motions to make and score; a hundredth of a second each.
        seed: of the samples.
        orthogonal_to: attributes to leave as they are: the direction is orthogonal to theirs.
        progress: called with the share done.

    Raises:
        MotionGenError: if scikit-learn is missing, the samples are too few or too much alike, or motions on this
            skeleton have no such attribute.
    """
    _support_vector_machines()  # refused before the work
    total = samples + 2 * MEASURED
    codes = generator.latents(samples, seed)
    columns = [attribute, *orthogonal_to]
    scores = scores_of(generator, codes, columns, lambda done: progress(done * samples / total))
    direction, *apart = (fit_direction(each.name, codes, row, seed) for each, row in zip(columns, scores.T))
    if apart:
        direction = make_orthogonal(direction, apart, codes, scores[:, 0], seed)
    others = generator.latents(MEASURED, seed + 1)
    moved = scores_along(
        generator, direction, [attribute], others, (-1.0, 1.0),
        progress=lambda done: progress((samples + done * 2 * MEASURED) / total),
    )  # fmt: skip
    change = float((moved[1] - moved[0]).mean() / 2 / direction.score_deviation)
    return dataclasses.replace(direction, change=change)


def fit_direction(name: str, codes: NDArray[Any], scores: NDArray[Any], seed: int = 0) -> Direction:
    """The unit normal of the boundary between codes with high and with low scores.

    A linear support vector machine parts the upper from the lower `SHARE` of the samples; those between say little. The
    boundary lies midway between the means of both sides.

    Args:
        name: of the attribute.
        codes: (N, S) in W.
        scores: (N,) of their motions.
        seed: of the choice of samples that are held out.

    Raises:
        MotionGenError: if scikit-learn is missing, or the samples are too few or too much alike.
    """
    machines = _support_vector_machines()
    codes, scores = np.asarray(codes, dtype=float), np.asarray(scores, dtype=float)
    sides, learnt = _sides(scores, seed)
    counts = [int((sides[part] == side).sum()) for part in (~learnt, learnt) for side in (-1, 1)]
    if min(counts[:2]) == 0 or min(counts[2:]) < FEWEST:
        raise MotionGenError(
            f"{len(codes)} samples are too few, or too much alike in '{name}', to tell much of it from little; "
            f"scores go from {scores.min(initial=np.inf):.3g} to {scores.max(initial=-np.inf):.3g}; take more samples "
            "or another attribute"
        )
    train = learnt & (sides != 0)
    centred = codes[train] - codes[learnt].mean(axis=0)
    scale = np.sqrt(codes[learnt].var(axis=0).sum())  # one for all, so that penalties mean the same
    normal = machines.fit(centred / scale, sides[train]).best_estimator_.coef_[0]
    return _described(name, normal / np.linalg.norm(normal), codes, scores, seed)


def make_orthogonal(
    direction: Direction, others: Sequence[Direction], codes: NDArray[Any], scores: NDArray[Any], seed: int = 0
) -> Direction:
    """A direction without its parts along others, which leaves their attributes alone as far as these are linear.

    The conditional manipulation of Shen et al. (2020). The boundary is found first and the parts are taken away from
    its normal, not from the codes: what codes without them still tell of them would lead the boundary astray.

    Args:
        direction: what to change.
        others: what it is to be orthogonal to.
        codes: (N, S) that it was fitted to.
        scores: (N,) of their motions.
        seed: that it was fitted with.

    Raises:
        MotionGenError: if nothing is left of it.
    """
    normals = np.stack([each.normal for each in others]).astype(float)
    _, sizes, basis = np.linalg.svd(normals, full_matrices=False)
    basis = basis[sizes > NOTHING]  # (M, S) orthonormal
    left = direction.normal - direction.normal @ basis.T @ basis
    if np.linalg.norm(left) < NOTHING:
        names = ", ".join(each.name for each in others)
        raise MotionGenError(f"nothing is left of '{direction.name}' without {names}; leave one of these out")
    left = _described(direction.name, left / np.linalg.norm(left), np.asarray(codes), np.asarray(scores), seed)
    return dataclasses.replace(left, orthogonal_to=tuple(each.name for each in others))


def move(
    codes: NDArray[Any], direction: Direction, strengths: Sequence[float], layers: Sequence[int] | None = None
) -> Codes:
    """(K, N, S) or (K, N, L, S) codes moved along a direction by each of K strengths.

    Args:
        codes: (N, S) in W, or (N, L, S) in W+.
        direction: where to.
        strengths: how far, in deviations of random codes along the direction.
        layers: which layers of codes in W+ are moved: the first ones make what is coarse, the last ones what is fine.
            All by default.

    Raises:
        MotionGenError: if there is no such layer, or the codes are not of this size.
    """
    codes = np.asarray(codes, dtype=np.float32)
    if codes.ndim not in (2, 3) or codes.shape[-1] != len(direction.normal):
        raise MotionGenError(
            f"a direction of {len(direction.normal)} numbers moves codes (N, S) or (N, L, S) of as many, "
            f"not {codes.shape}"
        )
    steps = np.asarray(strengths, dtype=np.float32).reshape(-1, *[1] * codes.ndim) * direction.spread * direction.normal
    if layers is None:
        return np.asarray(codes + steps, dtype=np.float32)
    if codes.ndim == 2:
        raise MotionGenError("layers are those of codes in W+, (N, L, S), and these are in W; leave out layers")
    known = codes.shape[1]
    if any(not 0 <= layer < known for layer in layers):
        raise MotionGenError(f"layers must be from 0 to {known - 1}, not {list(layers)}")
    moving = np.isin(np.arange(known), list(layers))[:, None]  # (L, 1)
    return np.asarray(codes + steps * moving, dtype=np.float32)


def scores_of(
    generator: MoDi,
    codes: NDArray[Any],
    attributes: Sequence[Attribute],
    progress: Progress = lambda share: None,
) -> Array:
    """(N, A) scores of the motions of codes (N, S) or (N, L, S), as the network makes them, with no feet cleaned."""
    plain = copy.copy(generator)  # the same network
    plain.options = dataclasses.replace(generator.options, clean_feet=False)
    deep = torch.from_numpy(generator.check_latents(codes))
    scores = np.empty((len(deep), len(attributes)))
    for first in range(0, len(deep), BATCH):
        with torch.inference_mode():
            made = generator.network.synthesis(deep[first : first + BATCH].to(generator.device)).cpu().numpy()
        for index, each in enumerate(made, start=first):
            motion = plain.motion_of(each, f"sample_{index:04d}")
            scores[index] = [attribute.score(motion) for attribute in attributes]
        progress((first + len(made)) / len(deep))
    return scores


def scores_along(
    generator: MoDi,
    direction: Direction,
    attributes: Sequence[Attribute],
    codes: NDArray[Any],
    strengths: Sequence[float],
    layers: Sequence[int] | None = None,
    progress: Progress = lambda share: None,
) -> Array:
    """(K, N, A) scores of the motions of codes that are moved by each of K strengths; see `move` and `scores_of`."""
    moved = move(codes, direction, strengths, layers)
    scores = scores_of(generator, moved.reshape(-1, *moved.shape[2:]), attributes, progress)
    return scores.reshape(*moved.shape[:2], len(attributes))


def kept_direction(generator: MoDi, name: str) -> Path | None:
    """The file of the direction of that name that came with the generator's checkpoint, if there is one."""
    return kept_directions(generator).get(name)


def kept_directions(generator: MoDi) -> dict[str, Path]:
    """Name -> file of the directions that came with the generator's checkpoint, in alphabetical order."""
    checkpoint = generator.options.checkpoint
    folder = (BUNDLED_MODEL if checkpoint is None else Path(checkpoint).expanduser()) / FOLDER
    return {path.stem: path for path in sorted(folder.glob(f"*{SUFFIX}"))}


def save_direction(path: str | Path, generator: MoDi, direction: Direction) -> None:
    """Write a direction to a file that appears when it is complete.

    Args:
        path: ending in .safetensors.
        generator: whose latent space it is of.
        direction: what to write.

    Raises:
        MotionGenError: if it cannot be written, or is of another latent space.
    """
    from safetensors.numpy import save

    if Path(path).suffix != SUFFIX:
        raise MotionGenError(f"{path}: files of directions end in {SUFFIX}; name it so")
    generator.check_latents(direction.normal[None])
    notes = {"format": str(FORMAT), "model": fingerprint(generator), "direction": json.dumps(direction.to_dict())}
    with atomic_write(path) as file:
        file.write(save({"normal": np.ascontiguousarray(direction.normal)}, notes))


def load_direction(path: str | Path, generator: MoDi) -> Direction:
    """Read a direction.

    Raises:
        MotionGenError: if it cannot be read, or the direction is another model's.
    """
    what = "file of a direction"
    tensors, notes = read_model_file(path, what)
    try:
        normal, told = tensors["normal"], json.loads(notes["direction"])
        direction = Direction(normal=normal, **told | {"orthogonal_to": tuple(told["orthogonal_to"])})
        number, model = int(notes["format"]), notes["model"]
    except (KeyError, TypeError, ValueError, MotionGenError) as error:
        raise not_one(path, what, error) from error
    check_origin(path, what, number, FORMAT, model, generator)
    generator.check_latents(normal[None])
    return direction


def _sides(scores: Array, seed: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(N,) 1 for samples with high scores, -1 for low ones and 0 between; (N,) which are learnt from, not held out."""
    learnt = np.random.default_rng(seed).permutation(len(scores)) >= round(HELD_OUT * len(scores))
    if not learnt.any():
        return np.zeros(len(scores), dtype=np.int64), learnt
    low, high = np.quantile(scores[learnt], [SHARE, 1 - SHARE])
    sides = (scores >= high).astype(np.int64) - (scores <= low)  # 0 where low is high, too
    return sides, learnt


def _described(name: str, normal: Array, codes: Array, scores: Array, seed: int) -> Direction:
    """The direction of a unit normal, with how well it parts samples of high from those of low scores."""
    sides, learnt = _sides(scores, seed)
    along = codes @ normal
    middle = np.mean([along[learnt & (sides == side)].mean() for side in (-1, 1)])
    test = ~learnt & (sides != 0)
    return Direction(
        name=name,
        normal=normal.astype(np.float32),
        spread=float(along.std()),
        accuracy=float(((along[test] > middle) == (sides[test] > 0)).mean()),
        score_mean=float(scores.mean()),
        score_deviation=float(scores.std()),
        samples=len(codes),
    )


def _support_vector_machines() -> Any:
    """A search over linear support vector machines for the best penalty, not yet fitted."""
    try:
        from sklearn.model_selection import GridSearchCV
        from sklearn.svm import LinearSVC
    except ImportError as error:
        raise MotionGenError("learning a direction needs scikit-learn: pip install 'motiongen[latent]'") from error
    machine = LinearSVC(dual="auto", max_iter=20000, random_state=0)
    return GridSearchCV(machine, {"C": PENALTIES}, cv=3)
