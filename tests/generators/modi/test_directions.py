"""Directions of the latent space: what was planted is found, moving along it is what it says, files keep it."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import motiongen as mg
from motiongen.attributes import Attribute, attribute_of
from motiongen.errors import MotionGenError
from motiongen.generators.modi.directions import (
    Direction,
    fit_direction,
    kept_direction,
    learn_direction,
    load_direction,
    make_orthogonal,
    move,
    save_direction,
    scores_along,
    scores_of,
)
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.latents import save_latents
from tests.bipeds import biped
from tests.checkpoints import random_checkpoint

pytest.importorskip("sklearn", reason="directions are learnt with scikit-learn, of the extra `latent`")

Array = NDArray[np.float64]

FEET = tuple(joint for joint, name in enumerate(biped().names) if name.endswith("Foot"))

HAND = Attribute("hand", "height of the right hand in the last frame", lambda motion: motion.positions[-1, 11, 1])
HIPS = Attribute("hips", "height of the hips in the last frame", lambda motion: motion.positions[-1, 0, 1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_checkpoint(tmp_path_factory.mktemp("modi") / "checkpoint", biped(), FEET, "m")


@pytest.fixture(scope="module")
def generator(folder: Path) -> MoDi:
    return modi(folder)


def modi(folder: Path, **options: Any) -> MoDi:
    made = mg.create("modi", checkpoint=str(folder), **options)
    assert isinstance(made, MoDi)
    return made


def cloud(seed: int, count: int = 2000, size: int = 12) -> tuple[Array, Array]:
    """Codes that spread differently along some hidden axes, and a unit vector."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(size, size)))[0]
    planted = axes @ rng.normal(size=size)
    return (
        (rng.normal(size=(count, size)) * rng.uniform(0.5, 2.0, size)) @ axes.T + 3.0,
        planted / np.linalg.norm(planted),
    )


def planted(normal: Array, **settings: Any) -> Direction:
    told = {"spread": 1.0, "accuracy": 1.0, "score_mean": 0.0, "score_deviation": 1.0, "samples": 100}
    return Direction("planted", normal.astype(np.float32), **(told | settings))


# -- finding


@pytest.mark.parametrize("seed", range(3))
def test_a_planted_score_is_found(seed: int) -> None:
    codes, normal = cloud(seed)
    found = fit_direction("planted", codes, codes @ normal)
    assert found.normal @ normal > 0.95
    assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=1e-6)
    assert found.accuracy > 0.98
    assert found.spread == pytest.approx((codes @ found.normal).std(), rel=1e-4)
    assert (found.score_mean, found.samples) == (pytest.approx((codes @ normal).mean()), len(codes))
    noisy = codes @ normal + np.random.default_rng(seed).normal(size=len(codes))
    assert fit_direction("planted", codes, noisy).normal @ normal > 0.9
    np.testing.assert_allclose(fit_direction("planted", codes, -(codes @ normal)).normal @ normal, -1, atol=0.05)


def test_neither_the_size_of_codes_nor_that_of_scores_matters() -> None:
    codes, normal = cloud(4)
    found, larger = (fit_direction("planted", scale * codes, scale**2 * (codes @ normal) + 7) for scale in (1, 50))
    np.testing.assert_allclose(larger.normal, found.normal, atol=1e-4)
    assert larger.spread == pytest.approx(50 * found.spread, rel=1e-3)
    assert larger.accuracy == found.accuracy


def test_chance_is_called_chance() -> None:
    """Held-out samples are held out: a boundary through noise parts them no better than a coin."""
    rng = np.random.default_rng(0)
    accuracies = [fit_direction("noise", cloud(s, 400, 60)[0], rng.normal(size=400)).accuracy for s in range(5)]
    assert 0.35 < np.mean(accuracies) < 0.65


