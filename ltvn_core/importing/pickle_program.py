"""How deep the values lie within one another that a pickle's program makes, found out without running it.

Python hashes, compares and frees values by calls that call themselves, some without a limit, so that a deep value ends
the process. Owns following the program: its stack, what it remembers, and the depth of each value.
"""

import pickletools
from collections.abc import Sequence
from typing import Any

MOST_STEPS = 1_000_000
"""Steps of a program."""
MOST_LEVELS = 50
"""Values within one another; a trajectory has about eight."""

_READ = ("GET", "BINGET", "LONG_BINGET", "DUP")
_REMEMBER = ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE")
_FILL = ("APPEND", "APPENDS", "SETITEM", "SETITEMS", "ADDITEMS", "BUILD")
"""These put values into the one below them."""
_TOO_FEW = "it takes more values than it made"


def check_program(data: bytes) -> None:
    """Raise ValueError for a program that is too long, makes values that are too deep, or is no program."""
    depths = _Depths()
    for count, (step, argument, _) in enumerate(pickletools.genops(data)):
        if count > MOST_STEPS:
            raise ValueError(f"it has more than {MOST_STEPS:,} steps")
        # The interpreter makes a list as long as the number, whatever was put into it.
        if step.name.endswith("PUT") and isinstance(argument, int) and argument > count:
            raise ValueError("it numbers what it remembers too high")
        depths.follow(step, argument)


class _Value:
    """How many levels lie within a value, and whether the program holds it in a second place."""

    __slots__ = ("is_shared", "levels")

    def __init__(self, levels: int) -> None:
        self.levels = levels
        self.is_shared = False


_MARK = _Value(0)


class _Depths:
    """The stack and the memory of a program, with depths in place of values."""

    def __init__(self) -> None:
        self._stack: list[_Value] = []
        self._memory: dict[int, _Value] = {}

    def follow(self, step: pickletools.OpcodeInfo, argument: Any) -> None:
        """Do what a step does. Raises ValueError where that is too deep or impossible."""
        if step.name == "MARK":
            self._stack.append(_MARK)
        elif step.name in _READ:
            self._read(step.name, argument)
        elif step.name in _REMEMBER:
            self._memory[len(self._memory) if step.name == "MEMOIZE" else int(argument)] = self._top()
        elif step.name in _FILL:
            self._fill(step)
        else:
            self._make(step)

    def _read(self, name: str, argument: Any) -> None:
        value = self._top() if name == "DUP" else self._memory.get(int(argument))
        if value is None:
            raise ValueError("it reads what it never remembered")
        value.is_shared = True
        self._stack.append(value)

    def _fill(self, step: pickletools.OpcodeInfo) -> None:
        within = self._taken(step.stack_before[1:])
        target = self._top()
        if target.is_shared:
            # What holds it already would become deeper unseen, and it could come to hold itself.
            raise ValueError("it goes on filling what it has put elsewhere")
        target.levels = max(target.levels, _around(within))

    def _make(self, step: pickletools.OpcodeInfo) -> None:
        within = self._taken(step.stack_before)
        if step.stack_after:
            self._stack.append(_Value(_around(within)))

    def _taken(self, wanted: Sequence[pickletools.StackObject]) -> list[_Value]:
        """Take from the stack what a step uses: as many values as it names, or all down to the last mark."""
        taken: list[_Value] = []
        if pickletools.markobject in wanted:
            while (value := self._pop()) is not _MARK:
                taken.append(value)
            wanted = wanted[: list(wanted).index(pickletools.markobject)]
        return taken + [self._pop() for _ in wanted]

    def _pop(self) -> _Value:
        if not self._stack:
            raise ValueError(_TOO_FEW)
        return self._stack.pop()

    def _top(self) -> _Value:
        if not self._stack or self._stack[-1] is _MARK:
            raise ValueError(_TOO_FEW)
        return self._stack[-1]


def _around(within: Sequence[_Value]) -> int:
    levels = 1 + max((value.levels for value in within), default=0)
    if levels > MOST_LEVELS:
        raise ValueError(f"its values lie within one another more than {MOST_LEVELS} levels deep")
    return levels
