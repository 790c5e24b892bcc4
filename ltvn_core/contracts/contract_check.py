"""One point of a contract, and whether a plug-in keeps to it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from ltvn_core.errors import LtvnError

Check: TypeAlias = Callable[[], str]
"""Looks at one point; returns what it found, and raises anything at all where the contract is broken."""


@dataclass(frozen=True, slots=True)
class ContractCheck:
    """What came of one point."""

    check: str
    """What the plug-in must do."""
    passed: bool
    said: str
    """What was found, or what is wrong."""

    def __str__(self) -> str:
        return f"{'ok     ' if self.passed else 'BROKEN '} {self.check}" + (f": {self.said}" if self.said else "")


class BrokenContractError(Exception):
    """A plug-in does not do what it must; the message says what it did instead."""


def require(kept: bool, otherwise: str) -> None:
    """Raise BrokenContractError unless the contract is kept."""
    if not kept:
        raise BrokenContractError(otherwise)


def run_check(name: str, check: Check) -> ContractCheck:
    """Look at one point; whatever is raised is what is wrong."""
    try:
        return ContractCheck(name, passed=True, said=check())
    except (BrokenContractError, LtvnError) as broken:
        return ContractCheck(name, passed=False, said=str(broken))
    except Exception as error:  # Another person's code may raise anything.
        return ContractCheck(name, passed=False, said=f"{type(error).__name__}: {error}")


def run_checks(first: tuple[str, Check], others: Iterable[tuple[str, Check]]) -> Iterator[ContractCheck]:
    """Look at all points; where the first one fails, there is nothing to look at the others with."""
    begun = run_check(*first)
    yield begun
    if begun.passed:
        yield from (run_check(name, check) for name, check in others)