@pytest.mark.parametrize("seed", range(3))
def test_an_orthogonal_direction_leaves_the_others_alone(seed: int) -> None:
    codes, normal = cloud(seed)
    rng = np.random.default_rng(seed + 10)
    other = normal + 0.7 * rng.normal(size=len(normal)) / np.sqrt(len(normal))
    away = planted(other / np.linalg.norm(other))
    plain = fit_direction("planted", codes, codes @ normal)
    found = make_orthogonal(plain, [away, away], codes, codes @ normal)
    assert found.orthogonal_to == ("planted", "planted")
    assert abs(found.normal @ away.normal) < 1e-6
    moved = move(codes, found, (-1.0, 0.0, 1.0))
    np.testing.assert_allclose(moved @ away.normal, np.broadcast_to(codes @ away.normal, moved.shape[:2]), atol=1e-4)
    assert (np.diff(moved @ normal, axis=0) > 0).all(), "there is more of it all the same"
    assert found.spread == pytest.approx((codes @ found.normal).std(), rel=1e-4)
    assert 0.5 < found.accuracy < plain.accuracy, "it tells less than it did"
    left = normal - normal @ away.normal * away.normal
    assert found.normal @ left / np.linalg.norm(left) > 0.8, "it is what is left of the planted one"
    with pytest.raises(MotionGenError, match="nothing is left of 'planted' without planted"):
        make_orthogonal(plain, [plain], codes, codes @ normal)


@pytest.mark.parametrize(
    "scores", [np.zeros(400), np.repeat([0.0, 1.0], [399, 1]), np.arange(30.0), np.zeros(0)], ids=len
)
def test_samples_that_tell_nothing_are_refused(scores: Array) -> None:
    codes = np.random.default_rng(0).normal(size=(len(scores), 12))
    with pytest.raises(MotionGenError, match=f"^{len(scores)} samples are too few, or too much alike in 'thing'"):
        fit_direction("thing", codes, scores)


