"""How the files of bags are called. Imports no library, so that asking costs nothing."""

from pathlib import Path

SUFFIXES = (".mcap", ".db3", ".bag")
COMPRESSED = ".zstd"
"""Appended to a file's name where ROS 2 compressed the whole file."""


def named_as_bag(path: Path) -> list[Path]:
    """Return the files at a path that are called like bags, unsorted. Raises OSError."""
    candidates = path.iterdir() if path.is_dir() else [path]
    return [file for file in candidates if plain_suffix(file) in SUFFIXES and file.is_file()]


def plain_suffix(file: Path) -> str:
    """Return the ending of a file's name before it was compressed."""
    return Path(file.stem).suffix if file.suffix == COMPRESSED else file.suffix
