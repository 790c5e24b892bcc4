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
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

import ltvn_core
from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.results import TrialResult

FACTORS = (0.8, 1.25)
_ROOT = Path(ltvn_core.__file__).parent
_NOT_SHOWN = {
    "graph.connectivity", "graph.feature_rows", "graph.node_layout", "graph.topological_graph",
    "graph.presence.persistent", "graph.presence.presence_maintenance", "graph.presence.presence_observations",
    "graph.presence.presence_plan", "navigation.map_learner", "navigation.bystanders",
}  # fmt: skip
"""Modules without a number of the method, or whose numbers act only where maps change or people walk."""
_DRIVING_ONLY = {"graph.place_belief", "graph.planner", "graph.localiser", "graph.ltvn"}
"""Modules of `graph` that do not build maps. Those of `navigation` do not, either."""
_CHILD = (
    "import sys; from benchmarks.numbers import scale; scale(sys.argv.pop(1), float(sys.argv.pop(1))); "
    "from ltvn_core.cli import main; main()"
)


@dataclass(frozen=True)
class Sensitivity:
    """What became of the episodes with the numbers of one module scaled."""

    module: str
    """Such as graph.place_belief; empty for the unchanged method."""
    numbers: int
    factor: float
    episodes: int
    reached: int
    spl: float
    collisions: float
    """Per episode."""


@dataclass(frozen=True)
class NumbersSummary:
    """The sensitivity to the numbers of each module."""

    scene: str
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

        from ltvn_core.evaluation.reports.evaluation_page import fill_blocks

        started = time.monotonic()
        rows = [_sensitivity(self._trial("", 1.0), "", 1.0)]
        for module in tqdm(self.module or tuple(scalable_modules()), unit="module"):
            rows += [_sensitivity(self._trial(module, factor), module, factor) for factor in FACTORS]
            if self.page is not None:
                fill_blocks(self.page, {"numbers": markdown(rows)})
        return NumbersSummary(self.scene, rows, round(time.monotonic() - started, 1))

    def _trial(self, module: str, factor: float) -> "TrialResult":
        """Drive the episodes with the numbers of a module scaled, unless they were driven before."""
        from ltvn_core.evaluation.results import TrialResult, load_results

        folder = self.folder / (f"{module}-{factor:g}" if module else "whole")
        name = "-".join([self.scene, *self.conditions, "0"])
        result = folder / name / f"ltvn-{self.episodes}.trial.json"
        if not result.exists():
            if module:
                builds = module.startswith("graph.") and module not in _DRIVING_ONLY
                _copy_inputs(self.folder / "whole" / name, folder / name, with_map=not builds)
            options = ["--scene", self.scene, "--conditions", *self.conditions, "--body", "planar", "--seed", "0"]
            options += ["--episodes", str(self.episodes), "--folder", str(folder), "--processes", "1"]
            scaled = [module or "navigation", str(factor)]  # One process, which is the one that imports scaled numbers.
            subprocess.run([sys.executable, "-c", _CHILD, *scaled, "evaluate", *options], check=True)
        return load_results(result, TrialResult)


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
    sys.meta_path.insert(0, _ScaledImport(f"ltvn_core.{module}", factor))


class _ScaledImport(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module with scaled numbers."""

    def __init__(self, name: str, factor: float) -> None:
        self._name = name
        self._factor = factor

    def find_spec(self, fullname: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name or _path(fullname.removeprefix("ltvn_core.")).name == "__init__.py":
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin=str(_path(fullname.removeprefix("ltvn_core."))))

    def exec_module(self, module: object) -> None:
        tree = ast.fix_missing_locations(_Scaling(self._factor).visit(_parsed(self._name.removeprefix("ltvn_core."))))
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


def markdown(rows: Sequence[Sensitivity]) -> str:
    """Return the table of all modules that are done."""
    whole, *others = rows
    lines = ["| module | numbers |", "| --- | ---: |"]
    for factor in FACTORS:
        lines[0] += f" times {factor:g}: reached | SPL | collisions |"
        lines[1] += " ---: | ---: | ---: |"
    lines.append(f"| *unchanged* | | {_cells(whole)} | {_cells(whole)} |")
    for first, second in zip(others[::2], others[1::2], strict=True):
        name = first.module.replace(".", "/") + ".py"
        lines.append(f"| `{name}` | {first.numbers} | {_cells(first)} | {_cells(second)} |")
    return "\n".join(lines) + "\n"


def _cells(row: Sensitivity) -> str:
    return f"{row.reached} of {row.episodes} | {row.spl:.2f} | {row.collisions:.1f}"


def _sensitivity(trial: "TrialResult", module: str, factor: float) -> Sensitivity:
    from ltvn_core.evaluation.metrics import compute_metrics

    found = compute_metrics([trial])
    return Sensitivity(
        module=module,
        numbers=numbers_of(module) if module else 0,
        factor=factor,
        episodes=found.episodes,
        reached=sum(each.reached for each in trial.episodes),
        spl=round(found.spl.mean, 3),
        collisions=round(found.collisions_per_episode.mean, 3),
    )


def _copy_inputs(source: Path, target: Path, *, with_map: bool) -> None:
    """Copy the drive and the weights, and the map where it stays the same."""
    kept = ["drive.*", "*.safetensors", "*.card.json"]
    if with_map:
        kept += ["*.npz", "*.rrd", "*.plan.json", "ltvn/map-*.rrd", "ltvn/plan.json"]
    for path in {path for pattern in kept for path in source.glob(pattern)}:
        copy = target / path.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)


def _parsed(module: str) -> ast.Module:
    return ast.parse(_path(module).read_text(encoding="utf-8"))


def _path(module: str) -> Path:
    plain = _ROOT.joinpath(*module.split(".")).with_suffix(".py")
    return plain if plain.exists() else plain.with_suffix("") / "__init__.py"


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.numbers", NumbersVerb))
