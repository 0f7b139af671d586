"""Several processes that train one model, as `torchrun` starts them; a single process is a group of one."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, distributed

from motiongen.errors import MotionGenError
from motiongen.generators.devices import torch_device

T = TypeVar("T", Tensor, "list[Tensor]")


@dataclass(frozen=True)
class Workers:
    """This process among all that train.

    Every process draws what the whole batch needs and takes its own share. Gradients are means over the shares, so that
    all processes make the step that one with the whole batch makes.

    Attributes:
        rank: the number of this process; 0 writes files.
        count: how many there are.
        device: where this one computes.
    """

    rank: int
    count: int
    device: torch.device

    @classmethod
    def join(cls, device: str) -> Workers:
        """The group that `torchrun` describes in the environment, or this process alone."""
        count, rank = int(os.environ.get("WORLD_SIZE", "1")), int(os.environ.get("RANK", "0"))
        place = torch_device(device)
        if place.type == "cuda" and place.index is None:
            place = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
            torch.cuda.set_device(place)
        if count > 1 and not distributed.is_initialized():
            distributed.init_process_group("nccl" if place.type == "cuda" else "gloo")
        return cls(rank, count, place)

    @property
    def leads(self) -> bool:
        """Whether this process writes files and speaks."""
        return self.rank == 0

    def share(self, whole: Tensor) -> Tensor:
        """This process's rows of what all have drawn, (B, ...) to (B / count, ...), on its device."""
        size = len(whole) // self.count
        return whole[self.rank * size : (self.rank + 1) * size].to(self.device, non_blocking=True)

    def check(self, batch: int, group: int) -> None:
        """Raise MotionGenError unless a batch can be shared out in whole groups, for it and for half of it."""
        if batch % (2 * self.count) or (self.count > 1 and batch // self.count % group):
            step = math.lcm(2, group) * self.count
            raise MotionGenError(
                f"a batch of {batch} cannot be shared by {self.count} processes; take a multiple of {step}"
            )

    def average(self, gradients: Sequence[Tensor]) -> None:
        """Replace each tensor by its mean over all processes."""
        if self.count == 1:
            return
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        distributed.all_reduce(flat)
        flat /= self.count
        for gradient, mean in zip(gradients, flat.split([gradient.numel() for gradient in gradients])):
            gradient.copy_(mean.view_as(gradient))

    def wait(self) -> None:
        """Until all processes have come here."""
        if self.count > 1:
            distributed.barrier()

    def leave(self) -> None:
        """Leave the group."""
        if self.count > 1 and distributed.is_initialized():
            distributed.destroy_process_group()
