"""The command line: `motiongen COMMAND ...`.

Each command imports what it needs when it runs, so that help, lists and mistakes are answered at once. A mistake costs
one line on standard error and exit code 2.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

# Waiting OpenMP threads must sleep, not spin: two busy processes otherwise slow each other down sixty times. It has to
# be set before torch is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from motiongen.errors import MotionGenError, nearest_of

EXIT_MISTAKE = 2
EXIT_INTERRUPTED = 130


@dataclass(frozen=True)
class Command:
    """A sub-command: one line for the overview, and the function that runs it with the arguments after its name."""

    help: str
    run: Callable[[Sequence[str]], None]


def _stream(arguments: Sequence[str]) -> None:
    from motiongen.commands.stream import run

    run(arguments)


def _info(arguments: Sequence[str]) -> None:
    from motiongen.commands.info import run

    run(arguments)


def _convert(arguments: Sequence[str]) -> None:
    from motiongen.commands.convert import run

    run(arguments)


def _render(arguments: Sequence[str]) -> None:
    from motiongen.commands.render import run

    run(arguments)


def _list(arguments: Sequence[str]) -> None:
    from motiongen.commands.list import run

    run(arguments)


def _sample(arguments: Sequence[str]) -> None:
    from motiongen.commands.sample import run

    run(arguments)


def _data(arguments: Sequence[str]) -> None:
    from motiongen.commands.data import run

    run(arguments)


COMMANDS = {
    "sample": Command("make new motions from example clips (settings as key=value)", _sample),
    "stream": Command("endless motion, chunk by chunk (settings as key=value)", _stream),
    "info": Command("what is in a clip, and what is odd about it", _info),
    "convert": Command("change a clip's format, frame rate, unit or up axis", _convert),
    "render": Command("clips as a video, an animated GIF or a film strip", _render),
    "data": Command("datasets of motion windows for training: import, info, pack, unpack", _data),
    "list": Command("the generators, file formats and constraints there are", _list),
}


def overview() -> str:
    """What `motiongen --help` prints."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {command.help}" for name, command in COMMANDS.items()]
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
        from motiongen.commands.completion import run

        run(arguments, list(COMMANDS))
    elif arguments[0] in COMMANDS:
        COMMANDS[arguments[0]].run(arguments[1:])
    else:
        near = nearest_of(arguments[0], COMMANDS) or ";"
        raise MotionGenError(f"there is no command '{arguments[0]}'{near} the commands are {', '.join(COMMANDS)}")


if __name__ == "__main__":
    sys.exit(main())
