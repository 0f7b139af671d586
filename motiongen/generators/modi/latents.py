"""Files of latent codes: safetensors with what each code is called and whose codes they are."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.errors import MotionGenError
from motiongen.files import atomic_write, open_to_read
from motiongen.generators.modi.generator import MoDi

FORMAT = 1

SUFFIX = ".safetensors"


@dataclass(frozen=True)
class Latents:
    """Codes with names.

    Attributes:
        codes: (N, S) in W, or (N, L, S) in W+.
        names: of each.
    """

    codes: NDArray[np.float32]
    names: tuple[str, ...]


def fingerprint(generator: MoDi) -> str:
    """What tells the weights that codes belong to from others."""
    digest = hashlib.sha256()
    for name, weight in sorted(generator.network.state_dict().items()):
        digest.update(name.encode())
        digest.update(weight.cpu().numpy().tobytes())
    return digest.hexdigest()[:16]


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
    from safetensors import safe_open

    open_to_read(path).close()
    try:
        with safe_open(path, framework="numpy") as file:
            codes, notes = file.get_tensor("codes"), file.metadata()
        names = tuple(str(name) for name in json.loads(notes["names"]))
        model, number = notes["model"], int(notes["format"])
    except Exception as error:  # the reader of safetensors raises exceptions of many kinds
        raise MotionGenError(f"{path}: this is no file of latents ({error}); take one that motiongen wrote") from error
    if number > FORMAT:
        raise MotionGenError(f"{path}: latents in format {number}; this version reads up to {FORMAT}; update motiongen")
    if model != fingerprint(generator):
        raise MotionGenError(f"{path}: the latents are another model's; take the checkpoint that they were made with")
    generator.check_latents(codes)
    if len(names) != len(codes):
        raise MotionGenError(f"{path}: {len(codes)} latents with {len(names)} names; the file is damaged")
    return Latents(codes, names)
