"""Virtual environments that hold the wheel and exactly what one extra asks for; nothing is downloaded.

The libraries are hard links to those of the environment that runs the tests. The requirements are read from the wheel,
so an extra that forgets a library fails here as it would on another machine.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator
from email.parser import Parser
from importlib.metadata import Distribution, distribution
from pathlib import Path
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]


def build_wheel(folder: Path) -> Path:
    """Build the wheel of what git tracks here from a copy, so that no leftovers of older builds get in."""
    source, dist = folder / "source", folder / "dist"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True).stdout
    wanted = [name for name in tracked.decode().split("\0") if name and not name.startswith(("docs/", "tests/"))]
    for name in wanted:
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, source / name)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", str(dist), str(source)], check=True)
    return next(dist.glob("ltvn-*.whl"))


def install_with_extra(folder: Path, wheel: Path, extra: str = "") -> Path:
    """Make an environment with the wheel and what an extra needs, no extra if empty; return its `ltvn`.

    Raises PackageNotFoundError for a requirement that the running environment lacks.
    """
    venv.create(folder, with_pip=False)
    packages = Path(sysconfig.get_path("purelib", scheme="venv", vars={"base": str(folder)}))
    for each in _closure(wheel, extra).values():
        _link(each, packages)
    pip = [sys.executable, "-m", "pip", "--python", str(folder), "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], check=True)
    return program_of(folder)


def program_of(folder: Path) -> Path:
    """Return the `ltvn` of an environment."""
    scripts = Path(sysconfig.get_path("scripts", scheme="venv", vars={"base": str(folder)}))
    return scripts / ("ltvn.exe" if sys.platform == "win32" else "ltvn")


def extras_of(wheel: Path) -> list[str]:
    """Return the names of all extras of a wheel."""
    return _metadata(wheel)["extra"]


def _closure(wheel: Path, extra: str) -> dict[str, Distribution]:
    """Return the distributions that an extra of a wheel needs, by canonical name, without the wheel itself."""
    own = _metadata(wheel)["requires"]
    found: dict[str, Distribution] = {}
    done: set[tuple[str, frozenset[str]]] = set()
    waiting = [Requirement(f"ltvn[{extra}]" if extra else "ltvn")]
    while waiting:
        wanted = waiting.pop()
        name, extras = canonicalize_name(wanted.name), frozenset(wanted.extras)
        if (name, extras) in done:
            continue
        done.add((name, extras))
        if name == "ltvn":
            waiting.extend(_applying(own, extras))
            continue
        found[name] = distribution(wanted.name)
        waiting.extend(_applying(found[name].requires or [], extras))
    return found


def _applying(requirements: list[str], extras: frozenset[str]) -> Iterator[Requirement]:
    for each in map(Requirement, requirements):
        if each.marker is None or any(each.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield each


def _metadata(wheel: Path) -> dict[str, list[str]]:
    with ZipFile(wheel) as file:
        name = next(each for each in file.namelist() if each.endswith(".dist-info/METADATA"))
        fields = Parser().parsestr(file.read(name).decode())
    return {"requires": fields.get_all("Requires-Dist", []), "extra": fields.get_all("Provides-Extra", [])}


def _link(installed: Distribution, packages: Path) -> None:
    """Link the files of a distribution into a folder of packages, also what Python compiled; scripts stay out."""
    for each in installed.files or ():
        source, target = Path(str(each.locate())), packages / each
        if ".." in each.parts or not source.is_file():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(source, target)
        except OSError:  # Another disk. Python takes what it compiled only with the time of its source.
            shutil.copy2(source, target)
