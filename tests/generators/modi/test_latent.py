"""Laws of places in the latent space."""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
import pytest

import motiongen as mg
from motiongen import rotations as rot
from motiongen.errors import MotionGenError
from motiongen.generators.modi import latent
from motiongen.generators.modi.generator import MoDi
from tests.checkpoints import random_checkpoint
from tests.datasets.clips import FIGURE, stride

RNG = np.random.default_rng(0)
W, W_PLUS = (6,), (5, 6)
needs_learning = pytest.mark.skipif(importlib.util.find_spec("sklearn") is None, reason="needs the extra 'latent'")


def codes(*shape: int) -> latent.Codes:
    return RNG.standard_normal(shape).astype(np.float32)


@pytest.fixture(scope="module")
def generator(tmp_path_factory: pytest.TempPathFactory) -> MoDi:
    folder = random_checkpoint(tmp_path_factory.mktemp("modi") / "checkpoint", FIGURE, (4, 6), "m")
    made = mg.create("modi", checkpoint=str(folder))
    assert isinstance(made, MoDi)
    return made


# -- codes


@pytest.mark.parametrize("shape", [W, W_PLUS])
@pytest.mark.parametrize("steps", [1, 4, 7])
def test_ways_are_straight_and_end_where_they_should(shape: tuple[int, ...], steps: int) -> None:
    start, end = codes(*shape), codes(*shape)
    way = latent.interpolate(start, end, steps)
    assert way.shape == (steps + 1, *shape)
    np.testing.assert_array_equal(way[0], start)
    np.testing.assert_array_equal(way[-1], end)
    for step, code in enumerate(way):
        np.testing.assert_allclose(code, start + step / steps * (end - start), atol=1e-6)
    np.testing.assert_allclose(latent.interpolate(end, start, steps), way[::-1], atol=1e-6)


def test_the_way_to_the_mean_is_truncation(generator: MoDi) -> None:
    code, mean = generator.latents(1, seed=3)[0], generator.mean_latent()
    way = latent.interpolate(code, mean, 4)
    options = {"checkpoint": generator.options.checkpoint}
    for step, kept in enumerate((1.0, 0.75, 0.5, 0.25, 0.0)):
        truncated = mg.create("modi", truncation=kept, **options).latents(1, seed=3)[0]
        np.testing.assert_allclose(way[step], truncated, atol=1e-6)


@pytest.mark.parametrize("first", range(6))
def test_mixes_take_layers_of_one_and_then_of_the_other(first: int) -> None:
    coarse, fine = codes(*W_PLUS), codes(*W_PLUS)
    mixed = latent.mix(coarse, fine, first)
    np.testing.assert_array_equal(mixed[:first], coarse[:first])
    np.testing.assert_array_equal(mixed[first:], fine[first:])
    np.testing.assert_array_equal(latent.mix(coarse, coarse, first), coarse)


