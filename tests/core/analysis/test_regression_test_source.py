"""The source of a test is data of a recording in the shape of code: no text of the recording may become code."""

import ast
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.analysis.regression_test_source import regression_test_source
from ltvn_core.navigation.events import AttemptEnd, AttemptEnded, Outcome, QueryEnded, StampedEvent

ATTACKS = [
    "reason\nimport os; os.system('touch owned')",
    '"""\nimport os\n"""',
    '" + __import__("os").getcwd() + "',
    "\\",
    '\\"; import os #',
    "line\rimport os",
    "null\0byte",
    "lone surrogate \udcff",
    "'\"",
    "{file} {0}",
]


def events(reason: str, query: int = 0) -> list[StampedEvent]:
    attempt = AttemptEnded(query, 1, 2, 3, 4, AttemptEnd.REACHED, 0.1, 0.9, True, reason)
    ended = QueryEnded(query, 3, Outcome.ARRIVED, 10, 0, 1.0)
    return [StampedEvent(4, 0.4, attempt), StampedEvent(5, 0.5, ended)]


def source(text: str) -> str:
    return regression_test_source(events(text), file=text, about=text)


def recording_name(tree: ast.Module) -> object:
    """Return the constant that is divided onto the folder of the test."""
    (assigned,) = (node.value for node in tree.body if isinstance(node, ast.Assign))
    assert isinstance(assigned, ast.BinOp)
    assert isinstance(assigned.right, ast.Constant)
    return assigned.right.value


def shape(tree: ast.Module) -> list[str]:
    return [type(node).__name__ for node in ast.walk(tree)]


HARMLESS = shape(ast.parse(source("harmless")))


@pytest.mark.parametrize("text", ATTACKS)
def test_a_hostile_text_stays_a_text(text: str) -> None:
    tree = ast.parse(source(text))
    assert shape(tree) == HARMLESS
    assert recording_name(tree) == text
    source(text).encode("ascii")


@given(st.text())
def test_any_text_stays_a_text(text: str) -> None:
    tree = ast.parse(source(text))
    assert shape(tree) == HARMLESS
    assert recording_name(tree) == text
    assert text in (ast.get_docstring(tree, clean=False) or "")


def test_numbers_that_cannot_name_a_function_are_spelt() -> None:
    ast.parse(regression_test_source(events("fine", query=-1), file="moment.rrd", about="a moment"))


def test_a_plain_name_looks_as_a_person_would_write_it() -> None:
    assert 'RECORDING = Path(__file__).parent / "moment.rrd"' in source("moment.rrd")
    assert Path(str(recording_name(ast.parse(source("Aufnahme Küche.rrd"))))).name == "Aufnahme Küche.rrd"
