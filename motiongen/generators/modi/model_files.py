"""What the files have in common that belong to one model: latents, directions, encoders. None of them can run code."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.files import open_to_read

if TYPE_CHECKING:
    from motiongen.generators.modi.generator import MoDi

SUFFIX = ".safetensors"


def fingerprint(generator: MoDi) -> str:
    """What tells the weights that a file belongs to from others."""
    digest = hashlib.sha256()
    for name, weight in sorted(generator.network.state_dict().items()):
        digest.update(name.encode())
        digest.update(weight.cpu().numpy().tobytes())
    return digest.hexdigest()[:16]


def read_model_file(path: str | Path, what: str) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """The tensors of a file, by name, and its metadata.

    Args:
        path: of a safetensors file.
        what: it is to be, such as `file of latents`.

    Raises:
        MotionGenError: if it cannot be read.
    """
    from safetensors import safe_open

    open_to_read(path).close()
    try:
        with safe_open(path, framework="numpy") as file:
            names = file.keys()
            # Copies, for torch warns of arrays that cannot be written to.
            return {name: np.array(file.get_tensor(name)) for name in names}, dict(file.metadata() or {})
    except Exception as error:  # the reader of safetensors raises exceptions of many kinds
        raise not_one(path, what, error) from error


def not_one(path: str | Path, what: str, error: Exception) -> MotionGenError:
    """What to raise for a file that is not what it should be."""
    return MotionGenError(f"{path}: this is no {what} ({error}); take one that motiongen wrote")


def check_origin(path: str | Path, what: str, number: int, newest: int, model: str, generator: MoDi) -> None:
    """Refuse a file of a later version or of another model.

    Args:
        path: of the file.
        what: it is, such as `file of latents`.
        number: of its format.
        newest: format that can be read.
        model: fingerprint of the model that it belongs to.
        generator: that it is to be used with.

    Raises:
        MotionGenError: if it is either.
    """
    if number > newest:
        raise MotionGenError(
            f"{path}: a {what} in format {number}; this version reads up to {newest}; update motiongen"
        )
    if model != fingerprint(generator):
        raise MotionGenError(f"{path}: a {what} of another model; take the checkpoint that it was made with")
