"""`motiongen stream`: endless motion, chunk by chunk, as a Hydra application over `configs/stream.yaml`."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from motiongen import io
from motiongen.commands.hydra_app import run_application
from motiongen.commands.inputs import load_examples, read_input
from motiongen.commands.settings import choice, leaving_no_empty, whole
from motiongen.errors import MotionGenError
from motiongen.generators.registry import spec_of
from motiongen.motion import METRES_PER_UNIT, UP_AXES


def run(arguments: Sequence[str]) -> None:
    """Run the command with its overrides."""
    run_application(_task, "stream", arguments)


def _task(config: DictConfig) -> None:
    folder = Path(HydraConfig.get().runtime.output_dir)
    with leaving_no_empty(folder):
        _stream(cast(dict[str, Any], OmegaConf.to_container(config, resolve=True)), folder)


def _stream(values: dict[str, Any], folder: Path) -> None:
    options = dict(values["generator"])
    spec = spec_of(str(options.pop("name")))
    chunks = None if values["chunks"] is None else whole("chunks", values["chunks"], 1)
    written = choice("format", values["format"], [suffix.lstrip(".") for suffix in io.formats()])
    up = choice("up", values["up"], (None, *UP_AXES))
    unit = choice("unit", values["unit"], (None, *METRES_PER_UNIT))
    generator: Any = spec.create(spec.options_type().build(options))
    if not hasattr(generator, "stream"):
        raise MotionGenError(f"generator={spec.name} makes no endless motion; generator=genmm does")
    examples = load_examples(read_input(values["input"], needed=True), up, unit)
    generator.fit(examples.clips)
    made = generator.stream(values["chunk_frames"], values["seed"], examples.constraints)
    begun = time.perf_counter()
    for number, chunk in enumerate(itertools.islice(made, chunks), start=1):
        path = folder / f"{chunk.name}.{written}"
        chunk.save(path)
        ahead = number * len(chunk) / chunk.frame_rate / (time.perf_counter() - begun)
        print(f"{path}: {len(chunk)} frames, {ahead:.0f} times as fast as they play", flush=True)
