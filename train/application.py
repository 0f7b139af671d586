"""What all trainings have in common as commands: settings composed by Hydra, one line for a mistake, exit codes."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from motiongen.commands.hydra_app import run_application
from motiongen.commands.settings import leaving_no_empty
from motiongen.errors import MotionGenError

EXIT_MISTAKE, EXIT_INTERRUPTED = 2, 130

Train = Callable[[dict[str, Any], Path], None]


def run_training(train: Train, config_name: str, program: str, arguments: Sequence[str], stopped: str) -> int:
    """Run a training as a Hydra application.

    Args:
        train: takes the composed settings as plain data, and the folder for results.
        config_name: the primary configuration.
        program: what to call it in messages.
        arguments: overrides and Hydra's own flags.
        stopped: what to say after an interrupt.

    Returns:
        The exit code.
    """
    try:
        run_application(functools.partial(_compose, train), config_name, arguments)
    except MotionGenError as error:
        print(f"{program}: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_MISTAKE
    except KeyboardInterrupt:
        print(f"{program}: stopped; {stopped}", file=sys.stderr)
        return EXIT_INTERRUPTED
    return 0


def _compose(train: Train, config: DictConfig) -> None:
    folder = Path(HydraConfig.get().runtime.output_dir)
    with leaving_no_empty(folder):
        train(cast(dict[str, Any], OmegaConf.to_container(config, resolve=True)), folder)
