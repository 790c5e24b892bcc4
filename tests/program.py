"""Runs `ltvn` in the tests' own process, where the process itself is not what is tested."""

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from ltvn_core.cli import main


@dataclass(frozen=True)
class Answered:
    """What the program printed, and its exit code."""

    code: int
    stdout: str
    stderr: str


def ltvn_here(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Answered:
    """Run a command; skip the test where a library that it needs is not installed."""
    try:
        code = main([*map(str, arguments)])
    except SystemExit as wrong_usage:  # As tyro ends for options that it does not know.
        code = int(wrong_usage.code or 0)
    printed = capsys.readouterr()
    skip_without_library(printed.err)
    return Answered(code, printed.out, printed.err)


def skip_without_library(stderr: str) -> None:
    """Skip the test where the program said that a library is not installed."""
    if missing := re.search(r"This needs (\w+), which is not installed", stderr):
        pytest.importorskip(missing[1])
