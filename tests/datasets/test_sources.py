"""Reading folders and archives: everything in them is handed out, and nothing that an archive says is trusted."""

from __future__ import annotations

import gzip
import io
import lzma
import tarfile
import zipfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motiongen.datasets import sources
from motiongen.datasets.sources import ARCHIVES, Item, walk
from motiongen.errors import MotionGenError

FILES = {"a.bvh": b"first", "b/c d.BVH": b"second" * 50_000, "b/notes.txt": b"text", "none": b""}
EVIL = ("../../outside.bvh", "/absolute.bvh", "..\\windows.bvh", "new\nline\x1b[31m.bvh", "con:.bvh", "a/../../b.bvh")


def items_of(*paths: Path) -> list[Item]:
    return list(walk(paths, lambda share: None))


def write_tar(path: Path, files: dict[str, bytes], *extra: tarfile.TarInfo) -> Path:
    mode = {".gz": "w:gz", ".tgz": "w:gz", ".bz2": "w:bz2", ".xz": "w:xz", ".txz": "w:xz"}.get(path.suffix, "w")
    with tarfile.open(path, mode) as tar:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            tar.addfile(info, io.BytesIO(content))
        for info in extra:
            tar.addfile(info)
    return path


def write_zip(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def write_archive(path: Path, files: dict[str, bytes]) -> Path:
    return write_zip(path, files) if path.suffix == ".zip" else write_tar(path, files)


def summary(items: list[Item]) -> list[tuple[str, str, bytes | None]]:
    """What motions there are, with what is in them, and what else."""
    return sorted(
        (each.name, each.suffix, each.content.read_bytes() if isinstance(each.content, Path) else each.content)
        for each in items
        if each.is_motion
    )


@pytest.mark.parametrize("suffix", ARCHIVES)
def test_an_archive_holds_what_the_folder_holds(suffix: str, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    for name, content in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    archive = write_archive(tmp_path / f"clips{suffix}", FILES)
    before = sorted(tmp_path.rglob("*"))
    expected = [("a", ".bvh", FILES["a.bvh"]), ("b/c d", ".bvh", FILES["b/c d.BVH"])]
    assert summary(items_of(folder)) == summary(items_of(archive)) == expected
    others = [[each.name for each in items_of(place) if not each.is_motion] for place in (folder, archive)]
    assert sorted(others[0]) == sorted(others[1]) == ["b/notes", "none"]
    assert sorted(tmp_path.rglob("*")) == before


def test_progress_goes_from_none_to_nearly_all(tmp_path: Path) -> None:
    many = {f"{i:03}.bvh": bytes(50_000) for i in range(100)}
    archives = [write_archive(tmp_path / f"clips{suffix}", many) for suffix in (".tar", ".2.tar")]
    shares: list[float] = []
    assert len(list(walk(archives, shares.append))) == 200
    assert shares == sorted(shares)
    assert 0 <= shares[0] < 0.3
    assert 0.9 < shares[-1] <= 1


@pytest.mark.parametrize("suffix", [".tar.gz", ".zip"])
def test_evil_names_are_labels_and_nothing_more(suffix: str, tmp_path: Path) -> None:
    archive = write_archive(tmp_path / f"clips{suffix}", dict.fromkeys(EVIL, b"x"))
    names = [item.name for item in items_of(archive)]
    assert len(names) == len(EVIL)
    assert all(name.isprintable() for name in names)
    assert [path.name for path in tmp_path.iterdir()] == [archive.name]


def test_links_and_devices_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "secret.bvh").write_text("secret")
    extra = []
    for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE):
        info = tarfile.TarInfo(f"{kind.decode()}.bvh")
        info.type, info.linkname = kind, str(tmp_path / "secret.bvh")
        extra.append(info)
    items = items_of(write_tar(tmp_path / "clips.tar", {}, *extra))
    assert len(items) == 4
    assert all(item.content is None and "link" in str(item.problem) for item in items)


def test_folders_reached_by_links_are_not_searched(tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "loop").symlink_to(tmp_path / "clips")
    (tmp_path / "clips" / "a.bvh").write_text("a")
    assert [item.name for item in items_of(tmp_path / "clips")] == ["a"]


