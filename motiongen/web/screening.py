"""What a visitor may say: messages of viser that are sound, and that the page itself could have sent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import msgspec
import viser
import viser._messages as messages

from motiongen.web.limits import MEBIBYTE

SMALL_MESSAGE_BYTES = 64 * 1024
"""The largest message that is no part of a file."""
PART_BYTES = 4096
"""Parts of a file smaller than this would cost more than what is in them."""
UPLOADS = 4
"""Files that one visitor may send at the same time."""
TEXT_LETTERS = 10_000
"""The longest text in a field of the page."""
LARGEST_NUMBER = 2.0**53
"""As far as JavaScript can count."""

EXPECTED: dict[str, type[messages.Message]] = {
    kind.__name__: kind
    for kind in (
        messages.ViewerCameraMessage,
        messages.GuiUpdateMessage,
        messages.CommandTriggerMessage,
        messages.ScenePointerMessage,
        messages.SceneNodeClickMessage,
        messages.FileTransferStartUpload,
        messages.FileTransferPart,
    )
}
"""What a visitor may say. The rest of viser's messages is never asked for here (pictures of the scene, what the browser
stores), does harm (tunnels; marks of forms, which go to all visitors), or is the server's to say."""


@dataclass
class Upload:
    """A file on its way: what was declared, how much of it is missing, and which part is next."""

    size: int
    parts: int
    missing: int
    next_part: int = 0


class Uploads:
    """The files that one visitor is sending. What they have declared counts until it is there, or until they leave."""

    def __init__(self, limit: int) -> None:
        """Take at most `limit` bytes at a time."""
        self._limit = limit
        self._uploads: dict[str, Upload] = {}

    def start(self, message: messages.FileTransferStartUpload) -> str | None:
        """Why a file may not come, "" where it would be of no use to say so; None if it may."""
        size, parts = message.size_bytes, message.part_count
        if size > self._limit:
            return f"It has {size / MEBIBYTE:.1f} MiB; at most {self._limit / MEBIBYTE:g} MiB are taken."
        # viser keeps what has come of a file until all has: a second start, or parts without end, would pile up.
        if message.transfer_uuid in self._uploads or not _could_be(size, parts):
            return ""
        if len(self._uploads) >= UPLOADS or sum(upload.size for upload in self._uploads.values()) + size > self._limit:
            return "Other files are still on their way. Wait for them, or load the page again."
        if parts:
            self._uploads[message.transfer_uuid] = Upload(size, parts, missing=size)
        return None

    def takes(self, message: messages.FileTransferPart) -> bool:
        """Whether a part is the next of a file, and no larger than what is missing."""
        upload = self._uploads.get(message.transfer_uuid)
        if upload is None or message.part_index != upload.next_part:
            return False
        missing = upload.missing - len(message.content)
        last = message.part_index == upload.parts - 1
        if missing < 0 or (last and missing > 0):
            return False
        upload.missing, upload.next_part = missing, upload.next_part + 1
        if last:
            del self._uploads[message.transfer_uuid]
        return True


def parse(raw: Any) -> messages.Message | None:
    """The message of some bytes, None if it is none that is expected, or not as it should be."""
    if not isinstance(raw, bytes):
        return None
    try:
        fields = msgspec.msgpack.decode(raw)
        kind = EXPECTED[fields.pop("type")]
        message = msgspec.convert(fields, kind)
        # viser makes the message once more, and stumbles over fields that it does not know.
        if not fields.keys() <= vars(message).keys():
            return None
        if kind is not messages.FileTransferPart and (len(raw) > SMALL_MESSAGE_BYTES or not _finite(fields)):
            return None
        return message
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def fits(widget: Any, value: Any) -> bool:
    """Whether the page could have sent a value for a widget, so that callbacks need not doubt what they are given."""
    if getattr(widget, "disabled", False) or isinstance(widget, viser.GuiUploadButtonHandle):
        return False
    options = getattr(widget, "options", None)
    if options is not None:
        return value in options
    if isinstance(widget.value, bool):
        return isinstance(value, bool)
    if isinstance(widget.value, str):
        return isinstance(value, str) and len(value) <= TEXT_LETTERS
    if isinstance(widget.value, tuple):
        numbers = value if isinstance(value, list) and len(value) == len(widget.value) else [None]
    else:
        numbers = [value]
    lowest, highest = (_bounds(getattr(widget, name, None), len(numbers)) for name in ("min", "max"))
    return all(
        isinstance(number, (int, float))
        and not isinstance(number, bool)
        and (low is None or number >= low - _slack(low))
        and (high is None or number <= high + _slack(high))
        for number, low, high in zip(numbers, lowest, highest)
    )


def _bounds(bound: Any, count: int) -> list[float | None]:
    return list(bound) if isinstance(bound, tuple) else [bound] * count


def _slack(bound: float) -> float:
    """JavaScript counts a slider's steps in floating point."""
    return 1e-6 * max(1.0, abs(bound))


def _could_be(size: int, parts: int) -> bool:
    """Whether a file of that size would come in so many parts."""
    return parts == 0 if size == 0 else size > 0 and 0 < parts <= size // PART_BYTES + 1


def _finite(value: Any) -> bool:
    """Whether all numbers within are finite and none is out of this world."""
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, (list, tuple)):
        return all(map(_finite, value))
    return not isinstance(value, (int, float)) or (math.isfinite(value) and abs(value) <= LARGEST_NUMBER)
