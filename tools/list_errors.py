"""Every message that a mistake can cost: `python -m tools.list_errors docs/errors.md`.

The messages are read from the source. What is filled in stands as `<name>`, after the expression that fills it. Where
a function makes the error from a text that it is given (`source.error("...")`), the text is filled in at each call.
"""

from __future__ import annotations

import argparse
import ast
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from motiongen.files import atomic_write

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("motiongen", "train")
ERROR = "MotionGenError"
DEFINED_IN = "motiongen/errors.py"

TOPICS = (
    (
        "Files and formats",
        ("motiongen/files.py", "motiongen/io/"),
        "The message begins with the file, and for BVH with the line. `motiongen info FILE` says what was understood "
        "of a file that can be read. A file that another program wrote wrongly is best exported anew.",
    ),
    (
        "Clips and skeletons",
        ("motiongen/skeleton.py", "motiongen/motion.py", "motiongen/mirror.py", "motiongen/contact.py",
         "motiongen/features.py", "motiongen/adapt.py", "motiongen/root_motion.py", "motiongen/ik/",
         "motiongen/stance.py", "motiongen/trajectory/", "motiongen/secondary/"),
        "Examples of one generator need one skeleton: the same joint names, tree and bone lengths. `motiongen info` "
        "tells what a clip has; names take the wildcards of a shell, such as `*Leg*`, in quotes.",
    ),
    (
        "Generators, options and constraints",
        ("motiongen/generators/registry.py", "motiongen/generators/options.py", "motiongen/generators/base.py",
         "motiongen/generators/constraints.py", "motiongen/generators/devices.py"),
        "`motiongen list` names generators and constraints, `motiongen sample generator=NAME --help` shows the "
        "options of one.",
    ),
    (
        "GenMM",
        ("motiongen/generators/genmm/",),
        "Mostly constraints that contradict each other, or clips that are too short for the patch size.",
    ),
    (
        "MoDi, its latent space and checkpoints",
        ("motiongen/generators/modi/", "motiongen/attributes/", "motiongen/recognition/"),
        "A model knows one skeleton, and its codes, directions and encoders fit its weights only. Files that belong "
        "together lie in one checkpoint's folder.",
    ),
    (
        "Creatures out of parts",
        ("motiongen/reassembly/",),
        "The body comes first; every other part says where it hangs. See [reassembly](tasks/reassemble.md).",
    ),
    (
        "Datasets and training",
        ("motiongen/datasets/", "train/"),
        "`motiongen data info FOLDER` tells what is in a dataset and whether it is as it was written. A training that "
        "stopped goes on by the same command.",
    ),
    ("Metrics", ("motiongen/metrics/", "motiongen/quality.py", "motiongen/report.py"),
     "Clips that are compared need one skeleton and enough frames."),
    ("Pictures and videos", ("motiongen/render/",), "MP4 needs the extra `video`; GIF, PNG and HTML need nothing."),
    (
        "The command line",
        ("motiongen/cli.py", "motiongen/commands/"),
        "Settings are `key=value`; quote what the shell would take for itself: `'input=clips/*.bvh'`, "
        "`'joints=[\"*Leg*\"]'`.",
    ),
    ("Elsewhere", ("",), "These come from other parts of the library."),
)  # fmt: skip
"""Title, sources, advice; a message belongs to the first topic that has its source."""


BEGINNING = """\
# Every message

Written from the source by `python -m tools.list_errors docs/errors.md`. What stands in angle brackets is filled in.

A mistake costs one line that says what came, what is allowed and what to do. The command line then ends with exit code
2; in Python it is a `motiongen.MotionGenError`. Anything else, with a traceback, is a fault of motiongen: please report
it. What to do about results that are not as hoped: [troubleshooting](troubleshooting.md).
"""


@dataclass(frozen=True)
class Message:
    """A message, and the source that it comes from, relative to the repository."""

    source: str
    text: str


