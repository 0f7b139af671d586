"""Where to compute."""

from __future__ import annotations

from typing import TYPE_CHECKING

from motiongen.errors import MotionGenError

if TYPE_CHECKING:
    import torch


def torch_device(name: str) -> torch.device:
    """The torch device of that name.

    Raises:
        MotionGenError: if torch has no such device here.
    """
    import torch

    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise MotionGenError(f"device '{name}' cannot be used: {reason}; use cpu") from error
    return device
