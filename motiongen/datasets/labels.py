"""What file names tell: labels by a pattern, and which part of a dataset a clip belongs to."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath

from motiongen.errors import MotionGenError

TRAINING, HELD_BACK = "training", "held_back"

SPLITS = (TRAINING, HELD_BACK)
"""The parts of a dataset."""

_FIELD = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True)
class LabelPattern:
    """A pattern such as `walks_{content}_{style}_{number}` that takes labels out of clips' names.

    Each field takes the shortest text that lets the whole fit, at least one character. A pattern without slashes is
    compared with a file's name without its folders and suffix; one with slashes, with as many folders more.

    Raises:
        MotionGenError: if there is no field, or a field's name is no identifier or comes twice.
    """

    text: str

    def __post_init__(self) -> None:
        """Check the fields."""
        if not self.fields:
            raise MotionGenError(f"the label pattern '{self.text}' has no field; write one as {{name}}")
        for name in self.fields:
            if not name.isidentifier() or self.fields.count(name) > 1:
                raise MotionGenError(
                    f"'{{{name}}}' in the label pattern '{self.text}' must be a name of letters, digits and "
                    "underscores that comes once"
                )

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the labels."""
        return tuple(_FIELD.findall(self.text))

    @cached_property
    def _expression(self) -> re.Pattern[str]:
        parts = _FIELD.split(self.text)  # text, field, text, ...
        return re.compile("".join(f"(?P<{p}>[^/]+?)" if i % 2 else re.escape(p) for i, p in enumerate(parts)))

    def labels_of(self, name: str) -> dict[str, str]:
        """The labels in a clip's name; none where the pattern does not fit."""
        parts = PurePosixPath(name).parts[-1 - self.text.count("/") :]
        found = self._expression.fullmatch("/".join(parts))
        return found.groupdict() if found else {}


def split_of(name: str, held_back: float) -> str:
    """The part a clip belongs to, told by its name alone: adding clips or changing their order moves none.

    Names are told apart without their folders, so that the clips of an archive and of the folder it was unpacked to are
    split alike.

    Args:
        name: the clip's name.
        held_back: the share of all clips to hold back from training, 0 to 1; it holds for many clips, not for few.
    """
    digest = hashlib.sha256(PurePosixPath(name).name.encode("utf-8", "surrogateescape")).digest()
    return HELD_BACK if int.from_bytes(digest[:8], "big") < held_back * 2.0**64 else TRAINING
