"""The shape of the house, read from the code's own imports: who may import what, and who may read the truth."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.repository import ROOT
from tools.house_counts import House, Part, parts

MODULES = sorted([*(ROOT / "ltvn_core").rglob("*.py"), *(ROOT / "ltvn_viz").rglob("*.py")])

HOMES = {
    "viser": ("ltvn_viz",),
    "pybullet": ("ltvn_core/simulation",),
    "torch": ("ltvn_core/network",),
    "rerun": ("ltvn_core/data/recording",),
    "jinja2": ("ltvn_core/evaluation/reports",),
    "matplotlib": ("ltvn_core/evaluation/reports",),
    "rosbags": ("ltvn_core/data/importing", "ltvn_core/data/exporting", "ltvn_core/robots/ros2"),
    "zenoh": ("ltvn_core/robots/ros2/zenoh_link.py",),
    "av": ("ltvn_core/data/importing",),
    "mcp": ("ltvn_viz/agent/server.py",),
}

COMPOSERS = (
    "ltvn_core/cli",
    "ltvn_core/evaluation",
    "ltvn_core/testing.py",
    "ltvn_core/training",
    "ltvn_core/network/training_data",
    "ltvn_core/verbs",
    "ltvn_viz",
)
TRUTH_READERS = (
    "ltvn_core/simulation",
    "ltvn_core/data/recording",
    "ltvn_core/evaluation",
    "ltvn_core/data/exporting",
    "ltvn_core/preprocessing.py",
    "ltvn_viz",
)


BUILD_LINES = 22_000
"""The most lines of the house that making a map may be able to reach: neither simulator, robots nor learning."""

LIGHT_LIBRARIES = {"numpy", "rustworkx", "scipy", "ltvn_core"}
"""All that graph, navigation and analysis need: no simulator, network, viewer or image library."""


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def syntax(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Every module that a file imports anywhere, inside functions too."""
    found: list[str] = []
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Import):
            found += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += (f"{node.module}.{alias.name}" for alias in node.names)
    return tuple(found)


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def import_graph() -> dict[str, set[str]]:
    """The modules of both packages and which of them each imports: at the top, in functions, or for type checkers."""
    names = {module_name(path) for path in MODULES}
    graph: dict[str, set[str]] = {}
    for path in MODULES:
        found = {name if name in names else name.rpartition(".")[0] for name in imports(path)}
        graph[module_name(path)] = (found & names) - {module_name(path)}
    return graph


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """What cannot be put into an order in which each imports only those before it, after taking away all that can."""
    left = {name: set(others) for name, others in graph.items()}
    while free := [name for name, others in left.items() if not others & left.keys()]:
        for name in free:
            del left[name]
    return [sorted(left)] if left else []


def files_of(part: str) -> list[Path]:
    package = ROOT / "ltvn_core" / part
    return sorted(package.rglob("*.py")) if package.is_dir() else [package.with_suffix(".py")]


@pytest.mark.parametrize("library", HOMES)
def test_a_heavy_library_is_imported_only_in_its_home(library: str) -> None:
    strangers = [
        relative(path)
        for path in MODULES
        if any(name.split(".")[0] == library for name in imports(path))
        and not relative(path).startswith(HOMES[library])
    ]
    assert strangers == []


def test_no_module_imports_itself_through_others() -> None:
    assert circles(import_graph()) == []


def test_parts_import_only_what_they_may() -> None:
    """The contracts are in pyproject.toml; in a process of its own, because import-linter silences other loggers."""
    check = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True, no_logo=True))"
    done = subprocess.run([sys.executable, "-c", check], cwd=ROOT, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_building_a_map_reaches_little_of_the_house() -> None:
    house = House(ROOT)
    reached = house.reached_from("ltvn_core.verbs.build")
    assert sum(house.lines[name] for name in reached) <= BUILD_LINES


@pytest.mark.parametrize("part", [*parts(ROOT)], ids=lambda part: part.names)
def test_no_part_of_the_house_grows_above_its_ceiling(part: Part) -> None:
    assert part.lines <= part.ceiling, "cut before you add; `python -m tools.house_counts --ceilings` prints the table"


def test_every_module_stands_under_exactly_one_ceiling() -> None:
    modules = set(MODULES)
    assert sorted(file for part in parts(ROOT) for file in part.files & modules) == MODULES


@pytest.mark.parametrize("part", ["graph", "navigation", "analysis"])
def test_the_method_and_its_analysis_need_numpy_and_a_graph_library_alone(part: str) -> None:
    heavy = {
        f"{relative(path)} imports {name}"
        for path in files_of(part)
        for name in imports(path)
        if name.split(".")[0] not in LIGHT_LIBRARIES | sys.stdlib_module_names
    }
    assert heavy == set()


def test_the_method_never_reads_the_truth() -> None:
    readers = [
        relative(path)
        for path in MODULES
        if not relative(path).startswith((*TRUTH_READERS, *COMPOSERS))
        and any(isinstance(node, ast.Attribute) and node.attr == "exact_pose" for node in ast.walk(syntax(path)))
    ]
    assert readers == []
