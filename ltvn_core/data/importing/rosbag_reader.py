"""The reader of ROS bags for the entry-point group; the library `rosbags` is imported only when a bag is opened.

Owns the names of bag files, and their order.
"""

from pathlib import Path

from ltvn_core.data.importing.raw_frame import DriveReader, ReadOptions
from ltvn_core.data.importing.stamped_lists import natural_order
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra

_SUFFIXES = (".mcap", ".db3", ".bag")
_COMPRESSED = ".zstd"
"""Ending that ROS 2 appends to the name of a file that it compressed as a whole."""


class RosbagReader:
    """Bags of ROS 2 (MCAP, sqlite3) and of ROS 1: a file, or a folder with the files of one bag."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell by file names alone whether a path is a bag; never raises."""
        try:
            return bool(_named_as_bag(path))
        except OSError:
            return False

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> DriveReader:
        """Open a bag. Raises DriveError, and MissingLibraryError without the library."""
        with naming_the_extra():
            from ltvn_core.data.importing.rosbag.drive_reader import BagDrive
        return BagDrive(path, _bag_files(path), options)


def _named_as_bag(path: Path) -> list[Path]:
    """Return the files at a path that have names of bags, unsorted. Raises OSError."""
    candidates = path.iterdir() if path.is_dir() else [path]
    return [file for file in candidates if _plain_suffix(file) in _SUFFIXES and file.is_file()]


def _plain_suffix(file: Path) -> str:
    """Return the ending of a file's name without the ending for compression."""
    return Path(file.stem).suffix if file.suffix == _COMPRESSED else file.suffix


def _bag_files(path: Path) -> list[Path]:
    """Return the files of a bag in the order in which they were written. Raises DriveError if there are none."""
    try:
        found = sorted(_named_as_bag(path), key=lambda file: natural_order(file.name))
    except OSError as error:
        raise DriveError(f"{path} cannot be read ({error.strerror}).") from error
    kinds = {_plain_suffix(file) for file in found}
    if not found:
        raise DriveError(f"{path} contains no bag: expected files that end in {', '.join(_SUFFIXES)}.")
    if len(kinds) > 1:
        raise DriveError(f"{path} contains bags of several kinds ({', '.join(sorted(kinds))}); name one of its files.")
    return found
