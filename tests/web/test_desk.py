"""What the parts of a page share: clips, takes, work and messages; and two desks side by side."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

import motiongen as mg
from motiongen.assets import EXAMPLE_CLIP
from motiongen.errors import MotionGenError
from motiongen.web.desk import Desk
from motiongen.web.jobs import JobQueue, State
from motiongen.web.limits import Limits
from motiongen.web.takes_tab import TakesTab, shown
from motiongen.web.wishes import Take
from tests.web.fakes import Client

CLIP = mg.load(EXAMPLE_CLIP)[:5]
PATIENCE_SECONDS = 30.0


@pytest.fixture
def queue() -> Iterator[JobQueue]:
    made = JobQueue(PATIENCE_SECONDS, waiting=2)
    yield made
    made.close()


def opened(queue: JobQueue, **limits: int) -> tuple[Desk, Client]:
    client = Client()
    return Desk(client, queue, Limits(**limits)), client


@pytest.fixture
def desk(queue: JobQueue) -> Desk:
    return opened(queue)[0]


def take(label: str) -> Take:
    return Take(CLIP.replace(name=label), label)


def labels(desk: Desk) -> list[str]:
    return [each.label for each in shown(desk)]


# -- clips


def test_clips_that_are_called_alike_are_told_apart(desk: Desk) -> None:
    for name in ("walk", "walk", "run", "walk", "walk 2"):
        desk.add_clip(CLIP.replace(name=name))
    names = [clip.name for clip in desk.clips]
    assert names == ["walk", "walk 2", "run", "walk 3", "walk 2 2"]
    assert desk.clip is desk.clips[-1], "the newest is worked on"


def test_only_so_many_clips_are_kept(queue: JobQueue) -> None:
    desk, _ = opened(queue, clips=2)
    for _ in range(2):
        desk.add_clip(CLIP)
    with pytest.raises(MotionGenError, match="there are 2 clips already; remove one first"):
        desk.add_clip(CLIP)
    desk.remove_clip()
    desk.add_clip(CLIP)


def test_the_clip_that_is_worked_on_is_removed_and_a_neighbour_takes_its_place(desk: Desk) -> None:
    for name in "abc":
        desk.add_clip(CLIP.replace(name=name))
    desk.choose(1)
    desk.remove_clip()
    assert [clip.name for clip in desk.clips] == ["a", "c"]
    assert desk.clip is desk.clips[0]
    for _ in range(3):
        desk.remove_clip()
    assert (desk.clips, desk.clip) == ([], None)


# -- takes


def test_new_takes_replace_all_but_those_that_were_accepted(desk: Desk) -> None:
    first, second = take("a"), take("b")
    desk.show_takes([first, second])
    desk.accept(second)
    assert [each.accepted for each in desk.takes] == [False, True]
    desk.show_takes([take("c"), take("d")])
    assert [each.label for each in desk.takes] == ["b", "c", "d"]
    assert labels(desk) == ["b ✓", "c", "d"]
    desk.reject(desk.takes[0])
    assert [each.label for each in desk.takes] == ["c", "d"]


def test_rejecting_takes_away_one_even_among_equals(desk: Desk) -> None:
    desk.show_takes([take("a"), take("a"), take("a")])
    _, second, third = desk.takes
    desk.reject(second)
    assert desk.takes[1] is third
    assert len(desk.takes) == 2
    desk.reject(second)
    assert len(desk.takes) == 2, "it is gone already"


def test_a_take_takes_the_place_of_another_unless_that_one_is_kept_or_gone(desk: Desk) -> None:
    a, b = take("a"), take("b")
    desk.show_takes([a, b])
    moved = take("moved")
    desk.swap(a, moved)
    assert desk.takes == [moved, b]
    desk.accept(moved)
    desk.swap(moved, again := take("again"))
    assert [each.label for each in desk.takes] == ["moved", "b", "again"]
    assert desk.takes[0].accepted, "what was accepted stays"
    desk.reject(again)
    desk.swap(again, take("late"))
    assert labels(desk) == ["moved ✓", "b", "late"]
    desk.swap(None, take("new"))
    assert len(desk.takes) == 4


def test_what_stands_on_the_stage_has_names_that_differ(desk: Desk) -> None:
    desk.add_clip(CLIP.replace(name="seed 1"))
    desk.show_takes([take("seed 1"), take("seed 1"), take("seed 1 (2)"), take("seed 1 ✓")])
    desk.accept(desk.takes[0])
    assert len(set(labels(desk))) == 5
    assert labels(desk)[0] == "seed 1", "the clip keeps its name"


def test_the_take_that_is_looked_at_stays_so_when_it_is_accepted(queue: JobQueue) -> None:
    """Accepted ones come first, so it moves; what is downloaded next must be it, all the same."""
    desk, client = opened(queue)
    tab = TakesTab(desk)
    desk.add_clip(CLIP)
    desk.show_takes([take("a"), take("b"), take("c")])
    choice, decide = client.gui["Motion"], client.gui["Decide"]
    assert choice.value == "a", "new ones are looked at first"
    choice.move("c")
    decide.move("Accept")
    assert (choice.options, choice.value, tab.number) == ((CLIP.name, "c ✓", "a", "b"), "c ✓", 1)
    choice.move("b")
    decide.move("Reject")
    assert (choice.value, client.said) == ("a", [])
    desk.show_takes([take("d"), take("e")])
    assert choice.options == (CLIP.name, "c ✓", "d", "e")
    choice.move(CLIP.name)
    decide.move("Reject")
    assert "this is the clip" in client.said[0].body
    decide.move("Reject the rest")
    assert choice.options == (CLIP.name, "c ✓")


def test_everybody_is_told_of_every_change(desk: Desk) -> None:
    seen: list[int] = []
    desk.listen(lambda: seen.append(len(desk.takes)))
    desk.show_takes([a := take("a"), take("b")])
    desk.accept(a)
    desk.reject(desk.takes[0])
    desk.swap(None, take("c"))
    desk.add_clip(CLIP)
    desk.remove_clip()
    assert seen == [2, 2, 1, 2, 2, 2]


# -- messages


def test_a_mistake_is_said_and_no_bug(queue: JobQueue, capsys: pytest.CaptureFixture[str]) -> None:
    desk, client = opened(queue)

    def fail() -> None:
        raise MotionGenError("the clip is empty;\n  give another")

    desk.act(fail)(SimpleNamespace(client_id=1))
    assert [(said.title, said.body, said.colour) for said in client.said] == [
        ("That does not go", "the clip is empty; give another", "red")
    ]
    assert capsys.readouterr().err == ""


def test_a_bug_is_said_to_be_one_and_leaves_a_trace(queue: JobQueue, capsys: pytest.CaptureFixture[str]) -> None:
    desk, client = opened(queue)
    desk.act(lambda: {}["missing"])(SimpleNamespace(client_id=1))
    assert [(said.title, said.body) for said in client.said] == [("motiongen failed", "KeyError: 'missing'")]
    assert "Traceback" in capsys.readouterr().err
    done: list[int] = []
    desk.act(lambda: done.append(1))(SimpleNamespace(client_id=1))
    assert done == [1], "the next click works"


def test_what_the_page_moves_itself_is_no_click(desk: Desk) -> None:
    done: list[str] = []
    act = desk.act(lambda: done.append("done"))
    act(SimpleNamespace(client_id=None))
    assert not done
    act(SimpleNamespace(client_id=3))
    act(SimpleNamespace())  # of events that know no visitor
    assert done == ["done", "done"]


def test_clicks_come_one_at_a_time(desk: Desk) -> None:
    inside, most = [0], [0]

    def work() -> None:
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        threading.Event().wait(0.005)
        inside[0] -= 1

    threads = [threading.Thread(target=desk.act(work), args=(SimpleNamespace(client_id=1),)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_SECONDS)
    assert most == [1]


# -- work


def test_a_result_is_taken_and_the_job_is_gone_from_the_desk(desk: Desk) -> None:
    taken: list[int] = []
    seen: list[int] = []
    job = desk.start("work", lambda progress: 42, lambda result: (taken.append(result), seen.append(len(desk.jobs))))
    assert job.wait(PATIENCE_SECONDS)
    assert (taken, seen, desk.jobs) == ([42], [0], [])


def test_what_fails_in_work_or_with_its_result_is_said(queue: JobQueue, capsys: pytest.CaptureFixture[str]) -> None:
    desk, client = opened(queue)

    def fail(error: Exception) -> None:
        raise error

    jobs = [
        desk.start("mistake", lambda progress: fail(MotionGenError("too short")), print),
        desk.start("bug", lambda progress: fail(KeyError("x")), print),
    ]
    assert all(job.wait(PATIENCE_SECONDS) for job in jobs)
    late = desk.start("result", lambda progress: 1, lambda result: fail(MotionGenError("no room")))
    assert late.wait(PATIENCE_SECONDS)
    assert [said.body for said in client.said] == ["too short", "motiongen failed: KeyError: 'x'", "no room"]
    assert desk.jobs == []
    assert capsys.readouterr().out == "", "nothing came that could be taken"


def test_what_was_cancelled_is_not_taken_and_not_spoken_of(queue: JobQueue) -> None:
    desk, client = opened(queue)
    began, taken = threading.Event(), []

    def work(progress) -> None:
        began.set()
        while True:
            progress(0.5)

    jobs = [desk.start("work", work, taken.append), desk.start("waits", work, taken.append)]
    assert began.wait(PATIENCE_SECONDS)
    desk.act(desk.cancel)(SimpleNamespace(client_id=1))
    assert all(job.wait(PATIENCE_SECONDS) for job in jobs)
    assert {job.state for job in jobs} == {State.CANCELLED}
    assert (taken, client.said, desk.jobs) == ([], [], [])


def test_too_much_work_is_a_message(queue: JobQueue) -> None:
    desk, client = opened(queue)
    hold, began = threading.Event(), threading.Event()

    def work(progress) -> None:
        began.set()
        while not hold.wait(0.001):
            progress(0.0)

    jobs = [desk.start("runs", work, print)]
    assert began.wait(PATIENCE_SECONDS)
    jobs += [desk.start("waits", work, lambda result: None) for _ in range(2)]
    desk.act(lambda: desk.start("too much", work, print))(SimpleNamespace(client_id=1))
    assert "wait already" in client.said[0].body
    assert len(desk.jobs) == 3
    desk.cancel()
    hold.set()
    assert all(job.wait(PATIENCE_SECONDS) for job in jobs)


# -- leaving and coming again


class Part:
    """A part of a page with a number of its own, a choice, and a slider that comes when the choice is made."""

    def __init__(self, desk: Desk, client: Client) -> None:
        self.desk, self.gui, self.number, self.told = desk, client.gui, 0, 0
        desk.keep("choice", lambda: self.choice.value, self.choose)
        desk.keep("number", lambda: self.number, lambda value: setattr(self, "number", value))
        self.choice = self.gui.add_dropdown("Choice", ("none", "slider"))
        self.flag = self.gui.add_checkbox("Flag", False)
        desk.keep_field("flag", self.flag, self.tell)

    def choose(self, value: str) -> None:
        self.choice.value = value
        if value == "slider":
            self.slider = self.gui.add_slider("Slider", 0.0, 1.0, 0.1, 0.0)
            self.desk.keep_field("slider", self.slider)

    def tell(self) -> None:
        self.told += 1


def test_a_page_goes_on_where_another_was_left(queue: JobQueue) -> None:
    desk, client = opened(queue)
    before = Part(desk, client)
    for name in "ab":
        desk.add_clip(CLIP.replace(name=name))
    desk.choose(0)
    desk.show_takes([take("x"), take("y")])
    desk.accept(desk.takes[1])
    before.number, before.flag.value = 7, True
    before.choose("slider")
    before.slider.value = 0.3
    left = desk.leave()

    again, other_client = opened(queue)
    after = Part(again, other_client)
    again.take_up(left)
    assert [each.name for each in again.clips] == ["a", "b"]
    assert again.clip is desk.clip
    assert [(each.label, each.accepted) for each in again.takes] == [("x", False), ("y", True)]
    assert (after.number, after.flag.value, after.told, after.slider.value) == (7, True, 1, 0.3)
    again.add_clip(CLIP)
    assert len(desk.clips) == 2, "they are two desks"


def test_what_comes_late_finds_its_own_and_what_never_comes_is_kept_on(queue: JobQueue) -> None:
    desk, client = opened(queue)
    before = Part(desk, client)
    before.choose("slider")
    before.slider.value = 0.3
    left = desk.leave()
    left.values["choice"] = "none"  # as where the slider waits for something else
    second, client = opened(queue)
    after = Part(second, client)
    second.take_up(left)
    third, client = opened(queue)
    last = Part(third, client)
    third.take_up(second.leave())
    last.choose("slider")
    assert last.slider.value == 0.3
    last.slider.value = 0.5
    last.choose("slider")
    assert last.slider.value == 0.0, "it is given once"
    after.choose("slider")
    assert after.slider.value == 0.3


def test_what_goes_and_comes_is_as_it_was(queue: JobQueue) -> None:
    desk, client = opened(queue)
    part = Part(desk, client)
    part.choose("slider")
    for value in (0.3, 0.7):
        part.slider.value = value
        desk.set_aside("sli")
        part.choose("slider")
        assert part.slider.value == value
    left = desk.leave()

    again, client = opened(queue)
    part = Part(again, client)
    part.choose("slider")  # one of another kind, which goes as soon as the choice is what it was
    choose = part.choose

    def choose_anew(value: str) -> None:
        again.set_aside("slider")
        part.slider.remove()
        choose(value)

    part.choose = choose_anew
    again.keep("choice", lambda: part.choice.value, choose_anew)
    again.take_up(left)
    assert part.slider.value == 0.7
    assert not part.slider.removed


def test_a_value_that_fits_no_more_is_left_out(queue: JobQueue) -> None:
    desk, client = opened(queue)
    Part(desk, client).choose("slider")
    left = desk.leave()
    left.values["slider"], left.values["flag"] = 3.0, "yes"
    again, client = opened(queue)
    part = Part(again, client)
    again.take_up(left)
    assert (part.slider.value, part.flag.value, part.told) == (0.0, False, 0)


def test_work_stops_when_its_visitor_leaves(queue: JobQueue) -> None:
    desk, _ = opened(queue)
    began = threading.Event()

    def work(progress) -> None:
        began.set()
        while True:
            progress(0.5)

    jobs = [desk.start("making 2 motions", work, print), desk.start("waits", work, print)]
    assert began.wait(PATIENCE_SECONDS)
    assert desk.leave().stopped == ["making 2 motions", "waits"]
    assert all(job.wait(PATIENCE_SECONDS) for job in jobs)


# -- two visitors


def test_two_desks_have_nothing_in_common_but_the_queue(queue: JobQueue) -> None:
    (mine, my_page), (yours, your_page) = opened(queue), opened(queue)
    mine.add_clip(CLIP)
    mine.show_takes([take("a")])
    assert (yours.clips, yours.takes) == ([], [])

    def fail(progress) -> None:
        raise MotionGenError("mine")

    assert mine.start("fails", fail, print).wait(PATIENCE_SECONDS)
    assert [said.body for said in my_page.said] == ["mine"]
    assert your_page.said == []
    hold, began = threading.Event(), threading.Event()

    def work(progress) -> str:
        began.set()
        while not hold.wait(0.001):
            progress(0.0)
        return "yours"

    taken: list[str] = []
    job = yours.start("works", work, taken.append)
    assert began.wait(PATIENCE_SECONDS)
    waiting = mine.start("waits", work, taken.append)
    assert mine.ahead(waiting) == 1
    mine.cancel()
    hold.set()
    assert job.wait(PATIENCE_SECONDS)
    assert taken == ["yours"], "who cancels stops only their own"