def test_without_scikit_learn_it_says_what_to_install(generator: MoDi, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.svm", None)
    with pytest.raises(MotionGenError, match=r"needs scikit-learn: pip install 'motiongen\[latent\]'"):
        learn_direction(generator, HAND, samples=10**9)


# -- moving


def test_a_step_is_the_strength_times_the_spread_along_the_normal() -> None:
    codes, normal = cloud(5, count=4)
    direction = planted(normal, spread=2.5)
    strengths = (-2.0, 0.0, 0.5, 3.0)
    moved = move(codes, direction, strengths)
    assert moved.shape == (4, 4, 12)
    np.testing.assert_allclose(
        (moved - codes) @ normal, 2.5 * np.array(strengths)[:, None] * np.ones((1, 4)), atol=1e-5
    )
    across = np.eye(12) - np.outer(normal, normal)
    np.testing.assert_allclose((moved - codes) @ across, 0, atol=1e-5)
    assert (np.diff(moved @ normal, axis=0) > 0).all(), "monotone"
    np.testing.assert_array_equal(moved[1], codes.astype(np.float32))
    deep = move(np.repeat(codes[:, None], 3, axis=1), direction, strengths)
    np.testing.assert_array_equal(deep, np.repeat(moved[:, :, None], 3, axis=2))


def test_only_the_layers_asked_for_move() -> None:
    codes, normal = cloud(6, count=2)
    deep = np.repeat(codes[:, None], 5, axis=1).astype(np.float32)
    direction = planted(normal)
    moved, whole = move(deep, direction, (1.0,), layers=[0, 3]), move(deep, direction, (1.0,))
    np.testing.assert_array_equal(moved[:, :, [0, 3]], whole[:, :, [0, 3]])
    np.testing.assert_array_equal(moved[0][:, [1, 2, 4]], deep[:, [1, 2, 4]])
    for layers, given, words in (
        ([5], deep, r"from 0 to 4, not \[5\]"), ([-1], deep, "from 0 to 4"), ([0], codes, "are in W; leave out layers")
    ):  # fmt: skip
        with pytest.raises(MotionGenError, match=words):
            move(given, direction, (1.0,), layers)
    with pytest.raises(MotionGenError, match=r"a direction of 12 numbers moves codes .* not \(2, 11\)"):
        move(codes[:, :11], direction, (1.0,))


# -- with a network


def plain_scores(folder: Path, codes: Sequence[Array], attributes: Sequence[Attribute]) -> list[list[float]]:
    generator = modi(folder, clean_feet=False)
    return [[each.score(generator.decode(code[None])[0]) for each in attributes] for code in codes]


def test_scores_are_those_of_the_motions(folder: Path, generator: MoDi) -> None:
    codes = generator.latents(11)
    known = [HAND, HIPS, attribute_of("step_length")]
    told: list[float] = []
    np.testing.assert_allclose(
        scores_of(generator, codes, known, told.append), plain_scores(folder, codes, known), atol=1e-5
    )
    assert told == [8 / 11, 1.0]
    assert generator.options.clean_feet, "it is left as it was"
    direction = planted(np.eye(8)[0])
    along = scores_along(generator, direction, known, codes, (-1.0, 2.0))
    for strength, scores in zip((-1.0, 2.0), along):
        expected = plain_scores(folder, codes + strength * np.eye(8)[0], known)
        np.testing.assert_allclose(scores, expected, atol=1e-5)


def test_a_learnt_direction_gives_more_of_it(generator: MoDi) -> None:
    told: list[float] = []
    direction = learn_direction(generator, HAND, samples=120, seed=3, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)
    assert (direction.name, direction.samples) == ("hand", 120)
    assert direction.accuracy > 0.8
    assert direction.change is not None
    assert direction.change > 0.3
    scores = scores_along(generator, direction, [HAND], generator.latents(20, seed=77), (-1.0, 0.0, 1.0))[..., 0]
    assert (scores[2] > scores[0]).mean() > 0.9
    apart = learn_direction(generator, HAND, samples=120, seed=3, orthogonal_to=[HIPS])
    codes = generator.latents(120, seed=3)
    hips, hand = (
        fit_direction(each.name, codes, scores_of(generator, codes, [each])[:, 0], 3) for each in (HIPS, HAND)
    )
    np.testing.assert_array_equal(hand.normal, direction.normal)
    assert apart.orthogonal_to == ("hips",)
    assert abs(apart.normal @ hips.normal) < 1e-6


# -- files


def test_files_keep_all_there_is(tmp_path: Path, generator: MoDi) -> None:
    written = planted(np.eye(8)[2], change=0.25, orthogonal_to=("speed", "gral"), spread=1 / 3)
    save_direction(tmp_path / "d.safetensors", generator, written)
    read = load_direction(tmp_path / "d.safetensors", generator)
    np.testing.assert_array_equal(read.normal, written.normal)
    assert read.normal.dtype == np.float32
    for field in dataclasses.fields(Direction):
        if field.name != "normal":
            assert getattr(read, field.name) == getattr(written, field.name)
    assert [path.name for path in tmp_path.iterdir()] == ["d.safetensors"]


def test_files_that_cannot_be_used_are_refused(tmp_path: Path, generator: MoDi) -> None:
    other = modi(random_checkpoint(tmp_path / "other", biped(), FEET, mapping_layers=3))
    save_direction(tmp_path / "d.safetensors", generator, planted(np.eye(8)[2]))
    with pytest.raises(MotionGenError, match="of another model; take the checkpoint"):
        load_direction(tmp_path / "d.safetensors", other)
    save_latents(tmp_path / "l.safetensors", generator, generator.latents(1), ["one"])
    (tmp_path / "text.safetensors").write_text("no tensors")
    written = (tmp_path / "d.safetensors").read_bytes()
    (tmp_path / "far.safetensors").write_bytes(written.replace(b"planted", b"../../a"))
    for name, words in (
        ("l", "no file of a direction"), ("text", "no file of a direction"), ("x", "no such file"),
        ("far", r"must be letters, digits and _, not '\.\./\.\./a'"),
    ):  # fmt: skip
        with pytest.raises(MotionGenError, match=words):
            load_direction(tmp_path / f"{name}.safetensors", generator)
    with pytest.raises(MotionGenError, match=r"end in \.safetensors"):
        save_direction(tmp_path / "d.npz", generator, planted(np.eye(8)[2]))
    with pytest.raises(MotionGenError, match="latents must have the shape"):
        save_direction(tmp_path / "e.safetensors", generator, planted(np.eye(9)[2]))
    assert not (tmp_path / "e.safetensors").exists()


def test_directions_kept_with_a_checkpoint_are_found(tmp_path: Path) -> None:
    folder = random_checkpoint(tmp_path / "checkpoint", biped(), FEET)
    generator = modi(folder)
    assert kept_direction(generator, "speed") is None
    (folder / "directions").mkdir()
    save_direction(folder / "directions" / "speed.safetensors", generator, planted(np.eye(8)[0]))
    assert kept_direction(modi(folder), "speed") == folder / "directions" / "speed.safetensors"
    assert kept_direction(modi(folder), "gral") is None
