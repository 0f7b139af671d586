"""Fields of a page that are built from an options dataclass, whoever wrote it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import pytest

from motiongen.errors import MotionGenError
from motiongen.generators.options import Options, offered, option
from motiongen.generators.registry import specs
from motiongen.web.fields import OptionFields, spoken
from tests.web.fakes import Gui


@dataclass(frozen=True)
class PluginOptions(Options):
    """One option of every kind that a dataclass can declare."""

    plain: int = 3
    flag: bool = option(True, "A box to tick.")
    count: int = option(8, "How many.", minimum=2, maximum=64)
    tiny: float = option(1e-5, "A small number.", above=0.0)
    third: float = option(4 / 3, "No short number.", minimum=0.5, maximum=2.0)
    whole: float = option(3, "A whole number that is a float.")
    word: str = option("soft", "One of few.", choices=("hard", "soft"))
    free: str = option("any text", "Any text.")
    empty: str = option("", "Text that may be empty.")
    rate: float | None = option(None, "A number or nothing.", above=0.0)
    some: float | None = option(0.25, "A number that may be taken away.")
    seed: int | None = option(None, "A whole number or nothing.")
    choice: str | None = option(None, "A word or nothing.", choices=("left", "right"))
    name: str | None = option("x", "Text or nothing.")
    maybe: bool | None = option(None, "Yes, no, or nothing said.")
    sizes: tuple = option((256, 0.5, "a"), "Things in brackets.")
    pairs: tuple = option(((0, 1), (2, 3)), "Brackets in brackets.")
    none_of: tuple | None = option(None, "Things in brackets, or nothing.")
    either: int | str = option(3, "A number or a word.")
    checkpoint: str | None = option(None, "A file.", file=True)


def built(kind: type[Options] = PluginOptions) -> tuple[Gui, OptionFields]:
    gui = Gui()
    return gui, OptionFields(gui, kind)


def with_field(name: str, value: Any) -> Options:
    """The options that come of one field that holds something else."""
    gui, made = built()
    gui[spoken(name)].move(value)
    return made.options()


def kinds() -> dict[str, type[Options]]:
    return {"plug-in": PluginOptions} | {name: spec.options_type() for name, spec in specs().items() if not spec.error}


@pytest.mark.parametrize("kind", kinds().values(), ids=kinds())
def test_fields_that_nobody_touches_are_the_defaults(kind: type[Options]) -> None:
    gui, made = built(kind)
    assert made.options() == kind()
    assert [handle.label for handle in gui.handles] == [spoken(each.name) for each in offered(kind)]


@pytest.mark.parametrize("kind", kinds().values(), ids=kinds())
def test_every_option_has_a_field_but_those_that_name_a_file(kind: type[Options]) -> None:
    gui, _ = built(kind)
    files = {spoken(field.name) for field in fields(kind) if field.metadata.get("file")}
    assert {handle.label for handle in gui.handles} == {spoken(field.name) for field in fields(kind)} - files
    assert kind is not PluginOptions or files == {"Checkpoint"}


@pytest.mark.parametrize("kind", kinds().values(), ids=kinds())
def test_bounds_choices_and_help_are_those_of_the_option(kind: type[Options]) -> None:
    gui, _ = built(kind)
    for each in offered(kind):
        handle = gui[spoken(each.name)]
        if each.types in (("int",), ("float",)):
            assert (handle.kind, handle.min, handle.max) == ("number", each.minimum, each.maximum)
            assert {type(bound) for bound in (handle.min, handle.max, handle.value)} <= {type(handle.value), type(None)}
        elif each.types == ("bool",):
            assert handle.kind == "checkbox"
        elif each.choices is not None and "null" not in each.types:
            assert (handle.kind, tuple(handle.options)) == ("dropdown", each.choices)
        else:
            assert handle.kind == "text"
        first = " ".join((each.help or "").split()[:3])
        assert first in (handle.hint or "")
        assert ("Empty: null." in (handle.hint or "")) == ("null" in each.types)


@pytest.mark.parametrize(
    ("name", "value", "meant"),
    [
        ("flag", False, False),
        ("count", 64, 64),
        ("tiny", 0.5, 0.5),
        ("whole", 4, 4.0),
        ("word", "hard", "hard"),
        ("free", "", ""),
        ("free", " kept as it is ", " kept as it is "),
        ("free", "[1, 2]", "[1, 2]"),
        ("rate", "30", 30.0),
        ("rate", " 1e1 ", 10.0),
        ("some", "", None),
        ("some", "  ", None),
        ("seed", "7", 7),
        ("choice", "left", "left"),
        ("choice", "", None),
        ("name", "", None),
        ("name", "3", "3"),
        ("maybe", "true", True),
        ("maybe", "false", False),
        ("sizes", "[1, 2.5, \"b\"]", (1, 2.5, "b")),
        ("sizes", "[]", ()),
        ("none_of", "[3]", (3,)),
        ("none_of", "", None),
    ],
)  # fmt: skip
def test_what_is_put_into_a_field_is_what_the_option_becomes(name: str, value: Any, meant: Any) -> None:
    made = with_field(name, value)
    assert (getattr(made, name), type(getattr(made, name))) == (meant, type(meant))
    assert {each.name for each in fields(made) if getattr(made, each.name) != getattr(PluginOptions(), each.name)} == (
        {name} if meant != getattr(PluginOptions(), name) else set()
    )


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("count", 1, "count must be at least 2, not 1"),
        ("count", 65, "count must be at most 64, not 65"),
        ("tiny", 0.0, "tiny must be more than 0, not 0"),
        ("rate", "0", "rate must be more than 0"),
        ("rate", "fast", "rate must be a number or nothing, not 'fast'"),
        ("rate", "3 0", "rate must be a number or nothing"),
        ("rate", "[1]", "rate must be of type"),
        ("rate", "NaN", "finite"),
        ("rate", "1e999", "finite"),
        ("seed", "7.5", "seed must be of type"),
        ("seed", "true", "seed must be of type"),
        ("choice", "up", "choice must be one of left, right, not 'up'"),
        ("sizes", "", "sizes is empty; give numbers in brackets"),
        ("sizes", "1, 2", "sizes must be numbers in brackets"),
        ("sizes", "7", "sizes must be of type"),
        ("sizes", "{}", "sizes must be of type"),
        ("maybe", "perhaps", "maybe must be"),
        ("either", "", "either is empty"),
        ("seed", "[" * 100_000, "seed must be"),
        ("seed", "9" * 5000, "seed must be"),
        ("seed", "a\nb", "seed must be"),
    ],
)
def test_what_an_option_cannot_be_costs_one_line(name: str, value: Any, words: str) -> None:
    with pytest.raises(MotionGenError) as caught:
        with_field(name, value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_fields_go_when_another_generator_is_chosen() -> None:
    gui, made = built()
    made.remove()
    assert all(handle.removed for handle in gui.handles)


def test_names_are_spoken_as_people_write_them() -> None:
    assert [spoken(name) for name in ("patch_size", "alpha", "LeftArm", "_x_", "")] == [
        "Patch size",
        "Alpha",
        "LeftArm",
        "X",
        "",
    ]


def test_long_help_is_cut_at_a_word() -> None:
    @dataclass(frozen=True)
    class Talkative(Options):
        """Says more than a page can show."""

        much: int = option(1, "word " * 200)

    gui, _ = built(Talkative)
    assert len(gui["Much"].hint) < 300
    assert gui["Much"].hint.endswith("word ...")
