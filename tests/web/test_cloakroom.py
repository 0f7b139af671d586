"""What visitors leave behind is there for them when they come again, once, and for nobody else."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from typing import Any

import pytest

from motiongen.web import cloakroom
from motiongen.web.cloakroom import Cloakroom


def known(value: str | None) -> Any:
    future: Future[str | None] = Future()
    future.set_result(value)
    return future


def test_what_was_left_last_is_given_out_first_and_once() -> None:
    room = Cloakroom(places=4)
    for ticket, value in (("a", "first"), ("b", "theirs"), ("a", "second")):
        room.keep(ticket, known(value))
    assert [room.fetch("a") for _ in range(3)] == ["second", "first", None]
    assert room.fetch("b") == "theirs"
    assert room.fetch("c") is None


def test_who_left_nothing_finds_what_they_left_before() -> None:
    room = Cloakroom(places=4)
    for value in ("first", None, None):
        room.keep("a", known(value))
    assert [room.fetch("a") for _ in range(2)] == ["first", None]


def test_there_are_only_so_many_places() -> None:
    room = Cloakroom(places=2)
    for ticket in "abc":
        room.keep(ticket, known(ticket))
    assert [room.fetch(ticket) for ticket in "abc"] == [None, "b", "c"]


def test_what_is_forgotten_is_gone_and_the_rest_is_not() -> None:
    room = Cloakroom(places=2)
    kept = [known("a"), known("b")]
    for each in kept:
        room.keep("t", each)
    room.forget(kept[1])
    room.forget(kept[1])  # does no harm
    room.keep("t", known("c"))
    assert [room.fetch("t") for _ in range(3)] == ["c", "a", None]


def test_who_comes_again_at_once_waits_for_what_they_leave() -> None:
    room, coming = Cloakroom(places=1), Future()
    room.keep("t", coming)
    threading.Timer(0.05, coming.set_result, ["late"]).start()
    assert room.fetch("t") == "late"


def test_nobody_waits_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cloakroom, "PATIENCE_SECONDS", 0.01)
    room = Cloakroom(places=1)
    room.keep("t", Future())
    assert room.fetch("t") is None
