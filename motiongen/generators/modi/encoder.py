"""A network that inverts in one pass, and what can be done with it: fuse, edit joints, denoise, predict."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.generators.modi.alignment import Floats, Track, bring, standardised
from motiongen.generators.modi.composites import cut_off, spliced, with_joints
from motiongen.generators.modi.generator import MoDi
from motiongen.generators.modi.hierarchy import Hierarchy, build_hierarchy
from motiongen.generators.modi.inversion import Inversion, deviation_of_codes, judged, on_device
from motiongen.generators.modi.layers import EqualisedLinear
from motiongen.generators.modi.model_files import check_origin, not_one, read_model_file
from motiongen.generators.modi.networks import MotionTrunk
from motiongen.generators.modi.options import NetworkOptions
from motiongen.motion import Motion

FORMAT = 1

WEIGHTS = "encoder.safetensors"


class EncoderNetwork(MotionTrunk):
    """Motion to a code in W+: the discriminator's trunk with a head that gives each layer's offset from the mean code.

    Args:
        hierarchy: the skeleton at all levels.
        options: the sizes.
        layers: L, how many layers of the synthesis network take a code.
    """

    mean_code: Tensor
    deviation: Tensor

    def __init__(self, hierarchy: Hierarchy, options: NetworkOptions, layers: int) -> None:
        """Draw the weights."""
        super().__init__(hierarchy, options)
        size = options.latent_size
        self.layers = layers
        self.head = nn.Sequential(
            EqualisedLinear(self.outputs, size, activate=True), EqualisedLinear(size, layers * size)
        )
        self.register_buffer("mean_code", torch.zeros(size))
        self.register_buffer("deviation", torch.ones(()))

    def forward(self, motions: Tensor) -> Tensor:
        """(B, T, E, K) standardised motions to (B, L, latent_size) codes."""
        offsets = self.head(self.flat(self.coarsest(motions))).unflatten(1, (self.layers, -1))
        codes: Tensor = self.mean_code + self.deviation * offsets
        return codes


def new_network(generator: MoDi) -> EncoderNetwork:
    """An untrained network for a generator, with random weights."""
    card = generator.card
    hierarchy = build_hierarchy(card.layout.skeleton, card.layout.feet, card.network)
    network = EncoderNetwork(hierarchy, card.network, generator.latent_layers).to(generator.device)
    network.mean_code.copy_(generator.network.mean_code)
    network.deviation.copy_(deviation_of_codes(generator))
    return network


class Encoder:
    """Motions to codes of a generator in one pass of a trained network.

    It is trained on whole motions as well as on ones that are noisy, cut off, or put together of two, so that the codes
    that it gives are those of whole motions near them. All that it makes comes as an `Inversion`, whose motions are one
    window long, face +z at first, and are near the targets only as far as a single pass can tell; `invert` with its
    codes as guess comes nearer.

    Attributes:
        generator: whose codes it gives.
        network: the weights.
    """

    def __init__(self, generator: MoDi, network: EncoderNetwork) -> None:
        """Take the parts as they are; `Encoder.load` reads them from disk."""
        self.generator = generator
        self.network = network.eval().requires_grad_(False).to(generator.device)

    @classmethod
    def load(cls, folder: str | Path, generator: MoDi) -> Encoder:
        """The encoder in a folder that `python -m train.encoder` has made.

        Raises:
            MotionGenError: if there is none, it is damaged, or belongs to another model.
        """
        notes, tensors = read_tensors(Path(folder).expanduser() / WEIGHTS)
        check_origin(folder, "folder of an encoder", notes["format"], FORMAT, notes["model"], generator)
        network = new_network(generator)
        try:
            network.load_state_dict(tensors)
        except RuntimeError as error:
            reason = str(error).splitlines()[-1].strip()
            raise MotionGenError(f"{folder}: the weights are not the encoder's ({reason})") from error
        return cls(generator, network)

    # -- what it does

    def codes(self, windows: Floats) -> Floats:
        """(N, L, S) codes of windows (N, T, E, 4) of entities, each by itself."""
        motions = on_device(self.generator, standardised(self.generator.card, windows))
        with torch.inference_mode():
            found: Floats = torch.cat([self.network(motion) for motion in motions.split(1)]).cpu().numpy()
        return found

    def encode(self, motion: Motion, windows: int | None = None) -> Inversion:
        """The codes of a clip, window by window as `invert` cuts it.

        Args:
            motion: on the checkpoint's skeleton, at least one window long.
            windows: at most so many, from the start.

        Raises:
            MotionGenError: if the clip has another skeleton or is too short.
        """
        cut = self._track(motion).cut(windows)
        report = (*cut.report, "encoded in one pass")
        return judged(self.generator, self.codes(cut.windows), cut.windows, cut.names, report)

    def denoise(self, motion: Motion) -> Inversion:
        """Clean motions near a noisy clip: `encode`, which has seen noise in training and never makes any."""
        return self.encode(motion)

    def fuse(self, first: Motion, second: Motion, first_frames: int) -> Inversion:
        """One window that begins as one clip begins and ends as another ends.

        The second clip goes on where the first one is and faces then; the two are encoded as one.

        Args:
            first: at least a window long.
            second: likewise.
            first_frames: how many of the frames are from the first clip, at the checkpoint's rate.

        Raises:
            MotionGenError: if a clip does not fit, or either would give no frame.
        """
        self._check("first_frames", first_frames, self._frames - 1)
        begins, ends = self._track(first), self._track(second)
        begins.starts(self._frames)
        last = ends.starts(self._frames)[-1]
        whole = spliced(
            self.generator.card.layout,
            begins.window(0, self._frames),
            ends.window(last, self._frames),
            first_frames,
        )
        said = f"the first {first_frames} frames of '{first.name}', then the last ones of '{second.name}'"
        return self._one(whole, whole, f"{first.name}_{second.name}", (*begins.report, *ends.report, said))

    def edit_joints(self, motion: Motion, joints: str | Sequence[str], source: Motion) -> Inversion:
        """The first window of a clip with some joints' rotations from another, encoded to a whole that goes together.

        Args:
            motion: at least a window long.
            joints: names or shell-style patterns of the joints to replace; the root brings its steps along.
            source: where they come from, at least a window long.

        Raises:
            MotionGenError: if a clip does not fit, or there is no such joint.
        """
        chosen = self.generator.skeleton.select(joints)
        tracks = self._track(motion), self._track(source)
        for track in tracks:
            track.starts(self._frames)
        ours, theirs = (track.window(0, self._frames) for track in tracks)
        whole = with_joints(self.generator.card.layout, ours, theirs, chosen)
        names = ", ".join(self.generator.skeleton.names[joint] for joint in chosen)
        said = f"{names} of '{source.name}' in '{motion.name}'"
        return self._one(whole, whole, f"{motion.name}_{source.name}", (*tracks[0].report, *tracks[1].report, said))

    def predict(self, prefix: Motion, frames: int) -> Inversion:
        """One window that begins as a clip ends and goes on for so many frames.

        Args:
            prefix: what came before; of a longer one as many of its last frames as the window has room for.
            frames: how many to predict, at the checkpoint's rate.

        Returns:
            An inversion whose motion holds the known frames, as the network makes them, and the predicted ones; its
            target holds the known ones alone.

        Raises:
            MotionGenError: if the clip has another skeleton, or a window does not hold so many frames.
        """
        self._check("frames", frames, self._frames - 1)
        track = self._track(prefix)
        known = min(len(track), self._frames - frames)
        window = track.window(len(track) - known, known)
        padded = np.concatenate([window, np.repeat(window[-1:], self._frames - known, axis=0)])
        said = f"{frames} frames predicted after the last {known} of '{prefix.name}'"
        found = self._one(
            cut_off(self.generator.card, padded, known), window, f"{prefix.name}_predicted", (*track.report, said)
        )
        return found.shortened(known + frames)

    @property
    def _frames(self) -> int:
        return self.generator.usual_frames

    def _track(self, motion: Motion) -> Track:
        return bring(self.generator.card, motion)

    def _one(self, given: Floats, target: Floats, name: str, report: Sequence[str]) -> Inversion:
        """What a window is encoded to, beside what it was to be near to."""
        return judged(self.generator, self.codes(given[None]), target[None], [name], report)

    @staticmethod
    def _check(name: str, value: int, most: int) -> None:
        if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= most:
            raise MotionGenError(f"{name} must be a whole number from 1 to {most}, not {value!r}")


def save_tensors(path: Path, notes: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    """Write tensors with plain data beside them into one file, which appears when it is complete.

    Raises:
        MotionGenError: if it cannot be written.
    """
    from safetensors.torch import save

    kept = {name: tensor.detach().cpu().clone().contiguous() for name, tensor in tensors.items()}
    with atomic_write(path) as file:
        file.write(save(kept, {"notes": json.dumps(notes)}))


def read_tensors(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """What `save_tensors` wrote.

    Raises:
        MotionGenError: if it cannot be read.
    """
    what = "encoder"
    tensors, metadata = read_model_file(path, what)
    try:
        notes = json.loads(metadata["notes"])
        known = {"format": int(notes["format"]), "model": str(notes["model"])}
    except (KeyError, TypeError, ValueError) as error:
        raise not_one(path, what, error) from error
    return notes | known, {name: torch.from_numpy(tensor) for name, tensor in tensors.items()}
