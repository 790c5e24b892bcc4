"""Tries in a separate process whether Rerun can read a file, because a damaged file can crash Rerun's reader.

Run as a program, this module is that process. It imports no other module of the package, so that it starts quickly.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

_SECONDS = 60
_BYTES_PER_SECOND = 2 << 20
"""Assumed reading speed in bytes per second for the time limit: a tenth of the speed on a busy machine."""
_MEMORY_BYTES = 8 << 30
_HEADER_BYTES = 12
_CHUNK = 2
"""Kind of the messages that contain rows."""


def reading_failure(path: Path) -> str | None:
    """Return the reason why Rerun cannot read a file; None if it can."""
    limit = _SECONDS + path.stat().st_size // _BYTES_PER_SECOND
    try:
        # With -P, files beside this one cannot replace libraries of the same name.
        command = [sys.executable, "-P", __file__, str(path)]
        tried = subprocess.run(command, capture_output=True, text=True, timeout=limit, env=_environment())
    except subprocess.TimeoutExpired:
        return f"Rerun does not finish reading it within {limit} s"
    if tried.returncode == 0:
        return None
    return tried.stdout.strip() or "Rerun's reader crashes on it"


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part), "RUST_BACKTRACE": "0"}


def _limit_process() -> None:
    try:
        import resource
    except ImportError:
        return  # This system has no such limit; the time limit remains.
    with suppress(OSError, ValueError):  # macOS refuses the second limit; the time limit remains.
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))


def _read(path: Path) -> None:
    """Read every row of a file. Raises ValueError if a message belongs to no store of the file."""
    # `rerun.chunk` wraps this module; without the rest of Rerun, the process starts in a third of the time.
    from rerun_bindings import RrdReaderInternal

    reader = RrdReaderInternal(str(path))
    found = 0
    for store in reader.store_entries():
        for chunk in reader.stream(store=store):
            chunk.to_record_batch().validate(full=True)
            found += 1
    with path.open("rb") as file:
        file.seek(_HEADER_BYTES)
        written = sum(kind == _CHUNK for kind in _kinds(file))
    if found != written:
        raise ValueError(f"{written - found} of its {written} tables belong to no recording")


def _try_file(path: Path) -> str:
    try:
        _read(path)
    except Exception as error:
        return " ".join(str(error).split()) or type(error).__name__
    return ""


def _kinds(file: BinaryIO) -> Iterator[int]:
    """Yield the kinds of the messages from the current position of a file to its end, or to the end message."""
    while (header := file.read(16)) and header[0]:
        yield header[0]
        file.seek(int.from_bytes(header[8:], "little"), os.SEEK_CUR)


def _leave_rerun_out() -> None:
    """Provide the only class of `rerun` that the reader needs, to warn about a file without Rerun's table of chunks.

    Importing the package for it would triple the time to start.
    """
    rerun = ModuleType("rerun")
    errors = ModuleType("rerun.error_utils")
    vars(errors)["RerunWarning"] = UserWarning
    vars(rerun)["error_utils"] = errors
    sys.modules |= {"rerun": rerun, "rerun.error_utils": errors}


if __name__ == "__main__":
    import warnings

    warnings.simplefilter("ignore")
    _leave_rerun_out()
    _limit_process()
    failure = _try_file(Path(sys.argv[1]))
    sys.stdout.write(failure)
    sys.exit(1 if failure else 0)
