"""Coarser skeletons: laws over random trees, and the paper's biped."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.errors import MotionGenError
from motiongen.generators.modi.hierarchy import Hierarchy, Level, build_hierarchy, describe, reductions
from motiongen.generators.modi.options import NetworkOptions
from motiongen.skeleton import Skeleton
from tests.strategies import generators, random_parents, random_skeleton
from tools.bench_modi import biped


def options_of(levels: int, **settings: object) -> NetworkOptions:
    return NetworkOptions.build({"channels": (4,) * levels, "frames": 2 ** (levels - 1)} | settings)


def tree(parents: list[int] | tuple[int, ...], names: list[str] | None = None) -> Skeleton:
    return Skeleton(
        tuple(names or [f"joint{j}" for j in range(len(parents))]), tuple(parents), np.zeros((len(parents), 3))
    )


@st.composite
def cases(draw: st.DrawFn, max_joints: int = 40) -> tuple[Skeleton, tuple[int, ...], Hierarchy]:
    """A random skeleton, some feet in any order, and its hierarchy with a random number of levels."""
    rng = draw(generators())
    skeleton = random_skeleton(rng, draw(st.integers(1, max_joints)))
    feet = tuple(rng.permutation(len(skeleton))[: draw(st.integers(0, min(6, len(skeleton))))].tolist())
    return skeleton, feet, build_hierarchy(skeleton, feet, options_of(draw(st.integers(1, 6))))


def joints_of(level: Level, skeleton: Skeleton) -> list[tuple[int, ...]]:
    """Members of the joint entities."""
    return [group for group in level.members if group[0] < len(skeleton)]


@given(cases())
def test_every_level_holds_all_entities_once_and_keeps_kinds_apart(case: tuple) -> None:
    skeleton, feet, hierarchy = case
    for level in hierarchy.levels:
        assert sorted(member for group in level.members for member in group) == list(
            range(len(skeleton) + 1 + len(feet))
        )
        assert (len(skeleton),) in level.members
        for group in level.members:
            assert len({(member > len(skeleton)) - (member < len(skeleton)) for member in group}) == 1
        assert len(level) == len(level.parents) == len(level.names)
    finest = hierarchy.levels[-1]
    assert finest.members == tuple((entity,) for entity in range(len(finest)))


@given(cases())
def test_every_entity_belongs_to_the_one_coarser_entity_that_holds_its_members(case: tuple) -> None:
    _, _, hierarchy = case
    for number in range(1, len(hierarchy)):
        fine, coarse = hierarchy.levels[number], hierarchy.levels[number - 1]
        affinity = hierarchy.affinity(number)
        assert affinity.shape == (len(fine), len(coarse))
        assert (affinity.sum(axis=1) == 1).all()
        assert (affinity.sum(axis=0) >= 1).all()
        for entity, owner in zip(*np.nonzero(affinity)):
            assert set(fine.members[entity]) <= set(coarse.members[owner])
        assert (hierarchy.down_links(number).mask == affinity.T).all()
        assert (hierarchy.up_links(number).mask == affinity).all()


@given(cases())
def test_what_merges_hangs_together_and_the_coarser_tree_is_that_of_the_joints(case: tuple) -> None:
    skeleton, _, hierarchy = case
    for level in hierarchy.levels:
        groups = joints_of(level, skeleton)
        owner = {joint: g for g, group in enumerate(groups) for joint in group}
        assert [len([j for j in group if owner.get(skeleton.parents[j]) != g]) for g, group in enumerate(groups)] == [
            1
        ] * len(groups)
        bones = {(owner[j], owner[p]) for j, p in enumerate(skeleton.parents) if p >= 0} - {
            (g, g) for g in range(len(groups))
        }
        assert {(g, p) for g, p in enumerate(level.parents[: len(groups)]) if p >= 0} == bones
        assert all(parent < entity for entity, parent in enumerate(level.parents))


@given(cases())
def test_root_motion_and_contacts_hang_beside_their_joints(case: tuple) -> None:
    skeleton, feet, hierarchy = case
    for level in hierarchy.levels:
        members, groups = level.members, joints_of(level, skeleton)
        assert 0 in members[level.parents[members.index((len(skeleton),))]]
        beside = [0] * len(groups)
        for entity in range(len(groups) + 1, len(level)):
            beside[level.parents[entity]] += 1
            for member in members[entity]:
                assert feet[member - len(skeleton) - 1] in members[level.parents[entity]]
        assert max(beside) <= 2
        for group, count in zip(groups, beside):  # two feet stay apart
            held = len(set(group) & set(feet))
            assert count == (held if held <= 2 else 1)


@given(cases(), st.integers(0, 5))
def test_neighbours_are_those_within_so_many_bones(case: tuple, distance: int) -> None:
    _, _, hierarchy = case
    for number, level in enumerate(hierarchy.levels):
        apart = np.full((len(level), len(level)), np.inf)
        np.fill_diagonal(apart, 0)
        for entity, parent in enumerate(level.parents[1:], start=1):  # a child is one bone further from all before it
            apart[entity, :entity] = apart[:entity, entity] = apart[parent, :entity] + 1
        near = level.neighbours(distance)
        assert (near == (apart <= distance)).all()
        assert (hierarchy.in_place_links(number, distance).mask == near).all()
        assert level.neighbours(len(level)).all()


@given(cases(max_joints=25), generators())
def test_the_order_of_joints_does_not_matter(case: tuple, rng: np.random.Generator) -> None:
    skeleton, feet, hierarchy = case
    order = [0]  # another order with parents before children
    while len(order) < len(skeleton):
        ready = [j for j in range(len(skeleton)) if j not in order and skeleton.parents[j] in order]
        order.append(int(rng.choice(ready)))
    parents = [-1, *(order.index(skeleton.parents[j]) for j in order[1:])]
    moved = tree(parents, [skeleton.names[j] for j in order])
    other = build_hierarchy(moved, [order.index(f) for f in feet], options_of(len(hierarchy)))
    to_old = [*order, *range(len(order), len(order) + 1 + len(feet))]
    for level, again in zip(hierarchy.levels, other.levels):
        renamed = [tuple(sorted(to_old[member] for member in group)) for group in again.members]
        place = [renamed.index(group) for group in level.members]
        assert (again.neighbours(1)[np.ix_(place, place)] == level.neighbours(1)).all()


@given(generators(), st.integers(1, 150))
def test_a_reduction_leaves_three_quarters_at_most_and_the_last_one_joint(
    rng: np.random.Generator, joints: int
) -> None:
    sizes = [len(groups) for groups in reductions(random_parents(rng, joints))]
    assert sizes[0] == joints
    assert sizes[-1] == 1
    assert all(fewer <= 0.75 * more for more, fewer in itertools.pairwise(sizes))


LEGS = [-1] + [above for joint in range(30) for above in (0, 3 * joint + 1, 3 * joint + 2)]


@pytest.mark.parametrize(
    "parents",
    [[-1], [-1] + [0] * 60, list(range(-1, 80)), LEGS, [-1] + [0] * 100 + list(range(100, 160))],
    ids=["one joint", "star", "snake", "spider", "star with a tail"],
)
def test_any_shape_comes_down_to_a_few_entities(parents: list[int]) -> None:
    feet = range(0, len(parents), 2)
    hierarchy = build_hierarchy(tree(parents), feet, NetworkOptions())
    assert len(hierarchy) == 5
    assert hierarchy.entities[0] <= 4
    assert list(hierarchy.entities) == sorted(hierarchy.entities)
    assert hierarchy.entities[-1] == len(parents) + 1 + len(feet)


def test_the_papers_biped_has_the_papers_levels() -> None:
    skeleton, feet = biped()
    hierarchy = build_hierarchy(skeleton, feet, NetworkOptions())
    assert [len(joints_of(level, skeleton)) for level in hierarchy.levels] == [1, 2, 7, 12, 20]  # Table 3
    assert hierarchy.entities == (4, 5, 10, 15, 23)


@given(cases())
def test_levels_are_of_the_sizes_asked_for_where_there_are_such(case: tuple) -> None:
    skeleton, feet, _ = case
    sizes = sorted({len(groups) for groups in reductions(skeleton.parents)})
    hierarchy = build_hierarchy(skeleton, feet, options_of(len(sizes), joints=tuple(sizes)))
    assert [len(joints_of(level, skeleton)) for level in hierarchy.levels] == sizes
    upper = sizes[len(sizes) // 2 :]
    hierarchy = build_hierarchy(skeleton, feet, options_of(len(upper), joints=tuple(upper)))
    assert [len(joints_of(level, skeleton)) for level in hierarchy.levels] == upper


@given(cases())
def test_an_image_is_halved_whatever_the_skeleton(case: tuple) -> None:
    skeleton, feet, hierarchy = case
    entities = len(skeleton) + 1 + len(feet)
    image = build_hierarchy(skeleton, feet, options_of(len(hierarchy), skeleton_aware=False))
    assert list(image.entities[::-1]) == [-(-entities // 2**level) for level in range(len(hierarchy))]
    for number in range(len(image)):
        links = image.in_place_links(number, 1)
        if image.entities[number] == 1:
            continue
        assert all(
            source - target + 1 == block for target, source, block in zip(links.targets, links.sources, links.blocks)
        )
        if number:
            assert set(image.down_links(number).blocks) <= {0, 1}


@given(cases(max_joints=12))
def test_the_drawing_shows_every_entity_once_under_its_parent(case: tuple) -> None:
    _, _, hierarchy = case
    lines = describe(hierarchy)
    for number, level in enumerate(hierarchy.levels):
        first = lines.index(f"level {number}: {len(level)} entities")
        shown = lines[first + 1 : first + 1 + len(level)]
        depths = [len(line) - len(line.lstrip(" │├└")) for line in shown]
        labels = [line.lstrip(" │├└") for line in shown]
        assert sorted(labels) == sorted(level.names)
        above = {}  # depth: label
        drawn = set()
        for depth, label in zip(depths, labels):
            above[depth] = label
            drawn.add((label, above.get(depth - 2)))
        parents = [level.names[parent] if parent >= 0 else None for parent in level.parents]
        assert drawn == set(zip(level.names, parents))


@pytest.mark.parametrize("feet", [(0, 0), (20,), (-1,)])
def test_feet_that_are_none_are_refused(feet: tuple[int, ...]) -> None:
    with pytest.raises(MotionGenError, match=r"feet must be different joints from 0 to 19, not \("):
        build_hierarchy(biped()[0], feet, NetworkOptions())


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"frames": 70}, "multiple of 16 with 5 levels, not 70; take 80"),
        ({"channels": ()}, "channels must be whole numbers"),
        ({"channels": (8, 0)}, "channels must be whole numbers"),
        ({"joints": (1, 2)}, "as many levels as channels, 5, not 2"),
        ({"kernel_width": 4}, "odd, not 4; take 5"),
        ({"scaler": "poling"}, "did you mean 'pooling'"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings: dict, said: str) -> None:
    with pytest.raises(MotionGenError, match=said):
        NetworkOptions.build(settings)


def test_options_come_back_from_plain_data() -> None:
    options = NetworkOptions(channels=[8, 4], joints=[1, 9], frames=6)
    assert NetworkOptions.build({**options.to_dict(), "channels": [8, 4], "joints": [1, 9]}) == options
    assert [options.frames_at(level) for level in range(2)] == [3, 6]
