"""A checkpoint: a folder of plain data that cannot run code, complete or not there at all.

    model.json              what the networks are, what their numbers mean, and how far they have got
    model.safetensors       the weights to sample from (the running mean of the generator's)
    training.json           what training needs besides, to go on
    training.safetensors    the weights in training, and the optimisers' memory

The last two are missing in a checkpoint that is only to be sampled from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from motiongen.datasets import EntityLayout
from motiongen.errors import MotionGenError
from motiongen.files import new_folder
from motiongen.generators.modi.options import NetworkOptions

FORMAT = 1

MODEL, TRAINING = "model", "training"

Tensors = dict[str, Tensor]


@dataclass(frozen=True)
class Card:
    """What the networks are and what their numbers mean.

    Attributes:
        network: shape of the networks.
        layout: which entity is what, on which skeleton.
        mean: (E, K) of the training data, which motions are standardised by.
        deviation: (E, K) likewise.
        frame_rate: in Hz.
        unit: length unit of the skeleton, if known.
        data_fingerprint: of the dataset that it was trained on.
        iteration: training steps so far.
        samples: motions seen so far.
        credit: whose motion it was trained on and what that allows; empty where nobody has said.
    """

    network: NetworkOptions
    layout: EntityLayout
    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    frame_rate: float
    unit: str | None
    data_fingerprint: str
    iteration: int = 0
    samples: int = 0
    credit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "format": FORMAT,
            "generator": "modi",
            "network": asdict(self.network),
            "layout": self.layout.to_dict(),
            "mean": self.mean.tolist(),
            "deviation": self.deviation.tolist(),
            "frame_rate_hz": self.frame_rate,
            "unit": self.unit,
            "data_fingerprint": self.data_fingerprint,
            "iteration": self.iteration,
            "samples": self.samples,
            "credit": self.credit,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Card:
        """The card of `to_dict`'s data.

        Raises:
            KeyError, TypeError, ValueError, MotionGenError: if it is not like that.
        """
        card = cls(
            network=NetworkOptions.build(dict(data["network"])),
            layout=EntityLayout.from_dict(data["layout"]),
            mean=np.array(data["mean"], dtype=np.float32),
            deviation=np.array(data["deviation"], dtype=np.float32),
            frame_rate=float(data["frame_rate_hz"]),
            unit=data["unit"],
            data_fingerprint=str(data["data_fingerprint"]),
            iteration=int(data["iteration"]),
            samples=int(data["samples"]),
            credit=str(data.get("credit", "")),
        )
        expected = card.layout.count, card.network.features
        if not card.mean.shape == card.deviation.shape == expected:
            raise ValueError(f"mean and deviation of shape {card.mean.shape}, {card.deviation.shape}, not {expected}")
        return card


def save_checkpoint(
    folder: Path, card: Card, weights: Tensors, training: tuple[Mapping[str, Any], Tensors] | None = None
) -> None:
    """Write a checkpoint; it appears by rename when it is complete.

    Args:
        folder: where; there must be nothing yet.
        card: what it is.
        weights: of the generator to sample from.
        training: what else is needed to go on: plain data, and tensors.

    Raises:
        MotionGenError: if it cannot be written.
    """
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    parts = {MODEL: (card.to_dict(), weights)} | ({} if training is None else {TRAINING: training})
    with new_folder(folder, parents=True) as temporary:
        for name, (data, tensors) in parts.items():
            (temporary / f"{name}.json").write_text(json.dumps(data))
            # Each tensor by itself: shared or strided memory is none of a file's concern.
            own = {key: tensor.detach().cpu().clone().contiguous() for key, tensor in tensors.items()}
            try:
                save_file(own, temporary / f"{name}.safetensors")
            except SafetensorError as error:
                raise OSError(str(error)) from error


def load_model(folder: str | Path) -> tuple[Card, Tensors]:
    """What a checkpoint needs to be sampled from.

    Raises:
        MotionGenError: if there is none, it is damaged, or a later version wrote it.
    """
    folder = Path(folder).expanduser()
    data, tensors = _read(folder, MODEL)
    generator, number = data.get("generator"), data.get("format")
    if generator != "modi" or (isinstance(number, int) and number > FORMAT):
        raise MotionGenError(
            f"{folder}: a checkpoint of '{generator}' in format {number}; this version reads those of 'modi' up to "
            f"format {FORMAT}; update motiongen"
        )
    try:
        return Card.from_dict(data), tensors
    except (KeyError, TypeError, ValueError, MotionGenError) as error:
        raise MotionGenError(f"{folder}: model.json is damaged ({error!r}); take another checkpoint") from error


def load_training(folder: str | Path) -> tuple[dict[str, Any], Tensors]:
    """What a checkpoint needs besides, to be trained on.

    Raises:
        MotionGenError: if it has no such part or is damaged.
    """
    return _read(Path(folder), TRAINING)


def _read(folder: Path, name: str) -> tuple[dict[str, Any], Tensors]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    place = folder / f"{name}.json"
    if not place.is_file():
        raise MotionGenError(f"{folder}: this is no checkpoint of modi, for it holds no {name}.json; name its folder")
    try:
        data = json.loads(place.read_text())
        if not isinstance(data, dict):
            raise ValueError("no JSON object")
        return data, load_file(folder / f"{name}.safetensors")
    except (OSError, ValueError, SafetensorError) as error:
        raise MotionGenError(f"{folder}: {name} cannot be read ({error}); take another checkpoint") from error
