"""Options of GenMM. The defaults are the paper's (section 4, Implementation Details)."""

from __future__ import annotations

from dataclasses import dataclass

from motiongen.generators.options import Options, option


@dataclass(frozen=True)
class GenMMOptions(Options):
    """How GenMM works; Table 4 of the paper measures what alpha, K, p and r do."""

    alpha: float | None = option(
        0.01,
        "Completeness (Eq. 2): smaller shows more of the example; 0 is unstable; null drops the normalisation, which "
        "loses rare moves. The coarsest stage takes a tenth of the examples' variance where that is less.",
        minimum=0.0,
    )
    patch_size: int = option(
        11,
        "Frames in a patch at the working rate (p): larger is more coherent and less varied, smaller the reverse.",
        minimum=2,
    )
    coarse_patches: float = option(
        4.0,
        "Length of the coarsest example in patches (K): larger gives more varied, less coherent motion; small repeats "
        "the example.",
        minimum=1.0,
    )
    scale_factor: float = option(
        4 / 3,
        "Step between pyramid stages (r): larger is faster and less stable (Table 4: 2 is nearly as good, 8 is not).",
        minimum=1.02,
    )
    iterations: int = option(
        5, "Rounds of matching and blending a stage (E): fewer is faster and leaves more blur.", minimum=1
    )
    noise: float = option(
        1.0,
        "Deviation of the first random guess, in the example's own deviations; 0 starts from its mean.",
        minimum=0.0,
    )
    root_rotation_weight: float = option(
        2.5,
        "How much the root's rotation counts beside another joint's; it turns the whole body. At 1 the synthesis now "
        "and then spins round in one frame, large values make everything else follow the root.",
        minimum=0.0,
    )
    root_motion_weight: float = option(
        30.0,
        "How much a root step or height difference of one skeleton height counts beside a rotation; 30 makes steps "
        "velocities in heights per second.",
        minimum=0.0,
    )
    contact_weight: float = option(
        0.0,
        "How much a foot-contact label counts beside a joint's rotation (section 3.1). Labels come along at 0, too; "
        "above, motions stray further from the example and feet slide no less.",
        minimum=0.0,
    )
    standing_feet: str = option(
        "still",
        "What inverse kinematics of the legs makes of feet that stand: still keeps them where they are; example lets "
        "them slide as the example's do; free leaves them as they come. Fixed joints and keys stay exact.",
        choices=("still", "example", "free"),
    )
    working_rate: float = option(
        30.0, "Rate in Hz at which patches are matched; the nearest whole fraction of the clip's own rate.", above=0.0
    )
    output_rate: float | None = option(None, "Frame rate in Hz of the result; null keeps the examples'.", above=0.0)
    search: str = option(
        "auto",
        "exact compares all patches of the examples with every place; approximate only those near the ones that the "
        "stage before chose, once a stage has over a million pairs of frames; auto does so from 134 million on.",
        choices=("auto", "exact", "approximate"),
    )
    memory_mb: int = option(
        1024,
        "Memory in MiB that matching may take beside the clips and the result: the less, the slower, and no other "
        "difference.",
        minimum=4,
    )
    device: str = option("cpu", "Where to compute: cpu, or a torch device such as cuda.")
