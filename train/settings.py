"""How a training goes; the defaults are the paper's (appendix D.2)."""

from __future__ import annotations

from dataclasses import dataclass

from motiongen.generators.options import Options, option


@dataclass(frozen=True)
class TrainerSettings(Options):
    """How MoDi is trained."""

    iterations: int = option(80_000, "Steps of training.", minimum=1)
    batch: int = option(16, "Motions in a step.", minimum=2)
    seed: int = option(0, "Decides the first weights and everything that is drawn.", minimum=0)
    learning_rate: float = option(0.002, "Of Adam.", above=0.0)
    beta2: float = option(0.99, "Of Adam; its first beta is 0.", minimum=0.0, maximum=1.0)
    mixing: float = option(0.9, "Share of steps whose motions are made from two codes each.", minimum=0.0, maximum=1.0)
    r1_weight: float = option(
        10.0, "Of the penalty on the discriminator's slope (Eq. 7); half of it counts, as in StyleGAN2.", minimum=0.0
    )
    r1_every: int = option(16, "Steps from one such penalty to the next, which then counts as many times.", minimum=1)
    path_weight: float = option(2.0, "Of the penalty on uneven path lengths (Eq. 6).", minimum=0.0)
    path_every: int = option(4, "Steps from one such penalty to the next, which then counts as many times.", minimum=1)
    path_memory: float = option(0.01, "How fast the mean path length follows.", above=0.0, maximum=1.0)
    contact_consistency: float = option(1.0, "Weight of Eq. 5.", minimum=0.0)
    contact_encouragement: float = option(0.01, "Weight of Eq. 4.", minimum=0.0)
    mean_half_life: float = option(10_000.0, "Samples after which old weights count half in the running mean.", above=0)
    precision: str = option(
        "float32", "Of the products in the networks; the weights are float32.", choices=("float32", "bfloat16")
    )
    device: str = option("cpu", "Where to compute: cpu, or a torch device such as cuda.")
    log_every: int = option(
        50, "Steps from one line of figures to the next; then the weights are checked, too.", minimum=1
    )
    picture_every: int = option(1000, "Steps from one set of pictures, clips and measurements to the next.", minimum=1)
    checkpoint_every: int = option(500, "Steps from one checkpoint to the next.", minimum=1)
    keep: int = option(3, "Checkpoints to keep, besides the best.", minimum=1)
    measured: int = option(1000, "Motions that are made to measure the distance from real ones.", minimum=50)
    recogniser: str | None = option(None, "Folder of a recogniser to measure FID and KID by; null measures none.")
    evaluate_every: int = option(5000, "Steps from one measurement of FID and KID to the next.", minimum=1)
