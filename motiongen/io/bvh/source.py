"""The lines of a text file, whatever their ends, a block at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from motiongen.errors import MotionGenError

# Small enough that the numbers of a block stay in the processor's cache while they are turned into rotations.
BLOCK = 1 << 19

# No line of a hierarchy is longer, and none but broken files have one of hundreds of megabytes.
LONGEST_LINE = 1 << 16

UTF8_MARK = b"\xef\xbb\xbf"
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


class Source:
    """Hands out a file's lines, one by one or in blocks, and knows where it is when something is wrong.

    Line ends of any kind (LF, CRLF, CR) come out as LF; a byte order mark is dropped. Never more than a block and a
    line are in memory.

    Attributes:
        path: as the user gave it.
        line: the number of lines handed out, which is the number of the latest, counted from 1.
    """

    def __init__(self, file: BinaryIO, path: str | Path) -> None:
        """Start at the beginning of a file opened for reading bytes."""
        self.path = path
        self.line = 0
        self._file = file
        self._text = b""
        self._at = 0
        if not self._fill():
            raise MotionGenError(f"{path}: this file is empty; a BVH file begins with HIERARCHY")
        self._text = self._text.removeprefix(UTF8_MARK)

    def error(self, what: str, line: int | None = None) -> MotionGenError:
        """What to raise when the latest line, or the one of the given number, is wrong."""
        return MotionGenError(f"{self.path}:{max(self.line if line is None else line, 1)}: {what}")

    def next_line(self) -> str | None:
        """The next line without its end, or None after the last.

        Bytes that are no UTF-8 are kept as surrogates, so that writing the text gives them back.
        """
        while (end := self._text.find(b"\n", self._at)) == -1:
            if len(self._text) - self._at > LONGEST_LINE:
                self.line += 1
                raise self.error("this line never ends; a BVH file is text with a joint's data on each line")
            if not self._fill():
                if self._at == len(self._text):
                    return None
                end = len(self._text)
                break
        line = self._text[self._at : end]
        self._at = min(end + 1, len(self._text))
        self.line += 1
        return line.decode("utf-8", "surrogateescape")

    def blocks(self, longest_line: int) -> Iterator[bytes]:
        """The remaining lines in blocks of whole lines, each ending with LF; `line` counts those handed out before.

        Raises:
            MotionGenError: if a line has more than `longest_line` bytes.
        """
        more = True
        while more:
            more = self._fill()
            end = self._text.rfind(b"\n") + 1 if more else len(self._text)
            block, self._text = self._text[self._at : end], self._text[max(end, self._at) :]
            self._at = 0
            if block:
                yield block if block.endswith(b"\n") else block + b"\n"
                self.line += block.count(b"\n")
            if len(self._text) > longest_line:
                raise self.error(
                    f"this line has more than {longest_line:,} bytes, too many for one frame", self.line + 1
                )

    def _fill(self) -> bool:
        """Append another block to the text that is left; False at the end of the file."""
        at_beginning = self._file.tell() == 0
        block = self._file.read(BLOCK)
        if at_beginning and block.startswith(UTF16_MARKS):  # which holds NUL bytes, too
            raise self.error("this is text in UTF-16; save it as UTF-8")
        if block.endswith(b"\r"):
            block += self._file.read(1)  # a CRLF must not be cut in two
        if b"\0" in block:
            raise self.error("this is a binary file (it holds NUL bytes); a BVH file is text")
        if b"\r" in block:
            block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self._text, self._at = self._text[self._at :] + block, 0
        return bool(block)
