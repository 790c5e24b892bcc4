"""Atomic files: a file appears under its name only when it is complete. Some replace an old file, new ones never do.

Owns that guarantee for recordings, maps, weights, checkpoints, shards and texts, and their access rights. Data is first
written in a temporary folder beside it, which is locked, and then renamed; if writing fails, the temporary folder is
removed. If the process is killed, the next one that writes the same file removes it.
"""

import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from ltvn_core.errors import RecordingError, RecordingStoppedError, remedy
from ltvn_core.readable_text import readable

try:
    import fcntl
except ImportError:  # On Windows nothing is locked, and what a killed process leaves is not removed.
    fcntl = None

MIN_FREE_DISK_BYTES = 16 << 20
"""Recording stops, with a complete file, when the disk has less than this left."""
_FOR_NOBODY_ELSE = 0o077
_PROBE_BYTES = 4096
"""Size of the file that is written to find out whether one can be: an empty one can be created on a full disk."""


@contextmanager
def owner_only() -> Iterator[None]:
    """Make all files and folders that are created in the block accessible to their owner only (0600 and 0700).

    Exports, reports and maps show private rooms, as recordings do. This changes the umask of the whole process and of
    the processes that it starts, so use it only in our own programs, never in a library function that others call.
    """
    before = os.umask(_FOR_NOBODY_ELSE)
    os.umask(before | _FOR_NOBODY_ELSE)
    try:
        yield
    finally:
        os.umask(before)


@contextmanager
def file_aside(path: Path) -> Iterator[Path]:
    """Yield an unused name near `path`, whose folder is created; a file left under that name is removed at the end.

    Two processes that write the same file at the same time get two names. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(path)
    owner = os.getpid()
    folder, lock = _locked_folder(path)
    try:
        yield folder / "part"
    finally:
        if os.getpid() == owner:  # In a forked process it is still the other one's.
            shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _locked_folder(path: Path) -> tuple[Path, int | None]:
    """Create a temporary folder for `path`, and return it with its lock; None if the file system has no locks."""
    while True:
        folder = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
        folder.mkdir(mode=0o700)
        lock = _lock(folder, wait=True)
        if lock is None or os.fstat(lock).st_nlink:
            return folder, lock
        os.close(lock)  # Another process took the folder for a leftover before it was locked.


def _remove_leftovers(path: Path) -> None:
    """Remove the temporary folders for `path` that killed processes left; those of living ones are locked."""
    name = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.part")
    for left in [each for each in path.parent.iterdir() if name.fullmatch(each.name)] if fcntl else ():
        lock = _lock(left, wait=False)
        if lock is not None:
            shutil.rmtree(left, ignore_errors=True)
            os.close(lock)


def _lock(folder: Path, *, wait: bool) -> int | None:
    """Lock a folder until the returned descriptor is closed or the process ends; None if that is not possible."""
    if fcntl is None:
        return None
    try:
        file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(file)
        return None
    return file


@contextmanager
def atomic_replacement(path: Path) -> Iterator[Path]:
    """Yield a name to write to; after the block, that file replaces `path`. If the block fails, the old file stays.

    Raises OSError.
    """
    with file_aside(path) as part:
        yield part
        os.replace(part, path)


@contextmanager
def atomic_output(path: Path) -> Iterator[Path]:
    """Yield a name to write to; after the block, it becomes the new file `path`, unless the block fails.

    Creates the folder of `path`. Raises RecordingError if `path` exists already or cannot be written.
    """
    require_new_path(path)
    try:
        with file_aside(path) as part:
            yield part
            create_new_file(path)
            os.replace(part, path)
    except RecordingStoppedError as error:
        raise RecordingError(
            f"{path} could not be written ({error.cause}), and nothing of it is kept; {error.remedy}, and begin again."
        ) from error
    except OSError as error:
        raise _refused(path, error) from error


@contextmanager
def new_folder(path: Path, *, leave: str = "") -> Iterator[Path]:
    """Yield an empty folder to fill; after the block, it becomes the new folder `path`. If the block fails, it is
    removed.

    With `leave`, only the entry of that name in the folder becomes `path`. Raises RecordingError as `atomic_output`
    does.
    """
    require_new_path(path)
    try:
        with file_aside(path) as part:
            part.mkdir()
            yield part
            require_new_path(path)
            os.rename(part / leave, path)
    except OSError as error:
        raise _refused(path, error) from error


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text to a new file, either completely or not at all, or to a stream such as /dev/stdout.

    Raises RecordingError as `atomic_output` does.
    """
    if is_stream(path):
        _write_stream(path, text.encode())
        return
    with atomic_output(path) as part:
        part.write_text(text, encoding="utf-8")


def is_stream(path: Path) -> bool:
    """Tell whether `path` is a pipe, a device, or this process's own output: writing there replaces nothing."""
    try:
        kind = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(kind) or stat.S_ISCHR(kind) or stat.S_ISSOCK(kind) or _own_output(path) is not None


