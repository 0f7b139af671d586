"""Skeletons: every refusal, questions about the tree against slow twins, equality and difference."""

from __future__ import annotations

import dataclasses
import pickle
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen import MotionGenError, Skeleton
from tests.strategies import random_skeleton, skeletons

# A body for the tests by name: two legs, one arm and a head with an end site.
NAMES = ("Hips", "LeftLeg", "LeftFoot", "RightLeg", "RightFoot", "Spine", "Head", "LeftArm")
PARENTS = (-1, 0, 1, 0, 3, 0, 5, 5)


def body(**changes: Any) -> Skeleton:
    fields = {"names": NAMES, "parents": PARENTS, "offsets": np.arange(24.0).reshape(8, 3)}
    return Skeleton(**(fields | {"end_sites": (6,), "end_site_offsets": [[0.0, 1.0, 0.0]]} | changes))


# -- what is refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": (), "parents": (), "offsets": np.zeros((0, 3))}, "at least one joint; none came"),
        ({"names": ("Hips",) * 2 + NAMES[2:]}, "joint names must be unique; 'Hips' came twice"),
        ({"parents": PARENTS[:-1]}, "8 joints need 8 parents; 7 came"),
        ({"parents": (0, *PARENTS[1:])}, "joint 0 must be the root, with parent -1, not 0"),
        ({"parents": (-1, -1, *PARENTS[2:])}, "joint 1 'LeftLeg' has parent -1; .*only joint 0 is a root"),
        ({"parents": (-1, 2, 1, *PARENTS[3:])}, "joint 1 'LeftLeg' has parent 2; parents must come before children"),
        ({"parents": (-1, 1, *PARENTS[2:])}, "joint 1 'LeftLeg' has parent 1"),
        ({"parents": (*PARENTS[:-1], 8)}, "joint 7 'LeftArm' has parent 8"),
        ({"end_sites": (8,)}, r"end sites must hang from joints 0 to 7; \(8,\) came"),
        ({"end_sites": (-1,)}, r"end sites must hang from joints 0 to 7; \(-1,\) came"),
        ({"offsets": np.zeros((7, 3))}, r"offsets must have shape \(8, 3\), not \(7, 3\)"),
        ({"offsets": np.zeros(24)}, r"offsets must have shape \(8, 3\), not \(24,\)"),
        ({"offsets": np.full((8, 3), np.nan)}, r"offsets must be finite numbers; entry \(0, 0\) is nan"),
        ({"end_site_offsets": np.zeros((2, 3))}, r"end_site_offsets must have shape \(1, 3\), not \(2, 3\)"),
        ({"end_site_offsets": [[0, np.inf, 0]]}, r"end_site_offsets must be finite numbers; entry \(0, 1\) is inf"),
    ],
)
def test_what_is_no_tree_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(MotionGenError, match=message) as caught:
        body(**changes)
    assert "\n" not in str(caught.value)


def test_it_cannot_be_changed() -> None:
    offsets = np.zeros((8, 3))
    skeleton = body(offsets=offsets)
    offsets[0] = 5.0  # the caller's array is not the skeleton's
    assert (skeleton.offsets == 0).all()
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(skeleton, dataclasses.fields(skeleton)[0].name, ("other",))
    for array in (skeleton.offsets, skeleton.end_site_offsets, skeleton.rest_positions):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


# -- the tree


@given(skeletons())
def test_levels_children_and_ancestors_tell_the_same_tree(skeleton: Skeleton) -> None:
    assert sorted(j for level in skeleton.levels for j in level) == list(range(len(skeleton)))
    for depth, level in enumerate(skeleton.levels):
        assert list(level) == sorted(level)
        assert all(len(skeleton.ancestors(joint)) == depth for joint in level)
    for joint, parent in enumerate(skeleton.parents):
        chain = skeleton.ancestors(joint)
        if parent == -1:
            assert chain == ()
        else:
            assert chain == (*skeleton.ancestors(parent), parent)
            assert joint in skeleton.children[parent]
    assert sum(len(kids) for kids in skeleton.children) == len(skeleton) - 1
    assert all(list(kids) == sorted(kids) for kids in skeleton.children)


