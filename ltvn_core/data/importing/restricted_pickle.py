"""Safe reading of untrusted pickles, which may contain only numbers, texts, lists, mappings and numpy arrays.

A pickle is a program. Here it may only call functions that build arrays, in forms that allocate no more memory than the
file has bytes. Owns the list of these functions, and the limit for nested values: Python hashes, compares and frees
nested values recursively, sometimes without a limit, so a deeply nested value crashes the process. The nesting depth is
computed without running the program, by simulating its stack and memo with the depth of each value.
"""

import io
import pickle
import pickletools
import re
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.errors import DriveError

MOST_STEPS = 1_000_000
"""Largest number of steps of a program."""
MOST_LEVELS = 50
"""Largest depth of nested values; a trajectory has about eight levels."""
_READ = ("GET", "BINGET", "LONG_BINGET", "DUP")
_REMEMBER = ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE")
_FILL = ("APPEND", "APPENDS", "SETITEM", "SETITEMS", "ADDITEMS", "BUILD")
"""Opcodes that put values into the container below them on the stack."""
_TOO_FEW = "it takes more values from the stack than there are"
MOST_BYTES = 50_000_000
"""Largest size of a file in bytes, enough for a million poses."""
_NUMPY_TYPE = re.compile("[<>|=]?[?biufcSUO][0-9]{0,4}")
"""Allowed type descriptions of numbers and texts; numpy takes minutes to parse very long descriptions."""


def check_program(data: bytes) -> None:
    """Raise ValueError for a program that is invalid, too long, or builds too deeply nested values."""
    depths = _Depths()
    for count, (step, argument, _) in enumerate(pickletools.genops(data)):
        if count > MOST_STEPS:
            raise ValueError(f"it has more than {MOST_STEPS:,} steps")
        # The interpreter allocates a memo as long as its largest index, even if it stays empty.
        if step.name.endswith("PUT") and isinstance(argument, int) and argument > count:
            raise ValueError("its memo has an index that is too high")
        depths.follow(step, argument)


class _Value:
    """Nesting depth of a value, and whether the program has stored it in a second place."""

    __slots__ = ("is_shared", "levels")

    def __init__(self, levels: int) -> None:
        self.levels = levels
        self.is_shared = False


_MARK = _Value(0)


class _Depths:
    """Simulates the stack and the memo of a program, with nesting depths in place of values."""

    def __init__(self) -> None:
        self._stack: list[_Value] = []
        self._memory: dict[int, _Value] = {}

    def follow(self, step: pickletools.OpcodeInfo, argument: Any) -> None:
        """Simulate one step. Raises ValueError if the result is nested too deeply or the step is invalid."""
        if step.name == "MARK":
            self._stack.append(_MARK)
        elif step.name in _READ:
            value = self._top() if step.name == "DUP" else self._memory.get(int(argument))
            if value is None:
                raise ValueError("it reads a memo that was never written")
            value.is_shared = True
            self._stack.append(value)
        elif step.name in _REMEMBER:
            self._memory[len(self._memory) if step.name == "MEMOIZE" else int(argument)] = self._top()
        elif step.name in _FILL:
            within = self._taken(step.stack_before[1:])
            target = self._top()
            if target.is_shared:
                # Containers that hold it would become deeper without being checked, and it could end up inside itself.
                raise ValueError("it changes a value that is already stored elsewhere")
            target.levels = max(target.levels, _around(within))
        else:
            within = self._taken(step.stack_before)
            self._stack += [_Value(_around(within))] if step.stack_after else []

    def _taken(self, wanted: Sequence[pickletools.StackObject]) -> list[_Value]:
        """Remove the operands of a step from the stack: a fixed number, or everything above the last mark."""
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
        raise ValueError(f"its values are nested more than {MOST_LEVELS} levels deep")
    return levels


def load_pickle(path: Path) -> Any:
    """Return the content of a pickle. Raises DriveError if it is damaged or calls a function that is not allowed."""
    try:
        data = read_foreign(path, most_bytes=MOST_BYTES, what="trajectory")
        check_program(data)
        return _ArrayUnpickler(io.BytesIO(data)).load()
    except DriveError:
        raise
    except Exception as error:  # A damaged pickle can raise almost anything.
        raise DriveError(f"{path} is not a pickle of a trajectory ({' '.join(str(error).split())!s:.120}).") from error


class _ArrayUnpickler(pickle.Unpickler):
    """Resolves only the functions that build arrays."""

    def find_class(self, module: str, name: str) -> Any:
        """Return the safe replacement of a callable that a pickle names."""
        module = module.replace("numpy.core.", "numpy._core.")
        found = _ALLOWED.get(f"{module}.{name}")
        if found is None:
            raise pickle.UnpicklingError(
                f"it wants to call {module:.60}.{name:.60}, which a trajectory does not need; it was not called"
            )
        return found

    def persistent_load(self, pid: Any) -> NoReturn:
        """Refuse references to objects outside of the file."""
        raise pickle.UnpicklingError("it refers to something outside of the file")


class _Marker:
    """Replacement for numpy's array class, which could allocate any size."""


def _dtype(text: object, *_: object) -> np.dtype:
    if not isinstance(text, str) or not _NUMPY_TYPE.fullmatch(text):
        raise pickle.UnpicklingError(f"{text!r:.20} is not a type of numbers")
    return np.dtype(text, copy=True)  # A copy, because the pickle's state may change it.


def _latin(text: str, encoding: str) -> bytes:
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"it uses the encoding {encoding!r:.20}")
    return text.encode("latin1")


_ALLOWED: dict[str, Callable[..., Any]] = {
    "numpy.ndarray": _Marker,
    "numpy.dtype": _dtype,
    # The empty array with which numpy's pickles begin; their state then fills it.
    "numpy._core.multiarray._reconstruct": lambda subtype, shape, dtype: np.empty(0, np.int8),
    "numpy._core.multiarray.scalar": lambda dtype, data: np.frombuffer(data, dtype=dtype, count=1)[0],
    "numpy._core.numeric._frombuffer": lambda buffer, dtype, shape, order: np.frombuffer(buffer, dtype=dtype).reshape(
        shape, order="F" if order == "F" else "C"
    ),
    "_codecs.encode": _latin,
    "collections.OrderedDict": OrderedDict,
}