@pytest.mark.parametrize("shape", [W, W_PLUS])
def test_neighbours_of_no_sigma_are_copies_and_seeds_repeat(shape: tuple[int, ...]) -> None:
    code, deviation = codes(*shape), np.linspace(0.5, 2, 6, dtype=np.float32)
    copies = latent.vary(code, 3, 0.0, deviation)
    np.testing.assert_array_equal(copies, np.broadcast_to(code, (3, *shape)))
    once, again, other = (latent.vary(code, 5, 0.4, deviation, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(once, again)
    assert not np.isclose(once, other).any()
    np.testing.assert_array_equal(once[:2], latent.vary(code, 2, 0.4, deviation, 7), "whatever their number")
    moves = once - code
    np.testing.assert_allclose(latent.vary(code, 5, 0.8, deviation, 7) - code, 2 * moves, atol=1e-5)


def test_noise_is_as_wide_as_sigma_says_and_the_same_in_all_layers() -> None:
    code, deviation = codes(*W_PLUS), np.linspace(0.5, 2, 6, dtype=np.float32)
    moves = latent.vary(code, 4000, 0.3, deviation) - code
    np.testing.assert_allclose(moves, np.broadcast_to(moves[:, :1], moves.shape), atol=1e-5)
    np.testing.assert_allclose(moves[:, 0].std(axis=0), 0.3 * deviation, rtol=0.05)
    np.testing.assert_allclose(moves[:, 0].mean(axis=0), 0, atol=0.05)


def test_deviation_is_that_of_codes_without_truncation(generator: MoDi) -> None:
    drawn = generator.latents(2000, seed=1).std(axis=0)
    np.testing.assert_allclose(latent.deviation(generator), drawn, rtol=0.1)
    options: dict[str, Any] = {"checkpoint": generator.options.checkpoint, "truncation": 0.0}
    truncated = mg.create("modi", **options)
    assert isinstance(truncated, MoDi)
    np.testing.assert_array_equal(latent.deviation(truncated), latent.deviation(generator))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: latent.interpolate(codes(*W), codes(*W_PLUS), 3), r"one shape, not \(6,\) and \(5, 6\)"),
        (lambda: latent.interpolate(codes(*W), codes(*W), 0), "steps must be a whole number of at least 1, not 0"),
        (lambda: latent.mix(codes(*W), codes(*W), 2), r"must be in W\+, \(L, S\), not \(6,\)"),
        (lambda: latent.mix(codes(*W_PLUS), codes(*W_PLUS), 6), "first must be a whole number from 0 to 5.*not 6"),
        (lambda: latent.vary(codes(*W), 2, -0.1, np.ones(6)), "sigma must be a number of at least 0, not -0.1"),
        (lambda: latent.vary(codes(*W), 2, np.inf, np.ones(6)), "sigma must be"),
        (lambda: latent.cluster(codes(3, 6), 4), "clusters must be from 1 to 3.*not 4"),
        (lambda: latent.flattened(codes(3, 6)), "at least 4 codes, not 3"),
        (lambda: latent.agreement(np.zeros(3), ["a"]), "as many, at least one, not 3 and 1"),
    ],
)
def test_what_makes_no_sense_is_refused(call: Any, words: str) -> None:
    with pytest.raises(MotionGenError, match=words):
        call()


# -- how far apart motions are


def test_distances_are_means_over_frames_and_joints() -> None:
    one, other = stride(0), stride(1)
    found = latent.apart(one, other)
    turns, ways = [], []
    for frame in range(len(one)):
        for joint in range(len(FIGURE)):
            cosine = abs(one.rotations[frame, joint] @ other.rotations[frame, joint])
            turns.append(np.degrees(2 * np.arccos(min(cosine, 1.0))))
            ways.append(np.linalg.norm(one.positions[frame, joint] - other.positions[frame, joint]) / FIGURE.height)
    assert found.degrees == pytest.approx(np.mean(turns))
    assert found.heights == pytest.approx(np.mean(ways))
    assert latent.apart(one, one).degrees == pytest.approx(0, abs=1e-6)
    larger = latent.apart(one.scale(3.0), other.scale(3.0))
    assert larger.heights == pytest.approx(found.heights), "in heights, whatever the unit"


def test_an_even_row_has_equal_steps_and_no_detour() -> None:
    """A pose that turns about one axis by equal steps."""
    still = stride(0, frames=8)
    turns = [rot.from_axis_angle(np.array([0.0, 0.0, 1.0]), angle) for angle in (0.0, 0.1, 0.2, 0.3)]
    row = [still.replace(rotations=rot.multiply(np.broadcast_to(turn, (8, 7, 4)), still.rotations)) for turn in turns]
    even = latent.smoothness(row)
    assert [step.degrees for step in even.steps] == pytest.approx([np.degrees(0.1)] * 3)
    assert even.largest_share.degrees == pytest.approx(1 / 3)
    assert even.detour.degrees == pytest.approx(1)
    jump = latent.smoothness([row[0], row[0], row[3]])
    assert jump.largest_share.degrees == pytest.approx(1)
    assert jump.largest_share.heights == pytest.approx(1)
    there_and_back = latent.smoothness([row[0], row[3], row[1]])
    assert there_and_back.detour.degrees == pytest.approx(5)
    nowhere = latent.smoothness([row[0], row[0]])
    assert (nowhere.detour.heights, nowhere.largest_share.heights) == (0.0, 0.0)


