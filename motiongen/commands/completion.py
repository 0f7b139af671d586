"""Tab completion: the names of commands by ourselves, what follows those that take settings by Hydra.

`eval "$(motiongen -sc install=bash)"` (or zsh, fish) sets it up; the shell then calls `motiongen -sc query=bash` with
the line so far in COMP_LINE.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence

RunCommand = Callable[[str, Sequence[str]], None]


def complete(arguments: Sequence[str], commands: Mapping[str, bool], run: RunCommand) -> None:
    """Install completion, or answer a query.

    Args:
        arguments: Hydra's own, such as `-sc query=bash`.
        commands: which there are, and whether each takes settings.
        run: runs one of them with arguments.
    """
    if not any("query=" in argument for argument in arguments):
        run(next(name for name, takes_settings in commands.items() if takes_settings), arguments)
        return
    line = os.environ.get("COMP_LINE", "")
    words = line.split()
    if len(words) < 2 or (len(words) == 2 and not line.endswith(" ")):
        begun = words[1] if len(words) == 2 else ""
        print(" ".join(name for name in commands if name.startswith(begun)))
        return
    if not commands.get(words[1], False):
        return
    # Hydra completes `program key=...`: take the command's name out of the line, and move the cursor with it.
    cut = len(line) - len(line.split(None, 2)[2]) if len(words) > 2 else len(line)
    shortened = f"{words[0]} {line[cut:]}"
    os.environ["COMP_LINE"] = shortened
    os.environ["COMP_POINT"] = str(len(shortened))
    run(words[1], arguments)
