"""The files of folders and archives, one after the other, without unpacking anything.

Archives come from anywhere, so nothing that they say is trusted: a member's name is a label and never a path, and how
much may be read of a member and of a whole archive is capped.
"""

from __future__ import annotations

import bz2
import gzip
import io as streams
import lzma
import os
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from motiongen import io
from motiongen.errors import MotionGenError
from motiongen.files import open_to_read

MOST_CLIP_BYTES = 1 << 28
"""No clip may be larger than this: a quarter of a gigabyte, about an hour of a detailed character as text."""

MOST_ARCHIVE_BYTES = 1 << 36
"""No more than this is unpacked of one archive."""

MOST_MEMBERS = 200_000
"""No archive may have more."""

MOST_XZ_MEMORY = 1 << 28
"""An xz file says how much memory unpacking takes, up to gigabytes; the highest usual setting asks for a quarter of
this."""

_MARGIN = 1 << 24  # what the headers before a member may take
_BLOCK = 1 << 20


class _Xz:
    """What an xz file unpacks to, as `lzma.LZMAFile` gives it, but with a limit to the memory that it may ask for."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.stream = lzma.LZMADecompressor(memlimit=MOST_XZ_MEMORY)

    def read(self, size: int) -> bytes:
        """Up to `size` bytes; none at the end."""
        while True:
            if self.stream.eof:  # another one may follow
                rest = self.stream.unused_data.lstrip(b"\0") or self.file.read(_BLOCK).lstrip(b"\0")
                if not rest:
                    return b""
                self.stream = lzma.LZMADecompressor(memlimit=MOST_XZ_MEMORY)
            elif self.stream.needs_input:
                if not (rest := self.file.read(_BLOCK)):
                    raise EOFError("it is cut off")
            else:
                rest = b""
            if block := self.stream.decompress(rest, size):
                return block


_TAR_STREAMS: dict[str, Callable[[BinaryIO], Any]] = {
    ".tar": lambda file: file,
    ".tar.gz": lambda file: gzip.GzipFile(fileobj=file),
    ".tgz": lambda file: gzip.GzipFile(fileobj=file),
    ".tar.bz2": bz2.BZ2File,
    ".tar.xz": _Xz,
    ".txz": _Xz,
}

ARCHIVES = (*_TAR_STREAMS, ".zip")
"""Suffixes of the archives that are read."""

# What Python's readers raise on damaged archives; RuntimeError on encrypted members and unknown compressions.
_DAMAGE = (tarfile.TarError, zipfile.BadZipFile, lzma.LZMAError, zlib.error, EOFError, OSError, ValueError)
_MEMBER_DAMAGE = (*_DAMAGE, RuntimeError)


@dataclass(frozen=True)
class Item:
    """One file of a source: where it lies, or what is in it, or why it cannot be read.

    Attributes:
        name: path within its source without the suffix, with unprintable characters spelled out; a label.
        suffix: in lower case, with its dot.
        content: the file's path, or an archive member's bytes; None where there is a problem.
        problem: why it is not to be read.
    """

    name: str
    suffix: str
    content: Path | bytes | None = None
    problem: str | None = None

    @property
    def is_motion(self) -> bool:
        """Whether the suffix is that of a format of motions."""
        return self.suffix in io.formats()


def walk(sources: Sequence[Path], progress: Callable[[float], None]) -> Iterator[Item]:
    """Every file of every source, in order: a folder's by name, an archive's as they lie there.

    Args:
        sources: folders and archives.
        progress: called with the share of all bytes gone through, 0 to 1.

    Raises:
        MotionGenError: at once if a source is neither; later, if an archive is damaged or larger than allowed.
    """
    sizes = [_size(source) for source in sources]
    return _walk(sources, sizes, progress)


def _walk(sources: Sequence[Path], sizes: Sequence[int], progress: Callable[[float], None]) -> Iterator[Item]:
    total, done = max(sum(sizes), 1), 0
    for source, size in zip(sources, sizes):
        for item, at in _files(source) if source.is_dir() else _members(source):
            progress((done + at) / total)
            yield item
        done += size


def _size(source: Path) -> int:
    if source.is_dir():
        return sum(path.stat().st_size for path in _paths(source))
    open_to_read(source).close()
    if _archive_suffix(source) is None:
        raise MotionGenError(f"{source}: neither a folder nor an archive; allowed are {', '.join(ARCHIVES)}")
    return source.stat().st_size


def _archive_suffix(source: Path) -> str | None:
    return next((suffix for suffix in ARCHIVES if source.name.lower().endswith(suffix)), None)


def _item(label: str, **rest: Any) -> Item:
    path = PurePosixPath(label)
    name = str(path.with_suffix("")) if path.suffix else label
    shown = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in name)
    return Item(shown, path.suffix.lower(), **rest)


# -- folders


def _paths(folder: Path) -> list[Path]:
    """The regular files in a folder and below, sorted by name; links to folders are not followed."""
    found = [Path(at) / name for at, _, names in os.walk(folder) for name in names]
    return sorted(path for path in found if path.is_file())


def _files(folder: Path) -> Iterator[tuple[Item, int]]:
    at = 0
    for path in _paths(folder):
        size = path.stat().st_size
        label = path.relative_to(folder).as_posix()
        yield (_too_large(label, size) if size > MOST_CLIP_BYTES else _item(label, content=path)), at
        at += size


def _too_large(label: str, size: int) -> Item:
    return _item(label, problem=f"it has {size:,} bytes, where {MOST_CLIP_BYTES:,} are allowed")


# -- archives


def _members(archive: Path) -> Iterator[tuple[Item, int]]:
    suffix = _archive_suffix(archive)
    with open_to_read(archive) as file:
        try:
            if suffix == ".zip":
                yield from _zip_members(archive, file)
            else:
                yield from _tar_members(archive, file, _TAR_STREAMS[str(suffix)])
        except _DAMAGE as error:
            if isinstance(error, MotionGenError):
                raise
            raise MotionGenError(f"{archive}: the archive is damaged ({error}); get it anew") from None


class _Capped(streams.RawIOBase):
    """What an archive unpacks to, up to a limit that is raised from member to member."""

    def __init__(self, unpacked: BinaryIO, archive: Path) -> None:
        self.unpacked, self.archive = unpacked, archive
        self.count, self.limit = 0, _MARGIN

    def read(self, size: int = -1) -> bytes:
        block = self.unpacked.read(_BLOCK if size < 0 else min(size, _BLOCK))
        self.count += len(block)
        if self.count > self.limit:
            raise self.too_large()
        return block

    def allow(self, size: int) -> None:
        """Let a member of so many bytes, and the headers of the next, be read."""
        self.limit = self.count + size + _MARGIN
        if self.limit > MOST_ARCHIVE_BYTES:
            raise self.too_large()

    def too_large(self) -> MotionGenError:
        return MotionGenError(f"{self.archive}: it unpacks to more than it should; unpack it yourself, and with care")


def _tar_members(archive: Path, file: BinaryIO, unpack: Callable[[BinaryIO], Any]) -> Iterator[tuple[Item, int]]:
    capped = _Capped(unpack(file), archive)
    # As a stream: any other way tarfile steps back a byte now and then, and an xz file starts from the beginning.
    with tarfile.open(fileobj=capped, mode="r|", bufsize=_BLOCK) as tar:
        for count, info in enumerate(tar):
            if count == MOST_MEMBERS:
                raise _too_many(archive)
            capped.allow(info.size)
            if info.isdir():
                continue
            if not info.isreg():
                item = _item(info.name, problem="it is a link or a device, not a file")
            elif info.size > MOST_CLIP_BYTES:
                item = _too_large(info.name, info.size)
            else:
                item = _item(info.name, content=b"")
                if item.is_motion and (member := tar.extractfile(info)) is not None:
                    item = _item(info.name, content=member.read())
            yield item, file.tell()


def _zip_members(archive: Path, file: BinaryIO) -> Iterator[tuple[Item, int]]:
    read = 0
    with zipfile.ZipFile(file) as opened:
        if len(opened.infolist()) > MOST_MEMBERS:
            raise _too_many(archive)
        for info in opened.infolist():
            if info.is_dir():
                continue
            item = _zip_member(opened, info)
            read += len(item.content) if isinstance(item.content, bytes) else 0
            if read > MOST_ARCHIVE_BYTES:
                raise MotionGenError(f"{archive}: it unpacks to more than {MOST_ARCHIVE_BYTES:,} bytes; take it apart")
            yield item, info.header_offset


def _too_many(archive: Path) -> MotionGenError:
    return MotionGenError(f"{archive}: it has more than {MOST_MEMBERS:,} members; take it apart")


def _zip_member(opened: zipfile.ZipFile, info: zipfile.ZipInfo) -> Item:
    item = _item(info.filename, content=b"")
    if not item.is_motion:
        return item
    try:
        with opened.open(info) as member:
            content = member.read(MOST_CLIP_BYTES + 1)
    except _MEMBER_DAMAGE as error:
        return _item(info.filename, problem=f"the archive's member is damaged or encrypted ({error})")
    if len(content) > MOST_CLIP_BYTES:
        return _too_large(info.filename, info.file_size)
    return _item(info.filename, content=content)
