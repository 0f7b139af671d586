"""The stage of the page: what stands on it is where the clip says, and the way back from a click is exact."""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

pytest.importorskip("viser", reason="viser is not installed: pip install motiongen[web]")

from motiongen.contact import contact_labels, foot_joints
from motiongen.motion import Motion
from motiongen.render.figure import LEFT, RIGHT
from motiongen.render.palette import SIDES
from motiongen.render.stage import cast
from motiongen.trajectory import path_through
from motiongen.web.body import STATURE, bodies
from motiongen.web.stage import Actor, Stage
from tests.render.figures import one_joint, standing, walking
from tests.strategies import motions, random_motion, random_skeleton
from tests.web.scenes import Client, Node
from tests.web.wanderers import SPANS, turned, wandering

Array = NDArray[Any]

PLACES = st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=6)


def on_stage(*clips: Motion, beside: bool = True) -> tuple[Client, Stage]:
    """A stage on which the first clip is the example of the others."""
    client = Client()
    stage = Stage(client)
    stage.show([Actor(clip, f"clip {i}", i == 0) for i, clip in enumerate(clips)], beside)
    return client, stage


def ends_of(limbs: Node) -> tuple[Array, Array]:
    """(B, 3) where the limbs of the scene begin and end."""
    lengths = limbs.batched_scales[:, 1]
    along = turned(limbs.batched_wxyzs, np.array([0.0, 1.0, 0.0]) * lengths[:, None])
    return limbs.batched_positions, limbs.batched_positions + along


# -- bones


def stretching(share: float) -> Motion:
    """The stiff figure, whose knee-less legs grow by a share of its height."""
    still = standing(6)
    leg = still.skeleton.names.index("LeftFoot")
    motion = still.with_translating([leg])
    translations = motion.translations.copy()
    translations[:, motion.translating.index(leg), 1] -= share * still.skeleton.height * np.arange(6) / 5
    return motion.replace(translations=translations)


@given(motions(min_frames=2) | st.sampled_from([0.0, 0.0004, 0.004, 0.04]).map(stretching), st.floats(0.0, 1.0))
def test_every_bone_begins_and_ends_at_its_joints(motion: Motion, when: float) -> None:
    client, stage = on_stage(motion)
    stage.move_to(when * motion.duration)
    frame = round(when * motion.duration * motion.frame_rate)
    actor = cast([motion], [""], [np.arange(len(motion))])[0]
    nodes = STATURE * (actor.nodes[frame] - actor.nodes[0, actor.figure.root] * [1.0, 0.0, 1.0])
    reach = max(1.0, float(np.abs(nodes).max()))
    balls = client.scene.ending("balls")[0]
    heads = nodes[actor.figure.balls].mean(axis=1)
    np.testing.assert_allclose(balls.batched_positions[: len(heads)], heads, atol=1e-5 * reach)
    if not len(actor.figure.bones):
        assert not client.scene.ending("limbs")
        return
    begins, ends = ends_of(client.scene.ending("limbs")[0])
    np.testing.assert_allclose(begins, nodes[actor.figure.bones[:, 0]], atol=1e-5 * reach)
    np.testing.assert_allclose(ends, nodes[actor.figure.bones[:, 1]], atol=1e-3 * STATURE + 1e-5 * reach)


# -- paths and clicks


@given(SPANS, PLACES, st.tuples(st.floats(-5, 5), st.floats(0.5, 5), st.floats(-5, 5)), st.integers(-1, 1))
def test_a_click_on_a_drawn_point_is_that_point(
    span: float, points: list[tuple[float, float]], eye: tuple[float, float, float], followed: int
) -> None:
    client, stage = on_stage(wandering(span, scale=70.0), wandering(span, scale=50.0))
    stage.follow(None if followed < 0 else followed)
    stage.move_to(0.2)
    stage.draw_path(100.0 * np.array(points))
    drawn = client.scene.nodes["/stage/path-points"].batched_positions
    for point, ball in zip(points, drawn):
        world = np.array([ball[0], 0.0, ball[2]]) + client.scene.nodes["/stage"].position
        hit = stage.ground_point(eye, tuple(world - np.array(eye)))
        assert hit == pytest.approx((100.0 * point[0], 100.0 * point[1]), abs=1e-3)