def find_messages(root: Path = ROOT) -> list[Message]:
    """All messages, in the order of their sources, each once a source."""
    paths = sorted(path for folder in SOURCES for path in (root / folder).rglob("*.py"))
    trees = {path.relative_to(root).as_posix(): ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    trees.pop(DEFINED_IN)
    makers = {
        (source.rpartition("/")[0], maker.name): maker for source, tree in trees.items() for maker in _makers(tree)
    }
    errors = {ERROR} | {name for tree in trees.values() for name in _own_errors(tree)}
    found = []
    for source, tree in trees.items():
        near = {name: maker for (folder, name), maker in makers.items() if folder == source.rpartition("/")[0]}
        found += [Message(source, text) for text in _texts(tree, errors, near)]
    return list(dict.fromkeys(found))


def _makers(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Functions that make an error of what they are told: they return it, or do nothing but raise it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and _making(node) is not None:
            yield node


def _making(maker: ast.FunctionDef) -> ast.Call | None:
    """Where a function makes its error, if it is there for that."""
    never_returns = getattr(maker.returns, "id", "") == "NoReturn"
    for node in ast.walk(maker):
        made = node.value if isinstance(node, ast.Return) else node.exc if isinstance(node, ast.Raise) else None
        if isinstance(made, ast.Call) and _called(made) == ERROR and (never_returns or isinstance(node, ast.Return)):
            return made
    return None


def _own_errors(tree: ast.Module) -> Iterator[str]:
    """Errors of a module's own, whose text becomes part of a message."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and {getattr(base, "id", "") for base in node.bases} & {"ValueError", ERROR}:
            yield node.name


def _texts(tree: ast.Module, errors: set[str], makers: Mapping[str, ast.FunctionDef]) -> Iterator[str]:
    """The messages of a module; those of makers where they are called."""
    inside = {inner for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name in makers
              for inner in ast.walk(node)}  # fmt: skip
    for node in sorted(ast.walk(tree), key=lambda node: getattr(node, "lineno", 0)):
        name = _called(node)
        if not isinstance(node, ast.Call) or not node.args:
            continue
        if name in errors and node not in inside:
            text = template(node.args[0], {})
        elif name in makers:
            text = _made(makers[name], node)
        else:
            continue
        if any(map(str.isalpha, _without_fillings(text))):
            yield text


def _made(maker: ast.FunctionDef, call: ast.Call) -> str:
    """The message of an error that `maker` makes of what it is called with."""
    names = [argument.arg for argument in maker.args.args if argument.arg != "self"]
    given = {name: template(value, {}) for name, value in zip(names, call.args)}
    made = _making(maker)
    assert made is not None
    return template(made.args[0], given)


def template(node: ast.expr, given: Mapping[str, str]) -> str:
    """A text with `<name>` for what is filled in, or what is `given` for that name."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=values):
            return "".join(template(value, given) for value in values)
        case ast.FormattedValue(value=value):
            return template(value, given)
        case ast.IfExp(body=body, orelse=other):
            return "/".join(filter(None, (template(body, given), template(other, given))))
        case ast.BinOp(left=ast.JoinedStr() | ast.Constant(value=str()) as left, op=ast.Add(), right=right):
            return template(left, given) + template(right, given)
        case ast.BoolOp(op=ast.Or(), values=values):
            return template(values[-1], given)
        case ast.Name(id=name) if name in given:
            return given[name]
        case ast.Call() if _called(node) == "nearest_of":
            return "; did you mean '<nearest>'?"
    return f"<{_word(node)}>"


def _word(node: ast.expr) -> str:
    """What to call that which an expression fills in."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name.strip("_").replace("_", " ")
        case ast.Subscript(value=value) | ast.Starred(value=value):
            return _word(value)
        case ast.Call(func=ast.Attribute(attr="join"), args=[first]):
            return _word(first)
        case ast.Call(args=[first, *_]):
            return _word(first)
        case ast.Call(func=ast.Attribute(value=value)) | ast.IfExp(body=value):
            return _word(value)
        case ast.GeneratorExp(generators=[first, *_]) | ast.ListComp(generators=[first, *_]):
            return _word(first.iter)
        case ast.Constant(value=value):
            return str(value)
    return "number" if isinstance(node, (ast.BinOp, ast.UnaryOp)) else "..."


def _called(node: ast.AST | None) -> str:
    """The name of the function that a node calls, or nothing."""
    if not isinstance(node, ast.Call):
        return ""
    return getattr(node.func, "id", getattr(node.func, "attr", ""))


def _without_fillings(text: str) -> str:
    return "".join(piece.split(">")[-1] for piece in text.split("<"))


def page(messages: list[Message]) -> str:
    """The Markdown page."""
    lines = [*BEGINNING.splitlines(), ""]
    topic_of = {message: _topic(message) for message in messages}
    for topic in TOPICS:
        title, _, advice = topic
        chosen = [message for message in messages if topic_of[message] == title]
        if not chosen:
            continue
        lines += [f"## {title}", "", advice, ""]
        for source, group in itertools.groupby(chosen, key=lambda message: message.source):
            lines += [f"`{source}`", "", *(f"- `{_one_line(message.text)}`" for message in group), ""]
    return "\n".join(lines)


def _topic(message: Message) -> str:
    return next(title for title, sources, _ in TOPICS if message.source.startswith(sources))


def _one_line(text: str) -> str:
    return " ".join(text.replace("`", "'").split())


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(prog="python -m tools.list_errors", description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path, help="Markdown file to write")
    options = parser.parse_args()
    messages = find_messages()
    with atomic_write(options.page) as file:
        file.write(page(messages).encode())
    print(f"{len(messages)} messages in {options.page}")


if __name__ == "__main__":
    main()
