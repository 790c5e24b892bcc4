"""The shape of the house, read from the code's own imports: who may import what, and who may read the truth."""

import ast
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
SIBLINGS = ("simulation", "network", "data/recording")
FOUNDATION = (
    "types",
    "geometry",
    "config",
    "errors",
    "extras",
    "findings",
    "garbage_collection",
    "image_validity",
    "atomic_files",
    "cache_folder",
    "palette",
    "plugins",
    "preprocessing",
    "protobuf_fields",
    "sole_writer",
    "structured_text",
    "readable_text",
    "terminal_text",
    "cameras",
    "robots",
    "worlds",
)

TRUTH_READERS = (
    "ltvn_core/simulation",
    "ltvn_core/data/recording",
    "ltvn_core/evaluation",
    "ltvn_core/data/exporting",
    "ltvn_core/preprocessing.py",
    "ltvn_viz",
)


CORE_ORDER = (
    "foundation",
    "graph",
    "navigation",
    "analysis",
    "data",
    "simulation",
    "network",
    "predictors",
    "systems",
    "training",
    "maps",
    "evaluation",
    "testing",
    "verbs",
    "cli",
)
"""The parts of the core, low to high: a part imports those before it alone. A new part needs its place here."""

BUILD_LINES = 22_000
"""The most lines of the house that making a map may be able to reach: neither simulator, robots nor learning."""

LIGHT_LIBRARIES = {"numpy", "rustworkx", "scipy", "ltvn_core"}
"""All that graph, navigation and analysis need: no simulator, network, viewer or image library."""

ROOMS = (
    "wishes",
    "server",
    "timeline",
    "session",
    "layers",
    "panels",
    "debugger",
    "agent",
    "page_layout",
    "app_opening",
    "app",
    "pairs",
    "verbs",
)
"""The rooms of the page, low to high: a room imports those before it alone."""


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


def core_parts(path: Path) -> set[str]:
    """Names of the top-level parts of ltvn_core that a file imports."""
    return {name.split(".")[1] for name in imports(path) if name.startswith("ltvn_core.")}


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


def test_core_never_imports_the_page_nor_what_is_outside_the_packages() -> None:
    outside = ("ltvn_viz", "benchmarks", "examples", "figures", "tests", "tools")
    offenders = [
        relative(path)
        for path in (ROOT / "ltvn_core").rglob("*.py")
        if any(name.split(".")[0] in outside for name in imports(path))
    ]
    assert offenders == []


def test_no_module_imports_itself_through_others() -> None:
    assert circles(import_graph()) == []


def test_the_parts_of_the_core_import_only_lower_parts() -> None:
    def place(module: str) -> int:
        part = module.split(".")[1]
        return CORE_ORDER.index("foundation" if part in FOUNDATION else part)

    offenders = [
        f"{module} imports {other}"
        for module, others in import_graph().items()
        for other in others
        if module.startswith("ltvn_core.") and other.startswith("ltvn_core.")
        if place(other) > place(module)
    ]
    assert offenders == []


def test_building_a_map_reaches_neither_simulator_nor_training() -> None:
    house = House(ROOT)
    reached = house.reached_from("ltvn_core.verbs.build")
    parts = {name.split(".")[1] for name in reached}

    assert not parts & {"simulation", "training", "importing"}
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


def test_kinds_of_scenes_and_renderers_know_nothing_of_each_other() -> None:
    kinds = ("apartments", "meshes", "rendering")
    offenders = [
        f"{module} imports {other}"
        for module, others in import_graph().items()
        for other in others
        if module.startswith("ltvn_core.simulation.") and other.startswith("ltvn_core.simulation.")
        if module.split(".")[2] in kinds and other.split(".")[2] in (*kinds, "scene_registry")
        if module.split(".")[2] != other.split(".")[2]
    ]
    assert offenders == []


def test_the_rooms_of_the_page_import_only_lower_rooms() -> None:
    offenders = [
        f"{module} imports {other}"
        for module, others in import_graph().items()
        for other in others
        if module.startswith("ltvn_viz.") and other.startswith("ltvn_viz.")
        if ROOMS.index(other.split(".")[1]) > ROOMS.index(module.split(".")[1])
    ]
    assert offenders == []


@pytest.mark.parametrize("part", FOUNDATION)
def test_the_foundation_imports_only_itself(part: str) -> None:
    allowed = {*FOUNDATION, "graph"} if part == "config" else {*FOUNDATION}
    for path in files_of(part):
        assert core_parts(path) <= allowed, relative(path)


def test_graph_stands_on_the_foundation_alone() -> None:
    for path in files_of("graph"):
        assert core_parts(path) <= {*FOUNDATION, "graph"}, relative(path)


def test_nav_stands_on_graph_and_the_foundation() -> None:
    for path in files_of("navigation"):
        assert core_parts(path) <= {*FOUNDATION, "graph", "navigation"}, relative(path)


def test_analysis_needs_neither_simulator_nor_network() -> None:
    for path in files_of("analysis"):
        assert core_parts(path) <= {*FOUNDATION, "graph", "navigation", "recording", "analysis"}, relative(path)


@pytest.mark.parametrize("part", SIBLINGS)
def test_siblings_do_not_import_each_other(part: str) -> None:
    others = set(SIBLINGS) - {part}
    for path in files_of(part):
        assert not core_parts(path) & others, relative(path)


def test_the_method_never_reads_the_truth() -> None:
    readers = [
        relative(path)
        for path in MODULES
        if not relative(path).startswith((*TRUTH_READERS, *COMPOSERS))
        and any(isinstance(node, ast.Attribute) and node.attr == "exact_pose" for node in ast.walk(syntax(path)))
    ]
    assert readers == []


def test_only_the_command_line_and_the_page_import_verbs() -> None:
    outer = ("ltvn_core/cli.py", "ltvn_core/verbs", "ltvn_viz")
    inner = [path for path in MODULES if not relative(path).startswith(outer)]

    assert [relative(path) for path in inner if "verbs" in core_parts(path)] == []
