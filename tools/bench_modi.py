"""How long MoDi's networks take to train: `python -m tools.bench_modi [--device cuda] [--threads 2]`.

One iteration is what training repeats: a step of the discriminator, a step of the generator, R1 every 16 iterations and
path length every 4, on half the batch, with Adam, for a biped of 20 joints and two contacts at the paper's sizes and
batch. Random numbers stand in for motions and there is no loss on contacts, which costs little. Printed as Markdown:
the time of each part, and of an iteration with the lazy parts spread over those without them. On a processor, seconds
of processor time stand beside, which other programs disturb less.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from motiongen.generators.modi.hierarchy import Hierarchy, build_hierarchy
from motiongen.generators.modi.networks import Discriminator, ModiGenerator
from motiongen.generators.modi.options import NetworkOptions
from motiongen.report import markdown_table
from motiongen.skeleton import Skeleton

R1_EVERY, PATH_EVERY = 16, 4

LEG, ARM = ("UpLeg", "Leg", "Foot"), ("Shoulder", "Arm", "ForeArm", "Hand")
CHAINS = [("Hips", ["Spine", "Spine1", "Spine2"]), ("Spine2", ["Neck", "Head"])]
for side in ("Left", "Right"):
    CHAINS += [("Hips", [side + bone for bone in LEG]), ("Spine2", [side + bone for bone in ARM])]


def biped() -> tuple[Skeleton, tuple[int, int]]:
    """A biped of 20 joints, and its feet."""
    names, parents = ["Hips"], [-1]
    for above, chain in CHAINS:
        parents += [names.index(above), *range(len(names), len(names) + len(chain) - 1)]
        names += chain
    skeleton = Skeleton(tuple(names), tuple(parents), np.ones((len(names), 3)))
    return skeleton, (skeleton.index("LeftFoot"), skeleton.index("RightFoot"))


class Training:
    """The networks, their optimisers and the steps of training."""

    def __init__(self, hierarchy: Hierarchy, options: NetworkOptions, batch: int, device: str) -> None:
        """Draw the weights and random motions."""
        self.options, self.batch, self.device = options, batch, device
        self.generator = ModiGenerator(hierarchy, options).to(device)
        self.discriminator = Discriminator(hierarchy, options).to(device)
        self.optimisers = [
            torch.optim.Adam(network.parameters(), lr=0.002, betas=(0.0, 0.99), fused=True)
            for network in (self.generator, self.discriminator)
        ]
        self.real = torch.randn(batch, options.frames, hierarchy.entities[-1], options.features, device=device)
        self.mean_length = torch.zeros((), device=device)

    def noise(self, batch: int) -> list[Tensor]:
        """Two z for each motion, to mix."""
        return [torch.randn(batch, self.options.latent_size, device=self.device) for _ in range(2)]

    def _step(self, of: int, loss: Tensor) -> None:
        self.optimisers[of].zero_grad(set_to_none=True)
        loss.backward(inputs=self.optimisers[of].param_groups[0]["params"])
        self.optimisers[of].step()

    def discriminator_step(self) -> None:
        """Eq. 3."""
        with torch.no_grad():
            fake = self.generator(self.noise(self.batch), mixing_index=5)
        loss = functional.softplus(self.discriminator(fake)).mean()
        self._step(1, loss + functional.softplus(-self.discriminator(self.real)).mean())

    def generator_step(self) -> None:
        """Eq. 2."""
        fake = self.generator(self.noise(self.batch), mixing_index=5)
        self._step(0, functional.softplus(-self.discriminator(fake)).mean())

    def r1(self) -> None:
        """Eq. 7."""
        real = self.real.detach().requires_grad_()
        (gradient,) = torch.autograd.grad(self.discriminator(real).sum(), real, create_graph=True)
        self._step(1, gradient.square().sum(dim=(1, 2, 3)).mean())

    def path_length(self) -> None:
        """Eq. 6."""
        codes = self.generator.codes(self.noise(self.batch // 2), mixing_index=5)
        motion = self.generator.synthesis(codes)
        way = torch.randn_like(motion) / (motion.shape[1] * motion.shape[2]) ** 0.5
        (gradient,) = torch.autograd.grad((motion * way).sum(), codes, create_graph=True)
        lengths = gradient.square().sum(dim=2).mean(dim=1).sqrt()
        self.mean_length = torch.lerp(self.mean_length, lengths.mean().detach(), 0.01)
        self._step(0, (lengths - self.mean_length).square().mean())


def measure(part: Callable[[], None], repeats: int, device: str) -> tuple[float, float]:
    """Seconds and processor seconds that `part` takes: the median of `repeats`, after two that do not count."""
    taken = []
    for _ in range(repeats + 2):
        begun, begun_processor = time.perf_counter(), time.process_time()
        part()
        if device != "cpu":
            torch.cuda.synchronize()
        taken.append((time.perf_counter() - begun, time.process_time() - begun_processor))
    seconds, processor = np.median(taken[2:], axis=0)
    return float(seconds), float(processor)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench_modi", description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    options = NetworkOptions(frames=arguments.frames)
    hierarchy = build_hierarchy(*biped(), options)
    training = Training(hierarchy, options, arguments.batch, arguments.device)
    parts = [
        ("discriminator step", training.discriminator_step, 1),
        ("generator step", training.generator_step, 1),
        (f"R1, every {R1_EVERY}", training.r1, R1_EVERY),
        (f"path length, every {PATH_EVERY}", training.path_length, PATH_EVERY),
    ]
    rows, total = [["part", "seconds", "processor seconds", "seconds an iteration"]], np.zeros(2)
    for name, part, every in parts:
        taken = np.array(measure(part, arguments.repeats, arguments.device))
        total += taken / every
        rows.append([name, *(f"{seconds:.4f}" for seconds in (*taken, taken[0] / every))])
    rows.append(["**iteration**", "", f"{total[1]:.4f}", f"**{total[0]:.4f}**"])
    print("\n".join(markdown_table(rows)))
    millions = [sum(p.numel() for p in n.parameters()) / 1e6 for n in (training.generator, training.discriminator)]
    print(f"\nEntities {hierarchy.entities}, {arguments.frames} frames, batch {arguments.batch}, {arguments.device}.")
    print(f"Weights: generator {millions[0]:.2f} M, discriminator {millions[1]:.2f} M. Load: {os.getloadavg()[0]:.1f}.")


if __name__ == "__main__":
    main()