@pytest.mark.parametrize("suffix", [".tar.xz", ".zip", ""])
def test_clips_that_are_too_large_are_told_and_left(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "MOST_CLIP_BYTES", 1000)
    files = {"large.bvh": bytes(1001), "right.bvh": bytes(1000)}
    if suffix:
        source = write_archive(tmp_path / f"clips{suffix}", files)
    else:
        source = tmp_path / "clips"
        source.mkdir()
        for name, content in files.items():
            (source / name).write_bytes(content)
    large, right = items_of(source)
    assert (large.content, right.problem) == (None, None)
    assert "1,001 bytes, where 1,000 are allowed" in str(large.problem)


@pytest.mark.parametrize("suffix", [".tar.xz", ".tar.gz", ".zip"])
def test_a_bomb_is_refused(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bomb = write_archive(tmp_path / f"bomb{suffix}", {f"{i}.bvh": bytes(1 << 22) for i in range(8)})
    assert bomb.stat().st_size < 100_000
    monkeypatch.setattr(sources, "MOST_ARCHIVE_BYTES", (1 << 24) + (1 << 23))
    with pytest.raises(MotionGenError, match="unpacks to more"):
        items_of(bomb)


def test_a_header_without_end_is_refused(tmp_path: Path) -> None:
    """A name of 100 MB, as an extended header may hold, is not read into memory."""
    info = tarfile.TarInfo("x" * 100)
    info.type, info.size = tarfile.XHDTYPE, 100 << 20
    path = tmp_path / "bomb.tar.gz"
    with gzip.open(path, "wb") as file:
        file.write(info.tobuf())
        for _ in range(100):
            file.write(bytes(1 << 20))
    with pytest.raises(MotionGenError, match="unpacks to more"):
        items_of(path)


@pytest.mark.parametrize("suffix", [".tar", ".zip"])
def test_too_many_members_are_refused(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "MOST_MEMBERS", 3)
    assert len(items_of(write_archive(tmp_path / f"few{suffix}", {f"{i}.bvh": b"" for i in range(3)}))) == 3
    with pytest.raises(MotionGenError, match="more than 3 members"):
        items_of(write_archive(tmp_path / f"many{suffix}", {f"{i}.bvh": b"" for i in range(4)}))


def test_an_xz_file_that_asks_for_much_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = write_archive(tmp_path / "clips.tar.xz", FILES)
    monkeypatch.setattr(sources, "MOST_XZ_MEMORY", 1 << 20)
    with pytest.raises(MotionGenError, match="the archive is damaged"):
        items_of(archive)


@pytest.mark.parametrize("suffix", ARCHIVES)
def test_damaged_archives_are_refused_in_one_line(suffix: str, tmp_path: Path) -> None:
    whole = write_archive(tmp_path / f"whole{suffix}", {f"{i}.bvh": bytes(range(256)) * 40 for i in range(9)})
    content = whole.read_bytes()
    for i, damaged in enumerate((content[: len(content) // 2], b"no archive at all" * 99, b"")):
        path = tmp_path / f"damaged{i}{suffix}"
        path.write_bytes(damaged)
        with pytest.raises(MotionGenError) as caught:
            items_of(path)
        assert f"damaged{i}{suffix}" in str(caught.value)


def test_a_damaged_member_of_a_zip_archive_costs_that_member(tmp_path: Path) -> None:
    archive = tmp_path / "clips.zip"
    with zipfile.ZipFile(archive, "w") as opened:
        for name in ("a.bvh", "b.bvh"):
            opened.writestr(name, b"numbers of " + name.encode())
    content = archive.read_bytes()
    archive.write_bytes(content.replace(b"numbers of a", b"numbers 0f a"))
    damaged, right = items_of(archive)
    assert "damaged" in str(damaged.problem)
    assert right.content == b"numbers of b.bvh"


@pytest.mark.parametrize(("name", "words"), [("gone", "no such file"), ("file.rar", "neither a folder nor an archive")])
def test_what_is_no_source_is_refused_at_once(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "file.rar").touch()
    with pytest.raises(MotionGenError, match=words):
        walk([tmp_path, tmp_path / name], lambda share: None)


@given(st.lists(st.binary(max_size=3000), min_size=1, max_size=3), st.integers(1, 5000), st.integers(0, 2))
def test_xz_streams_are_read_as_the_library_reads_them(parts: list[bytes], size: int, padding: int) -> None:
    content = b"".join(lzma.compress(part) + bytes(4 * padding) for part in parts)
    stream = sources._Xz(io.BytesIO(content))
    blocks = list(iter(lambda: stream.read(size), b""))
    assert max(map(len, blocks), default=0) <= size
    assert b"".join(blocks) == b"".join(parts)
    if padding == 0:  # where the library stops reading
        assert lzma.decompress(content) == b"".join(parts)
