"""What is shipped: the wheel holds what it needs and nothing else, and runs by itself in an empty folder."""

from __future__ import annotations

import configparser
import email
import os
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.xdist_group("packaging")  # one worker builds and installs for all

PACKAGES = ("motiongen",)


def run(*command: str | Path, cwd: Path, timeout: int = 120) -> str:
    """The standard output of a command that must succeed, in an environment that knows nothing of the checkout."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    ended = subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=cwd, env=environment, timeout=timeout
    )
    assert ended.returncode == 0, f"{command} ended with {ended.returncode}:\n{ended.stdout}\n{ended.stderr}"
    return ended.stdout


def build(source: Path, kind: str, into: Path) -> Path:
    """Build a `kind` of distribution ("wheel" or "sdist") from a source tree."""
    run(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", into, cwd=source)
    (built,) = into.iterdir()
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, "wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def read(wheel: Path, ending: str) -> str:
    """The one file of the wheel whose name has this ending, as text."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(ending))
        return archive.read(name).decode()


# -- what is in it


def test_every_module_configuration_and_asset_is_in_the_wheel(names: set[str]) -> None:
    modules = {path.relative_to(ROOT).as_posix() for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    assets = {path.relative_to(ROOT).as_posix() for path in (ROOT / "motiongen" / "assets").rglob("*.*")}
    configs = {f"motiongen/{path.relative_to(ROOT).as_posix()}" for path in (ROOT / "configs").rglob("*.yaml")}
    assert "motiongen/configs/sample.yaml" in configs
    assert any(asset.endswith(".bvh") for asset in assets)
    assert modules | assets | configs | {"motiongen/py.typed"} <= names


def test_nothing_else_is_in_the_wheel(names: set[str]) -> None:
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} <= set(PACKAGES)
    assert len(tops - set(PACKAGES)) == 1
    strays = ("test", "conftest", "__pycache__", ".")
    assert [name for name in names for part in name.split("/") if part.startswith(strays)] == []


def test_metadata_says_what_it_is(wheel: Path) -> None:
    scripts = configparser.ConfigParser()
    scripts.read_string(read(wheel, ".dist-info/entry_points.txt"))
    assert dict(scripts["console_scripts"]) == {"motiongen": "motiongen.cli:main"}
    metadata = email.message_from_string(read(wheel, ".dist-info/METADATA"))
    assert metadata["Name"] == "motiongen"
    assert metadata["License-Expression"] == "Apache-2.0"
    assert set(metadata.get_all("License-File", [])) == {"LICENSE", "NOTICE"}
    for licence in ("LICENSE", "NOTICE"):
        assert read(wheel, f".dist-info/licenses/{licence}") == (ROOT / licence).read_text(encoding="utf-8")
    optional = [need for need in metadata.get_all("Requires-Dist", []) if "extra ==" not in need]
    assert not any(need.startswith(("matplotlib", "imageio", "pytest", "viser", "roma")) for need in optional)


def test_the_source_distribution_builds_the_same_wheel(names: set[str], tmp_path: Path) -> None:
    with tarfile.open(build(ROOT, "sdist", tmp_path / "sdist")) as archive:
        members = [member for member in archive.getmembers() if member.isfile()]
        for member in members:  # a plain loop: safe extraction filters are newer than some supported Pythons
            target = tmp_path / "source" / Path(*Path(member.name).parts[1:])
            target.parent.mkdir(parents=True, exist_ok=True)
            content = archive.extractfile(member)
            assert content is not None
            target.write_bytes(content.read())
    with zipfile.ZipFile(build(tmp_path / "source", "wheel", tmp_path / "again")) as again:
        assert set(again.namelist()) == names
    assert (tmp_path / "source" / "tests" / "conftest.py").is_file()


def test_the_notice_credits_the_bundled_clip() -> None:
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    assert "The data used in this project was obtained from mocap.cs.cmu.edu." in " ".join(notice.split())
    assert "NSF EIA-0196217" in notice


# -- what it does once installed


@dataclass(frozen=True)
class Installation:
    """An environment that holds the wheel, and reaches the dependencies of this one."""

    scripts: Path

    def motiongen(self, *arguments: str, cwd: Path, timeout: int = 120) -> str:
        return run(self.scripts / "motiongen", *arguments, cwd=cwd, timeout=timeout)

    def python(self, program: str, cwd: Path) -> str:
        return run(self.scripts / "python", "-c", program, cwd=cwd).strip()


@pytest.fixture(scope="module")
def installation(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installation:
    folder = tmp_path_factory.mktemp("installation")
    venv.create(folder, with_pip=False, symlinks=True)
    scripts = folder / "bin"
    pip = (sys.executable, "-m", "pip", "--python", scripts / "python", "install", "--no-deps", "--no-index", "--quiet")
    run(*pip, wheel, cwd=folder)
    # A path in a .pth file makes packages importable; .pth files found there, such as the checkout's, do not count.
    where = run(scripts / "python", "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip()
    dependencies = sorted({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})
    (Path(where) / "dependencies.pth").write_text("\n".join(dependencies), encoding="utf-8")
    return Installation(scripts)


def test_the_installed_package_is_used_and_not_the_checkout(installation: Installation, tmp_path: Path) -> None:
    where = installation.python("import motiongen; print(motiongen.__file__)", tmp_path)
    assert Path(where).is_relative_to(installation.scripts.parent)


def test_help_lists_the_commands(installation: Installation, tmp_path: Path) -> None:
    words = installation.motiongen("--help", cwd=tmp_path)
    for command in ("sample", "info", "convert", "render", "list"):
        assert command in words
    assert list(tmp_path.iterdir()) == []


def test_sample_runs_in_an_empty_folder(installation: Installation, tmp_path: Path) -> None:
    installation.motiongen("sample", "frames=60", "output=out", cwd=tmp_path, timeout=300)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"sample_0000.bvh", "report.json", "report.md"} <= written
    assert {".mp4", ".gif"} & {Path(name).suffix for name in written}
    assert ".png" in {Path(name).suffix for name in written}
    frames = installation.python("import motiongen.io as io; print(len(io.load('out/sample_0000.bvh')))", tmp_path)
    assert frames == "60"
