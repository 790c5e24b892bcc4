"""Tries in a separate process whether Rerun can read a file, because a damaged one can crash Rerun's reader.

As a program it is that process. It imports nothing of ours, so that it starts quickly.
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
"""Bytes of a file per second of the time limit: a tenth of the speed of a busy machine."""
_MESSAGE_SECONDS = 20
_MEMORY_BYTES = 8 << 30
_HEADER_BYTES = 12
_CHUNK = 2
"""Kind of the messages that hold rows."""
_FILE = "file"
_MESSAGES = "messages"


def reading_failure(path: Path) -> str | None:
    """Return why Rerun cannot read a file, None when it can."""
    limit = _SECONDS + path.stat().st_size // _BYTES_PER_SECOND
    try:
        tried = subprocess.run(_command(_FILE, path), capture_output=True, text=True, timeout=limit, env=_environment())
    except subprocess.TimeoutExpired:
        return f"Rerun does not finish reading it within {limit} s"
    if tried.returncode == 0:
        return None
    return tried.stdout.strip() or "Rerun's reader crashes on it"


def unreadable_messages(path: Path, count: int) -> dict[int, str]:
    """Return which of the `count` messages of a file Rerun cannot read, and why; each is tried alone.

    The file must consist of a header, one message that describes the store, which is not counted, and whole messages.
    """
    failures = dict[int, str]()
    first = 0
    while first < count:
        tried = subprocess.run(
            _command(_MESSAGES, path, str(first)), capture_output=True, text=True, check=False, env=_environment()
        )
        for line in tried.stdout.splitlines():
            place, _, why = line.partition(" ")
            first = int(place) + 1
            if why:
                failures[int(place)] = why
        if first < count:
            failures[first] = "Rerun's reader crashes on it"
            first += 1
    return failures


def _command(kind: str, path: Path, *rest: str) -> list[str]:
    # -P, or the files beside this one would stand in for libraries of the same name.
    return [sys.executable, "-P", __file__, kind, str(path), *rest]


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part), "RUST_BACKTRACE": "0"}


def _limit_process() -> None:
    try:
        import resource
    except ImportError:
        return  # Not on this system; the time limit remains.
    with suppress(OSError, ValueError):  # macOS refuses the second; the time limit remains.
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))


def _read(path: Path) -> None:
    """Touch every row of a file as a reader does. Raises ValueError when a message belongs to no store of it."""
    # What `rerun.chunk` wraps; without the rest of Rerun the process starts in a third of the time.
    from rerun_bindings import RrdReaderInternal

    reader = RrdReaderInternal(str(path))
    found = 0
    for store in reader.store_entries():
        for chunk in reader.stream(store=store):
            chunk.to_record_batch().validate(full=True)
            found += 1
    with path.open("rb") as file:
        file.seek(_HEADER_BYTES)
        written = sum(message[0] == _CHUNK for message in _messages(file))
    if found != written:
        raise ValueError(f"{written - found} of its {written} tables belong to no recording")


def _try_file(path: Path) -> str:
    try:
        _read(path)
    except Exception as error:
        return " ".join(str(error).split()) or type(error).__name__
    return ""


def _messages(file: BinaryIO) -> Iterator[bytes]:
    """Yield the messages from a place in a file to its end, or to the message that ends it."""
    while (header := file.read(16)) and header[0]:
        yield header + file.read(int.from_bytes(header[8:], "little"))


def _try_messages(path: Path, first: int) -> None:
    import signal

    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES)
        messages = _messages(file)
        beginning = header + next(messages)
        alone = path.with_suffix(".one")
        for place, message in enumerate(messages):
            if place >= first:
                if hasattr(signal, "alarm"):
                    signal.alarm(_MESSAGE_SECONDS)
                alone.write_bytes(beginning + message)
                _answer(f"{place} {_try_file(alone)}")


def _answer(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _leave_rerun_out() -> None:
    """Give the reader the one class of `rerun` that it asks for, to warn of a file without Rerun's table of chunks.

    To import the package for it would take twice as long as all the rest.
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
    if sys.argv[1] == _FILE:
        failure = _try_file(Path(sys.argv[2]))
        _answer(failure)
        sys.exit(1 if failure else 0)
    _try_messages(Path(sys.argv[2]), int(sys.argv[3]))