def test_speed_is_way_over_time_in_heights() -> None:
    motion = stride(0, frames=12)
    way = sum(
        float(np.linalg.norm(motion.positions[frame + 1, joint] - motion.positions[frame, joint]))
        for frame in range(11)
        for joint in range(7)
    )
    assert latent.speed(motion) == pytest.approx(way / 7 / (11 / 30) / FIGURE.height)
    assert latent.speed(motion[::2]) <= latent.speed(motion)
    assert latent.speed(motion[0]) == 0.0


# -- clusters


@needs_learning
def test_groups_that_stand_apart_are_found_largest_first() -> None:
    middles = np.array([[9.0, 0, 0], [0, 9, 0], [0, 0, 9]])
    kinds = np.repeat([0, 1, 2], (10, 40, 25))
    many = (middles[kinds] + 0.1 * RNG.standard_normal((75, 3))).astype(np.float32)
    found = latent.cluster(many, 3)
    assert found.sizes.tolist() == [40, 25, 10]
    np.testing.assert_array_equal(found.members, np.array([2, 0, 1])[kinds])
    for group, centre in enumerate(found.centres):
        np.testing.assert_allclose(centre, many[found.members == group].mean(axis=0), atol=1e-5)
    np.testing.assert_array_equal(found.of(many), found.members)
    np.testing.assert_array_equal(latent.cluster(many, 3).members, found.members, "a seed repeats")
    assert latent.agreement(found.members, [f"kind {kind}" for kind in kinds]).information == pytest.approx(1)


@needs_learning
def test_representatives_are_the_nearest_and_others_of_the_group() -> None:
    many = codes(60, 4)
    found = latent.cluster(many, 4)
    chosen = latent.representatives(found, many, 3, seed=5)
    assert len(chosen) == 4
    for group, members in enumerate(chosen):
        inside = np.flatnonzero(found.members == group)
        far = {int(each): float(np.linalg.norm(many[each] - found.centres[group])) for each in inside}
        assert members[0] == min(far, key=lambda each: far[each])
        assert len(set(members.tolist())) == len(members) == min(3, len(inside))
        assert set(members.tolist()) <= set(inside.tolist())
        np.testing.assert_array_equal(members, latent.representatives(found, many, 3, seed=5)[group])
    everything = latent.representatives(found, many, 60)
    assert sorted(np.concatenate(everything).tolist()) == list(range(60)), "no more than there are"


@needs_learning
def test_a_map_keeps_neighbours_together_and_repeats() -> None:
    far = np.repeat([0.0, 50.0], 15)[:, None] + RNG.standard_normal((30, 5))
    place = latent.flattened(far, seed=2)
    assert place.shape == (30, 2)
    spread = max(np.ptp(place[:15], axis=0).max(), np.ptp(place[15:], axis=0).max())
    assert np.linalg.norm(place[:15].mean(axis=0) - place[15:].mean(axis=0)) > spread / 2
    np.testing.assert_array_equal(latent.flattened(far, seed=2), place)


@needs_learning
def test_agreement_is_one_where_each_tells_the_other_and_none_by_chance() -> None:
    groups = np.repeat(np.arange(4), 25)
    whole = latent.agreement(groups, [f"kind {3 - group}" for group in groups])
    assert (whole.information, whole.purity) == (pytest.approx(1), 1.0)
    assert abs(whole.chance_information) < 0.02
    assert 0.25 < whole.chance_purity < 0.5
    rng = np.random.default_rng(3)
    none = latent.agreement(groups, [str(kind) for kind in rng.integers(0, 4, 100)])
    assert abs(none.information) < 0.1
    assert none.purity == pytest.approx(none.chance_purity, abs=0.1)
    labels = ["a", "a", "b", "b", "b", "c"]
    assert latent.agreement(np.array([0, 0, 0, 1, 1, 1]), labels).purity == pytest.approx(4 / 6)


def test_without_the_extra_one_line_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refusing(name: str, *rest: Any, **more: Any) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(latent.importlib, "import_module", refusing)
    with pytest.raises(MotionGenError, match=r"need the extra 'latent': pip install 'motiongen\[latent\]'"):
        latent.cluster(codes(9, 6), 2)
