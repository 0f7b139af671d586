"""Random numbers by what they are for: a run that was broken off and goes on draws what the unbroken one would have."""

from __future__ import annotations

import zlib

import numpy as np
import torch


def numpy_random(seed: int, iteration: int, purpose: str) -> np.random.Generator:
    """Random numbers of one iteration for one purpose; nothing else changes them."""
    return np.random.default_rng(np.random.SeedSequence((seed, iteration, zlib.crc32(purpose.encode()))))


def torch_random(seed: int, iteration: int, purpose: str) -> torch.Generator:
    """The same for torch, on the processor, so that every device draws the same."""
    return torch.Generator().manual_seed(int(numpy_random(seed, iteration, purpose).integers(2**63)))
