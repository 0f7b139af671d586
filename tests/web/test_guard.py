"""What a visitor may say and send, against all that viser would believe."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("viser", reason="the page needs the extra 'web'")

import msgspec
import viser

from motiongen.web import guard, screening
from motiongen.web.limits import Limits
from motiongen.web.server import Server
from tests.web.pages import Page, page, update
from tests.web.wire import CAMERA, Deaf, hear, hear_the_end, say, visitor, wait_until, wait_until_still

PART = 512 * 1024

pytestmark = pytest.mark.usefixtures("forgotten_pages")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with Server(port=0, limits=Limits(upload_bytes=2**20), visit=Page) as server:
        yield server


# -- what a visitor may say


def test_nobody_opens_a_tunnel(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_, **__: asked.append(1))
    monkeypatch.setattr(viser.ViserServer, "disconnect_share_url", lambda *_, **__: asked.append(1))
    with visitor(server) as connection:
        assert hear(connection, "ThemeConfigurationMessage")["show_share_button"] is False
        say(connection, "ShareUrlRequest")
        say(connection, "ShareUrlDisconnect")
        update(connection, page(), "check", True)
        wait_until(lambda: page().heard)
    assert not asked


UNSOUND: dict[str, Any] = {
    "no message": b"\xc1",
    "nothing": b"",
    "text": "text",
    "no map": [1, 2],
    "no type": {"uuid": "x"},
    "odd type": {"type": ["GuiUpdateMessage"]},
    "unknown type": {"type": "Nonsense"},
    "deep": b"\x91" * 50_000,
    "endless": b"\xdd\xff\xff\xff\xff",
    "odd keys": {"type": "GuiUpdateMessage", "uuid": "x", "updates": {}, 3: 4},
    "more fields": {"type": "ViewerCameraMessage", **CAMERA, "camera_cb": 1},
    "fewer fields": {"type": "ViewerCameraMessage", "fov": 1},
    "short vector": {"type": "ViewerCameraMessage", **CAMERA, "position": [0, 0]},
    "no number": {"type": "ViewerCameraMessage", **CAMERA, "position": [0, 0, float("nan")]},
    "infinity": {"type": "ViewerCameraMessage", **CAMERA, "look_at": [0, 0, float("inf")]},
    "far away": {"type": "ViewerCameraMessage", **CAMERA, "look_at": [0, 0, 1e300]},
    "large": {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": "x" * 100_000}},
    "half a click": {
        "type": "ScenePointerMessage",
        "event_type": "click",
        "ray_origin": None,
        "ray_direction": [0, 0, 1],
        "screen_pos": [[0, 0]],
        "modifier": None,
    },
    "everybody's": {"type": "GuiFormDirtyMessage", "uuid": "x"},
    "the server's": {"type": "RunJavascriptMessage", "source": "alert(1)"},
    "no widget": {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1}},
}


def test_unsound_messages_change_nothing(
    server: Server, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with visitor(server) as connection, visitor(server) as bystander:
        wait_until(lambda: len(Page.all) == 2)
        position = page().client.camera.position.tolist()
        for message in UNSOUND.values():
            connection.send(message if isinstance(message, (str, bytes)) else msgspec.msgpack.encode(message))
        for visit in Page.all:
            say(connection, "GuiUpdateMessage", uuid=visit.uuid("text"), updates={"value": "x", "update_cb": []})
            say(connection, "GuiUpdateMessage", uuid=visit.uuid("text"), updates={"props": None})
        text = hear(connection, "GuiTextMessage")["uuid"]
        mine = next(visit for visit in Page.all if visit.uuid("text") == text)
        update(connection, mine, "check", True)
        wait_until(lambda: mine.heard)
        assert mine.heard == [("check", True)]
        assert page().client.camera.position.tolist() == position
        assert mine.widgets["text"].value == "before"
        update(bystander, next(visit for visit in Page.all if visit is not mine), "check", True)
        wait_until(lambda: all(visit.heard for visit in Page.all))
    assert not caplog.records
    assert capfd.readouterr() == ("", "")


def test_nobody_is_listened_to_before_their_page_is_there(server: Server, caplog: pytest.LogCaptureFixture) -> None:
    with visitor(server, greet=False) as connection:
        say(connection, "GuiUpdateMessage", uuid="x", updates={"value": 1})
        say(connection, "CommandTriggerMessage", uuid="x")
        say(connection, "ViewerCameraMessage", **CAMERA)
        update(connection, page(), "check", True)
        wait_until(lambda: page().heard)
    assert not caplog.records


SOUND = [
    ("slider", 0.7, 0.7),
    ("slider", 1, 1.0),
    ("slider", 1.0000000001, 1.0000000001),
    ("steps", 10, 10),
    ("number", -1e6, -1e6),
    ("seed", 2**40, 2**40),
    ("text", "\U0001f600" * 100, "\U0001f600" * 100),
    ("check", True, True),
    ("choice", "b", "b"),
    ("group", "y", "y"),
    ("vector", [1, 2.5, 1e6], (1.0, 2.5, 1e6)),
    ("range", [3, 9], (3, 9)),
    ("button", True, True),
]
WRONG = [
    ("slider", 1.1),
    ("slider", -0.1),
    ("slider", None),
    ("slider", "0.5"),
    ("slider", True),
    ("slider", [0.5]),
    ("steps", 11),
    ("number", float("nan")),
    ("number", float("inf")),
    ("number", {}),
    ("seed", -1),
    ("text", 3),
    ("text", "x" * (screening.TEXT_LETTERS + 1)),
    ("check", 1),
    ("check", "False"),
    ("choice", "c"),
    ("choice", ["a"]),
    ("choice", None),
    ("group", "z"),
    ("vector", [1, 2]),
    ("vector", [0, 0, -2]),
    ("vector", [0, 0, "0"]),
    ("vector", 1),
    ("range", [1, 2, 3]),
    ("range", [1, 11]),
    ("button", "pressed"),
    ("off", True),
    ("upload", "x"),
    ("upload", 3),
]


def test_widgets_are_given_what_the_page_could_send_and_nothing_else(
    server: Server, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with visitor(server) as connection:
        visit = page()
        before = {name: widget.value for name, widget in visit.widgets.items()}
        for name, value in WRONG:
            update(connection, visit, name, value)
        for number, (name, value, _) in enumerate(SOUND, start=1):
            update(connection, visit, name, value)
            wait_until(lambda number=number: len(visit.heard) == number)
        ray = {"ray_origin": [0, 0, 0], "ray_direction": [0, 0, 1], "screen_pos": [[0.5, 0.5]], "modifier": None}
        say(connection, "ScenePointerMessage", event_type="rect-select", **ray)
        say(connection, "ScenePointerMessage", event_type="click", **ray)
        wait_until(lambda: visit.heard[-1][0] == "scene")
        say(connection, "CommandTriggerMessage", uuid=visit.command._impl.uuid)
        wait_until(lambda: visit.heard[-1][0] == "command")
        expected = [(name, value) for name, _, value in SOUND]
        assert visit.heard == [*expected, ("scene", (0.0, 0.0, 1.0)), ("command", None)]
        assert visit.widgets["off"].value == before["off"]
    assert not caplog.records
    assert capfd.readouterr() == ("", "")


def test_whoever_keeps_their_thread_busy_waits_alone(server: Server) -> None:
    clicks = 3 * guard.CALLBACKS_WAITING
    go_on, done = threading.Event(), []
    with visitor(server) as busy:
        visit = page()
        visit.widgets["button"].on_click(lambda _: done.append(go_on.wait(10)))
        callbacks = visit.client.gui._thread_executor
        try:
            for _ in range(clicks):
                update(busy, visit, "button", True)
            wait_until(lambda: callbacks.waiting > guard.CALLBACKS_WAITING)
            with visitor(server) as other:
                wait_until(lambda: len(Page.all) == 2)
                update(other, page(), "check", True)
                wait_until(lambda: page().heard)
            assert callbacks.waiting <= guard.CALLBACKS_WAITING + 2  # one message calls two callbacks
        finally:
            go_on.set()
        wait_until(lambda: len(done) == clicks)


def test_whoever_does_not_read_is_not_listened_to(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MESSAGES_A_SECOND", 1e9)
    clicks, content, sent = 400, os.urandom(2**17), []  # nothing that could be packed
    with Deaf(server) as connection:
        visit = page()

        @visit.widgets["button"].on_click
        def _(_: Any) -> None:
            visit.client.send_file_download(f"{len(sent)}", content)
            sent.append(True)

        for _ in range(clicks):
            update(connection, visit, "button", True)
        unsent = visit.client._websock_connection.get_message_buffer().message_from_id
        wait_until(lambda: len(unsent) > guard.MESSAGES_WAITING)
        wait_until_still(lambda: len(sent))
        assert len(unsent) <= guard.MESSAGES_WAITING + 4 * guard.CALLBACKS_WAITING
        assert len(sent) < clicks


# -- files


def start(connection: Any, visit: Page, size: int, parts: int, name: str = "clip.bvh", transfer: str = "t") -> None:
    say(
        connection,
        "FileTransferStartUpload",
        source_component_uuid=visit.uuid("upload"),
        transfer_uuid=transfer,
        filename=name,
        mime_type="",
        part_count=parts,
        size_bytes=size,
    )


def part(connection: Any, visit: Page, index: int, content: bytes, transfer: str = "t") -> None:
    say(
        connection,
        "FileTransferPart",
        source_component_uuid=visit.uuid("upload"),
        transfer_uuid=transfer,
        part_index=index,
        content=content,
    )


def send_file(connection: Any, visit: Page, content: bytes, transfer: str = "t") -> None:
    """As viser's page does."""
    parts = [content[i : i + PART] for i in range(0, len(content), PART)]
    start(connection, visit, len(content), len(parts), transfer=transfer)
    for index, each in enumerate(parts):
        part(connection, visit, index, each, transfer)


