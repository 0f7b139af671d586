"""How much one visitor of the page, and all of them together, may ask of the machine."""

from __future__ import annotations

from dataclasses import dataclass, fields

from motiongen.errors import MotionGenError

MEBIBYTE = 2**20


@dataclass(frozen=True)
class Limits:
    """What is refused beyond.

    Attributes:
        upload_bytes: size of a file that comes, in bytes.
        frames: frames of a clip that comes, and of all motions together that one request makes.
        joints: joints of a clip that comes.
        seconds: running time of one job.
        visitors: pages that are open at the same time.
        clips: clips that are kept for one visitor.
        waiting: jobs of one visitor that wait.

    Raises:
        MotionGenError: if a limit is not above zero, so that nothing at all would be let through.
    """

    upload_bytes: int = 32 * MEBIBYTE
    frames: int = 20_000
    joints: int = 500
    seconds: float = 300.0
    visitors: int = 8
    clips: int = 16
    waiting: int = 4

    def __post_init__(self) -> None:
        """Refuse limits that let nothing through."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:  # written so that NaN is refused too
                raise MotionGenError(f"the limit on {field.name} is {value}; it must be above zero")
