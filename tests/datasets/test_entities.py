"""A motion as entities and back: exact but for where it is."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen import kinematics
from motiongen import rotations as rot
from motiongen.contact import contact_labels
from motiongen.datasets.entities import (
    EntityLayout,
    choose_signs,
    from_entities,
    heading_radians,
    to_entities,
    turn_about_up,
)
from motiongen.errors import MotionGenError
from motiongen.motion import Motion
from tests.datasets.clips import stride
from tests.strategies import generators, random_motion, skeletons


@st.composite
def figures(draw: st.DrawFn) -> tuple[Motion, EntityLayout]:
    """A random motion of a random tree, its root alone translating, and a layout with some of its joints as feet."""
    skeleton = draw(skeletons())
    motion = random_motion(draw(generators()), skeleton, frames=draw(st.integers(1, 9)), translating=(0,))
    feet = draw(st.sets(st.integers(0, len(skeleton) - 1), max_size=4))
    return motion, EntityLayout(skeleton, tuple(sorted(feet)))


@given(figures())
def test_there_and_back_is_the_same_motion_over_the_origin(figure: tuple[Motion, EntityLayout]) -> None:
    motion, layout = figure
    back = from_entities(to_entities(motion, layout), layout, motion.frame_rate, motion.unit)
    height = motion.skeleton.height
    apart = motion.positions - back.positions
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0, 0], apart.shape), atol=1e-9 * height)
    assert rot.angle_between(motion.rotations, back.rotations).max() < 1e-7
    assert np.abs(back.positions[0, 0, [0, 2]]).max() < 1e-9 * height
    assert kinematics.ground_height(back) == pytest.approx(0.0, abs=1e-9 * height)
    assert back.skeleton == motion.skeleton


@given(figures())
def test_every_number_is_what_the_layout_says(figure: tuple[Motion, EntityLayout]) -> None:
    motion, layout = figure
    entities = to_entities(motion, layout)
    joints, feet = len(motion.skeleton), layout.feet
    assert entities.shape == (len(motion), layout.count, 4) == (len(motion), joints + 1 + len(feet), 4)
    labels = contact_labels(motion, feet)
    for t in range(len(motion)):
        now, before = max(t, min(1, len(motion) - 1)), max(t, 1) - 1
        step = (motion.positions[now, 0] - motion.positions[before, 0]) / motion.skeleton.height
        np.testing.assert_allclose(entities[t, layout.root], [*step, 0.0], atol=1e-12)
        for foot in range(len(feet)):
            assert entities[t, layout.contacts][foot].tolist() == [float(labels[t, foot]), 0.0, 0.0, 0.0]
        for joint in range(joints):
            assert abs(entities[t, layout.joints][joint] @ motion.rotations[t, joint]) == pytest.approx(1.0)
    following = np.einsum("tjc,tjc->tj", entities[1:, layout.joints], entities[:-1, layout.joints])
    assert (following >= 0).all()


@given(figures(), st.floats(-10, 10))
def test_turning_windows_turns_the_motion(figure: tuple[Motion, EntityLayout], angle: float) -> None:
    motion, layout = figure
    turned = to_entities(motion.transform(rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), angle)), layout)
    windows = to_entities(motion, layout)[None].copy()
    turn_about_up(windows, layout, np.array([angle]))
    np.testing.assert_allclose(windows[0, :, layout.root], turned[:, layout.root], atol=1e-9)
    same = np.abs(np.einsum("tjc,tjc->tj", windows[0, :, layout.joints], turned[:, layout.joints]))
    np.testing.assert_allclose(same, 1.0, atol=1e-9)
    np.testing.assert_array_equal(windows[0, :, layout.contacts], to_entities(motion, layout)[:, layout.contacts])


@given(figures(), generators())
def test_signs_are_chosen_for_whole_windows(figure: tuple[Motion, EntityLayout], rng: np.random.Generator) -> None:
    motion, layout = figure
    entities = to_entities(motion, layout)
    flipped = entities.copy()
    flipped[:, layout.joints] *= rng.choice([-1.0, 1.0], size=(len(layout.skeleton), 1))
    reference = rng.normal(size=(len(layout.skeleton), 4))
    windows = np.stack([entities, flipped])
    choose_signs(windows, layout, reference)
    np.testing.assert_array_equal(windows[0], windows[1])
    assert (np.einsum("jc,jc->j", windows[0, 0, layout.joints], reference) >= 0).all()
    np.testing.assert_array_equal(np.abs(windows[0]), np.abs(entities))


@given(st.floats(-20, 20))
def test_heading_is_the_angle_within_a_turn(angle: float) -> None:
    found = heading_radians(rot.from_axis_angle(np.array([0.0, 1.0, 0.0]), angle))
    assert -np.pi <= found <= np.pi
    assert np.cos(found - angle) == pytest.approx(1.0)


@given(figures())
def test_a_layout_comes_back_from_plain_data(figure: tuple[Motion, EntityLayout]) -> None:
    layout = figure[1]
    assert EntityLayout.from_dict(json.loads(json.dumps(layout.to_dict()))) == layout
    with pytest.raises(ValueError, match="are no joints"):
        EntityLayout.from_dict(layout.to_dict() | {"feet": [len(layout.skeleton)]})


def test_a_larger_rig_of_the_same_shape_gives_the_same_entities() -> None:
    motion = stride(0)
    layout = EntityLayout(motion.skeleton, (4, 6))
    np.testing.assert_allclose(to_entities(motion.scale(40.0), layout), to_entities(motion, layout), atol=1e-12)


def test_numbers_that_are_no_motion_are_refused() -> None:
    layout = EntityLayout(stride(0).skeleton)
    with pytest.raises(MotionGenError, match="zero"):
        from_entities(np.zeros((3, layout.count, 4)), layout, 30.0)
    with pytest.raises(MotionGenError, match="finite"):
        from_entities(np.full((3, layout.count, 4), np.nan), layout, 30.0)
