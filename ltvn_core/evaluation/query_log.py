"""The log of an unfinished test: the result of each query, one line of JSON, on disk as soon as the query is over.

A test that is begun again reads it and runs only what is missing. Several processes that share a folder may append to
one; a query that stands there twice counts once, by its last line.
"""

import json
import os
from pathlib import Path

import cattrs

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import CONVERTER, QueryResult
from ltvn_core.structured_text import parse_json


def read_query_log(path: Path) -> list[QueryResult]:
    """Return the finished queries in order; a line that was cut off is left out, so that its query is run again."""
    if not path.exists():
        return []
    found: dict[tuple[str, int], QueryResult] = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            result = CONVERTER.structure(parse_json(line), QueryResult)
        except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError):
            continue
        found[result.phase or "", result.query] = result
    return list(found.values())


def append_to_log(path: Path, result: QueryResult) -> None:
    """Add a finished query; it is on the disk when this returns. Raises OptionError where it cannot be written."""
    line = json.dumps(CONVERTER.unstructure(result), separators=(",", ":"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            # The line break stands first, so that a line that was cut off spoils no other.
            file.write(f"\n{line}" if file.tell() else line)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OptionError(
            f"{path} cannot be written: {error.strerror}. Free some space or name another --folder; what is done is "
            "kept."
        ) from error
