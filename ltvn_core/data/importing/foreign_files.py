"""Files from untrusted sources: read completely if they are plain files, not too large, and in the expected place.

Reading a pipe or a device in an unpacked folder would never end, and a link could point to any file of this machine.
"""

import os
import stat
from pathlib import Path

from ltvn_core.errors import DriveError

MOST_IMAGE_BYTES = 200_000_000
"""Largest size of a single image, in bytes."""

_POINTER = b"version https://git-lfs"
"""First bytes of the pointer file that Git LFS writes for a file that was not fetched."""
_LONGEST_POINTER = 1024
_ATTRIBUTES = ".gitattributes"
_MOST_ATTRIBUTES = 1_000_000
_READ_LEVELS = 5


def read_foreign(path: Path, *, most_bytes: int, what: str) -> bytes:
    """Return the bytes of a plain file.

    Args:
        path: The file.
        most_bytes: Largest size in bytes that is read.
        what: Kind of file in messages, such as "image".

    Raises:
        DriveError: The file is too large, not a plain file, or only a Git LFS pointer.
        OSError: The file cannot be read.
    """
    require_plain(path)
    if path.stat().st_size > most_bytes:
        raise DriveError(f"{path} has more than {most_bytes:,} bytes, which is too large for a {what}.")
    return path.read_bytes()


def require_plain(path: Path) -> None:
    """Raise DriveError for a pipe, a device or a Git LFS pointer; OSError where nothing exists."""
    found = path.stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):  # Reading a folder raises OSError.
        raise DriveError(f"{path} is a pipe or a device, not a file, so it is not read.")
    if stat.S_ISREG(found.st_mode) and found.st_size <= _LONGEST_POINTER:
        with path.open("rb") as file:
            is_pointer = file.read(len(_POINTER)) == _POINTER
        if is_pointer:
            raise DriveError(
                f"{path} is only a pointer of Git LFS, not the file itself; run `git lfs pull` in {path.parent}."
            )


def require_own_files(folder: Path) -> None:
    """Raise DriveError for a link in a folder that leads outside of it.

    Without this check, the author of the folder could have any file of this machine read and shown in a message.
    Subfolders are checked to `_READ_LEVELS` levels, as deep as readers search; deeper paths come only from lists, and
    `require_within` checks those.
    """
    if not folder.is_dir():
        return
    found = [(folder, 0)]
    while found:
        place, level = found.pop()
        with os.scandir(place) as entries:
            for entry in entries:
                if entry.is_symlink():
                    link = Path(entry.path)
                    # A broken or circular link shows nothing.
                    if link.exists() and not link.resolve().is_relative_to(folder.resolve()):
                        raise DriveError(
                            f"{link} is a link to outside of {folder}, and links are not followed there. If you trust "
                            "its target, copy the folder with `cp -rL` and import the copy; otherwise remove the link."
                        )
                elif level < _READ_LEVELS and entry.is_dir(follow_symlinks=False):
                    found.append((Path(entry.path), level + 1))


def is_from_lfs(folder: Path) -> bool:
    """Tell whether a folder keeps files in Git LFS, by its own `.gitattributes` or that of its repository."""
    try:
        root = next((each for each in (folder, *folder.resolve().parents) if (each / ".git").exists()), folder)
        for path in {folder / _ATTRIBUTES, root / _ATTRIBUTES}:
            if path.is_file() and path.stat().st_size < _MOST_ATTRIBUTES and b"filter=lfs" in path.read_bytes():
                return True
    except OSError:
        return False
    return False


def require_within(path: Path, folder: Path) -> None:
    """Raise DriveError for a path that leads out of a folder, by its name or by links."""
    try:
        is_within = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # A zero byte in the name, or links in a circle.
        raise DriveError(f"{path} cannot be resolved ({error!s:.120}).") from error
    if not is_within:
        raise DriveError(f"{path} lies outside of {folder}, so it is not read.")


def read_bytes_within(folder: Path, name: str) -> bytes:
    """Return the bytes of an image within a folder. Raises DriveError for a missing or too large file, or one outside
    of it."""
    path = folder / name
    require_within(path, folder)
    try:
        return read_foreign(path, most_bytes=MOST_IMAGE_BYTES, what="image of a robot")
    except (OSError, ValueError) as error:
        raise DriveError(f"{name} cannot be read from {folder} ({error!s:.120}).") from error