@pytest.mark.parametrize("size", [0, 1, PART, 2 * PART - 1, 2**20])
def test_a_file_arrives_as_it_was_sent(server: Server, size: int) -> None:
    content = bytes(i % 251 for i in range(size))
    with visitor(server) as connection:
        for transfer in ("first", "second"):  # one that has arrived counts no more
            send_file(connection, page(), content, transfer)
            acknowledged = hear(connection, "FileTransferPartAck", lambda message: message["transferred_bytes"] == size)
            assert acknowledged["transfer_uuid"] == transfer
        wait_until(lambda: len(page().heard) == 2)
        assert all(file.content == content and file.name == "clip.bvh" for _, file in page().heard)
        assert page().kept_bytes() == 0


def test_a_part_of_the_page_fits_into_a_message(server: Server) -> None:
    source = Path(viser.__file__).parent / "client" / "src" / "components" / "UploadButton.tsx"
    assert "const chunkSize = 512 * 1024" in source.read_text()
    assert 2 * PART <= guard.MESSAGE_BYTES


def test_a_file_too_large_is_refused_before_it_comes(server: Server) -> None:
    with visitor(server) as connection:
        send_file(connection, page(), bytes(2**20 + 1))
        done = hear(connection, "FileTransferPartAck")
        assert done["transferred_bytes"] == done["total_bytes"] == 2**20 + 1  # else the page would wait for ever
        notice = hear(connection, "NotificationShowMessage")
        assert "at most 1 MiB" in str(notice)
        send_file(connection, page(), b"small")
        wait_until(lambda: page().heard)
        assert page().heard[0][1].content == b"small"
        assert page().kept_bytes() == 0


