"""Sole writers: a second process that wants to write the same output is refused at its start, before its work.

Owns the lock: an empty, hidden file beside the output, which the operating system locks and unlocks when its process
ends, however it ends. The file is removed at the end; one that a killed process left locks nothing.
"""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ltvn_core.atomic_files import require_new_path, require_usable_name
from ltvn_core.errors import RecordingError

_HELD = {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
"""Errors of a lock that another process holds; other errors mean that the file system has no locks."""

if sys.platform == "win32":
    import msvcrt

    def _lock(file: int) -> None:
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(file: int) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def sole_writer(output: Path) -> Iterator[None]:
    """Make this process the only one that writes the new file `output` in the block.

    Raises RecordingError if another process writes it, if it exists, or if its folder cannot be written.
    """
    with sole_user(output):
        require_new_path(output)
        yield


@contextmanager
def sole_user(path: Path) -> Iterator[None]:
    """Make this process the only one that works on a file or folder in the block; it need not exist.

    Raises RecordingError if another process works on it, or if its folder cannot be written.
    """
    require_usable_name(path)
    lock = path.with_name(f".{path.name}.lock")
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        file = _locked(lock)
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be written ({error.strerror or error}); name a file in a folder that you may write to."
        ) from error
    if file is None:
        raise RecordingError(f"Another process is writing {path} now; wait until it ends, or name another file.")
    try:
        yield
    finally:
        if sys.platform == "win32":  # There an open file cannot be removed; elsewhere nobody may lock it before.
            os.close(file)
        with suppress(OSError):  # On Windows another process may have just opened it, and removes it.
            lock.unlink()
        if sys.platform != "win32":
            os.close(file)


def _locked(lock: Path) -> int | None:
    """Return the descriptor of the locked file; None if another process holds it. Raises OSError."""
    while True:
        file = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600)
        try:
            _lock(file)
        except OSError as error:
            if error.errno in _HELD:
                os.close(file)
                return None
        if _is_same(file, lock):
            return file
        os.close(file)  # Its owner ended and removed it meanwhile.


def _is_same(file: int, lock: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), lock.stat())
    except FileNotFoundError:
        return False
