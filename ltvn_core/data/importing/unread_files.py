"""Files that lie beside a drive and are not read, by what their names say that they hold.

A reader lists them among its streams, so that a missing depth, lens or odometry is not called missing where it lies
beside.
"""

import re
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

from ltvn_core.data.importing.raw_frame import SourceFact
from ltvn_core.errors import DriveError

_MOST_ENTRIES = 1000
_MOST_LISTED = 10
_TABLES = (".csv", ".txt", ".tsv", ".json", ".npy", ".npz", ".tum", ".yaml", ".yml", ".xml", ".ini", ".bin", ".pkl")
_NAMES = {
    "depth": re.compile(r"depth", re.IGNORECASE),
    "odometry": re.compile(r"odom|pose|traj|transforms|ground_?truth|arkit|^images\.(txt|bin)$", re.IGNORECASE),
    "camera_info": re.compile(r"camera|intrinsic|calib|transforms|^k\.", re.IGNORECASE),
}
"""Role -> pattern of the names of its files; depth is in folders or lists, the others in files."""
_MODELS = ("", "sparse", "sparse/0", "intrinsic")
"""Folders beside the images that hold the poses or lens of some formats."""


def unread_beside(folder: Path, used: Iterable[str] = (), *, remedy: str = "") -> list[SourceFact]:
    """Return what lies in a folder and could be depth, odometry or a lens, without the names `used`.

    `remedy` says how to use it if the options of the reader cannot.
    """
    taken = set(used)
    entries = [each for name in _MODELS for each in _entries(folder / name)]
    return [
        SourceFact("", path.relative_to(folder).as_posix() + "/" * path.is_dir(), could_be=role, remedy=remedy)
        for path in entries
        for role, pattern in _NAMES.items()
        if pattern.search(path.name)
        and (path.is_dir() if role == "depth" else path.suffix.lower() in _TABLES)
        and path.relative_to(folder).as_posix() not in taken
    ]


def require_file(path: Path, option: str, role: str) -> None:
    """Raise DriveError that names the files beside where the file of an option does not exist."""
    if path.exists():
        return
    beside = [fact.name for fact in unread_beside(path.parent) if fact.could_be == role]
    raise DriveError(
        f"There is no file {path} for {option}; in {path.parent} there could be "
        f"{', '.join(beside[:_MOST_LISTED]) or 'none'}."
    )


def _entries(folder: Path) -> Iterator[Path]:
    """Yield the visible entries of a folder in the order of their names; nothing where it cannot be listed."""
    try:
        found = sorted(islice(folder.iterdir(), _MOST_ENTRIES))
    except OSError:
        return
    yield from (path for path in found if not path.name.startswith("."))
