"""The numbers of a BVH file: one line a frame, one number a channel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from motiongen.io.bvh.header import LARGEST, Header, number, shown
from motiongen.io.bvh.source import LONGEST_LINE, Source

Array = NDArray[np.float64]

LONGEST_NUMBER = 64
"""Bytes that a number and the blanks around it may take, on average over a line."""


def check_claim(source: Source, header: Header, file_size: int) -> None:
    """Refuse a file that says it holds more frames than could be in it, before memory is taken for them."""
    smallest = 2 * header.columns * header.frames - 1  # a digit and a blank each
    if smallest > file_size:
        raise source.error(
            f"{header.frames:,} frames of {header.columns} numbers cannot be in a file of {file_size:,} bytes; "
            "correct the number behind 'Frames:', or get the file anew if it is cut off",
            header.frame_line,
        )


def read_numbers(source: Source, header: Header) -> Iterator[Array]:
    """The frames in order, some at a time: arrays (n, columns) that come to the number of frames the header says.

    Raises:
        MotionGenError: if a line holds anything but that many finite numbers, or there are fewer or more frames.
    """
    found = 0
    for block in source.blocks(longest_line=LONGEST_LINE + LONGEST_NUMBER * header.columns):
        table = _parse(block, header.columns)
        if table is None:
            table = _parse_slowly(block, header.columns, source)
        found += len(table)
        if found <= header.frames:
            yield table
    if found != header.frames:
        raise source.error(
            f"'Frames: {header.frames}' does not fit the {found} frames that follow; "
            f"write 'Frames: {found}'" + (", or get the file anew if it is cut off" if found < header.frames else ""),
            header.frame_line,
        )


def _parse(block: bytes, columns: int) -> Array | None:
    """Whole lines as an array (n, columns), or None where anything about them is wrong."""
    if not block.strip():
        return np.empty((0, columns))
    try:
        # Of NumPy's ways from text to numbers, and Python's own, this one takes the least time by far.
        table = np.loadtxt(block.decode("ascii").split("\n"), comments=None, ndmin=2)
    except ValueError:
        return None
    inside = table.max() < LARGEST and table.min() > -LARGEST  # false for NaN
    return table if inside and table.shape[1] == columns else None


def _parse_slowly(block: bytes, columns: int, source: Source) -> Array:
    """The same line by line, to find what is wrong and say it."""
    rows: list[list[float]] = []
    for line, text in enumerate(block.split(b"\n"), start=source.line + 1):
        words = text.decode("utf-8", "replace").split()
        values = [number(word) for word in words]
        if None in values:
            word = words[values.index(None)]
            raise source.error(f"'{shown(word)}' is no number that a channel can have; {_cure(word)}", line)
        if len(words) not in (0, columns):
            raise source.error(
                f"this frame has {len(words)} numbers where the channels need {columns}; "
                "correct the line, or get the file anew if it is cut off",
                line,
            )
        if words:
            rows.append([value for value in values if value is not None])
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def _cure(word: str) -> str:
    if "," in word:
        return "write decimal points, not commas, and blanks between numbers"
    return "give a finite number, or remove the frame and correct 'Frames:'"
