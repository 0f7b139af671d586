"""A recogniser: what it is given, what it says, and how it is kept."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from motiongen import rotations as rot
from motiongen.datasets import Dataset
from motiongen.errors import MotionGenError
from motiongen.recognition import Recogniser
from motiongen.recognition.positions import first_poses, placed, positions_of
from motiongen.skeleton import Skeleton
from tests.datasets.clips import FIGURE, stride
from tests.recognition.kinds import KINDS, RATE, clip_of, windows_of
from tests.strategies import generators, random_motion, random_skeleton

UP = np.array([0.0, 1.0, 0.0])


# -- positions


def test_positions_of_windows_are_those_of_their_motions(kinds: Dataset) -> None:
    windows = windows_of(kinds, "training", 5)
    for window, positions in zip(windows, positions_of(windows, kinds.layout)):
        motion = kinds.to_motion(window, standardised=False)
        ours, theirs = positions, motion.positions / motion.skeleton.height
        np.testing.assert_allclose(ours - ours[0, 0], theirs - theirs[0, 0], atol=1e-5)


@given(generators(), st.floats(-3, 3))
def test_where_a_motion_is_and_faces_does_not_count(rng: np.random.Generator, angle: float) -> None:
    motion = random_motion(rng, random_skeleton(rng), frames=5, translating=(0,))
    moved = motion.transform(rot.from_axis_angle(UP, np.array(angle)), rng.normal(size=3))
    reference = first_poses(motion.positions[None])[0] + 0.1 * rng.normal(size=(len(motion.skeleton), 3))
    # A pose whose joints all stand over the root faces nowhere.
    assume(np.abs(first_poses(motion.positions[None])[..., [0, 2]]).max() > 1e-2)
    here, there = placed(motion.positions[None], reference), placed(moved.positions[None], reference)
    np.testing.assert_allclose(here, there, atol=1e-3)


def test_a_placed_motion_stands_on_the_ground_over_the_origin_and_faces_as_the_reference() -> None:
    clip = clip_of("nod", 1)
    ahead = first_poses(clip.positions[None])[0]
    turned = clip.transform(rot.from_axis_angle(UP, np.array(2.0)), [3.0, 1.0, -2.0])
    found = placed(turned.positions[None], ahead)[0]
    np.testing.assert_allclose(found[0, 0, [0, 2]], 0, atol=1e-6)
    np.testing.assert_allclose(np.percentile(found[..., 1].min(axis=1), 2), 0, atol=1e-6)
    np.testing.assert_allclose(found[0] - found[0, 0], ahead, atol=1e-5)


# -- what it finds


def test_it_has_learned_the_kinds(recogniser: Recogniser) -> None:
    """Clips from seeds that no dataset had, turned and moved."""
    fresh = [clip_of(kind, 100 + seed) for kind in KINDS for seed in range(8)]
    chances = recogniser.probabilities(recogniser.of_motions(fresh))
    np.testing.assert_allclose(chances.sum(axis=1), 1, atol=1e-5)
    said = [recogniser.card.classes[k] for k in chances.argmax(axis=1)]
    assert np.mean([a == b for a, b in zip(said, [kind for kind in KINDS for _ in range(8)])]) > 0.9


def test_features_lead_to_probabilities_and_know_no_neighbours(recogniser: Recogniser, kinds: Dataset) -> None:
    positions = positions_of(windows_of(kinds, "held_back", 70), kinds.layout)
    features = recogniser.features(positions)
    head = recogniser.network.head
    logits = features @ head.weight.numpy().T + head.bias.numpy()
    chances = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(recogniser.probabilities(positions), chances, atol=1e-5)
    np.testing.assert_allclose(recogniser.features(positions[65:66]), features[65:66], atol=1e-4)


def test_motions_at_another_rate_are_brought_to_its_own(recogniser: Recogniser) -> None:
    clip = clip_of("kick", 3, frames=33)
    double = clip.resample(2 * RATE)
    assert len(double) == 2 * len(clip) - 1
    np.testing.assert_allclose(recogniser.of_motions([double]), recogniser.of_motions([clip]), atol=1e-6)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda r: r.of_motions([]), "at least one motion"),
        (lambda r: r.of_motions([clip_of("nod", 0, 30), clip_of("nod", 1, 40)]), "'nod_01' has 40 frames at 30 Hz and"),
        (
            lambda r: r.of_motions([stride(0, skeleton=other_figure())]),
            "another skeleton than the recogniser: joint '",
        ),
        (lambda r: r.features(np.zeros((2, 5, 6, 3))), r"shape \(motions, frames, 7, 3\), not \(2, 5, 6, 3\)"),
        (lambda r: r.features(np.zeros((0, 5, 7, 3))), r"not \(0, 5, 7, 3\)"),
        (lambda r: r.probabilities(np.full((2, 5, 7, 3), np.nan)), "not finite"),
    ],
)
def test_what_does_not_fit_is_refused(recogniser: Recogniser, ask: Callable[[Recogniser], object], words: str) -> None:
    with pytest.raises(MotionGenError, match=words) as caught:
        ask(recogniser)
    assert "\n" not in str(caught.value)


def other_figure() -> Skeleton:
    offsets = FIGURE.offsets.copy()
    offsets[1, 1] *= 1.5
    return dataclasses.replace(FIGURE, offsets=offsets)


# -- as a file


def test_a_file_keeps_it_to_the_last_bit(recogniser: Recogniser, kinds: Dataset, tmp_path: Path) -> None:
    recogniser.save(tmp_path / "kept")
    again = Recogniser.load(tmp_path / "kept")
    positions = positions_of(windows_of(kinds, "held_back", 6), kinds.layout)
    np.testing.assert_array_equal(again.features(positions), recogniser.features(positions))
    assert again.card.to_dict() == recogniser.card.to_dict()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept"]
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == ["model.json", "model.safetensors"]


def test_nothing_is_overwritten(recogniser: Recogniser, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(MotionGenError, match="this exists"):
        recogniser.save(tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda folder: (folder / "model.json").unlink(), "no recogniser, for it holds no model.json"),
        (lambda folder: (folder / "model.safetensors").unlink(), "cannot be read"),
        (lambda folder: (folder / "model.safetensors").write_bytes(b"xy"), "cannot be read"),
        (lambda folder: (folder / "model.json").write_text("[]"), "cannot be read"),
        (lambda folder: change(folder, kind="motion"), "it says that it is 'motion'"),
        (lambda folder: change(folder, format=99), "format 99, and this version reads up to 1"),
        (lambda folder: change(folder, channels=[4, 4]), "cannot be read"),
        (lambda folder: change(folder, reference=[1.0]), "cannot be read"),
    ],
)
def test_damage_is_told_in_one_line(
    recogniser: Recogniser, damage: Callable[[Path], object], words: str, tmp_path: Path
) -> None:
    recogniser.save(tmp_path / "kept")
    damage(tmp_path / "kept")
    with pytest.raises(MotionGenError, match=words) as caught:
        Recogniser.load(tmp_path / "kept")
    assert "\n" not in str(caught.value)


def change(folder: Path, **values: object) -> None:
    data = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(data | values))
