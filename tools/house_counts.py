"""Print the size and the shape of the two packages: `python -m tools.house_counts [ROOT]`.

Lines and modules, modules that one sibling alone imports, who makes a Navigator or a KeyframeStore, imports inside
functions, tuple assignments, the length of functions, and how much of the house each verb can reach. A count is a
thermometer and no goal: nothing is squeezed to lower it. With `--ceilings`, print instead the lines of each part beside
its ceiling in `tools/ceilings.txt`, and end with status 1 where a part is above it.
"""

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import NamedTuple, TypeAlias

PACKAGES = ("ltvn_core", "ltvn_viz")
COUNTED_CALLS = ("Navigator", "KeyframeStore")

Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef


class House:
    """All modules below a root, parsed."""

    def __init__(self, root: Path) -> None:
        """Read every file of both packages."""
        files = [file for package in PACKAGES for file in sorted((root / package).rglob("*.py"))]
        texts = {_module_name(file.relative_to(root)): file.read_text(encoding="utf-8") for file in files}
        self.trees = {name: ast.parse(text) for name, text in texts.items()}
        self.lines = {name: text.count("\n") for name, text in texts.items()}

    @cached_property
    def imports(self) -> dict[str, set[str]]:
        """The modules of the house that each module imports, for type checkers too."""
        return {name: set(self._imported(name, tree)) - {name} for name, tree in self.trees.items()}

    def _imported(self, module: str, tree: ast.AST) -> Iterator[str]:
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names if alias.name in self.trees)
            elif isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    if inner in self.trees:
                        yield inner
                    elif node.module in self.trees:
                        yield node.module

    def reached_from(self, module: str) -> set[str]:
        """Return the modules that a module can reach when it runs, itself included."""
        reached, waiting = set[str](), [module]
        while waiting:
            name = waiting.pop()
            if name not in reached:
                reached.add(name)
                waiting.extend(self.imports[name] - self._for_types_alone(name))
        return reached

    def _for_types_alone(self, module: str) -> set[str]:
        """Return the modules that a module imports for type checkers and nowhere else."""
        tree = self.trees[module]
        typing = [node for node in tree.body if _is_for_type_checkers(node)]
        running = ast.Module([node for node in tree.body if not _is_for_type_checkers(node)], [])
        return {name for node in typing for name in self._imported(module, node)} - set(self._imported(module, running))

    def one_sibling_modules(self) -> list[str]:
        """Return the modules that one module alone imports, and that one from the same folder."""
        importers = defaultdict[str, set[str]](set)
        for name, others in self.imports.items():
            for other in others:
                importers[other].add(name)
        return sorted(
            name
            for name, found in importers.items()
            if len(found) == 1 and next(iter(found)).rpartition(".")[0] == name.rpartition(".")[0]
        )

    def functions(self) -> Iterator[Function]:
        """Yield every function and method."""
        for tree in self.trees.values():
            yield from (node for node in ast.walk(tree) if isinstance(node, Function))

    def calls(self, name: str) -> list[str]:
        """Return the modules that call a name, once for each call."""
        return sorted(
            module
            for module, tree in self.trees.items()
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
        )


def _is_for_type_checkers(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def _module_name(file: Path) -> str:
    parts = file.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def lazy_imports(house: House) -> int:
    """Return how many imports stand inside functions."""
    return sum(isinstance(node, ast.Import | ast.ImportFrom) for each in house.functions() for node in ast.walk(each))


def type_only_imports(house: House) -> int:
    """Return how many imports are for type checkers alone."""
    return sum(
        isinstance(inner, ast.Import | ast.ImportFrom)
        for tree in house.trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and _is_for_type_checkers(node)
        for inner in node.body
    )


def tuple_assignments(house: House) -> int:
    """Return how many assignments set several names from a tuple that is written out."""
    return sum(
        isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
        for tree in house.trees.values()
        for node in ast.walk(tree)
    )


def counts(house: House) -> list[tuple[str, str]]:
    """Return all counts as rows of name and value."""
    total = sum(house.lines.values())
    lengths = sorted((each.end_lineno or each.lineno) - each.lineno + 1 for each in house.functions())
    pairs = tuple_assignments(house)
    rows = [
        ("lines", f"{total:,}"),
        ("modules", f"{len(house.trees):,}"),
        ("modules that one sibling alone imports", f"{len(house.one_sibling_modules())}"),
        ("function median, p90, max", f"{median(lengths):.0f}, {lengths[len(lengths) * 9 // 10]}, {lengths[-1]}"),
        ("functions of more than 20 lines", f"{sum(length > 20 for length in lengths)} of {len(lengths)}"),
        ("imports inside functions", f"{lazy_imports(house)}"),
        ("imports for type checkers alone", f"{type_only_imports(house)}"),
        ("tuple assignments (per 1,000 lines)", f"{pairs} ({1000 * pairs / total:.1f})"),
    ]
    for name in COUNTED_CALLS:
        found = house.calls(name)
        rows.append((f"calls of {name}", f"{len(found)} in {len(set(found))} modules"))
    return rows + _reached_rows(house)


def _reached_rows(house: House) -> list[tuple[str, str]]:
    verbs = [name for name in house.trees if ".verbs." in name and house.lines[name] > 1]
    rows = []
    for name in sorted(verbs):
        if any(isinstance(node, ast.ClassDef) and node.name.endswith("Verb") for node in house.trees[name].body):
            reached = house.reached_from(name)
            rows.append((f"{name} reaches", f"{sum(house.lines[each] for each in reached):,} lines in {len(reached)}"))
    return rows


class Part(NamedTuple):
    """Some folders of the repository, and how many lines they may have."""

    ceiling: int
    names: str
    files: frozenset[Path]

    @property
    def lines(self) -> int:
        """The lines that they have."""
        return sum(file.read_bytes().count(b"\n") for file in self.files)


def parts(root: Path) -> Iterator[Part]:
    """Yield the parts of the table of ceilings."""
    for line in (root / "tools" / "ceilings.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            ceiling, *names = line.split()
            patterns = [name if "*" in name else f"{name}/**/*.py" for name in names]
            yield Part(int(ceiling), " ".join(names), frozenset(file for each in patterns for file in root.glob(each)))


def main() -> int:
    """Print the counts of this tree, or of the one whose root is given, and return the exit status."""
    given = [argument for argument in sys.argv[1:] if argument != "--ceilings"]
    root = Path(given[0]) if given else Path(__file__).parents[1]
    if "--ceilings" not in sys.argv:
        for name, value in counts(House(root)):
            sys.stdout.write(f"{name:<48} {value}\n")
        return 0
    found = [*parts(root)]
    for part in found:
        mark = "ABOVE" if part.lines > part.ceiling else ""
        sys.stdout.write(f"{part.lines:7,} of {part.ceiling:6,}  {part.names}  {mark}".rstrip() + "\n")
    return int(any(part.lines > part.ceiling for part in found))


if __name__ == "__main__":
    sys.exit(main())
