"""What optimisers remember, as tensors with names that a checkpoint can hold."""

from __future__ import annotations

import torch
from torch import Tensor

Tensors = dict[str, Tensor]


def memory_of(optimiser: torch.optim.Optimizer, prefix: str) -> Tensors:
    """An optimiser's memory: `PREFIX.NUMBER.WHAT` for each of its weights."""
    return {
        f"{prefix}.{number}.{what}": value
        for number, kept in optimiser.state_dict()["state"].items()
        for what, value in kept.items()
    }


def remember(optimiser: torch.optim.Optimizer, tensors: Tensors, prefix: str) -> None:
    """Give an optimiser back what `memory_of` has kept.

    Raises:
        KeyError, RuntimeError, ValueError: if it is another optimiser's.
    """
    memories: dict[int, Tensors] = {}
    for key, value in below(tensors, f"{prefix}.").items():
        number, _, what = key.partition(".")
        memories.setdefault(int(number), {})[what] = value
    optimiser.load_state_dict({**optimiser.state_dict(), "state": memories})


def below(tensors: Tensors, prefix: str) -> Tensors:
    """The tensors whose names begin with a prefix, without it."""
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}
