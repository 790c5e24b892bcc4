"""Docstrings and comments name what the code has, and the docstring of each field can be read alone."""

import ast
import builtins
import re
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import pytest

from tests.repository import ROOT

PACKAGES = ("ltvn_core", "ltvn_viz")
MODULES = tuple(sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")))
DOCUMENTS = tuple(sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "recordings").rglob("*.md")]))

_IN_BACKTICKS = re.compile(r"(?<!`)`([^`]+)`(?!`)")
_COMMENT = re.compile(r"(^|\s)# .*")
_WORD = re.compile(r"[A-Za-z_]\w*")
_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+(\(\))?")
_SOURCE_PATH = re.compile(r"([\w-]+/)*[\w-]+\.(py|js|css|md)|(ltvn_core|ltvn_viz|docs|tools|tests)/[\w./-]+")
_DATA_FILE = re.compile(r".+\.(csv|gz|jpg|json|jsonl|mcap|pkl|png|toml|txt|yaml|glb)")
_CONTINUATIONS = re.compile(
    r"(an?|and|are|as|at|both|but|by|for|from|how|if|in|is|its?|likewise|nor|not|of|on|or|so|than|that|the|their|then|"
    r"these|they|this|those|to|unless|when|where|which|while|who|whose|with|without)\b"
)
"""Words that begin a sentence only with a capital letter; symbols such as d or fx may begin one as they are."""

Reference = tuple[int, str]
"""A line, and what stands in backticks there."""


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def blocks_of(path: Path) -> tuple[list[ast.stmt], ...]:
    """Return the blocks of statements of a module, without looking into expressions."""
    blocks: list[list[ast.stmt]] = []
    waiting: list[ast.AST] = [tree_of(path)]
    while waiting:
        node = waiting.pop()
        for name in ("body", "orelse", "finalbody"):
            block = getattr(node, name, [])
            if isinstance(block, list):
                blocks.append(block)
                waiting += block
    return tuple(blocks)


def text_of(statement: ast.stmt) -> ast.Constant | None:
    """Return the string that a statement consists of."""
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return None
    return statement.value if isinstance(statement.value.value, str) else None


@cache
def docstrings_of(path: Path) -> tuple[ast.Constant, ...]:
    """Return the docstrings of a module, its classes, functions and fields."""
    return tuple(text for block in blocks_of(path) for each in block if (text := text_of(each)) is not None)


@cache
def code_of(path: Path) -> list[str]:
    """Return the lines of a module, without its docstrings and comments."""
    lines = path.read_text(encoding="utf-8").splitlines()
    for docstring in docstrings_of(path):
        last = docstring.end_lineno or docstring.lineno
        lines[docstring.lineno - 1 : last] = [""] * (last - docstring.lineno + 1)
    return [_COMMENT.sub("", line) for line in lines]


def words_of(lines: list[str]) -> frozenset[str]:
    """Return the names in code, dotted ones too, and the words in its strings, which may be keys of a file."""
    text = "\n".join(lines)
    return frozenset(_WORD.findall(text)) | frozenset(found.group() for found in _DOTTED.finditer(text))


@cache
def words_in(path: Path) -> frozenset[str]:
    return words_of(code_of(path))


@cache
def house_words() -> frozenset[str]:
    """Return all words of the packages' code, of their settings, and of the page's scripts."""
    files = [ROOT / "pyproject.toml", *(ROOT / "ltvn_viz" / "static").glob("*.js"), *ROOT.glob("ltvn_core/**/*.toml")]
    words = frozenset(_WORD.findall(" ".join(path.read_text(encoding="utf-8") for path in files)))
    return words.union(*map(words_in, MODULES), *(path.relative_to(ROOT).with_suffix("").parts for path in MODULES))


@cache
def house_classes() -> dict[str, tuple[frozenset[str], frozenset[str]]]:
    """Return the words in each class, and the names of its bases; classes of one name count as one."""
    classes: dict[str, tuple[frozenset[str], frozenset[str]]] = {}
    for path in MODULES:
        for node in (each for block in blocks_of(path) for each in block if isinstance(each, ast.ClassDef)):
            words, bases = classes.get(node.name, (frozenset(), frozenset()))
            named = frozenset(_WORD.findall(" ".join(map(ast.unparse, node.bases))))
            classes[node.name] = (words | words_of(code_of(path)[node.lineno : node.end_lineno]), bases | named)
    return classes


def has_member(name: str, member: str) -> bool:
    """Tell whether a class of the packages, or one of its bases, has a member."""
    words, bases = house_classes().get(name, (frozenset(), frozenset()))
    return member in words or any(has_member(base, member) for base in bases)