@given(skeletons())
def test_a_subtree_is_all_that_has_the_joint_above_it(skeleton: Skeleton) -> None:
    for joint in range(len(skeleton)):
        below = [j for j in range(len(skeleton)) if j == joint or joint in skeleton.ancestors(j)]
        assert skeleton.subtree(joint) == tuple(below)
    assert skeleton.subtree(0) == tuple(range(len(skeleton)))


@given(skeletons(), st.sampled_from([1e-3, 7.0]))
def test_height_is_the_longest_side_of_the_rest_pose(skeleton: Skeleton, factor: float) -> None:
    points = []
    body = skeleton.subtree(skeleton.body)
    for joint, offset in enumerate(skeleton.offsets):
        above = [skeleton.offsets[j] for j in skeleton.ancestors(joint)]
        np.testing.assert_allclose(skeleton.rest_positions[joint], np.sum([*above, offset], axis=0), atol=1e-9)
        if joint not in body:
            continue
        points.append(skeleton.rest_positions[joint])
        points += [points[-1] + skeleton.end_site_offsets[s] for s, j in enumerate(skeleton.end_sites) if j == joint]
    extent = max(max(p[axis] for p in points) - min(p[axis] for p in points) for axis in range(3))
    assert skeleton.height == pytest.approx(extent if extent > 0 else 1.0)
    larger = dataclasses.replace(
        skeleton, offsets=factor * skeleton.offsets, end_site_offsets=factor * skeleton.end_site_offsets
    )
    assert larger.height == pytest.approx(factor * extent if extent > 0 else 1.0)


def test_a_point_has_height_one() -> None:
    point = Skeleton(("only",), (-1,), np.array([[3.0, 4.0, 5.0]]))
    assert point.height == 1.0
    assert point.levels == ((0,),)
    assert "1 joints" in repr(point)


# -- by name


@given(skeletons())
def test_every_joint_is_found_by_its_name(skeleton: Skeleton) -> None:
    assert [skeleton.index(name) for name in skeleton.names] == list(range(len(skeleton)))
    assert skeleton.select(skeleton.names) == tuple(range(len(skeleton)))
    assert skeleton.select(["*"]) == tuple(range(len(skeleton)))


@pytest.mark.parametrize(
    ("patterns", "expected"),
    [
        (["Left*"], "LeftLeg LeftFoot LeftArm"),
        (["left*", "LeftLeg"], "LeftLeg LeftFoot LeftArm"),
        (["*leg", "h*"], "Hips LeftLeg RightLeg Head"),
        (["????"], "Hips Head"),
        (["[LR]*foot"], "LeftFoot RightFoot"),
        ([], ""),
    ],
)
def test_joints_are_selected_by_pattern(patterns: list[str], expected: str) -> None:
    assert [NAMES[j] for j in body().select(patterns)] == expected.split()


def test_one_pattern_needs_no_list() -> None:
    """Taken letter by letter it would match nothing, or something else."""
    assert body().select("Left*") == body().select(["Left*"])


def test_names_with_brackets_match_themselves() -> None:
    skeleton = Skeleton(("Arm[0]", "Arm0"), (-1, 0), np.zeros((2, 3)))
    assert skeleton.select(["Arm[0]"]) == (0,)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Hip", "there is no joint 'Hip'; did you mean 'Hips'\\?"),
        ("leftfoot", "there is no joint 'leftfoot'; did you mean 'LeftFoot'\\?"),
        ("HEAD", "there is no joint 'HEAD'; did you mean 'Head'\\?"),
        ("tail", "there is no joint 'tail'$"),
    ],
)
def test_an_unknown_name_is_refused_with_the_nearest(name: str, message: str) -> None:
    with pytest.raises(MotionGenError, match=message):
        body().index(name)


def test_a_pattern_without_joints_is_refused() -> None:
    with pytest.raises(MotionGenError, match="no joint matches 'Lfet\\*'; did you mean 'Left"):
        body().select(["Hips", "Lfet*"])


# -- equality and difference


