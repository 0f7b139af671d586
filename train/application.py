"""What all trainings have in common as commands: settings composed by Hydra, one line for a mistake, exit codes."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from motiongen.commands.hydra_app import Work, run_command
from motiongen.errors import MotionGenError

EXIT_MISTAKE, EXIT_INTERRUPTED = 2, 130


def run_training(train: Work, config_name: str, program: str, arguments: Sequence[str], stopped: str) -> int:
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
        run_command(train, config_name, arguments)
    except MotionGenError as error:
        print(f"{program}: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_MISTAKE
    except KeyboardInterrupt:
        print(f"{program}: stopped; {stopped}", file=sys.stderr)
        return EXIT_INTERRUPTED
    return 0
