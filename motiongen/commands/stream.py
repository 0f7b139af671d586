"""`motiongen stream`: endless motion, chunk by chunk, as a Hydra application over `configs/stream.yaml`."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from motiongen.commands.hydra_app import run_command
from motiongen.commands.inputs import load_examples, read_input
from motiongen.commands.settings import chosen_generator, own_format, suffix_of, up_and_unit, whole
from motiongen.errors import MotionGenError


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_command(_stream, "stream", arguments)


def _stream(values: dict[str, Any], folder: Path) -> None:
    spec, options = chosen_generator(values["generator"])
    chunks = None if values["chunks"] is None else whole("chunks", values["chunks"], 1)
    written = own_format(values)
    up, unit = up_and_unit(values)
    generator: Any = spec.create(spec.options_type().build(options))
    if not hasattr(generator, "stream"):
        raise MotionGenError(f"generator={spec.name} makes no endless motion; generator=genmm does")
    examples = load_examples(read_input(values["input"], needed=True), up, unit)
    generator.fit(examples.clips)
    made = generator.stream(values["chunk_frames"], values["seed"], examples.constraints)
    begun = time.perf_counter()
    for number, chunk in enumerate(itertools.islice(made, chunks), start=1):
        path = folder / f"{chunk.name}.{suffix_of(chunk, written)}"
        chunk.save(path)
        ahead = number * len(chunk) / chunk.frame_rate / (time.perf_counter() - begun)
        print(f"{path}: {len(chunk)} frames, {ahead:.0f} times as fast as they play", flush=True)
