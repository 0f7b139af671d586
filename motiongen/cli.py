"""The command line: `motiongen COMMAND ...`.

Each command imports what it needs when it runs, so that help, lists and mistakes are answered at once. A mistake costs
one line on standard error and exit code 2.
"""

from __future__ import annotations

import importlib
import io
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass

# Waiting OpenMP threads must sleep, not spin: two busy processes otherwise slow each other down sixty times. It has to
# be set before torch is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from motiongen.errors import MotionGenError, nearest_of

EXIT_MISTAKE = 2
EXIT_INTERRUPTED = 130


@dataclass(frozen=True)
class Command:
    """A sub-command; its module in `motiongen.commands` has a `run` that takes the arguments after its name.

    Attributes:
        help: one line for the overview.
        settings: whether it takes settings as key=value, which Hydra composes and completes.
    """

    help: str
    settings: bool = False


COMMANDS = {
    "sample": Command("make new motions from example clips, or from a trained model", settings=True),
    "stream": Command("endless motion, chunk by chunk", settings=True),
    "latent": Command("between, around and in the midst of a model's motions", settings=True),
    "invert": Command("the codes of clips in a model's latent space", settings=True),
    "edit": Command("more or less of an attribute, such as how high a hand is", settings=True),
    "evaluate": Command("made motions measured against real ones", settings=True),
    "info": Command("what is in a clip, and what is odd about it"),
    "convert": Command("change a clip's format, frame rate, unit, up axis or root motion"),
    "render": Command("clips as a video, an animated GIF, a film strip or a page that plays"),
    "data": Command("datasets of motion windows for training: import, info, pack, unpack"),
    "serve": Command("a page in the browser: load a clip, make motions, watch, compare and download them"),
    "worker": Command("motions on request for other programs, as lines of JSON"),
    "list": Command("the generators, models, file formats and constraints there are"),
}


def run_command(name: str, arguments: Sequence[str]) -> None:
    """Run a sub-command with the arguments after its name."""
    importlib.import_module(f"motiongen.commands.{name}").run(arguments)


def overview() -> str:
    """What `motiongen --help` prints."""
    width = max(map(len, COMMANDS))
    lines = [
        f"  {name:<{width}}  {command.help}{' (settings as key=value)' if command.settings else ''}"
        for name, command in COMMANDS.items()
    ]
    return "\n".join(
        [
            "usage: motiongen COMMAND ...",
            "",
            "New motion from your own clips, on your own rig.",
            "",
            *lines,
            "",
            "`motiongen COMMAND --help` tells more; `motiongen sample` alone makes motions from the bundled clip.",
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    for stream in (sys.stdout, sys.stderr):  # joint names of a file need not be text that the terminal can show
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        _dispatch(arguments)
    except MotionGenError as error:
        print(f"motiongen: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_MISTAKE
    except BrokenPipeError:  # the reader of our output has gone, as `motiongen info clip.bvh | head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("motiongen: stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    return 0


def _dispatch(arguments: Sequence[str]) -> None:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(overview())
    elif arguments[0] in ("-V", "--version"):
        from motiongen import __version__

        print(f"motiongen {__version__}")
    elif arguments[0] == "-sc":
        from motiongen.commands.completion import complete

        complete(arguments, {name: command.settings for name, command in COMMANDS.items()}, run_command)
    elif arguments[0] in COMMANDS:
        run_command(arguments[0], arguments[1:])
    else:
        near = nearest_of(arguments[0], COMMANDS) or ";"
        raise MotionGenError(f"there is no command '{arguments[0]}'{near} the commands are {', '.join(COMMANDS)}")


if __name__ == "__main__":
    sys.exit(main())
