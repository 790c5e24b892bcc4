"""New files appear under their name only when they are whole, and never in place of another. Owns that promise."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from ltvn_core.errors import RecordingError


def claim(path: Path) -> None:
    """Make the folder and an empty file which nobody made before. Raises RecordingError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(exist_ok=False)
    except FileExistsError as error:
        if path.parent.is_dir():
            raise _exists(path) from error
        raise RecordingError(f"{path} cannot be written: {path.parent} is no folder; name another place.") from error
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be written ({error.strerror}); name a file in a folder that you may write to."
        ) from error


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a name beside `path` to write to; it becomes `path` when the block ends well and vanishes otherwise.

    Raises RecordingError when `path` exists already.
    """
    if path.exists():
        raise _exists(path)
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    try:
        yield part
        claim(path)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _exists(path: Path) -> RecordingError:
    return RecordingError(f"{path} exists already and is never overwritten; name another file or move that one away.")
