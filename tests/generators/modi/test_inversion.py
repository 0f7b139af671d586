"""Clips to codes: alignment as in the dataset, what is compared, and the search."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import motiongen as mg
from motiongen import rotations as rot
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.generators.base import Progress
from motiongen.generators.modi.alignment import Track, bring, motions_of, standardised
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.inversion import Inversion, InversionOptions, body_of, descend, invert, judged, on_device
from motiongen.generators.modi.likeness import MotionError, distances, errors, mean_error, seen
from motiongen.motion import Motion
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE, in_other_order, stride, under_still_root
from tests.train.runs import FRAMES, make_dataset, training_of

QUICK = {"steps": 40, "candidates": 8, "mean_weight": 0.0}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset.open(make_dataset(tmp_path_factory.mktemp("inversion")))


@pytest.fixture(scope="module")
def generator(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> MoDi:
    """Random weights, whose motions vary as much as the data."""
    folder = tmp_path_factory.mktemp("inversion") / "checkpoint"
    training_of(dataset).save(folder, {})
    made = mg.create("modi", checkpoint=str(folder), clean_feet=False)
    assert isinstance(made, MoDi)
    return made


def made_windows(generator: MoDi, codes: np.ndarray) -> np.ndarray:
    """(N, T, E, 4) entities that the network makes of codes, facing whichever way they face."""
    with torch.no_grad():
        made = generator.network.synthesis(torch.from_numpy(generator.check_latents(codes)))
    entities: np.ndarray = made.numpy() * generator.card.deviation + generator.card.mean
    return entities


def error_of(generator: MoDi, windows: np.ndarray, guess: np.ndarray | None = None, **options: Any) -> MotionError:
    codes = descend(generator, windows, InversionOptions.build(QUICK | options), guess=guess)[0]
    assert np.ptp(codes, axis=1).max() > 0 or options.get("space") == "W"
    return judged(generator, codes, windows, ["made"], ()).errors[0]


# -- alignment


def test_windows_are_those_of_the_dataset_whatever_the_rig_looked_like(generator: MoDi, dataset: Dataset) -> None:
    """The same joints in another order, below another root, at twice the rate."""
    clip = dataset.names.index("clip_7")
    starts = bring(generator.card, stride(7, frames=FRAMES + 28)).starts(FRAMES)
    assert starts == (0, 16, 28)
    expected = dataset.batch([(clip, start) for start in starts], standardised=False)
    rng = np.random.default_rng(0)
    motion = stride(7, frames=FRAMES + 28)
    for same in (motion, in_other_order(motion, [0, 5, 6, 3, 4, 1, 2]), under_still_root(motion, rng)):
        found = bring(generator.card, same).cut().windows
        alike = np.einsum("bjc,jc->bj", found[:, 0, dataset.layout.joints], generator.card.mean[dataset.layout.joints])
        assert (alike >= 0).all()
        # The dataset has a reference of its own for the signs.
        theirs = np.einsum("bjc,bjc->bj", found[:, 0, :7], expected[:, 0, :7])
        found[:, :, :7] *= np.sign(theirs)[:, None, :, None]
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_faster_clips_are_resampled_and_it_is_said(generator: MoDi) -> None:
    slow = bring(generator.card, stride(1, frames=40))
    fast = bring(generator.card, stride(1, frames=40).resample(60.0))
    np.testing.assert_allclose(fast.entities, slow.entities, atol=1e-5)
    assert "resampled from 60 to 30 Hz" in fast.report
    assert not any("resampled" in line for line in slow.report)


@given(st.integers(1, 200), st.integers(1, 64))
def test_windows_cover_the_clip(length: int, frames: int) -> None:
    track = Track(None, "clip", np.zeros((length, 1, 4)), np.zeros(length), np.zeros((length, 3)), None, ())
    if length < frames:
        return
    starts = track.starts(frames)
    assert {start + k for start in starts for k in range(frames)} == set(range(length))
    assert all(b - a == frames for a, b in itertools.pairwise(starts[:-1]))


def test_clips_that_have_no_codes_are_refused_in_one_line(generator: MoDi) -> None:
    names = tuple(name.replace("Head", "Tail") for name in FIGURE.names)
    stranger = stride(0).replace(skeleton=replace(FIGURE, names=names))
    with pytest.raises(MotionGenError, match="'clip0' has another skeleton than the checkpoint: it lacks joint 'Head'"):
        invert(generator, stranger)
    offsets = FIGURE.offsets.copy()
    offsets[2] = [0.3, 0, 0]
    bent = stride(0, skeleton=replace(FIGURE, offsets=offsets))
    with pytest.raises(MotionGenError, match="another skeleton than the checkpoint: joint 'Head' rests"):
        invert(generator, bent)
    with pytest.raises(MotionGenError, match=f"'clip0' has 15 frames at 30 Hz where a window has {FRAMES}"):
        invert(generator, stride(0, frames=15))


# -- what is compared


def test_figures_are_those_of_the_motions(generator: MoDi) -> None:
    """A slow twin: angles and places of motions, one after the other."""
    card, body = generator.card, body_of(generator)
    windows = [bring(card, stride(seed, frames=FRAMES)).cut().windows[0] for seed in range(4)]
    motions = motions_of(card, windows, ["a"] * 4)
    one, other = (
        seen(body, on_device(generator, standardised(card, np.stack(half)))) for half in (windows[:2], windows[2:])
    )
    for k, error in enumerate(errors(card, one, other)):
        angles = rot.angle_between(motions[k].rotations, motions[k + 2].rotations)
        assert error.rotation_degrees == pytest.approx(np.degrees(angles).mean(), rel=1e-3)
        places = [m.positions - m.positions[0, 0] for m in (motions[k], motions[k + 2])]
        apart = np.linalg.norm(places[0] - places[1], axis=-1) / FIGURE.height
        assert error.position_heights == pytest.approx(apart.mean(), rel=1e-3)
        assert error.position_cm == pytest.approx(100 * FIGURE.height * apart.mean(), rel=1e-3) or card.unit is None
        labels = [w[:, card.layout.contacts, 0] for w in (windows[k], windows[k + 2])]
        assert error.contact_disagreement == pytest.approx((labels[0] != labels[1]).mean(), abs=1e-6)
        found = distances(one, other)
        assert found.rotation[k] == pytest.approx((4 * np.sin(angles / 2) ** 2).mean(), rel=1e-3)
        assert found.position[k] == pytest.approx((apart**2).mean(), rel=1e-3)
        assert found.contact[k] == pytest.approx(((labels[0] - labels[1]) ** 2).mean(), abs=1e-5)
        assert found.weighted(2.0, 3.0)[k] == pytest.approx(
            float(found.rotation[k] + 2 * found.position[k] + 3 * found.contact[k])
        )


def test_a_quaternion_and_its_negative_are_the_same(generator: MoDi) -> None:
    body = body_of(generator)
    one = seen(body, torch.randn(3, FRAMES, generator.card.layout.count, 4, generator=torch.Generator().manual_seed(0)))
    other = one._replace(rotations=-one.rotations)
    for found in (distances(one, one), distances(one, other)):
        torch.testing.assert_close(torch.stack(list(found)), torch.zeros(3, 3), atol=1e-5, rtol=0)
    assert all(error.rotation_degrees < 0.1 for error in errors(generator.card, one, other))


def test_the_mean_of_errors_is_that_of_each_figure() -> None:
    found = mean_error([MotionError(1.0, 0.2, 3.0, 0.0), MotionError(3.0, 0.4, 5.0, 0.5)])
    assert found == MotionError(2.0, pytest.approx(0.3), 4.0, 0.25)
    assert mean_error([MotionError(1.0, 0.2, None, 0.0)]).position_cm is None
    assert str(found) == "2.0 degrees, 30.00% of the height (4.0 cm), contacts differ in 25.0%"


# -- the search


@pytest.mark.parametrize("space", ["W", "W+"])
def test_motions_of_the_generator_are_found_again(generator: MoDi, space: str) -> None:
    windows = made_windows(generator, generator.latents(1, seed=5))
    nearest = error_of(generator, windows, steps=1, space=space)
    found = error_of(generator, windows, steps=150, space=space)
    assert found.rotation_degrees < 0.25 * nearest.rotation_degrees
    assert found.position_heights < 0.5 * nearest.position_heights


def test_more_codes_come_nearer_to_what_the_generator_has_not_made(generator: MoDi) -> None:
    found = {
        space: invert(
            generator, stride(50, frames=FRAMES), InversionOptions.build(QUICK | {"steps": 80, "space": space})
        )
        for space in ("W", "W+")
    }
    assert found["W+"].errors[0].rotation_degrees < found["W"].errors[0].rotation_degrees


def test_what_comes_back_belongs_together(generator: MoDi) -> None:
    clip = stride(3, frames=FRAMES + 20)
    found = invert(generator, clip, InversionOptions.build(QUICK))
    assert found.codes.shape == (3, generator.latent_layers, generator.latent_size)
    assert found.codes.dtype == np.float32
    assert [m.name for m in found.motions] == [f"clip3_{k:04d}" for k in (0, 16, 20)]
    for decoded, motion, target in zip(generator.decode(found.codes), found.motions, found.targets):
        assert decoded == motion.replace(name=decoded.name)
        assert len(target) == FRAMES
        np.testing.assert_allclose(target.positions[0, 0, [0, 2]], 0, atol=1e-9)
    report = found.to_dict()
    assert [window["name"] for window in report["windows"]] == [m.name for m in found.motions]
    assert any(f"3 windows of {FRAMES} frames" in line and "overlap" in line for line in report["report"])
    assert sum("degrees about the up axis" in line for line in report["report"]) == 3


def test_where_a_clip_is_and_faces_does_not_matter(generator: MoDi) -> None:
    clip, options = stride(4, frames=FRAMES), InversionOptions.build(QUICK | {"steps": 5})
    elsewhere = clip.transform(rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), 2.0), (3.0, 0.0, -7.0))
    one, other = invert(generator, clip, options), invert(generator, elsewhere, options)
    np.testing.assert_allclose(one.targets[0].positions, other.targets[0].positions, atol=1e-5)
    np.testing.assert_allclose(one.codes, other.codes, atol=1e-2)


def test_the_same_seed_gives_the_same_codes(generator: MoDi) -> None:
    clip = stride(2, frames=2 * FRAMES)

    def codes(**options: Any) -> np.ndarray:
        return invert(generator, clip, InversionOptions.build(QUICK | {"steps": 3} | options)).codes

    np.testing.assert_array_equal(codes(seed=1), codes(seed=1))
    assert np.abs(codes(seed=1) - codes(seed=2)).max() > 0.1
    assert len(codes(windows=1)) == 1


def test_the_generator_inverts_with_the_usual_options(generator: MoDi, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[InversionOptions] = []

    def quick(generator: MoDi, motion: Motion, options: InversionOptions, progress: Progress | None) -> Inversion:
        asked.append(options)
        return invert(generator, motion, replace(options, steps=2, candidates=4), progress)

    monkeypatch.setattr("motiongen.generators.modi.inversion.invert", quick)
    clip = stride(2, frames=FRAMES)
    expected = invert(generator, clip, InversionOptions(seed=1, steps=2, candidates=4)).codes[0]
    shares: list[float] = []
    np.testing.assert_array_equal(generator.invert(clip, seed=1, progress=shares.append), expected)
    assert asked[0].seed == 1
    assert shares[-1] == 1.0


def test_from_the_right_guess_nothing_is_left_to_find(generator: MoDi) -> None:
    codes = generator.latents(1, seed=8)
    assert error_of(generator, made_windows(generator, codes), guess=codes, steps=2, space="W").rotation_degrees < 0.1
    with pytest.raises(MotionGenError, match="1 windows need as many guessed codes, not 2"):
        invert(generator, stride(0, frames=FRAMES), guess=generator.latents(2))


def test_the_pull_to_the_mean_shortens_codes(generator: MoDi) -> None:
    def far(weight: float) -> float:
        options = InversionOptions.build(QUICK | {"mean_weight": weight})
        return float(
            np.abs(invert(generator, stride(6, frames=FRAMES), options).codes - generator.mean_latent()).mean()
        )

    assert far(10.0) < 0.5 * far(0.0)


def test_a_search_that_stands_still_ends_early(generator: MoDi) -> None:
    windows = bring(generator.card, stride(0, frames=FRAMES)).cut().windows
    options = InversionOptions.build(QUICK | {"steps": 200, "learning_rate": 1e-9, "patience": 4})
    assert descend(generator, windows, options)[1] == 4


def test_progress_rises_to_one(generator: MoDi, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("motiongen.generators.modi.inversion.BATCH", 2)
    shares: list[float] = []
    options = InversionOptions.build(QUICK | {"steps": 3})
    found = invert(generator, stride(2, frames=2 * FRAMES), options, shares.append)
    assert len(found.codes) == 2
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(set(shares)) > 4


def test_mistakes_in_the_options_cost_one_line() -> None:
    with pytest.raises(MotionGenError, match="space must be one of W, W\\+, not 'Z'"):
        InversionOptions(space="Z")
    with pytest.raises(MotionGenError, match="starts must be at most candidates=3, not 4"):
        InversionOptions(starts=4, candidates=3)


def test_a_skeleton_without_feet_has_no_labels_to_differ_in(tmp_path: Path) -> None:
    footless = mg.create("modi", checkpoint=str(random_checkpoint(tmp_path / "checkpoint", FIGURE)))
    assert isinstance(footless, MoDi)
    found = invert(footless, stride(0, frames=16), InversionOptions.build(QUICK | {"steps": 2}))
    assert found.errors[0].contact_disagreement == 0.0
