"""A recogniser of motions: a small trained network whose features say how like real motions made ones are.

It is a folder of plain data that cannot run code, complete or not there at all:

    model.json           what the network is, on which skeleton, what it tells apart and how well
    model.safetensors    its weights, the matrices among them in half precision
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from motiongen.datasets import EntityLayout
from motiongen.errors import MotionGenError
from motiongen.files import new_folder
from motiongen.motion import Motion
from motiongen.recognition.network import GraphNetwork
from motiongen.recognition.positions import placed
from motiongen.skeleton import Skeleton

Floats = NDArray[np.float32]

KIND, FORMAT = "motiongen recogniser", 1

MODEL, WEIGHTS = "model.json", "model.safetensors"

BATCH = 64
"""Motions that go through the network together."""


@dataclass(frozen=True, eq=False)
class Card:
    """What a recogniser is.

    Attributes:
        skeleton: the only one that it knows.
        frame_rate: in Hz.
        frames: length of the motions that it was trained on.
        classes: what it tells apart.
        channels: of the network's blocks.
        reference: (J, 3) usual first pose (see `positions.placed`).
        data_fingerprint: of the dataset that it was trained on.
        label: of the dataset, whose values the classes are.
        accuracy: share of the held-back windows that it recognised; None where none were held back.
        balanced_accuracy: mean of that over the classes.
        confusion: (classes, classes) held-back windows of each class, by what they were taken for.
    """

    skeleton: Skeleton
    frame_rate: float
    frames: int
    classes: tuple[str, ...]
    channels: tuple[int, ...]
    reference: Floats
    data_fingerprint: str
    label: str
    accuracy: float | None = None
    balanced_accuracy: float | None = None
    confusion: NDArray[np.int64] | None = None

    def network(self, dropout: float = 0.0) -> GraphNetwork:
        """Its network, with random weights."""
        return GraphNetwork(self.skeleton.parents, len(self.classes), self.channels, dropout)

    def to_dict(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "kind": KIND,
            "format": FORMAT,
            "skeleton": EntityLayout(self.skeleton).to_dict(),
            "frame_rate_hz": self.frame_rate,
            "frames": self.frames,
            "classes": list(self.classes),
            "channels": list(self.channels),
            "reference": self.reference.tolist(),
            "data_fingerprint": self.data_fingerprint,
            "label": self.label,
            "accuracy": self.accuracy,
            "balanced_accuracy": self.balanced_accuracy,
            "confusion": None if self.confusion is None else self.confusion.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Card:
        """The card of `to_dict`'s data.

        Raises:
            KeyError, TypeError, ValueError: if it is not like that.
        """
        skeleton = EntityLayout.from_dict(data["skeleton"]).skeleton
        channels = tuple(int(size) for size in data["channels"])
        if not channels or min(channels) < 1:
            raise ValueError(f"channels of sizes {channels}")
        confusion = data["confusion"]
        return cls(
            skeleton=skeleton,
            frame_rate=float(data["frame_rate_hz"]),
            frames=int(data["frames"]),
            classes=tuple(str(name) for name in data["classes"]),
            channels=channels,
            reference=np.array(data["reference"], dtype=np.float32).reshape(len(skeleton), 3),
            data_fingerprint=str(data["data_fingerprint"]),
            label=str(data["label"]),
            accuracy=data["accuracy"],
            balanced_accuracy=data["balanced_accuracy"],
            confusion=None if confusion is None else np.array(confusion, dtype=np.int64),
        )


class Recogniser:
    """A trained network that tells what a motion is, by the joints' positions, on one skeleton.

    Attributes:
        card: what it is.
        network: its weights; float32, rounded as they are kept in a file.
    """

    def __init__(self, card: Card, weights: Mapping[str, Tensor]) -> None:
        """Take a network's weights.

        Raises:
            RuntimeError: if they are not those of such a network.
        """
        self.card = card
        self.network = card.network()
        self.network.load_state_dict({name: _kept(tensor).float() for name, tensor in weights.items()})
        self.network.eval().requires_grad_(False)

    @classmethod
    def load(cls, folder: str | Path) -> Recogniser:
        """The recogniser in a folder.

        Raises:
            MotionGenError: if there is none, it is damaged, or a later version wrote it.
        """
        from safetensors import SafetensorError
        from safetensors.torch import load_file

        folder = Path(folder).expanduser()
        if not (folder / MODEL).is_file():
            raise MotionGenError(
                f"{folder}: this is no recogniser, for it holds no {MODEL}; make one with "
                "`python -m train.recogniser data=FOLDER output=FOLDER`"
            )
        try:
            data = json.loads((folder / MODEL).read_text(encoding="utf-8"))
            if data["kind"] != KIND:
                raise ValueError(f"it says that it is '{data['kind']}'")
            if data["format"] > FORMAT:
                raise ValueError(f"it has format {data['format']}, and this version reads up to {FORMAT}")
            return cls(Card.from_dict(data), load_file(folder / WEIGHTS))
        except (KeyError, TypeError, ValueError, OSError, RuntimeError, SafetensorError) as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise MotionGenError(f"{folder}: this recogniser cannot be read ({reason}); take another one") from error

    def save(self, folder: str | Path) -> None:
        """Write it into a new folder, which appears when it is complete.

        Raises:
            MotionGenError: if there is something already, or it cannot be written.
        """
        from safetensors import SafetensorError
        from safetensors.torch import save_file

        with new_folder(folder) as temporary:
            (temporary / MODEL).write_text(json.dumps(self.card.to_dict()), encoding="utf-8")
            weights = {name: _kept(tensor).contiguous() for name, tensor in self.network.state_dict().items()}
            try:
                save_file(weights, temporary / WEIGHTS)
            except SafetensorError as error:
                raise OSError(str(error)) from error

    # -- what it finds

    def of_motions(self, motions: Sequence[Motion]) -> Floats:
        """(B, T, J, 3) joint positions in skeleton heights, at its frame rate, for `features` and `probabilities`.

        Raises:
            MotionGenError: if there is none, one has another skeleton, or they have different lengths.
        """
        if not motions:
            raise MotionGenError("a recogniser needs at least one motion; none came")
        rows = []
        for motion in motions:
            if found := self.card.skeleton.difference(motion.skeleton, ignoring=motion.translating):
                raise MotionGenError(
                    f"'{motion.name}' has another skeleton than the recogniser: {found}; train a recogniser on motions "
                    "of that skeleton"
                )
            at_rate = motion if motion.frame_rate == self.card.frame_rate else motion.resample(self.card.frame_rate)
            rows.append((at_rate.positions / motion.skeleton.height).astype(np.float32))
            if len(rows[-1]) != len(rows[0]):
                raise MotionGenError(
                    f"'{motion.name}' has {len(rows[-1])} frames at {self.card.frame_rate:g} Hz and "
                    f"'{motions[0].name}' has {len(rows[0])}; cut them to one length"
                )
        return np.stack(rows)

    def features(self, positions: NDArray[Any]) -> Floats:
        """(B, D) features of positions (B, T, J, 3) in skeleton heights, wherever they are and face.

        Raises:
            MotionGenError: if the shape is another or a number is not finite.
        """
        return np.concatenate([self.network.features(batch).numpy() for batch in self._batches(positions)])

    def probabilities(self, positions: NDArray[Any]) -> Floats:
        """(B, classes) how likely each motion is to be of each class; rows add up to 1.

        Raises:
            MotionGenError: if the shape is another or a number is not finite.
        """
        return np.concatenate([self.network(batch).softmax(dim=1).numpy() for batch in self._batches(positions)])

    def _batches(self, positions: NDArray[Any]) -> list[Tensor]:
        joints = len(self.card.skeleton)
        if positions.ndim != 4 or positions.shape[2:] != (joints, 3) or 0 in positions.shape:
            raise MotionGenError(f"positions must have the shape (motions, frames, {joints}, 3), not {positions.shape}")
        if not np.isfinite(positions).all():
            raise MotionGenError("positions hold numbers that are not finite; take motions without such frames")
        starts = range(0, len(positions), BATCH)
        return [torch.from_numpy(placed(positions[start : start + BATCH], self.card.reference)) for start in starts]


def _kept(tensor: Tensor) -> Tensor:
    """A weight as a file holds it: matrices in half precision; what scales and shifts channels needs more."""
    return tensor.half() if tensor.ndim > 1 and tensor.is_floating_point() else tensor
