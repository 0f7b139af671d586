"""The house keeps its floors: who may import whom, read from the source, and what importing costs."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.conftest import ROOT

# The floor of each module, or of everything in a package. A module may import its own floor and lower ones when it is
# imported itself. A new module fails these tests until it is entered here, on the lowest floor that it can live on.
FLOORS = {
    # nouns, and pure functions over arrays
    "motiongen.errors": 0,
    "motiongen.files": 0,
    "motiongen.rotations": 0,
    "motiongen.skeleton": 0,
    "motiongen.motion": 0,
    "motiongen.kinematics": 0,
    "motiongen.mirror": 0,
    "motiongen.contact": 0,
    "motiongen.easing": 0,
    "motiongen.adapt": 0,
    "motiongen.stance": 1,
    "motiongen.root_motion": 1,
    # what is made of them
    "motiongen.assets": 1,
    "motiongen.io": 1,
    "motiongen.features": 1,
    "motiongen.quality": 1,
    "motiongen.ik": 1,
    "motiongen.datasets": 1,
    "motiongen.secondary": 1,
    "motiongen.trajectory": 1,
    "motiongen.reassembly": 2,
    # measures, and the generators' contract
    "motiongen.metrics": 2,
    "motiongen.recognition": 2,
    "motiongen.attributes": 2,
    "motiongen.generators": 2,
    # generators, pictures, reports
    "motiongen.generators.genmm": 3,
    "motiongen.generators.modi": 3,
    "motiongen.render": 3,
    "motiongen.report": 3,
    # faces
    "motiongen": 4,  # what `import motiongen` offers; inside, import from the modules themselves
    "motiongen.console": 4,
    "motiongen.commands": 4,
    "motiongen.cli": 4,
    "motiongen.web": 4,
    # programs
    "train": 5,
    "tools": 5,
}

# Who may import a package from elsewhere when imported itself; anyone may inside a function. NumPy is for all.
GENERATORS = ("motiongen.generators.genmm", "motiongen.generators.modi")
PROGRAMS = ("train", "tools")
HYDRA_COMMANDS = tuple(
    f"motiongen.commands.{name}"
    for name in ("sample", "stream", "invert", "edit", "latent", "evaluate", "hydra_app", "sweep", "sweep_plan")
)
OUTSIDE = {
    "numpy": ("motiongen", *PROGRAMS),
    "torch": (*GENERATORS, "motiongen.recognition", *PROGRAMS),
    "roma": ("motiongen.generators.modi", *PROGRAMS),
    "scipy": (*GENERATORS, *PROGRAMS),
    "hydra": (*HYDRA_COMMANDS, *PROGRAMS),
    "omegaconf": (*HYDRA_COMMANDS, *PROGRAMS),
    "PIL": ("motiongen.render", "motiongen.commands.render", *PROGRAMS),
    "viser": ("motiongen.web", *PROGRAMS),
    "websockets": ("motiongen.web", *PROGRAMS),
    "msgspec": ("motiongen.web",),
    "safetensors": PROGRAMS,
    "rich": PROGRAMS,
    "matplotlib": PROGRAMS,
    "tensorboard": PROGRAMS,
    "pybvh": PROGRAMS,
    "tests": ("tools",),  # the slow twins are the yardsticks of some benchmarks
}

# What may not know of each other at all, not even inside a function.
STRANGERS = [
    ("motiongen.generators.genmm", "motiongen.generators.modi"),
    ("motiongen.generators.modi", "motiongen.generators.genmm"),
    ("motiongen.metrics", "motiongen.generators"),
    ("motiongen.recognition", "motiongen.generators"),
]


@dataclass(frozen=True)
class Import:
    """One imported name: by whom, what, on which line, and whether it happens as soon as the module is imported."""

    importer: str
    imported: str
    line: int
    at_once: bool

    def __str__(self) -> str:
        return f"{self.importer}, line {self.line}: imports {self.imported}"


def module_files(root: Path) -> dict[str, Path]:
    """The dotted name of every module of the project."""
    files = [path for package in ("motiongen", *PROGRAMS) for path in sorted((root / package).rglob("*.py"))]
    names = {}
    for path in files:
        parts = path.relative_to(root).with_suffix("").parts
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


def imports_of(module: str, path: Path, modules: set[str]) -> Iterator[Import]:
    """All imports of one module, inside functions too; those for type checkers count as not happening at once."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    pending: list[tuple[ast.AST, bool]] = [(ast.parse(path.read_text(encoding="utf-8")), True)]
    while pending:
        node, at_once = pending.pop()
        if isinstance(node, ast.Import):
            yield from (Import(module, alias.name, node.lineno, at_once) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                inside = f"{origin}.{alias.name}"
                yield Import(module, inside if inside in modules else origin, node.lineno, at_once)
        later = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        )
        pending += [(child, at_once and not later) for child in ast.iter_child_nodes(node)]


