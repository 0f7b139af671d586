"""Places of a latent space and their codes, with the model that comes along."""

from __future__ import annotations

import numpy as np
import pytest

import motiongen as mg
from motiongen.errors import MotionGenError
from motiongen.generators.modi.directions import Direction, kept_directions, load_direction
from motiongen.generators.modi.generator import MoDi
from motiongen.web.places import STARTS, Place, Space, code_of, space_of

A_SEED, THE_CLIP, THE_MEAN = STARTS


@pytest.fixture(scope="module")
def model() -> MoDi:
    made = mg.create("modi")
    assert isinstance(made, MoDi)
    return made


@pytest.fixture(scope="module")
def directions(model: MoDi) -> dict[str, Direction]:
    paths = dict(list(kept_directions(model).items())[:2])
    return {name: load_direction(path, model) for name, path in paths.items() if path}


def own(model: MoDi, seed: int) -> np.ndarray:
    """(L, S) the code of a seed's own motion."""
    return model.check_latents(model.latents(1, seed))[0]


def code(model: MoDi, inverted: np.ndarray | None = None, directions: dict | None = None, **place) -> np.ndarray:
    return code_of(model, Place(**place), inverted, Space(model.latent_layers, directions or {}))


def test_the_space_of_the_model_is_its_layers_and_the_directions_it_came_with(model: MoDi) -> None:
    space = space_of(model)
    assert space.layers == model.latent_layers
    assert set(space.directions) == set(kept_directions(model))
    assert all(direction.name == name for name, direction in space.directions.items())


@pytest.mark.parametrize("seed", [0, 12345])
def test_a_seed_is_the_motion_that_sample_makes_of_it(model: MoDi, seed: int) -> None:
    np.testing.assert_allclose(code(model, seed=seed), own(model, seed), atol=1e-5)
    (motion,) = model.decode(code(model, seed=seed)[None], 64)
    assert motion.allclose(model.sample(64, seed=seed)[0], 1e-4)


def test_the_way_to_another_seed_begins_here_and_ends_there(model: MoDi) -> None:
    here, there = own(model, 3), own(model, 4)
    for share in (0.0, 0.25, 1.0):
        found = code(model, seed=3, end_seed=4, share=share)
        np.testing.assert_allclose(found, here + share * (there - here), atol=1e-5)


@pytest.mark.parametrize("start", [A_SEED, THE_MEAN])
def test_nothing_away_from_the_mean_is_the_mean_motion(model: MoDi, start: str) -> None:
    found = code(model, start=start, seed=5, end_seed=6, share=0.3, coarse_layers=2, truncation=0.0)
    mean = model.check_latents(model.mean_latent()[None])[0]
    np.testing.assert_allclose(found, mean, atol=1e-6)
    np.testing.assert_array_equal(code(model, start=THE_MEAN), code(model, start=THE_MEAN, truncation=1.5))


def test_truncation_is_the_share_of_the_way_from_the_mean(model: MoDi) -> None:
    mean = model.check_latents(model.mean_latent()[None])[0]
    for share in (0.5, 1.0, 1.5):
        found = code(model, seed=5, truncation=share)
        np.testing.assert_allclose(found - mean, share * (own(model, 5) - mean), atol=1e-5)


def test_the_coarse_layers_are_kept_and_the_others_taken(model: MoDi) -> None:
    layers = model.latent_layers
    for kept in (1, layers // 2, layers - 1):
        found = code(model, seed=5, detail_seed=6, coarse_layers=kept)
        np.testing.assert_allclose(found[:kept], own(model, 5)[:kept], atol=1e-5)
        np.testing.assert_allclose(found[kept:], own(model, 6)[kept:], atol=1e-5)
    for all_of_them in (None, layers, layers + 3):
        found = code(model, seed=5, detail_seed=6, coarse_layers=all_of_them)
        np.testing.assert_allclose(found, own(model, 5), atol=1e-5)


def test_no_layer_kept_is_the_other_motion(model: MoDi) -> None:
    np.testing.assert_allclose(code(model, seed=5, detail_seed=6, coarse_layers=0), own(model, 6), atol=1e-5)


def test_directions_move_along_their_normals_and_add_up(model: MoDi, directions: dict[str, Direction]) -> None:
    assert len(directions) == 2, "the model came with directions"
    here = code(model, seed=2)
    strengths = dict(zip(directions, (1.5, -2.0)))
    steps = [strength * directions[name].spread * directions[name].normal for name, strength in strengths.items()]
    found = code(model, None, directions, seed=2, strengths=strengths)
    np.testing.assert_allclose(found - here, np.broadcast_to(sum(steps), here.shape), atol=1e-5)
    still = code(model, None, directions, seed=2, strengths=dict.fromkeys(directions, 0.0))
    np.testing.assert_array_equal(still, here)


def test_truncation_does_not_shrink_what_was_asked_for_along_a_direction(
    model: MoDi, directions: dict[str, Direction]
) -> None:
    name, direction = next(iter(directions.items()))
    moved, plain = (
        code(model, None, directions, seed=2, truncation=0.5, strengths=strengths) for strengths in ({name: 1.0}, {})
    )
    np.testing.assert_allclose((moved - plain) @ direction.normal, direction.spread, rtol=1e-3)


def test_the_clip_starts_from_its_own_code_and_needs_one(model: MoDi) -> None:
    inverted = own(model, 1) + np.linspace(-1, 1, model.latent_layers, dtype=np.float32)[:, None]
    np.testing.assert_allclose(code(model, inverted, start=THE_CLIP), inverted, atol=1e-5)
    assert np.abs(code(model, inverted, seed=0) - inverted).max() > 0.1, "a seed is not the clip"
    with pytest.raises(MotionGenError, match="press 'Invert the clip' first"):
        code(model, start=THE_CLIP)


def test_every_code_can_be_decoded(model: MoDi, directions: dict[str, Direction]) -> None:
    place = {"seed": 3, "share": 0.5, "coarse_layers": 2, "truncation": 1.5, "strengths": dict.fromkeys(directions, 3)}
    found = code(model, None, directions, **place)
    assert (found.shape, found.dtype) == ((model.latent_layers, own(model, 0).shape[1]), np.float32)
    (motion,) = model.decode(found[None], 40)
    assert len(motion) == 40


def test_what_a_place_is_called_says_where_it_is() -> None:
    assert Place(seed=7).label == "seed 7"
    assert Place(start=THE_MEAN, seed=7).label == "mean"
    assert Place(start=THE_CLIP).label == "clip"
    assert Place(seed=7, end_seed=9, share=0.5).label == "seed 7 → 9 (50%)"
    assert Place(seed=7, strengths={"speed": 1.5, "bend": 0.0, "arms": -2.0}).label == "seed 7, speed +1.5, arms -2.0"
