"""The hierarchy of a BVH file, and how many frames it says follow."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from motiongen.errors import MotionGenError
from motiongen.io.bvh.layout import CHANNELS, NUMBER, rate_of
from motiongen.io.bvh.source import Source

DEEPEST = 10_000
"""How deep joints may be nested: far deeper than any character, and safe to work through."""

LARGEST = 1e12
"""Numbers beyond this, either way, are damage: a light year is 1e18 cm."""

KEYWORDS = ("root", "joint", "end", "offset", "channels", "motion")
BLANKS = " \t\v\f"
_SPELLING = {channel.lower(): channel for channel in CHANNELS}
_WORD = re.compile(r"[{}]|[^\s{}]+")
_END_SITE = re.compile(r"end(\s*site)?(?![^\s{}])", re.IGNORECASE)
_FRAMES = re.compile(r"frames\s*:?\s*(.*)", re.IGNORECASE)
_FRAME_TIME = re.compile(r"frame\s*time\s*:?\s*(.*)", re.IGNORECASE)


@dataclass
class Node:
    """A joint or end site as the file describes it.

    Attributes:
        name: may be empty for an end site.
        parent: index of the parent joint, -1 for the root.
        line: where it begins.
        offset: None until it has come.
        channels: in order; None until they have come.
        first_column: where its channels begin among the numbers of a frame.
        children_before: how many child joints its parent had before it.
        children: how many child joints it has.
        tip: whether it is an end site.
    """

    name: str
    parent: int
    line: int
    offset: tuple[float, float, float] | None = None
    channels: tuple[str, ...] | None = None
    first_column: int = 0
    children_before: int = 0
    children: int = 0
    tip: bool = False


@dataclass
class Header:
    """Everything before the numbers.

    Attributes:
        joints: in file order, parents before children.
        end_sites: in file order.
        columns: how many numbers a frame has.
        frames: how many frames the file says it has.
        frame_time: seconds, as spelled.
        frame_line: the line that says how many frames there are.
    """

    joints: list[Node] = field(default_factory=list)
    end_sites: list[Node] = field(default_factory=list)
    columns: int = 0
    frames: int = 0
    frame_time: str = ""
    frame_line: int = 0


def read_header(source: Source) -> Header:
    """Read up to and with the frame time.

    Raises:
        MotionGenError: if this is no BVH file, or a broken one; the message names the line.
    """
    return _Parser(source).parse()


def shown(text: str, longest: int = 60) -> str:
    """Text from a file in a form that any terminal prints, shortened."""
    text = text if len(text) <= longest else text[: longest - 3] + "..."
    return "".join(c if c.isprintable() else f"\\x{ord(c) & 0xFF:02x}" for c in text)


def number(text: str) -> float | None:
    """The number that `text` spells, or None where it spells none or one that no file should hold."""
    value = float(text) if NUMBER.fullmatch(text) else float("inf")
    return value if abs(value) < LARGEST else None


class _Parser:
    """Walks over the words of the hierarchy with a stack of open braces."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.header = Header()
        self.rest = ""  # of the current line
        self.open: list[Node] = []  # joints and end sites whose brace is open
        self.unopened: Node | None = None  # the one whose brace comes next
        self.indices: dict[str, int] = {}  # joints by name

    def parse(self) -> Header:
        word = self.word()
        if word.lower() != "hierarchy":
            raise self.error(f"'{shown(word)}' begins the file; a BVH file begins with HIERARCHY")
        while (word := self.word()).lower() != "motion":
            self.step(word)
        if self.unopened or self.open:
            node = self.unopened or self.open[-1]
            raise self.error(
                f"MOTION comes while {_called(node)} of line {node.line} is not closed; add the missing '}}'"
            )
        if not self.header.joints:
            raise self.error("MOTION comes before any joint; a hierarchy begins with ROOT and a name")
        if not self.header.columns:
            raise self.error("no joint has a channel, so there is no motion; list CHANNELS for the joints that move")
        self.frames()
        return self.header

    # -- words

    def error(self, what: str) -> MotionGenError:
        return self.source.error(what)

    def word(self) -> str:
        """The next word or brace, on this line or a later one."""
        while not (found := _WORD.search(self.rest)):
            line = self.source.next_line()
            if line is None:
                where = f"{_called(self.open[-1])} is still open" if self.open else "there is no MOTION section"
                raise self.error(f"the file ends here and {where}; it seems to be cut off, get it anew")
            self.rest = line
        self.rest = self.rest[found.end() :]
        return found.group()

    def words_while(self, belongs: Callable[[str], object]) -> list[str]:
        """The words that follow on this line, up to the first that does not belong to them."""
        words: list[str] = []
        while (found := _WORD.search(self.rest)) and belongs(found.group()):
            words.append(found.group())
            self.rest = self.rest[found.end() :]
        return words

    def name(self) -> str:
        """What follows on this line, up to an opening brace."""
        name, brace, rest = self.rest.partition("{")
        self.rest = brace + rest
        return name.strip(BLANKS)

    # -- hierarchy

    def step(self, word: str) -> None:
        """Take in one word and what belongs to it."""
        keyword = word.lower()
        if self.unopened and word != "{":
            raise self.error(f"'{shown(word)}' comes where {_called(self.unopened)} needs its '{{'")
        if word == "{":
            self.enter()
        elif word == "}":
            self.leave()
        elif keyword in ("root", "joint"):
            self.joint(keyword)
        elif found := _END_SITE.match(word + self.rest):
            self.rest = (word + self.rest)[found.end() :]
            self.end_site()
        elif keyword == "offset":
            self.offset()
        elif keyword == "channels":
            self.channels()
        else:
            raise self.error(
                f"'{shown(word)}' is no keyword; allowed are ROOT, JOINT, End Site, OFFSET, CHANNELS, MOTION"
            )

    def enter(self) -> None:
        if self.unopened is None:
            raise self.error("'{' opens nothing; it comes once after each ROOT, JOINT and End Site")
        if len(self.open) == DEEPEST:
            raise self.error(f"joints are nested more than {DEEPEST:,} deep; no character is, so the file is damaged")
        self.open.append(self.unopened)
        self.unopened = None

    def leave(self) -> None:
        if not self.open:
            raise self.error("'}' closes nothing; remove it, or the one too many before it")
        node = self.open.pop()
        if node.offset is None:
            raise self.error(f"{_called(node)} has no OFFSET; give it one of three numbers")

    def joint(self, keyword: str) -> None:
        name = self.name()
        parent = self.open[-1] if self.open else None
        if keyword == "root" and self.header.joints:
            root = self.header.joints[0]
            raise self.error(
                f"a second ROOT '{shown(name)}' after '{shown(root.name)}' of line {root.line}; "
                "a file holds one character, put the other into a file of its own"
            )
        if keyword == "joint" and (parent is None or parent.tip):
            raise self.error(f"JOINT '{shown(name)}' stands in no joint; put it between the braces of its parent")
        if not name:
            raise self.error(f"{keyword.upper()} has no name; write one behind it")
        if name in self.indices:
            first = self.header.joints[self.indices[name]].line
            raise self.error(f"joint '{shown(name)}' came in line {first} already; names must differ, rename one")
        self.indices[name] = len(self.header.joints)
        self.unopened = Node(name, self.indices[parent.name] if parent else -1, self.source.line)
        self.header.joints.append(self.unopened)
        if parent:
            parent.children += 1

    def end_site(self) -> None:
        name = self.name()
        if not self.open or self.open[-1].tip:
            raise self.error("End Site stands in no joint; put it between the braces of the joint it ends")
        parent = self.open[-1]
        node = Node(name, self.indices[parent.name], self.source.line, children_before=parent.children, tip=True)
        self.unopened = node
        self.header.end_sites.append(node)

    def offset(self) -> None:
        came = self.rest
        values = [value for value in map(number, self.words_while(NUMBER.fullmatch)) if value is not None]
        if len(values) != 3:
            raise self.error(
                f"OFFSET is followed by '{shown(came.strip())}'; give three finite numbers, for x, y and z"
            )
        node = self.node("OFFSET")
        if node.offset is not None:
            raise self.error(f"{_called(node)} has a second OFFSET; remove one of them")
        node.offset = (values[0], values[1], values[2])

    def channels(self) -> None:
        node = self.node("CHANNELS")
        came = self.rest
        count = self.words_while(str.isdecimal)
        words = self.words_while(lambda word: word not in ("{", "}") and word.lower() not in KEYWORDS)
        if node.tip or node.channels is not None:
            what = "is an end site, which has no" if node.tip else "has a second list of"
            raise self.error(f"{_called(node)} {what} CHANNELS; remove it")
        if unknown := [word for word in words if word.lower() not in _SPELLING]:
            raise self.error(f"'{shown(unknown[0])}' is no channel; allowed are {', '.join(CHANNELS)}")
        listed = tuple(_SPELLING[word.lower()] for word in words)
        if twice := [channel for channel in listed if listed.count(channel) > 1]:
            raise self.error(f"{_called(node)} has channel {twice[0]} twice; remove one of them")
        if count != [str(len(listed))]:
            raise self.error(
                f"CHANNELS is followed by '{shown(came.strip())}'; give the number of names that follow, 0 to 6"
            )
        node.channels, node.first_column = listed, self.header.columns
        self.header.columns += len(listed)

    def node(self, keyword: str) -> Node:
        """The joint or end site that a line belongs to."""
        if not self.open:
            raise self.error(f"{keyword} stands in no joint; put it between the braces of one")
        return self.open[-1]

    # -- the beginning of the motion section

    def frames(self) -> None:
        header = self.header
        count = self.line_like(_FRAMES, "Frames: N")
        if not re.fullmatch(r"0*[1-9]\d{0,14}", count, re.ASCII):
            raise self.error(f"the number of frames is '{shown(count)}'; give a whole number of 1 or more")
        header.frames, header.frame_line = int(count), self.source.line
        header.frame_time = self.line_like(_FRAME_TIME, "Frame Time: SECONDS")
        try:
            rate_of(header.frame_time)
        except MotionGenError as error:
            raise self.error(shown(str(error), 200)) from None

    def line_like(self, pattern: re.Pattern[str], example: str) -> str:
        """What stands behind the colon of the next line that is not blank."""
        while not self.rest.strip():
            line = self.source.next_line()
            if line is None:
                raise self.error(f"the file ends before '{example}'; it seems to be cut off, get it anew")
            self.rest = line
        line, self.rest = self.rest.strip(), ""
        if not (found := pattern.fullmatch(line)):
            raise self.error(f"'{shown(line)}' comes where '{example}' is needed")
        return found.group(1)


def _called(node: Node) -> str:
    return f"joint '{shown(node.name)}'" if not node.tip else "the End Site"