def references_in(path: Path) -> Iterator[Reference]:
    """Yield what stands in backticks in the docstrings and comments of a module."""
    texts = [(docstring.lineno, str(docstring.value)) for docstring in docstrings_of(path)]
    lines = path.read_text(encoding="utf-8").splitlines()
    texts += [(line, found.group()) for line, text in enumerate(lines, 1) if (found := _COMMENT.search(text))]
    for line, text in texts:
        for found in _IN_BACKTICKS.finditer(text):
            yield line, found.group(1)


def packages_around(path: Path) -> list[Path]:
    return [folder for folder in path.parents if folder.is_relative_to(ROOT)]


def is_there(path: Path, reference: str) -> bool:
    """Tell whether what a module at a path, or a document, refers to exists, as far as one can see that."""
    if _DATA_FILE.fullmatch(reference):
        return True
    if _SOURCE_PATH.fullmatch(reference):
        return any((folder / reference).exists() for folder in (*packages_around(path), ROOT / "ltvn_viz" / "static"))
    if _DOTTED.fullmatch(reference):
        return is_dotted_name(path, reference.removesuffix("()").split("."))
    return not _WORD.fullmatch(reference) or reference in house_words() or hasattr(builtins, reference)


def is_dotted_name(path: Path, parts: list[str]) -> bool:
    """Tell whether a module has a member, or a class has it, or a word of the code may well have it."""
    for folder in (*packages_around(path), ROOT / "ltvn_core"):
        if (folder / parts[0]).is_dir() or (folder / f"{parts[0]}.py").is_file():
            return is_in_module(folder, parts)
    if parts[0] in house_classes():
        return has_member(*parts[:2])
    if ".".join(parts) in house_words() or find_spec(parts[0]) is not None:
        return True
    return parts[0] in words_in(path) and parts[-1] in house_words()


def is_in_module(folder: Path, parts: list[str]) -> bool:
    """Tell whether a folder has a module, or a member of one, by its dotted name."""
    inside = folder / parts[0]
    module = inside / "__init__.py" if inside.is_dir() else inside.with_suffix(".py")
    if not module.is_file():
        return False
    if len(parts) == 1:
        return True
    if inside.is_dir() and ((inside / parts[1]).is_dir() or (inside / f"{parts[1]}.py").is_file()):
        return is_in_module(inside, parts[1:])
    return parts[1] in words_in(module) and (len(parts) == 2 or has_member(*parts[1:3]))


@cache
def fields_of(path: Path) -> tuple[ast.Constant, ...]:
    """Return the docstrings of a module's attributes and constants."""
    pairs = (pair for block in blocks_of(path) for pair in pairwise(block))
    texts = (text_of(after) for before, after in pairs if isinstance(before, ast.Assign | ast.AnnAssign))
    return tuple(text for text in texts if text is not None)


def is_half_a_sentence(text: str) -> bool:
    """Tell whether a docstring goes on in the next one, or goes on with the one before."""
    return text.rstrip()[-1:] in ",;:" or bool(_CONTINUATIONS.match(text))


def at(path: Path, line: int) -> str:
    return f"{path.relative_to(ROOT)}:{line}"


@pytest.mark.parametrize("package", PACKAGES)
def test_what_docstrings_and_comments_name_is_there(package: str) -> None:
    found = (
        (path, line, reference)
        for path in MODULES
        if path.is_relative_to(ROOT / package)
        for line, reference in references_in(path)
    )

    assert [f"{at(path, line)}: {name}" for path, line, name in found if not is_there(path, name)] == []


def test_documents_name_files_and_modules_that_are_there() -> None:
    ours = re.compile(r"ltvn_(core|viz)\b[\w./]*|(docs|tools|tests|benchmarks)/[\w./-]+")
    found = (
        (path, reference)
        for path in DOCUMENTS
        for reference in _IN_BACKTICKS.findall(path.read_text(encoding="utf-8"))
        if ours.fullmatch(reference)
    )

    assert [f"{path.relative_to(ROOT)}: {name}" for path, name in found if not is_there(path, name)] == []


def test_the_docstring_of_a_field_is_not_half_a_sentence() -> None:
    fields = ((path, text) for path in MODULES for text in fields_of(path))

    assert [at(path, text.lineno) for path, text in fields if is_half_a_sentence(str(text.value))] == []


@pytest.mark.parametrize("reference", ["graph.no_module", "ltvn_core.types.NoClass", "gone.py", "World.no_member"])
def test_what_is_gone_is_noticed(reference: str) -> None:
    assert not is_there(ROOT / "ltvn_core" / "graph" / "builder.py", reference)


@pytest.mark.parametrize("text", ["Share of the near pairs,", "and of the far ones."])
def test_half_a_sentence_is_noticed(text: str) -> None:
    assert is_half_a_sentence(text)