def test_a_line_of_sight_over_the_horizon_meets_no_ground() -> None:
    _, stage = on_stage(standing())
    assert stage.ground_point((0, 2, 0), (0, 0.1, 1)) is None
    assert stage.ground_point((0, 2, 0), (0, 0, 1)) is None
    assert stage.ground_point((0, -2, 0), (0, -1, 0)) is None
    assert Stage(Client()).ground_point((0, 2, 0), (0, -1, 0)) is None


@given(PLACES)
def test_the_drawn_line_is_the_one_that_is_followed(points: list[tuple[float, float]]) -> None:
    places = np.array(points).round(2)
    assume((places != places[0]).any())
    client, stage = on_stage(standing(scale=2.0), standing(scale=2.0))
    stage.draw_path(places)
    line = client.scene.nodes["/stage/path"].points
    x, z = np.concatenate([line[:, 0], line[-1:, 1]])[:, ::2].T
    shown = [stage.ground_point((a, 1.0, b), (0.0, -1.0, 0.0)) for a, b in zip(x, z)]
    np.testing.assert_allclose(shown, path_through(places).places, atol=1e-4)


def test_a_path_of_no_or_one_place_has_no_line() -> None:
    client, stage = on_stage(standing())
    for points, nodes in (([], 0), ([[1, 2]], 1), ([[1, 2], [1, 2]], 1), ([[1, 2], [3, 2]], 2), ([], 0)):
        stage.draw_path(np.array(points, dtype=float))
        assert len([name for name in client.scene.nodes if "path" in name]) == nodes


# -- time


@given(st.floats(-1.0, 4.0), st.sampled_from([30.0, 29.97, 120.0]))
def test_every_actor_stands_at_the_nearest_frame_and_stays_on_its_last(seconds: float, frame_rate: float) -> None:
    clips = [walking(40, frame_rate=frame_rate), walking(90, frame_rate=30.0)]
    client, stage = on_stage(*clips)
    stage.move_to(seconds)
    begins, _ = ends_of(client.scene.ending("limbs")[0])
    start = 0
    for clip, label in zip(clips, client.scene.ending("label")):
        moments = np.arange(len(clip)) / clip.frame_rate
        nearest = int(np.argmin(np.abs(moments - seconds)))
        assume(abs(abs(seconds * clip.frame_rate - nearest) - 0.5) > 1e-6 or nearest in (0, len(clip) - 1))
        body = bodies(clips)[clips.index(clip)]
        bones = len(body.figure.bones)
        gone = begins[start : start + bones, 2] - body.nodes[0, body.figure.bones[:, 0], 2]
        np.testing.assert_allclose(gone * body.unit, clip.root_positions[nearest, 2], atol=1e-5)
        start += bones
        assume(abs(seconds - moments[-1] - 0.5 / clip.frame_rate) > 1e-6)
        assert ("over" in label.text) == (seconds > moments[-1] + 0.5 / clip.frame_rate)


def test_the_last_frame_lasts_as_long_as_any_other() -> None:
    client, stage = on_stage(walking(10, frame_rate=10.0), walking(40, frame_rate=10.0))
    for seconds, over in ((0.9, False), (0.94, False), (0.96, True), (0.9, False)):
        stage.move_to(seconds)
        assert ("over" in client.scene.ending("label")[0].text) == over


def saturation(node: Node) -> Array:
    """(N,) how far the colours of a batch are from grey."""
    return np.ptp(node.batched_colors.astype(int), axis=1)


def test_one_that_is_over_is_grey_until_it_goes_on() -> None:
    client, stage = on_stage(walking(10), walking(40))
    for node in client.scene.ending("limbs") + client.scene.ending("balls"):
        before, half = node.batched_colors.copy(), len(node.batched_colors) // 2
        stage.move_to(0.9)
        assert (saturation(node)[:half] < 5).all()
        np.testing.assert_array_equal(node.batched_colors[half:], before[half:])
        stage.move_to(0.1)
        np.testing.assert_array_equal(node.batched_colors, before)


