"""Files of a folder that somebody else made: read only from within it, whatever its lists say."""

from pathlib import Path

from ltvn_core.errors import DriveError

MOST_BYTES = 200_000_000
"""No single image is so large."""


def read_bytes_within(folder: Path, name: str) -> bytes:
    """Return the bytes of a file within a folder. Raises DriveError for a missing, huge or foreign one."""
    path = folder / name
    try:
        if not path.resolve().is_relative_to(folder.resolve()):
            raise DriveError(f"{name} lies outside of {folder}, and is not read.")
        if path.stat().st_size > MOST_BYTES:
            raise DriveError(f"{name} has more than {MOST_BYTES:,} bytes, which no image of a robot has.")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte.
        raise DriveError(f"{name} cannot be read from {folder} ({error!s:.120}).") from error
