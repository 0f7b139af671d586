"""What is let through of messages and files, against a model of what would pile up in memory."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import pytest

pytest.importorskip("viser", reason="the page needs the extra 'web'")

import msgspec
import viser._messages as messages
from hypothesis import given
from hypothesis import strategies as st

from motiongen.web.screening import EXPECTED, SMALL_MESSAGE_BYTES, UPLOADS, Uploads, parse
from tests.web.wire import CAMERA

LIMIT = 20_000


def start(transfer: str, size: int, parts: int) -> messages.FileTransferStartUpload:
    return messages.FileTransferStartUpload("button", transfer, "clip.bvh", "", parts, size)


def part(transfer: str, index: int, size: int) -> messages.FileTransferPart:
    return messages.FileTransferPart("button", transfer, index, bytes(size))


# -- files

transfers = st.sampled_from("abcdefgh")
starts = st.builds(start, transfers, st.integers(-1, LIMIT + 1), st.integers(-1, 6))
parts = st.builds(part, transfers, st.integers(-1, 5), st.sampled_from([0, 1, 4096, 5000, LIMIT]))


@given(st.lists(st.one_of(starts, parts), max_size=60))
def test_whatever_is_sent_no_more_is_kept_than_allowed(sent: list[Any]) -> None:
    uploads = Uploads(LIMIT)
    declared: dict[str, tuple[int, int]] = {}  # as viser keeps them, until all parts are there
    kept: dict[str, list[int]] = defaultdict(list)
    for message in sent:
        name = message.transfer_uuid
        if isinstance(message, messages.FileTransferStartUpload):
            if uploads.start(message) is not None:
                continue
            assert name not in declared  # viser would begin it again
            assert 0 <= message.size_bytes <= LIMIT
            assert (message.part_count == 0) == (message.size_bytes == 0)
            if message.part_count:
                declared[name] = message.size_bytes, message.part_count
        elif uploads.takes(message):
            size, count = declared[name]
            assert message.part_index == len(kept[name]) < count
            kept[name].append(len(message.content))
            if len(kept[name]) == count:
                assert sum(kept[name]) == size
                del declared[name], kept[name]
        assert sum(map(sum, kept.values())) <= LIMIT
        assert len(declared) <= UPLOADS
        assert sum(count for _, count in declared.values()) <= LIMIT // 4096 + UPLOADS


def test_lies_one_by_one() -> None:
    uploads = Uploads(LIMIT)
    assert uploads.start(start("a", 5000, 2)) is None
    assert not uploads.takes(part("a", 1, 1))  # not the next
    assert not uploads.takes(part("a", 0, 5001))  # more than there is
    assert uploads.takes(part("a", 0, 4000))
    assert not uploads.takes(part("a", 0, 1))  # once more
    assert not uploads.takes(part("a", 1, 999))  # the last, but not all
    assert uploads.takes(part("a", 1, 1000))
    assert not uploads.takes(part("a", 2, 0))  # after the end
    assert [uploads.start(start(str(i), 1, 1)) is None for i in range(UPLOADS + 2)] == [True] * UPLOADS + [False] * 2


@given(st.lists(st.integers(1, 9000), min_size=1, max_size=30), st.integers(1, 3))
def test_honest_files_come_through_one_after_the_other(sizes: list[int], beside: int) -> None:
    part_bytes = 4096
    uploads = Uploads(9000 * beside)
    for first in range(0, len(sizes), beside):
        together = {str(first + i): size for i, size in enumerate(sizes[first : first + beside])}
        count = {name: -(-size // part_bytes) for name, size in together.items()}
        assert all(uploads.start(start(name, size, count[name])) is None for name, size in together.items())
        for index in range(max(count.values())):  # they take turns
            for name, size in together.items():
                if index < count[name]:
                    assert uploads.takes(part(name, index, min(part_bytes, size - index * part_bytes)))


def test_a_refusal_says_what_is_allowed() -> None:
    uploads = Uploads(2**20)
    assert uploads.start(start("a", 3 * 2**20, 6)) == "It has 3.0 MiB; at most 1 MiB are taken."
    assert uploads.start(start("a", 2**20, 2)) is None
    assert "still on their way" in uploads.start(start("b", 1, 1))


# -- messages


def packed(kind: str, **fields: Any) -> bytes:
    return msgspec.msgpack.encode({"type": kind, **fields})


RAY = {"ray_origin": [0, 1, 2], "ray_direction": [0, 0, 1], "modifier": "shift"}
SAMPLES: dict[str, dict[str, Any]] = {
    "ViewerCameraMessage": CAMERA,
    "GuiUpdateMessage": {"uuid": "a", "updates": {"value": [1, 2.5]}},
    "CommandTriggerMessage": {"uuid": "a"},
    "ScenePointerMessage": {"event_type": "click", "screen_pos": [[0.5, 0.5]], **RAY},
    "SceneNodeClickMessage": {"name": "/a", "instance_index": None, "screen_pos": [0.5, 0.5], "owner": "", **RAY},
    "FileTransferStartUpload": {
        "source_component_uuid": "a",
        "transfer_uuid": "b",
        "filename": "clip.bvh",
        "mime_type": "",
        "part_count": 1,
        "size_bytes": 3,
    },
    "FileTransferPart": {"source_component_uuid": "a", "transfer_uuid": "b", "part_index": 0, "content": b"abc"},
}


@pytest.mark.parametrize("kind", sorted(EXPECTED))
def test_what_the_page_says_is_understood_as_viser_does(kind: str) -> None:
    raw = packed(kind, **SAMPLES[kind])
    assert parse(raw) == messages.Message.deserialize(raw)


@given(st.binary(max_size=200))
def test_bytes_at_random_are_no_message(raw: bytes) -> None:
    assert parse(raw) is None


plain = st.one_of(st.none(), st.booleans(), st.integers(-3, 2**60), st.floats(), st.text(max_size=5), st.just(b""))
values = st.recursive(
    plain,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=6,
)


@given(kind=st.sampled_from(sorted(EXPECTED)), data=st.data())
def test_what_is_let_through_viser_understands(kind: str, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from([*SAMPLES[kind], "other"]))
    raw = packed(kind, **{**SAMPLES[kind], name: data.draw(values)})
    message = parse(raw)
    assert message is None or messages.Message.deserialize(raw) == message


def test_only_parts_of_files_may_be_large() -> None:
    text = "x" * SMALL_MESSAGE_BYTES
    assert parse(packed("GuiUpdateMessage", uuid="a", updates={"value": text[:1000]})) is not None
    assert parse(packed("GuiUpdateMessage", uuid="a", updates={"value": text})) is None
    content = {"source_component_uuid": "a", "transfer_uuid": "b", "part_index": 0, "content": text.encode()}
    assert parse(packed("FileTransferPart", **content)) is not None


@pytest.mark.parametrize(
    "value", [float("nan"), float("inf"), -float("inf"), 1e30, 2**60, [[1.0, float("nan")]], {"a": 1e99}]
)
def test_numbers_are_finite_wherever_they_stand(value: Any) -> None:
    assert parse(packed("GuiUpdateMessage", uuid="a", updates={"value": value})) is None