def test_an_example_is_paler_and_left_and_right_keep_their_colours() -> None:
    client, _ = on_stage(standing(), standing())
    colours = client.scene.ending("limbs")[0].batched_colors.astype(float)
    pale, full = np.split(colours, 2)
    sides = bodies([standing()])[0].figure.sides
    for side in (LEFT, RIGHT):
        shown = (full[sides == side] / 255) ** (1 / 2.2) * 255  # the page takes colours for amounts of light
        np.testing.assert_allclose(shown, np.tile(SIDES[side], (len(shown), 1)), atol=12)
        assert (np.ptp(pale[sides == side], axis=1) < 0.7 * np.ptp(full[sides == side], axis=1)).all()


@given(motions(min_frames=4, smooth=True))
def test_a_mark_lies_under_every_foot_that_stands_and_under_no_other(motion: Motion) -> None:
    feet = foot_joints(motion)
    labels = contact_labels(motion, feet)
    client, stage = on_stage(motion)
    if not feet:
        assert not client.scene.ending("feet")
        return
    body = bodies([motion])[0]
    for frame in range(len(motion)):
        stage.move_to(frame / motion.frame_rate)
        places = client.scene.ending("feet")[0].batched_positions
        stands = labels[frame]
        assert ((places[stands, 1] > 0) & (places[stands, 1] < 0.02)).all()
        assert (places[~stands, 1] < -100).all()
        np.testing.assert_array_equal(places[stands, ::2], body.nodes[frame, body.feet, ::2][stands])


def test_the_way_is_strong_as_far_as_it_is_gone() -> None:
    clip = walking(60)
    client, stage = on_stage(clip)
    way = client.scene.ending("way")[0]
    for frame in range(0, 60, 7):
        stage.move_to(frame / 30)
        strong = np.ptp(way.colors.astype(int), axis=-1)[:, 0] > 100
        gone = way.points[:, 1, 2] <= bodies([clip])[0].way[frame, 1] + 1e-5
        np.testing.assert_array_equal(strong, gone)


def test_a_moment_costs_a_few_messages_whatever_the_joints() -> None:
    rng = np.random.default_rng(0)
    clips = [random_motion(rng, random_skeleton(rng, joints), frames=30) for joints in (3, 60, 120)]
    client, stage = on_stage(*clips)
    before = client.scene.changes
    stage.move_to(0.5)
    assert client.scene.changes - before <= 6 + 3 * len(clips)
    before = client.scene.changes
    stage.move_to(0.501)
    assert client.scene.changes == before, "the same frames need not be sent again"


# -- camera


@given(SPANS, st.integers(0, 1), st.booleans())
def test_who_is_followed_stays_before_the_camera_that_is_the_visitors(span: float, number: int, beside: bool) -> None:
    client, stage = on_stage(wandering(span, 40), wandering(span / 2, 30), beside=beside)
    client.camera.look_at = (0.3, 1.0, -0.4)
    stage.follow(number)
    written = client.camera.written
    for seconds in (0.0, 0.4, 1.2):
        stage.move_to(seconds)
        here = client.scene.ending("label")[number].position + np.array(client.scene.nodes["/stage"].position)
        np.testing.assert_allclose(here[::2], (0.3, -0.4), atol=1e-6)
        stage.follow(number)
    assert client.camera.written == written
    there = client.scene.nodes["/stage"].position
    client.camera.look_at = (2.0, 1.0, 2.0)  # the visitor looks elsewhere
    stage.follow(number)
    assert client.scene.nodes["/stage"].position == there
    there = client.scene.nodes["/stage"].position
    stage.follow(None)
    stage.move_to(0.0)
    assert client.scene.nodes["/stage"].position == there, "nothing jumps when it is let go"


