"""`motiongen invert`: clips to latent codes and back, as a Hydra application over `configs/invert.yaml`."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.core.hydra_config import HydraConfig

from motiongen import io
from motiongen.commands.hydra_app import run_command
from motiongen.commands.latent_inputs import latent_generator
from motiongen.commands.settings import choice, clip_format, up_and_unit, whole
from motiongen.console import progress_bar
from motiongen.errors import MotionGenError
from motiongen.files import atomic_path, atomic_write
from motiongen.motion import Motion

if TYPE_CHECKING:
    from motiongen.generators.modi.encoder import Encoder
    from motiongen.generators.modi.inversion import Inversion

METHODS = ("optimiser", "encoder", "both")

ACTIONS = ("invert", "denoise", "fuse", "edit_joints", "predict")

SHOWN = 4
"""Windows in the film strip, at most."""


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_command(_invert, "invert", arguments)


def _invert(values: dict[str, Any], folder: Path) -> None:
    written = clip_format(values)
    action, method = choice("action", values["action"], ACTIONS), choice("method", values["method"], METHODS)
    needs_encoder = action != "invert" or method != "optimiser"
    if needs_encoder and values["encoder"] is None:
        asked = f"method={method}" if action == "invert" else f"action={action}"
        raise MotionGenError(f"{asked} needs encoder=FOLDER; make one with python -m train.encoder")
    clip = _clip(values, "input")
    generator = latent_generator(values["generator"])
    encoder = _encoder(values["encoder"], generator) if needs_encoder else None
    begun = time.perf_counter()
    found = _inverted(values, generator, encoder, clip) if action == "invert" else _made(values, encoder, clip)
    seconds = time.perf_counter() - begun
    record = {
        "settings": list(HydraConfig.get().overrides.task),
        "action": action,
        "method": method if action == "invert" else "encoder",
        "clip": clip.name,
        "seconds": seconds,
        **found.to_dict(),
    }
    _write(found, generator, folder, written, record)
    for line in found.report:
        print(line)
    for motion, error in zip(found.motions, found.errors):
        print(f"{folder / motion.name}.{written}: {error}")
    print(f"{seconds:.1f} s; codes in {folder / 'latents.safetensors'}")


def _clip(values: dict[str, Any], name: str) -> Motion:
    if values[name] is None:
        raise MotionGenError(f"{name}=CLIP is missing; clips end in {', '.join(io.formats())}")
    up, unit = up_and_unit(values)
    return io.load(Path(str(values[name])).expanduser(), up=up, unit=unit)


def _encoder(folder: Any, generator: Any) -> Encoder:
    from motiongen.generators.modi.encoder import Encoder

    return Encoder.load(str(folder), generator)


def _inverted(values: dict[str, Any], generator: Any, encoder: Encoder | None, clip: Motion) -> Inversion:
    from motiongen.generators.modi.inversion import InversionOptions, invert

    options = InversionOptions.build(values["inversion"])
    first = None if encoder is None else encoder.encode(clip, options.windows)
    if first is not None and values["method"] == "encoder":
        return first
    with progress_bar("inverting") as progress:
        return invert(generator, clip, options, progress, None if first is None else first.codes)


def _made(values: dict[str, Any], encoder: Any, clip: Motion) -> Inversion:
    """What an action other than inversion makes."""
    if values["action"] == "denoise":
        return encoder.denoise(clip)
    if values["action"] == "predict":
        return encoder.predict(clip, whole("frames", values["frames"], 1))
    source = _clip(values, "source")
    if values["action"] == "fuse":
        return encoder.fuse(clip, source, whole("first_frames", values["first_frames"], 1))
    if not values["joints"]:
        raise MotionGenError("action=edit_joints needs joints=[NAME,...]; names or patterns such as '*Arm*'")
    return encoder.edit_joints(clip, values["joints"], source)


def _write(found: Inversion, generator: Any, folder: Path, suffix: str, record: dict[str, Any]) -> None:
    from motiongen.generators.modi.latents import save_latents
    from motiongen.render import film_strip

    names = [motion.name for motion in found.motions]
    save_latents(folder / "latents.safetensors", generator, found.codes, names)
    for motion in found.motions:
        motion.save(folder / f"{motion.name}.{suffix}")
    pairs = list(zip(found.targets, found.motions))[:SHOWN]
    shown = [(motion, f"{motion.name} {what}") for pair in pairs for motion, what in zip(pair, ("target", "decoded"))]
    picture = film_strip([motion for motion, _ in shown], [label for _, label in shown])
    with atomic_path(folder / "film_strip.png") as path:
        picture.save(path)
    with atomic_write(folder / "inversion.json") as file:
        file.write(json.dumps(record, indent=1).encode())