def test_no_lie_about_files_fills_the_memory(server: Server, capfd: pytest.CaptureFixture[str]) -> None:
    with visitor(server) as connection:
        visit = page()
        start(connection, visit, 10, 2**40)  # parts without end
        start(connection, visit, 0, 3)
        start(connection, visit, 3, 0)
        start(connection, visit, -5, 1)
        start(connection, visit, 2**18, 2, transfer="a")
        part(connection, visit, 0, bytes(2**18 + 1), transfer="a")  # more than declared
        part(connection, visit, 1, b"", transfer="a")  # not the next
        part(connection, visit, 0, b"x", transfer="a")
        part(connection, visit, 0, b"x", transfer="a")  # once more
        part(connection, visit, 1, b"x", transfer="a")  # the last, but not all
        part(connection, visit, 1, b"x", transfer="z")  # never begun
        for number in range(50):  # never ended
            start(connection, visit, 2**18, 1, transfer=f"many {number}", name="x" * 1000)
            part(connection, visit, 0, bytes(2**17), transfer=f"many {number}")
        start(connection, visit, 10, 1, transfer="a")  # begun again
        assert "still on their way" in str(hear(connection, "NotificationShowMessage"))
        update(connection, visit, "check", True)
        wait_until(lambda: visit.heard)
        states = visit.client.gui._current_file_upload_states
        assert len(states) <= screening.UPLOADS
        assert visit.kept_bytes() <= 2**20
        assert visit.heard == [("check", True)]
    wait_until(lambda: not states)
    assert capfd.readouterr() == ("", "")


def test_a_message_too_large_ends_the_connection(server: Server) -> None:
    with visitor(server) as connection:
        page()
        connection.send(bytes(guard.MESSAGE_BYTES + 1))
        assert hear_the_end(connection) == 1009
