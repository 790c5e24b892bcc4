"""Where an open file lies: is it still where it was made, and has its disk room for more?

Looks at the disk, and may wait for it. Writes nothing.
"""

import os
import shutil
from pathlib import Path


class FilePlace:
    """The place of an open file. Every look raises OSError when the disk cannot say."""

    def __init__(self, path: Path, file: int, min_free_bytes: int) -> None:
        """Watch the open `file` that was made as `path`; its disk has room with `min_free_bytes` left."""
        self._path, self._file, self._min_free_bytes = path, file, min_free_bytes
        # Where the two differ from the beginning, as in some network folders, only the name can be watched.
        self._is_name_telling = _same_file(os.stat(path), os.fstat(file))

    def misplacement(self) -> str | None:
        """Return what happened to the file when it is not in its place any more, else None."""
        opened = os.fstat(self._file)
        try:
            named = os.stat(self._path)
        except FileNotFoundError:
            named = None
        if named is not None and (not self._is_name_telling or _same_file(named, opened)):
            return None
        if opened.st_nlink == 0:
            return f"{self._path} was deleted while it was being recorded, and what it held is lost. Record again."
        return (
            f"{self._path} is no longer in its place: the file or a folder above it was renamed or replaced, or the "
            f"disk was unmounted. What was recorded before is in the file{self._new_place()}. Record again."
        )

    def lack_of_room(self) -> str | None:
        """Return how little room is left when it is too little, else None."""
        free = self._free_bytes()
        if free >= self._min_free_bytes:
            return None
        return (
            f"The disk under {self._path.parent} is full: {free >> 20} MiB are left, recording needs "
            f"{self._min_free_bytes >> 20} MiB. Everything up to here is kept. Free some space, then record again."
        )

    def _free_bytes(self) -> int:
        if not hasattr(os, "fstatvfs"):  # Windows.
            return shutil.disk_usage(self._path.parent).free
        disk = os.fstatvfs(self._file)
        return disk.f_bavail * disk.f_frsize

    def _new_place(self) -> str:
        try:
            place = os.readlink(f"/proc/self/fd/{self._file}")
        except OSError:
            return ""
        return f", now {place}" if place != str(self._path.absolute()) and os.path.exists(place) else ""


def _same_file(one: os.stat_result, other: os.stat_result) -> bool:
    return (one.st_dev, one.st_ino) == (other.st_dev, other.st_ino)