def is_standard_output(path: Path) -> bool:
    """Tell whether `path` names this process's standard output, as /dev/stdout does."""
    return _own_output(path) == 1


def _own_output(path: Path) -> int | None:
    """Return the number of the open file that a name such as /dev/stdout stands for; None for any other path."""
    named = {"/dev/stdout": "1", "/dev/stderr": "2"}.get(str(path)) or (
        path.name if str(path.parent) in ("/dev/fd", "/proc/self/fd") else ""
    )
    return int(named) if named.isdecimal() else None


def _write_stream(path: Path, data: bytes) -> None:
    # Our own output is not opened a second time: where it is a file, that would begin at its start.
    own = _own_output(path)
    try:
        with open(path if own is None else os.dup(own), "wb", buffering=0) as stream:
            left = memoryview(data)
            while left:
                left = left[stream.write(left) :]
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _refused(path, error) from error


def create_new_file(path: Path) -> None:
    """Create a new, empty file, and its folder if necessary. Raises RecordingError, also if the file exists."""
    require_usable_name(path)
    _make_folder(path)
    try:
        path.touch(exist_ok=False)
    except FileExistsError as error:
        raise _exists(path) from error
    except OSError as error:
        raise _refused(path, error) from error


def open_new_file(path: Path) -> int:
    """Create a new file that only its owner may read, and return its file descriptor, open for appending.

    Creates its folder if necessary. Raises RecordingError, also if the file exists.
    """
    require_usable_name(path)
    _make_folder(path)
    # Windows has no O_CLOEXEC; only Windows has O_BINARY, without which it would change line ends.
    flags = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    try:
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | flags, 0o600)
    except FileExistsError as error:
        raise _exists(path) from error
    except OSError as error:
        raise _refused(path, error) from error


def recording_path(given: Path | str) -> Path:
    """Return the path of a recording or map that a program names. Raises RecordingError if it is no path."""
    if not isinstance(given, str | os.PathLike):
        raise RecordingError(
            f"A recording or map is named by the path of its file, a str or pathlib.Path such as 'map.rrd', not by "
            f"{given!r:.40} ({type(given).__name__})."
        )
    return Path(given)


def require_usable_name(path: Path) -> None:
    """Raise RecordingError for an invalid file name, or one that the libraries for recordings cannot open."""
    shown = readable(str(path))
    if "\0" in shown:
        raise RecordingError(f"{shown!r} holds a NUL character, which no file name can; name another file.")
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise RecordingError(_why_not_utf8(path, shown)) from error
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        raise RecordingError(f"{shown:.120}: {error.strerror}; {remedy(error)}.") from error


def _why_not_utf8(path: Path, shown: str) -> str:
    try:
        named = os.fsencode(path).decode()
    except UnicodeError:
        return (
            f"{shown}: this name is not UTF-8, and recordings are opened by UTF-8 names alone; rename the file or its "
            "folder, for instance with `mv`."
        )
    return (
        f"{named}: Python's UTF-8 is switched off, and without it only ASCII names can be opened; remove PYTHONUTF8=0 "
        "from the environment, or set PYTHONUTF8=1."
    )


def require_new_path(path: Path, *, free_bytes: int = 0) -> None:
    """Raise RecordingError unless a new file can be written at `path`; call it before long work.

    Args:
        path: The file or folder that will be written; its folder may be missing.
        free_bytes: Space that the disk must have left.
    """
    require_usable_name(path)
    if os.path.lexists(path):
        raise _exists(path)
    require_writable(path, free_bytes=free_bytes)


def require_writable(path: Path, *, free_bytes: int = 0) -> None:
    """Raise RecordingError unless a file at `path` can be written or replaced; tries it, and leaves nothing behind.

    Args:
        path: The file; its folder may be missing.
        free_bytes: Space that the disk must have left.
    """
    require_usable_name(path)
    if path.is_dir():
        raise RecordingError(f"{path} is a folder; name a file.")
    try:
        there = next(parent for parent in path.absolute().parents if os.path.lexists(parent))
        with file_aside(there / path.name) as part:
            part.write_bytes(bytes(_PROBE_BYTES))
        free = shutil.disk_usage(there).free
    except OSError as error:
        raise _refused(path, error) from error
    if free < free_bytes:
        raise RecordingError(
            f"{path} cannot be written: its disk has {free >> 20} MiB left, and {free_bytes >> 20} MiB are needed; "
            "free some space, or name another place."
        )


def _make_folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refused(path, error) from error


def _refused(path: Path, error: OSError) -> RecordingError:
    if isinstance(error, FileExistsError):  # From creating the folder, or one above it.
        return RecordingError(f"{path} cannot be written: {error.filename} is not a folder; name another path.")
    return RecordingError(f"{path} cannot be written ({error.strerror or error}); {remedy(error)}.")


def _exists(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} exists already and is never overwritten; name another file, or move the existing one."
    )
