"""New files appear under their name only when they are whole, and never in place of another. Owns that promise."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from ltvn_core.errors import RecordingError


def create_new_file(path: Path) -> None:
    """Make the folder and an empty file which nobody made before. Raises RecordingError."""
    _make_folder(path)
    try:
        path.touch(exist_ok=False)
    except FileExistsError as error:
        raise _exists(path) from error
    except OSError as error:
        raise _refused(path, error) from error


@contextmanager
def atomic_output(path: Path) -> Iterator[Path]:
    """Yield a name beside `path` to write to; it becomes `path` when the block ends well and vanishes otherwise.

    Makes its folder. Raises RecordingError when `path` exists already or cannot be written.
    """
    require_new_path(path)
    _make_folder(path)
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    try:
        yield part
        create_new_file(path)
        os.replace(part, path)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        part.unlink(missing_ok=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text to a new file, whole or not at all. Raises RecordingError as `atomic_output` does."""
    with atomic_output(path) as part:
        part.write_text(text, encoding="utf-8")


def require_new_path(path: Path) -> None:
    """Raise RecordingError where there is a file of this name already; ask it before long work."""
    if path.exists():
        raise _exists(path)


def _make_folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise RecordingError(f"{path} cannot be written: {path.parent} is no folder; name another place.") from error
    except OSError as error:
        raise _refused(path, error) from error


def _refused(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"{path} cannot be written ({error.strerror or error}); name a file in a folder that you may write to."
    )


def _exists(path: Path) -> RecordingError:
    return RecordingError(f"{path} exists already and is never overwritten; name another file or move that one away.")
