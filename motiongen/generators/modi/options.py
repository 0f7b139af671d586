"""Options of MoDi's networks. The defaults are the paper's (tables 3 and 4, appendix D.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from motiongen.errors import MotionGenError
from motiongen.generators.options import Options, option

ROTATION_FEATURES, POSITION_FEATURES = 4, 3


@dataclass(frozen=True)
class NetworkOptions(Options):
    """The shape of MoDi's generator and discriminator; the ablations of Table 2 are settings of it.

    Raises:
        MotionGenError: if the settings do not fit together.
    """

    frames: int = option(64, "Frames of a motion; each level below the finest has half as many.", minimum=1)
    channels: tuple = option((256, 128, 64, 64, 32), "Channels of each level, coarsest first (Table 3).")
    joints: tuple | None = option(
        None,
        "About how many joints each level should have, coarsest first; null: from one joint to all by even factors.",
    )
    in_place: int = option(2, "In-place convolutions of a level (Table 4); 1 is an ablation of Table 2.", minimum=1)
    scaler: str = option(
        "convolution",
        "How a level becomes the next: the paper's convolutional scaler, or pooling and a convolution (Table 2).",
        choices=("convolution", "pooling"),
    )
    smoothing: bool = option(
        True, "Average neighbouring frames after each convolutional scaler of the generator, as StyleGAN2 does."
    )
    held_ends: bool = option(
        False, "Beyond its ends a motion stays as it is there, in the eyes of convolutions; false: it is zero there."
    )
    skeleton_aware: bool = option(
        True, "Follow the skeleton; false takes motion as an image of entities by frames (Table 2)."
    )
    representation: str = option(
        "rotations",
        "What an entity holds: a joint's rotation as a quaternion, or its position (Table 2).",
        choices=("rotations", "positions"),
    )
    kernel_width: int = option(3, "Frames that an in-place convolution sees (U); odd.", minimum=1)
    neighbour_distance: int = option(1, "Bones between entities that an in-place convolution joins.", minimum=0)
    latent_size: int = option(512, "Numbers in a latent code.", minimum=1)
    mapping_layers: int = option(8, "Layers of the mapping network.", minimum=1)
    mapping_rate: float = option(0.01, "Learning rate of the mapping network beside the others'.", above=0.0)
    deviation_group: int = option(
        4,
        "Motions whose deviation from each other the discriminator sees; 1 shows it none.",
        minimum=1,
    )

    def __post_init__(self) -> None:
        """Take lists as tuples, as configuration files give them, and check what depends on each other."""
        for name in ("channels", "joints"):
            value: Any = getattr(self, name)
            if isinstance(value, list):
                object.__setattr__(self, name, tuple(value))
        super().__post_init__()
        _check_sizes("channels", self.channels)
        if self.joints is not None:
            _check_sizes("joints", self.joints)
            if len(self.joints) != self.levels:
                raise MotionGenError(
                    f"joints must give as many levels as channels, {self.levels}, not {len(self.joints)}"
                )
        if self.kernel_width % 2 == 0:
            raise MotionGenError(f"kernel_width must be odd, not {self.kernel_width}; take {self.kernel_width + 1}")
        step = 2 ** (self.levels - 1)
        if self.frames % step:
            raise MotionGenError(
                f"frames must be a multiple of {step} with {self.levels} levels, not {self.frames}; "
                f"take {-(-self.frames // step) * step}"
            )

    @property
    def levels(self) -> int:
        """How many levels the networks have."""
        return len(self.channels)

    @property
    def features(self) -> int:
        """K of a motion: the numbers that each entity holds in a frame."""
        return ROTATION_FEATURES if self.representation == "rotations" else POSITION_FEATURES

    def frames_at(self, level: int) -> int:
        """Frames at a level; level 0 is the coarsest."""
        return int(self.frames // 2 ** (self.levels - 1 - level))


def _check_sizes(name: str, sizes: tuple[Any, ...]) -> None:
    if not sizes or any(type(size) is not int or size < 1 for size in sizes):
        raise MotionGenError(f"{name} must be whole numbers from 1 on, one for each level, not {sizes}")


@dataclass(frozen=True)
class ModiOptions(Options):
    """How motions are made from a trained checkpoint."""

    checkpoint: str | None = option(None, "Folder of the checkpoint to make motions from.", file=True)
    truncation: float = option(
        1.0,
        "How far motions may be from the mean motion: 1 as far as they come, 0 all the mean one (section 4.2).",
        minimum=0.0,
    )
    clean_feet: bool = option(True, "Keep feet that stand from sliding, by inverse kinematics of the legs.")
    device: str = option("cpu", "Where to compute: cpu, or a torch device such as cuda.")
