"""Files of latent codes: safetensors with what each code is called and whose codes they are."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.model_files import SUFFIX, check_origin, fingerprint, not_one, read_model_file

FORMAT = 1


@dataclass(frozen=True)
class Latents:
    """Codes with names.

    Attributes:
        codes: (N, S) in W, or (N, L, S) in W+.
        names: of each.
    """

    codes: NDArray[np.float32]
    names: tuple[str, ...]


def save_latents(path: str | Path, generator: MoDi, codes: NDArray[Any], names: Sequence[str]) -> None:
    """Write codes to a file that appears when it is complete.

    Args:
        path: ending in .safetensors.
        generator: whose codes they are.
        codes: (N, S) or (N, L, S).
        names: of each of the N.

    Raises:
        MotionGenError: if it cannot be written, or codes and names do not go together.
    """
    from safetensors.numpy import save

    if Path(path).suffix != SUFFIX:
        raise MotionGenError(f"{path}: files of latents end in {SUFFIX}; name it so")
    generator.check_latents(codes)
    if len(names) != len(codes):
        raise MotionGenError(f"{len(codes)} latents need as many names, not {len(names)}")
    notes = {"format": str(FORMAT), "model": fingerprint(generator), "names": json.dumps(list(names))}
    with atomic_write(path) as file:
        file.write(save({"codes": np.ascontiguousarray(codes, dtype=np.float32)}, notes))


def load_latents(path: str | Path, generator: MoDi) -> Latents:
    """Read codes.

    Raises:
        MotionGenError: if it cannot be read, or the codes are another model's.
    """
    what = "file of latents"
    tensors, notes = read_model_file(path, what)
    try:
        codes, names = tensors["codes"], tuple(str(name) for name in json.loads(notes["names"]))
        number, model = int(notes["format"]), notes["model"]
    except (KeyError, TypeError, ValueError) as error:
        raise not_one(path, what, error) from error
    check_origin(path, what, number, FORMAT, model, generator)
    generator.check_latents(codes)
    if len(names) != len(codes):
        raise MotionGenError(f"{path}: {len(codes)} latents with {len(names)} names; the file is damaged")
    return Latents(codes, names)