MODULES = module_files(ROOT)
IMPORTS = [each for name, path in MODULES.items() for each in imports_of(name, path, set(MODULES))]


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def floor_of(module: str) -> int | None:
    """The floor of the closest entry at or above `module`; the entry of `motiongen` is for its front door alone."""
    entry = module
    while entry and entry not in FLOORS:
        entry = entry.rpartition(".")[0]
    return None if entry == "motiongen" != module else FLOORS.get(entry)


def may_import(module: str, outside: str) -> bool:
    return any(within(module, package) for package in OUTSIDE.get(outside, ()))


# -- the table itself


def test_the_source_is_found() -> None:
    assert {"motiongen", "motiongen.motion", "motiongen.io", "tools.bench_rotations"} <= set(MODULES)
    assert any(each.importer == "motiongen.motion" and each.imported == "motiongen.skeleton" for each in IMPORTS)
    assert any(each.importer == "motiongen.motion" and each.imported == "motiongen.io" for each in IMPORTS)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import motiongen.motion", [("motiongen.motion", True)]),
        ("from motiongen import motion, Motion", [("motiongen.motion", True), ("motiongen", True)]),
        ("from . import io", [("motiongen.io", True)]),
        ("from .io import save", [("motiongen.io", True)]),
        ("def f():\n    import torch", [("torch", False)]),
        ("if TYPE_CHECKING:\n    import torch", [("torch", False)]),
        ("try:\n    import torch\nexcept ImportError:\n    pass", [("torch", True)]),
        ("class A:\n    import torch", [("torch", True)]),
    ],
)
def test_every_way_to_import_is_read(source: str, expected: list[tuple[str, bool]], tmp_path: Path) -> None:
    path = tmp_path / "face.py"
    path.write_text(source)
    found = imports_of("motiongen.face", path, {"motiongen", "motiongen.motion", "motiongen.io"})
    assert [(each.imported, each.at_once) for each in found] == expected


@pytest.mark.parametrize("module", MODULES)
def test_every_module_has_a_floor(module: str) -> None:
    assert floor_of(module) is not None, f"{module} is new: enter it in FLOORS in {Path(__file__).name}"


# -- the floors


@pytest.mark.parametrize("module", MODULES)
def test_a_floor_imports_only_itself_and_lower_floors(module: str) -> None:
    own = floor_of(module)
    assert own is not None
    upward = [
        f"{each} of floor {floor}, and is of floor {own}"
        for each in IMPORTS
        if each.importer == module and each.at_once and each.imported in MODULES
        if (floor := floor_of(each.imported)) is not None and floor > own
    ]
    assert upward == []


@pytest.mark.parametrize("module", MODULES)
def test_what_comes_from_elsewhere_is_allowed_here(module: str) -> None:
    for each in IMPORTS:
        outside = each.imported.split(".")[0]
        if each.importer != module or outside in sys.stdlib_module_names or outside in ("motiongen", *PROGRAMS):
            continue
        if each.at_once:
            assert outside in OUTSIDE, (
                f"{each}: enter it in OUTSIDE in {Path(__file__).name}, or import it in a function"
            )
            assert may_import(module, outside), f"{each} when it is imported itself; import it inside a function"


@pytest.mark.parametrize(("one", "other"), STRANGERS)
def test_strangers_stay_strangers(one: str, other: str) -> None:
    assert [str(each) for each in IMPORTS if within(each.importer, one) and within(each.imported, other)] == []


def test_no_module_imports_itself_in_a_circle() -> None:
    graph = {name: {i.imported for i in IMPORTS if i.importer == name and i.at_once} & set(MODULES) for name in MODULES}
    while leaves := [name for name, imported in graph.items() if not imported & set(graph)]:
        for name in leaves:
            del graph[name]
    assert graph == {}, "these import each other in a circle, or from one that does"


# -- what importing brings in

PROBE = """
import importlib, json, sys
for name in json.loads(sys.argv[1]):
    importlib.import_module(name)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def brought_in_by(modules: list[str]) -> set[str]:
    """The top-level packages that are loaded once `modules` are imported in a fresh Python."""
    command = [sys.executable, "-c", PROBE, json.dumps(modules)]
    ended = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    assert ended.returncode == 0, ended.stderr
    return set(json.loads(ended.stdout))


def test_importing_motiongen_brings_in_numpy_and_nothing_heavier() -> None:
    loaded = brought_in_by(["motiongen"])
    assert "numpy" in loaded
    assert loaded & (set(OUTSIDE) - {"numpy"}) == set()


def test_light_modules_bring_in_nothing_heavy_through_others() -> None:
    """All modules that may import nothing from elsewhere but NumPy, together, the command line among them."""
    light = [name for name in MODULES if not any(may_import(name, outside) for outside in set(OUTSIDE) - {"numpy"})]
    assert "motiongen.io" in light
    assert brought_in_by(light) & (set(OUTSIDE) - {"numpy"}) == set()
