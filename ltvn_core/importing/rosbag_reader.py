"""The reader of ROS bags as the entry-point group knows it; the library `rosbags` is imported when a bag is opened."""

from pathlib import Path

from ltvn_core.extras import naming_the_extra
from ltvn_core.importing.raw_frame import DriveReader, ReadOptions
from ltvn_core.importing.rosbag.file_names import named_as_bag


class RosbagReader:
    """Bags of ROS 2 (MCAP, sqlite3) and of ROS 1: a file, or a folder with the files of one bag."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a bag, by the names of files alone; never raises."""
        try:
            return bool(named_as_bag(path))
        except OSError:
            return False

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> DriveReader:
        """Open a bag. Raises DriveError, and MissingLibraryError without the library."""
        with naming_the_extra():
            from ltvn_core.importing.rosbag.drive_reader import open_bag
        return open_bag(path, options)