@given(
    st.lists(st.floats(0.01, 0.15), min_size=1, max_size=4),
    st.sampled_from([0.6, 1.5, 2.4]),
    st.sampled_from([(0.0, 0.0, 1.0, 1.0), (0.0, 0.1, 0.6, 0.7), (0.5, 0.2, 1.0, 1.0)]),
)
def test_everything_is_seen(spans: list[float], aspect: float, clear: tuple[float, float, float, float]) -> None:
    client = Client()
    client.camera.aspect = aspect
    stage = Stage(client, clear)
    stage.show([Actor(wandering(span), "", False) for span in spans])
    stage.frame_all()
    eye, target = client.camera.position, client.camera.look_at
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    half = math.tan(client.camera.fov / 2)
    seen = []
    for frame in range(12):
        stage.move_to(frame / 30)
        balls = client.scene.ending("balls")[0].batched_positions - eye
        depth = balls @ forward
        assert (depth > 1.0).all()
        across, down = balls @ right / (aspect * half * depth), -(balls @ np.cross(right, forward)) / (half * depth)
        seen.append((np.stack([across, down], axis=1) + 1) / 2)  # from the top left corner
    places = np.concatenate(seen)
    assert (places >= np.array(clear[:2]) - 1e-4).all()
    assert (places <= np.array(clear[2:]) + 1e-4).all()
    assert (np.ptp(places, axis=0) > 0.5 * np.subtract(clear[2:], clear[:2])).any(), "and not from further than that"


def test_to_see_everything_who_is_followed_is_met_again() -> None:
    client, stage = on_stage(walking(), wandering(1.0))
    stage.follow(1)
    client.camera.look_at = (40.0, 0.0, 0.0)
    stage.frame_all()
    here = client.scene.ending("label")[1].position + np.array(client.scene.nodes["/stage"].position)
    np.testing.assert_allclose(here[::2], client.camera.look_at[::2], atol=1e-6)


# -- the stage as a whole


def test_a_stage_can_be_empty() -> None:
    client, stage = on_stage(walking(), walking())
    stage.follow(1)
    stage.show([])
    stage.move_to(0.3)
    stage.frame_all()
    stage.draw_path(np.ones((2, 2)))
    assert not client.scene.ending("limbs")
    assert not client.scene.ending("label")


@pytest.mark.parametrize("clip", [one_joint(np.zeros((1, 3))), one_joint(np.eye(3)), standing(1)])
def test_clips_of_almost_nothing_can_be_shown(clip: Motion) -> None:
    client, stage = on_stage(clip, clip)
    stage.move_to(1.0)
    stage.frame_all()
    assert np.isfinite(client.scene.ending("balls")[0].batched_positions).all()
    assert np.isfinite(client.camera.position).all()


def test_what_is_hidden_stays_hidden_and_what_is_drawn_stays_drawn_when_others_come() -> None:
    client, stage = on_stage(walking())
    assert stage.paths
    assert stage.contacts
    stage.paths = stage.contacts = False
    stage.draw_path(np.array([[0.0, 0.0], [1.0, 1.0]]))
    stage.move_to(0.4)
    stage.show([Actor(walking(), "one", False), Actor(walking(), "two", False)])
    assert not any(node.visible for node in client.scene.ending("way") + client.scene.ending("feet"))
    assert "/stage/path" in client.scene.nodes
    assert client.scene.ending("label")[0].position[2] > 0.1, "the moment stays, too"
    stage.paths = stage.contacts = True
    assert all(node.visible for node in client.scene.ending("way") + client.scene.ending("feet"))
    assert len(client.scene.ending("way")) == 2


@pytest.fixture
def restless() -> Iterator[None]:
    """Threads take turns after every few instructions."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


@pytest.mark.usefixtures("restless")
def test_one_thread_moves_while_another_changes_the_actors() -> None:
    client, stage = on_stage(walking())
    done = threading.Event()
    errors: list[BaseException] = []

    def play() -> None:
        step = 0
        try:
            while not done.is_set():
                stage.move_to(step / 60 % 1.0)
                step += 1
        except BaseException as error:
            errors.append(error)

    player = threading.Thread(target=play)
    player.start()
    for count in (1, 3, 0, 2) * 4:
        stage.show([Actor(walking(), str(i), False) for i in range(count)])
        stage.draw_path(np.array([[0.0, 1.0], [2.0, 3.0]]))
        stage.follow(count - 1)
    done.set()
    player.join()
    assert errors == []
    assert len(client.scene.ending("label")) == 2