@given(skeletons())
def test_equal_skeletons_are_equal_and_hash_alike(skeleton: Skeleton) -> None:
    twin = Skeleton(*(getattr(skeleton, field.name) for field in dataclasses.fields(skeleton)))
    assert skeleton == twin
    assert hash(skeleton) == hash(twin)
    assert pickle.loads(pickle.dumps(skeleton)) == skeleton
    assert skeleton.difference(twin) is None
    assert skeleton != "a skeleton"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"names": ("Hip", *NAMES[1:])}, "it lacks joint 'Hips'"),
        ({"names": tuple(name.lower() for name in NAMES)}, "it lacks joint 'Hips' and 7 more"),
        ({"parents": (*PARENTS[:-1], 0)}, "its joints come in another order or under other parents"),
        ({"names": (*NAMES[:2], "RightLeg", "LeftFoot", *NAMES[4:])}, "another order"),
        ({"offsets": np.arange(24.0).reshape(8, 3) * 1.5}, "joint 'LeftArm' sits .*% of the height elsewhere"),
    ],
)
def test_a_difference_is_said_in_words(changes: dict[str, Any], words: str) -> None:
    other = body(**changes)
    assert other != body()
    found = body().difference(other)
    assert found is not None
    assert re.search(words, found)


def test_extra_joints_are_a_difference() -> None:
    wider = Skeleton((*NAMES, "Tail"), (*PARENTS, 0), np.zeros((9, 3)))
    assert body().difference(wider) == "it has an extra joint 'Tail'"
    assert wider.difference(body()) == "it lacks joint 'Tail'"


def test_small_and_ignored_offsets_are_no_difference() -> None:
    skeleton = body()
    offsets = skeleton.offsets.copy()
    offsets[3, 1] += 0.01 * skeleton.height
    other = body(offsets=offsets)
    assert skeleton.difference(other) == "joint 'RightLeg' sits 1.0% of the height elsewhere"
    assert skeleton.difference(other, ignoring=[3]) is None
    assert skeleton.difference(other, tolerance=0.02) is None
    offsets[3] = skeleton.offsets[3]
    offsets[0] += 9.0  # where the root rests is no part of the body
    assert skeleton.difference(body(offsets=offsets)) is None


@given(skeletons(min_joints=2))
def test_the_same_tree_may_have_other_bones(skeleton: Skeleton) -> None:
    other = dataclasses.replace(skeleton, offsets=skeleton.offsets + 1.0)
    assert skeleton.same_tree(other)
    assert skeleton != other
    reversed_names = dataclasses.replace(skeleton, names=skeleton.names[::-1])
    assert not skeleton.same_tree(reversed_names)


def test_random_trees_are_of_every_shape() -> None:
    """The random trees of these tests reach the corners: a chain, a star, one joint, no tip, two tips on a joint."""
    trees = [random_skeleton(np.random.default_rng(seed)) for seed in range(200)]
    assert any(len(tree) == 1 for tree in trees)
    assert any(len(tree.levels) == len(tree) > 4 for tree in trees)
    assert any(max(map(len, tree.children)) > 4 for tree in trees)
    assert any(len(set(tree.end_sites)) < len(tree.end_sites) for tree in trees)
    assert any((tree.end_site_offsets == 0).all(axis=-1).any() for tree in trees)


def test_where_the_body_stands_is_no_part_of_its_height() -> None:
    """Some files rest their hips metres from a still root above them; the hips' offset is a place, not a bone."""
    offsets = np.array([[0.0, 0.0, 0.0], [1.0, 94.0, -452.0], [0.0, 60.0, 0.0], [0.0, -90.0, 0.0]])
    skeleton = Skeleton(("Root", "Hips", "Head", "Foot"), (-1, 0, 1, 1), offsets, (2,), np.array([[0.0, 20.0, 0.0]]))
    assert skeleton.body == 1
    assert skeleton.height == pytest.approx(170.0)


def test_a_chain_is_all_body() -> None:
    skeleton = Skeleton(("a", "b", "c"), (-1, 0, 1), np.array([[9.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 3.0, 0.0]]))
    assert skeleton.body == 0
    assert skeleton.height == pytest.approx(5.0)
