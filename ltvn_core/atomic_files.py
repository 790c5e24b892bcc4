"""Atomic files: a file appears under its name only when it is complete. Some replace an old file, new ones never do.

Owns that guarantee for recordings, maps, weights, checkpoints, shards and texts, and their access rights. Data is first
written to a temporary file in the same folder, which is then renamed; if writing fails, the temporary file is removed.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from ltvn_core.errors import RecordingError
from ltvn_core.readable_text import readable

_FOR_NOBODY_ELSE = 0o077


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
    """Yield an unused name beside `path`, whose folder is created; a file left under that name is removed at the end.

    Two processes that write the same file at the same time get two names. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    try:
        yield part
    finally:
        part.unlink(missing_ok=True)


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
    _make_folder(path)
    try:
        with file_aside(path) as part:
            yield part
            create_new_file(path)
            os.replace(part, path)
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
    _make_folder(path)
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    try:
        part.mkdir()
        yield part
        require_new_path(path)
        os.rename(part / leave, path)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text to a new file, either completely or not at all. Raises RecordingError as `atomic_output` does."""
    with atomic_output(path) as part:
        part.write_text(text, encoding="utf-8")


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
        raise RecordingError(
            f"{shown}: this name is not UTF-8, and recordings are opened by UTF-8 names alone; rename the file or its "
            "folder, for instance with `mv`."
        ) from error
    try:
        path.exists()
    except OSError as error:
        raise RecordingError(f"{shown:.120}...: {error.strerror}; give it a shorter name.") from error


def require_new_path(path: Path) -> None:
    """Raise RecordingError for an unusable name, or if a file of this name exists; call it before long work."""
    require_usable_name(path)
    if path.exists():
        raise _exists(path)


def _make_folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise RecordingError(f"{path} cannot be written: {path.parent} is not a folder; name another path.") from error
    except OSError as error:
        raise _refused(path, error) from error


def _refused(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"{path} cannot be written ({error.strerror or error}); name a file in a folder that you may write to."
    )


def _exists(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} exists already and is never overwritten; name another file, or move the existing one."
    )
