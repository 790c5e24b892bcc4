"""`python -m benchmarks.numbers`: how sensitive the method is to the numbers that stand in its modules.

All numbers of one module are scaled at once, in the source before it is run, and the same episodes are driven again on
a map of the same drive. A module whose scaled numbers change nothing holds none that had to be chosen with care. Goes
on from what its folder holds. Owns which modules are scaled, and the table.
"""

import ast
import importlib.abc
import importlib.machinery
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

import ltvn_core
from benchmarks.rules import Achieved, summed_up, table
from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.results import TestedMap

FACTORS = (0.8, 1.25)
_ROOT = Path(ltvn_core.__file__).parent
_NOT_SHOWN = {
    "graph.topological_graph", "graph.presence.presence_filter", "graph.presence.edge_presence",
    "navigation.bystanders",
}  # fmt: skip
"""Modules without a number of the method, or whose numbers act only where maps change or people walk."""
_DRIVING_ONLY = {"graph.place_belief", "graph.planner", "graph.localiser", "graph.ltvn"}
"""Modules of `graph` that do not build maps. Those of `navigation` do not, either."""
_EVALUATE = "from ltvn_core.cli import main; main()"


@dataclass(frozen=True)
class Sensitivity:
    """What became of the episodes with the numbers of one module scaled."""

    module: str
    """Such as graph.place_belief."""
    numbers: int
    """Numbers in the module."""
    factor: float
    achieved: Achieved


@dataclass(frozen=True)
class NumbersSummary:
    """The sensitivity to the numbers of each module."""

    whole: Achieved
    """What the unchanged method came to."""
    rows: list[Sensitivity]
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class NumbersVerb(Verb):
    """Drive the same episodes with the numbers of one module scaled at a time; resumable."""

    scene: str = "tune-1"
    """Scene by name, none of the test scenes."""
    conditions: tuple[str, ...] = ("slip", "one-loop")
    """What is harder than usual."""
    module: tuple[str, ...] = ()
    """Modules below `ltvn_core`, for instance navigation.steering; by default all whose numbers matter to a frozen
    map."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Episodes for each module and factor."""
    folder: Path = Path("runs/numbers")
    """Where drives, weights, maps and results are kept, and found again by the next call."""
    page: Path | None = None
    """Write the table into this Markdown page, between the lines of its block `numbers`."""

    def run(self) -> Summary:
        """Run what is missing, module after module, and sum up."""
        from tqdm import tqdm

        from tools.results_page import fill_blocks

        started = time.monotonic()
        whole = summed_up(self._trial("whole", _EVALUATE))
        rows: list[Sensitivity] = []
        for module in tqdm(self.module or tuple(scalable_modules()), unit="module"):
            rows += [self._scaled(module, factor) for factor in FACTORS]
            if self.page is not None:
                fill_blocks(self.page, {"numbers": markdown(whole, rows)})
        return NumbersSummary(whole, rows, round(time.monotonic() - started, 1))

    def _scaled(self, module: str, factor: float) -> Sensitivity:
        """Drive the episodes with the numbers of a module scaled, on the same map if the module builds none."""
        name = f"{module}-{factor:g}"
        builds = module.startswith("graph.") and module not in _DRIVING_ONLY
        if not self._place(name).exists():
            _copy_inputs(self._place("whole"), self._place(name), with_map=not builds)
        code = f"from benchmarks.numbers import scale; scale({module!r}, {factor}); {_EVALUATE}"
        return Sensitivity(module, numbers_of(module), factor, summed_up(self._trial(name, code)))

    def _place(self, name: str) -> Path:
        return self.folder / name / "-".join([self.scene, *self.conditions, "0"])

    def _trial(self, name: str, code: str) -> "TestedMap":
        """Run the evaluation by this code of Python; what was run before is only read."""
        from ltvn_core.evaluation.results import read_runs, rows_in

        options = ["--scene", self.scene, "--conditions", *self.conditions, "--body", "planar", "--seed", "0"]
        options += ["--episodes", str(self.episodes), "--folder", str(self.folder / name)]
        # One process, which is the one that imports scaled numbers.
        subprocess.run([sys.executable, "-c", code, "evaluate", *options, "--processes", "1"], check=True)
        (run,) = read_runs(rows_in(self._place(name)))
        return replace(run.maps[0], episodes=run.maps[0].episodes[: self.episodes])


