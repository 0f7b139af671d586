"""The two chunks of a GLB file, and typed arrays in the second one (glTF 2.0, sections 3.6 and 4)."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.files import atomic_write, open_to_read

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
CODES = {dtype: code for code, dtype in COMPONENTS.items()}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TYPES = {width: name for name, width in WIDTHS.items()}

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963


MOST_NUMBERS = 50_000_000
"""That a file may ask for, however small it is: 400 MB."""


class DamageError(ValueError):
    """What a file says of itself does not hold."""


@dataclass
class Container:
    """A document and its binary data, which can be added to.

    Attributes:
        document: the JSON chunk.
        binary: the binary chunk.
        numbers_read: how many numbers accessors have given so far: a small file can name the same ones again and again.
    """

    document: dict[str, Any]
    binary: bytearray
    numbers_read: int = 0

    # -- reading

    def array(self, accessor: int) -> NDArray[np.float64]:
        """(N, width) values of an accessor; integers that stand for fractions become those.

        Raises:
            DamageError: if it does not lie within the data, or is of a kind that is not read.
        """
        spec = self.item("accessors", accessor)
        dtype, width = COMPONENTS.get(spec.get("componentType", 0)), WIDTHS.get(spec.get("type", ""))
        count = spec.get("count")
        if dtype is None or width is None or not isinstance(count, int) or count < 1:
            raise DamageError(f"accessor {accessor} is damaged")
        if "sparse" in spec:
            raise DamageError(f"accessor {accessor} is sparse, which is not read; export without sparse accessors")
        if "bufferView" not in spec:
            self._count(count * width)
            return np.zeros((count, width))
        view = self.item("bufferViews", spec["bufferView"])
        data = self.buffer(view.get("buffer", 0))
        item = np.dtype(dtype).itemsize * width
        stride = view.get("byteStride", item)
        start = view.get("byteOffset", 0) + spec.get("byteOffset", 0)
        if min(stride - item, start) < 0 or start + stride * (count - 1) + item > len(data):
            raise DamageError(f"accessor {accessor} reaches beyond the data")
        self._count(count * width)
        rows: NDArray[Any] = np.ndarray(
            (count, width), dtype, buffer=data, offset=start, strides=(stride, np.dtype(dtype).itemsize)
        )
        values = rows.astype(np.float64)
        if spec.get("normalized") and dtype != "<f4":
            values = np.maximum(values / np.iinfo(np.dtype(dtype)).max, -1.0)
        return values

    def _count(self, numbers: int) -> None:
        self.numbers_read += numbers
        if self.numbers_read > max(MOST_NUMBERS, 4 * len(self.binary)):
            raise DamageError(f"its accessors hold more than {MOST_NUMBERS:,} numbers")

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """One of the document's nodes, accessors and so on.

        Raises:
            DamageError: if there is none.
        """
        items = self.document.get(kind, [])
        if not isinstance(index, int) or not 0 <= index < len(items) or not isinstance(items[index], dict):
            raise DamageError(f"there is no {kind}[{index}]")
        found: dict[str, Any] = items[index]
        return found

    def buffer(self, index: int) -> bytes | bytearray:
        """The data of a buffer: the binary chunk, or what stands in the document.

        Raises:
            DamageError: if it lies elsewhere.
        """
        uri = self.item("buffers", index).get("uri")
        if uri is None and index == 0:
            return self.binary
        if isinstance(uri, str) and uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except binascii.Error as error:
                raise DamageError(f"buffer {index} is no base64: {error}") from error
        raise DamageError(f"buffer {index} lies in another file; export everything into one .glb")

    # -- writing

    def add(self, values: NDArray[Any], dtype: str = "<f4", target: int | None = None, bounds: bool = False) -> int:
        """Append (N,) or (N, width) values; their accessor's index.

        Args:
            values: what to store.
            dtype: one of `COMPONENTS`.
            target: what a graphics card is to take the data for.
            bounds: whether the least and the greatest values are stored with it.
        """
        stored = np.ascontiguousarray(values, dtype=dtype)
        self.binary += b"\0" * (-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": stored.nbytes}
        self.binary += stored.tobytes()
        views = self.document.setdefault("bufferViews", [])
        views.append(view if target is None else {**view, "target": target})
        width = 1 if stored.ndim == 1 else stored.shape[1]
        accessor = {
            "bufferView": len(views) - 1,
            "componentType": CODES[dtype],
            "count": len(stored),
            "type": TYPES[width],
        }
        if bounds:
            rows = stored.reshape(len(stored), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        accessors = self.document.setdefault("accessors", [])
        accessors.append(accessor)
        return len(accessors) - 1

    def save(self, path: Path) -> None:
        """Write the file, which appears complete or not at all."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        buffers = self.document.setdefault("buffers", [{}])
        buffers[0]["byteLength"] = len(self.binary)
        text = json.dumps(self.document, separators=(",", ":"), ensure_ascii=False).encode("utf-8", "replace")
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
        chunks += struct.pack("<II", len(self.binary), BINARY_CHUNK) + self.binary
        with atomic_write(path) as file:
            file.write(struct.pack("<4sII", MAGIC, VERSION, 12 + len(chunks)) + chunks)


def read_container(path: Path) -> Container:
    """The chunks of a file.

    Raises:
        MotionGenError: if it cannot be read or is no GLB file.
    """
    with open_to_read(path) as file:
        content = file.read()
    try:
        return _parsed(content)
    except (DamageError, ValueError, struct.error, RecursionError) as error:
        raise MotionGenError(f"{path}: this is no GLB file that can be read ({error}); export it anew") from error


def _parsed(content: bytes) -> Container:
    if len(content) < 20:
        raise DamageError("it is too short")
    magic, version, length = struct.unpack_from("<4sII", content)
    if magic != MAGIC:
        raise DamageError("it does not begin with 'glTF'")
    if version != VERSION:
        raise DamageError(f"it is of glTF version {version}, not {VERSION}")
    if length > len(content):
        raise DamageError(f"it ends after {len(content)} of {length} bytes")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", content, at)
        if at + 8 + size > length:
            raise DamageError("a chunk reaches beyond the file")
        chunks.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    document = json.loads(chunks.get(JSON_CHUNK, b""))
    if not isinstance(document, dict):
        raise DamageError("its JSON is no object")
    if document.get("extensionsRequired"):
        unknown = sorted(set(document["extensionsRequired"]) - READABLE_EXTENSIONS)
        if unknown:
            raise DamageError(f"it needs the extension {unknown[0]}, which is not read")
    container = Container(document, bytearray(chunks.get(BINARY_CHUNK, b"")))
    if document.get("buffers") and "uri" in container.item("buffers", 0):
        container.binary = bytearray(container.buffer(0))  # what is added comes behind it
        del container.item("buffers", 0)["uri"]
    return container


READABLE_EXTENSIONS = {
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_materials_unlit",
    "KHR_texture_basisu",
    "EXT_texture_webp",
}
"""Extensions that do not change what skeletons and animations mean."""
