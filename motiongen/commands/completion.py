"""Tab completion: the names of commands by ourselves, what follows `sample` by Hydra.

`eval "$(motiongen -sc install=bash)"` (or zsh, fish) sets it up; the shell then calls `motiongen -sc query=bash` with
the line so far in COMP_LINE.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

HYDRA_COMMANDS = ("sample",)


def run(arguments: Sequence[str], commands: Sequence[str]) -> None:
    """Install completion, or answer a query."""
    if not any("query=" in argument for argument in arguments):
        _hydra(HYDRA_COMMANDS[0], arguments)
        return
    line = os.environ.get("COMP_LINE", "")
    words = line.split()
    if len(words) < 2 or (len(words) == 2 and not line.endswith(" ")):
        begun = words[1] if len(words) == 2 else ""
        print(" ".join(name for name in commands if name.startswith(begun)))
        return
    if words[1] not in HYDRA_COMMANDS:
        return
    # Hydra completes `program key=...`: take the command's name out of the line, and move the cursor with it.
    cut = len(line) - len(line.split(None, 2)[2]) if len(words) > 2 else len(line)
    shortened = f"{words[0]} {line[cut:]}"
    os.environ["COMP_LINE"] = shortened
    os.environ["COMP_POINT"] = str(len(shortened))
    _hydra(words[1], arguments)


def _hydra(command: str, arguments: Sequence[str]) -> None:
    from motiongen.commands.sample import hydra_application

    hydra_application(arguments)