def scalable_modules() -> Iterator[str]:
    """Yield the modules of the method that hold numbers of their own, by their names below `ltvn_core`."""
    for room in ("graph", "navigation"):
        for path in sorted((_ROOT / room).rglob("*.py")):
            module = ".".join(path.relative_to(_ROOT).with_suffix("").parts)
            if module not in _NOT_SHOWN and numbers_of(module):
                yield module


def numbers_of(module: str) -> int:
    """Return how many numbers stand in the constants of a module."""
    counter = _Scaling(1.0)
    counter.visit(_parsed(module))
    return counter.count


def scale(module: str, factor: float) -> None:
    """Let the next import of a module below `ltvn_core` scale all numbers in its constants."""
    sys.meta_path.insert(0, _ScaledImport(module, factor))


class _ScaledImport(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module with scaled numbers."""

    def __init__(self, name: str, factor: float) -> None:
        self._name = name
        self._factor = factor

    def find_spec(self, fullname: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        return importlib.machinery.ModuleSpec(fullname, self) if fullname == f"ltvn_core.{self._name}" else None

    def exec_module(self, module: object) -> None:
        tree = ast.fix_missing_locations(_Scaling(self._factor).visit(_parsed(self._name)))
        exec(compile(tree, self._name, "exec"), vars(module))


class _Scaling(ast.NodeTransformer):
    """Scales the numbers in the constants at the top level of a module; a number stays on
    its side of 1."""

    def __init__(self, factor: float) -> None:
        self.count = 0
        self._factor = factor

    def visit_Module(self, node: ast.Module) -> ast.Module:
        for statement in node.body:
            if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
                statement.value = self.visit(statement.value)
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        is_shape = isinstance(node.func, ast.Attribute) and node.func.attr == "empty"
        return node if is_shape else self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float) or value in (0, 1, -1):
            return node
        self.count += 1
        scaled = value * self._factor
        if isinstance(value, int):
            return ast.Constant(max(round(scaled), 1))
        return ast.Constant(min(scaled, 0.99) if value < 1 else max(scaled, 1.01))


def markdown(whole: Achieved, rows: Sequence[Sensitivity]) -> str:
    """Return the table of all modules that are done."""
    head = ["module", "numbers"]
    for factor in FACTORS:
        head += [f"times {factor:g}: reached", "SPL", "collisions"]
    lines = [["*unchanged*", "", *_cells(whole), *_cells(whole)]]
    for first, second in zip(rows[::2], rows[1::2], strict=True):
        name = first.module.replace(".", "/") + ".py"
        lines.append([f"`{name}`", f"{first.numbers}", *_cells(first.achieved), *_cells(second.achieved)])
    return table(head, lines)


def _cells(achieved: Achieved) -> list[str]:
    return [f"{achieved.reached} of {achieved.episodes}", f"{achieved.spl:.2f}", f"{achieved.collisions:.1f}"]


def _copy_inputs(source: Path, target: Path, *, with_map: bool) -> None:
    """Copy the drive and the weights, and the map where it stays the same."""
    kept = ["drive.*", "*.safetensors", "*.card.json"]
    if with_map:
        kept += ["*.npz", "*.rrd", "*.plan.json", "ltvn/map-*.rrd", "ltvn/run.json"]
    for path in {path for pattern in kept for path in source.glob(pattern)}:
        copy = target / path.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)


def _parsed(module: str) -> ast.Module:
    return ast.parse(_ROOT.joinpath(*module.split(".")).with_suffix(".py").read_text(encoding="utf-8"))


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.numbers", NumbersVerb))
