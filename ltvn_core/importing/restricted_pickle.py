"""Pickles of strangers, of which only numbers, texts, lists, mappings and numpy's arrays come out.

A pickle is a program. Here it may call nothing but what puts an array together, in forms that allocate no more than
the file itself holds. Owns that list.
"""

import io
import pickle
import re
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ltvn_core.errors import DriveError
from ltvn_core.importing.foreign_files import read_foreign
from ltvn_core.importing.pickle_program import check_program

MOST_BYTES = 50_000_000
"""A million poses; a longer file is no trajectory."""
_NUMPY_TYPE = re.compile("[<>|=]?[?biufcSUO][0-9]{0,4}")
"""Numbers and texts; numpy parses longer descriptions for minutes."""


def load_pickle(path: Path) -> Any:
    """Return what a pickle holds. Raises DriveError where it is damaged, or wants to do anything else."""
    try:
        data = read_foreign(path, most_bytes=MOST_BYTES, what="trajectory")
        check_program(data)
        return _ArrayUnpickler(io.BytesIO(data)).load()
    except DriveError:
        raise
    except Exception as error:  # A damaged program fails in as many ways as there are steps.
        raise DriveError(f"{path} is no pickle of a trajectory ({' '.join(str(error).split())!s:.120}).") from error


class _ArrayUnpickler(pickle.Unpickler):
    """Finds what puts arrays together, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return our own form of what a pickle calls."""
        module = module.replace("numpy.core.", "numpy._core.")
        found = _ALLOWED.get(f"{module}.{name}")
        if found is None:
            raise pickle.UnpicklingError(
                f"it wants to call {module:.60}.{name:.60}, which a trajectory needs not, and was not called"
            )
        return found

    def persistent_load(self, pid: Any) -> NoReturn:
        """Refuse what lies outside of the file."""
        raise pickle.UnpicklingError("it refers to something outside of the file")


class _Marker:
    """Stands for numpy's array class, which could allocate any size."""


def _empty_array(subtype: object, shape: object, dtype: object) -> np.ndarray:
    """Return the empty array that numpy's pickles begin with; their state fills it."""
    return np.empty(0, np.int8)


def _array(buffer: bytes, dtype: np.dtype, shape: tuple[int, ...], order: str) -> np.ndarray:
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order="F" if order == "F" else "C")


def _dtype(text: object, *_: object) -> np.dtype:
    if not isinstance(text, str) or not _NUMPY_TYPE.fullmatch(text):
        raise pickle.UnpicklingError(f"{text!r:.20} is no type of numbers")
    return np.dtype(text, copy=True)  # What the state then changes must not be numpy's own.


def _scalar(dtype: np.dtype, data: bytes) -> Any:
    return np.frombuffer(data, dtype=dtype, count=1)[0]


def _latin(text: str, encoding: str) -> bytes:
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"it uses the encoding {encoding!r:.20}")
    return text.encode("latin1")


_ALLOWED: dict[str, Callable[..., Any]] = {
    "numpy.ndarray": _Marker,
    "numpy.dtype": _dtype,
    "numpy._core.multiarray._reconstruct": _empty_array,
    "numpy._core.multiarray.scalar": _scalar,
    "numpy._core.numeric._frombuffer": _array,
    "_codecs.encode": _latin,
    "collections.OrderedDict": OrderedDict,
}
