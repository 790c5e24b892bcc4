"""Files that somebody else made: read whole, if they are plain files, not too long, and where they should be.

A pipe or a device in an unpacked folder would never end, and a link could name any file of this machine.
"""

import stat
from pathlib import Path

from ltvn_core.errors import DriveError

MOST_IMAGE_BYTES = 200_000_000
"""No single image is so large."""


def read_foreign(path: Path, *, most_bytes: int, what: str) -> bytes:
    """Return the bytes of a plain file.

    Args:
        path: The file.
        most_bytes: The longest that is read.
        what: What messages call something that is never longer, as "image".

    Raises:
        DriveError: It is too long, or no plain file.
        OSError: It cannot be read.
    """
    require_plain(path)
    if path.stat().st_size > most_bytes:
        raise DriveError(f"{path} has more than {most_bytes:,} bytes, which no {what} has.")
    return path.read_bytes()


def require_plain(path: Path) -> None:
    """Raise DriveError for a pipe, a device or their like; OSError where nothing is there."""
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # Of a folder the system itself says that it is one.
        raise DriveError(f"{path} is a pipe or a device, not a file, and is not read.")


def require_within(path: Path, folder: Path) -> None:
    """Raise DriveError where a path leads out of a folder, by its name or by links."""
    try:
        is_within = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # A zero byte in the name, or links in a circle.
        raise DriveError(f"{path} leads nowhere ({error!s:.120}).") from error
    if not is_within:
        raise DriveError(f"{path} lies outside of {folder}, and is not read.")


def read_bytes_within(folder: Path, name: str) -> bytes:
    """Return the bytes of an image within a folder. Raises DriveError for a missing, huge or foreign one."""
    path = folder / name
    require_within(path, folder)
    try:
        return read_foreign(path, most_bytes=MOST_IMAGE_BYTES, what="image of a robot")
    except (OSError, ValueError) as error:
        raise DriveError(f"{name} cannot be read from {folder} ({error!s:.120}).") from error
