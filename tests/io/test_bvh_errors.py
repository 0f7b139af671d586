"""Broken BVH files: one line that names the file, the line and the cure; never another error, never much memory."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from motiongen.errors import MotionGenError
from motiongen.io import load, save
from motiongen.motion import Motion
from tests.conftest import ROOT
from tests.io.bvh_texts import PLAIN, bvh_text, random_joints, random_numbers, walker, write_text

TEXT = """HIERARCHY
ROOT Hips
{
	OFFSET 0 1 0
	CHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation
	JOINT LeftFoot
	{
		OFFSET 0.1 -1 0
		CHANNELS 3 Zrotation Yrotation Xrotation
		End Site
		{
			OFFSET 0 0 0.2
		}
	}
	JOINT Head
	{
		OFFSET 0 0.7 0
		CHANNELS 3 Zrotation Yrotation Xrotation
	}
}
MOTION
Frames: 3
Frame Time: 0.033333
0 0.9 0 1 2 3 4 5 6 7 8 9
0 0.9 1 1 2 3 4 5 6 7 8 9
0 0.9 2 1 2 3 4 5 6 7 8 9
"""
SECOND_FRAME = 25  # its line


def change(old: str, new: str) -> Callable[[str], str]:
    """Put something in place of the first `old`."""

    def changed(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return changed


def number(word: str) -> Callable[[str], str]:
    """Put a word in place of the third number of the second frame."""
    return change("0 0.9 1 ", f"0 0.9 {word} ")


def lines(count: int) -> Callable[[str], str]:
    """Only the first lines."""
    return lambda text: "".join(text.splitlines(keepends=True)[:count])


def deep(text: str) -> str:
    """A chain of 10,001 joints below the hips."""
    chain = "".join(f"JOINT c{n} {{ OFFSET 0 1 0\n" for n in range(10_001))
    return text.replace("\tJOINT Head", chain + "}\n" * 10_001 + "\tJOINT Head")


# What is done to the file, the line that must be named, and what must be said.
BROKEN = {
    "no hierarchy": (change("HIERARCHY", "HELLO"), 1, "'HELLO' begins the file; a BVH file begins with HIERARCHY"),
    "unknown keyword": (change("CHANNELS", "CHANELS"), 5, "'CHANELS' is no keyword; allowed are ROOT,.* CHANNELS"),
    "unknown channel": (change("Xposition", "Wposition"), 5, "'Wposition' is no channel; allowed are Xposition"),
    "a channel twice": (change("Yposition", "Xposition"), 5, "'Hips' has channel Xposition twice; remove one"),
    "too few channels": (change("CHANNELS 3", "CHANNELS 4"), 9, "'4 Zrot.*; give the number of names that follow"),
    "too many channels": (change("CHANNELS 3", "CHANNELS 2"), 9, "'2 Zrot.*; give the number of names that follow"),
    "no number of channels": (change("CHANNELS 3", "CHANNELS"), 9, "'Zrot.*; give the number of names that follow"),
    "channels twice": (change("CHANNELS 3", "CHANNELS 0\nCHANNELS 3"), 10, "'LeftFoot' has a second list of CHANNELS"),
    "no channel at all": (partial(re.sub, "CHANNELS.*", "CHANNELS 0"), 21, "no joint has a channel.*; list CHANNELS"),
    "two roots": (
        change("JOINT Head", "ROOT Head"),
        15,
        "second ROOT 'Head' after 'Hips' of line 2; .* file of its own",
    ),
    "two characters": (change("MOTION", "ROOT Two\n{\nOFFSET 0 0 0\n}\nMOTION"), 21, "second ROOT 'Two' .* of its own"),
    "joint without parent": (change("ROOT", "JOINT"), 2, "JOINT 'Hips' stands in no joint; put it between the braces"),
    "a name twice": (
        change("Head", "LeftFoot"),
        15,
        "'LeftFoot' came in line 6 already; names must differ, rename one",
    ),
    "no name": (change("JOINT Head", "JOINT"), 15, "JOINT has no name; write one"),
    "no offset": (change("OFFSET 0 0.7 0", ""), 19, "'Head' has no OFFSET; give it one of three numbers"),
    "short offset": (change("OFFSET 0.1 ", "OFFSET "), 8, "OFFSET is followed by '-1 0'; give three finite numbers"),
    "long offset": (change("OFFSET 0.1", "OFFSET 7 0.1"), 8, "followed by '7 0.1 -1 0'; give three finite numbers"),
    "offset nan": (change("OFFSET 0.1", "OFFSET nan"), 8, "followed by 'nan -1 0'; give three finite numbers"),
    "offset twice": (change("OFFSET 0.1", "OFFSET 0 0 0\nOFFSET 0.1"), 9, "'LeftFoot' has a second OFFSET; remove one"),
    "offset outside": (change("ROOT", "OFFSET 0 0 0\nROOT"), 2, "OFFSET stands in no joint; put it between"),
    "end site outside": (change("ROOT", "End Site\n{\nROOT"), 2, "End Site stands in no joint; put it between"),
    "joint in end site": (change("OFFSET 0 0 0.2", "JOINT x {"), 12, "JOINT 'x' stands in no joint; put it between"),
    "channels of an end site": (
        change("0.2", "0.2\nCHANNELS 0"),
        13,
        "the End Site is an end site, which has no CHANNELS",
    ),
    "a brace too few": (change("}\nMOTION", "MOTION"), 20, "joint 'Hips' of line 2 is not closed; add the missing '}'"),
    "a brace too many": (change("}\nMOTION", "}\n}\nMOTION"), 21, "'}' closes nothing; remove it"),
    "a brace of nothing": (change("\tJOINT Head", "{\n\tJOINT Head"), 15, "'{' opens nothing; it comes once after"),
    "no brace": (change("Head\n\t{", "Head"), 16, "'OFFSET' comes where joint 'Head' needs its '{'"),
    "too deep": (deep, 10_014, "nested more than 10,000 deep; no character is, so the file is damaged"),
    "cut in the hierarchy": (lines(15), 15, "the file ends here and joint 'Hips' is still open; .* get it anew"),
    "no motion": (lines(20), 20, "the file ends here and there is no MOTION section; .* get it anew"),
    "nothing after motion": (lines(21), 21, "the file ends before 'Frames: N'; .* get it anew"),
    "no joint": (partial(re.sub, "(?s)ROOT.*}\n", ""), 2, "MOTION comes before any joint; .* begins with ROOT"),
    "no number of frames": (change("Frames: 3\n", ""), 22, "'Frame Time: 0.033333' comes where 'Frames: N' is needed"),
    "no frames": (
        change("Frames: 3", "Frames: 0"),
        22,
        "the number of frames is '0'; give a whole number of 1 or more",
    ),
    "half a frame": (change("Frames: 3", "Frames: 2.5"), 22, "the number of frames is '2.5'; give a whole number"),
    "minus three frames": (change("Frames: 3", "Frames: -3"), 22, "the number of frames is '-3'; give a whole number"),
    "many frames": (change("Frames: 3", "Frames: many"), 22, "the number of frames is 'many'; give a whole number"),
    "ten gigabytes": (change("Frames: 3", "Frames: 100000000"), 22, "cannot be in a file of .*; correct the number"),
    "endless frames": (
        change("Frames: 3", "Frames: " + "9" * 5000),
        22,
        "the number of frames is '999.*; give a whole",
    ),
    "no frame time": (
        change("Frame Time: 0.033333\n", ""),
        23,
        "'0 0.9 .* comes where 'Frame Time: SECONDS' is needed",
    ),
    "no time": (change("0.033333", "0.000"), 23, "the frame time is '0.000'; give seconds, from 0.000001 to 3600"),
    "time backwards": (change("0.033333", "-0.03"), 23, "the frame time is '-0.03'; give seconds, from"),
    "years": (change("0.033333", "1e9"), 23, "the frame time is '1e9'; give seconds, from"),
    "time nan": (change("0.033333", "nan"), 23, "the frame time is 'nan'; give seconds, from"),
    "time in words": (change("0.033333", "30 fps"), 23, "the frame time is '30 fps'; give seconds, from"),
    "more said": (change("Frames: 3", "Frames: 5"), 22, "'Frames: 5' does not fit the 3 frames .* write 'Frames: 3'"),
    "fewer said": (change("Frames: 3", "Frames: 2"), 22, "'Frames: 2' does not fit the 3 frames .* write 'Frames: 3'"),
    "nan": (number("nan"), SECOND_FRAME, "'nan' is no number that a channel can have; give a finite number"),
    "infinite": (number("-inf"), SECOND_FRAME, "'-inf' is no number"),
    "overflow": (number("1e999"), SECOND_FRAME, "'1e999' is no number"),
    "a light year": (number("1e18"), SECOND_FRAME, "'1e18' is no number"),
    "a word": (number("abc"), SECOND_FRAME, "'abc' is no number"),
    "digits in groups": (number("1_0"), SECOND_FRAME, "'1_0' is no number"),
    "run together": (number("1.5-2.5"), SECOND_FRAME, "'1.5-2.5' is no number"),
    "control character": (number("\x01"), SECOND_FRAME, r"'\\x01' is no number"),
    "Arabic digits": (number("١٢"), SECOND_FRAME, "is no number"),
    "decimal comma": (number("1,5"), SECOND_FRAME, "'1,5' is no number .*; write decimal points, not commas"),
    "a number too few": (number(""), SECOND_FRAME, "has 11 numbers where the channels need 12; correct the line"),
    "a number too many": (number("1 2"), SECOND_FRAME, "has 13 numbers where the channels need 12; correct the line"),
    "one moved to the next line": (change("8 9\n0 0.9 1", "8\n9 0 0.9 1"), 24, "has 11 numbers where"),
    "cut in a frame": (
        change("0 0.9 2 1 2 3 4 5 6 7 8 9\n", "0 0.9 2 1"),
        26,
        "has 4 numbers where .* if it is cut off",
    ),
    "words behind the frames": (lambda text: text + "the end\n", 27, "'the' is no number"),
}


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("broken", BROKEN)
def test_a_broken_file_costs_one_line_with_place_and_cure(tmp_path: Path, broken: str, newline: str) -> None:
    spoil, line, words = BROKEN[broken]
    path = write_text(tmp_path / "broken.bvh", spoil(TEXT), newline)
    with pytest.raises(MotionGenError) as raised:
        load(path)
    message = str(raised.value)
    assert message.isprintable()  # so it is one line
    assert re.search(rf"^{re.escape(str(path))}:{line}: .*{words}", message), message


def test_the_file_that_is_broken_above_is_fine(tmp_path: Path) -> None:
    assert len(load(write_text(tmp_path / "fine.bvh", TEXT))) == 3


WHOLE_FILES = {
    "empty": (b"", 1, "this file is empty; a BVH file begins with HIERARCHY"),
    "blank": (b" \n\t\n", 2, "no MOTION section"),
    "binary": (TEXT.encode()[:100] + b"\0" * 50, 1, "binary file .*a BVH file is text"),
    "noise": (np.random.default_rng(0).bytes(5000), 1, "binary file"),
    "UTF-16": (b"\xff\xfe" + TEXT.encode("utf-16-le"), 1, "text in UTF-16; save it as UTF-8"),
    "one endless line": (b"x " * 100_000, 1, "this line never ends"),
    "an endless frame": (TEXT.encode() + b"1" * 3_000_000, 27, "more than .* bytes, too many for one frame"),
    "text of another kind": (b"<html>\n<body>", 1, "'<html>' begins the file; a BVH file begins with HIERARCHY"),
}


@pytest.mark.parametrize("kind", WHOLE_FILES)
def test_a_file_of_another_kind_costs_one_line(tmp_path: Path, kind: str) -> None:
    content, line, words = WHOLE_FILES[kind]
    path = tmp_path / "other.bvh"
    path.write_bytes(content)
    with pytest.raises(MotionGenError) as raised:
        load(path)
    message = str(raised.value)
    assert re.fullmatch(rf"{re.escape(str(path))}:.*", message), message  # one line
    assert kind == "empty" or message.startswith(f"{path}:{line}: "), message
    assert re.search(words, message), message


@pytest.mark.parametrize("block", range(90, 120))
def test_the_line_is_named_in_later_blocks_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    """Also where the end of a block falls between the two characters of a line end."""
    monkeypatch.setattr("motiongen.io.bvh.source.BLOCK", block)
    text = TEXT.replace("Frames: 3", "Frames: 54") + "0 0.9 3 1 2 3 4 5 6 7 8 9\n" * 50 + "0 oops\n"
    with pytest.raises(MotionGenError, match=r"broken\.bvh:77: 'oops'"):
        load(write_text(tmp_path / "broken.bvh", text, "\r\n"))


def test_memory_is_not_taken_for_joints_without_channels(tmp_path: Path) -> None:
    """A file of little text must not ask for gigabytes."""
    still = "".join(f"JOINT j{n} {{ OFFSET 0 1 0 }}\n" for n in range(3000))
    text = f"HIERARCHY\nROOT r {{ OFFSET 0 0 0 CHANNELS 1 Xrotation\n{still}}}\nMOTION\nFrames: 40000\nFrame Time: 1\n"
    path = write_text(tmp_path / "wide.bvh", text + "0\n" * 40_000)
    with pytest.raises(MotionGenError, match=r"need 3.8 GB.*remove those joints"):
        load(path)


@pytest.mark.parametrize("name", ["a\nb", "a{b", " a", "a\t", "", "\0", "\ud800", "x" * 5000])
def test_names_that_would_not_come_back_are_not_written(tmp_path: Path, name: str) -> None:
    motion = load(write_text(tmp_path / "in.bvh", TEXT))
    names = (*motion.skeleton.names[:-1], name)
    skeleton = type(motion.skeleton)(names, motion.skeleton.parents, motion.skeleton.offsets)
    with pytest.raises(MotionGenError, match="cannot be written to a BVH file; rename it"):
        save(motion.replace(skeleton=skeleton), tmp_path / "out.bvh")
    assert not (tmp_path / "out.bvh").exists()


def test_rates_and_lengths_that_would_not_come_back_are_not_written(tmp_path: Path) -> None:
    motion = load(write_text(tmp_path / "in.bvh", TEXT))
    for changed, words in (
        (motion.replace(frame_rate=1e7), "rates from .* to 1e.06 Hz, not 1e.07; resample"),
        (motion.replace(frame_rate=1e-7), "resample"),
        (motion.scale(1e12), "lengths of 1e.12 and more .*; scale"),
    ):
        with pytest.raises(MotionGenError, match=words):
            save(changed, tmp_path / "out.bvh")
        assert not (tmp_path / "out.bvh").exists()


# -- damage at random

CASES = 200
WORDS = (
    "nan -inf 1e999 1e-320 - . , { } ROOT JOINT End Site OFFSET CHANNELS MOTION Frames: 0 6 7 -1 99999999999 Xrotation"
)


def damaged(rng: np.random.Generator, text: bytes) -> bytes:
    """One or two random changes: bytes, words or lines lost, doubled, swapped or put in, or other digits."""
    for _ in range(int(rng.integers(1, 3))):
        start, stop = sorted(rng.integers(0, len(text) + 1, size=2))
        near = min(stop, start + int(rng.integers(1, 40)))
        rows, words = text.split(b"\n"), WORDS.encode().split()
        n, m = rng.integers(0, len(rows), size=2)
        kind = int(rng.integers(0, 14))
        if kind == 0:
            text = text[:start] + text[near:]
        elif kind == 1:
            text = text[:start] + rng.bytes(int(rng.integers(1, 6))) + text[near:]
        elif kind == 2:
            text = text[:stop]
        elif kind == 3:
            text = text[:start] + text[start:near] * 3 + text[near:]
        elif kind == 4:
            text = text[:start] + b" " + words[int(rng.integers(len(words)))] + b" " + text[start:]
        elif kind == 5:
            rows[n], rows[m] = rows[m], rows[n]
            text = b"\n".join(rows)
        elif kind == 6:
            text = b"\n".join(rows[:n] + rows[n + 1 :])
        elif kind == 7:
            text = b"\n".join([*rows[:n], rows[m], *rows[n:]])
        elif kind > 8:
            digit = b"%d" % rng.integers(0, 10)
            text = text[:start] + re.sub(rb"\d", digit, text[start:], count=1)
        else:  # a word of a line, most often of the hierarchy
            line = rows[int(min(n, m) * rng.uniform())].split()
            if line:
                line[int(rng.integers(len(line)))] = words[int(rng.integers(len(words)))]
            rows[min(n, m)] = b" ".join(line)
            text = b"\n".join(rows)
    return text


def few_frames(path: Path, frames: int = 6) -> bytes:
    """The beginning of a real file."""
    rows = path.read_bytes().split(b"\n")
    start = next(i for i, row in enumerate(rows) if row.startswith(b"Frame Time"))
    rows[start - 1] = b"Frames: %d" % frames
    return b"\n".join(rows[: start + 1 + frames]) + b"\n"


def fuzzed_files() -> list[bytes]:
    rng = np.random.default_rng(1)
    joints = random_joints(rng, 8, 1.0, "joint{}")
    texts = [walker().encode(), bvh_text(joints, random_numbers(rng, joints, 4, 1.0), style=PLAIN).encode()]
    shared = ROOT.parent / "shared" / "data"
    return texts + [few_frames(path) for path in sorted(shared.glob("*/*.bvh"))]


def load_or_message(path: Path) -> Motion | str:
    try:
        return load(path)
    except MotionGenError as error:
        return str(error)


def test_damaged_files_give_a_motion_or_one_line(tmp_path: Path) -> None:
    """Real files, where there are any, and made ones, damaged hundreds of times: no other error, no memory, no end."""
    rng = np.random.default_rng(20)
    path, target = tmp_path / "damaged.bvh", tmp_path / "out.bvh"
    texts = fuzzed_files()
    motions = 0
    tracemalloc.start()
    for case in range(CASES):
        path.write_bytes(damaged(rng, texts[case % len(texts)]))
        tracemalloc.reset_peak()
        came = load_or_message(path)
        if isinstance(came, Motion):
            motions += 1
            save(came, target)  # what can be read can be written
            assert len(load(target)) == len(came), case
        else:
            assert re.fullmatch(rf"{re.escape(str(path))}:.*", came), case  # one line that begins with the file
        assert tracemalloc.get_traced_memory()[1] < 50e6, case
    tracemalloc.stop()
    assert 30 < motions < CASES - 30  # the damage is neither too much nor too little to say anything
