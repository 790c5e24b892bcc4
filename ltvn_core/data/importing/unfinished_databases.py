"""SQLite databases whose last changes still lie in a file beside them, because the program that wrote them was ended.

Owns the copy into which SQLite itself takes over these changes; the user's files stay as they are.
"""

import shutil
import sqlite3
import weakref
from contextlib import closing
from pathlib import Path
from tempfile import mkdtemp

from ltvn_core.errors import DriveError

_BESIDE = ("-wal", "-journal")
"""Endings that SQLite appends to a database's name for the files with its last changes."""


def files_beside(file: Path) -> list[Path]:
    """Return the files beside a database that hold changes to it; empty if it is finished."""
    beside = [file.with_name(file.name + ending) for ending in _BESIDE]
    return [each for each in beside if each.is_file() and each.stat().st_size]


def finished(file: Path, owner: object) -> Path:
    """Return the file of a finished database, or a copy with the changes that lie beside it, deleted with its `owner`.

    Raises DriveError if there is too little space, or if the changes cannot be read.
    """
    if not files_beside(file):
        return file
    folder = Path(mkdtemp(prefix="ltvn-"))
    weakref.finalize(owner, shutil.rmtree, folder, ignore_errors=True)
    parts = [file, *files_beside(file)]
    needed = sum(part.stat().st_size for part in parts)
    advice = f"Copy {', '.join(part.name for part in parts)} to a folder with free space, run `sqlite3 {file.name} "
    advice += "'PRAGMA wal_checkpoint(TRUNCATE)'` there, and import that copy."
    if 2 * needed > shutil.disk_usage(folder).free:
        raise DriveError(
            f"{file} was not finished, and its last changes lie beside it. To take them over, a copy needs {needed:,} "
            f"bytes in {folder.parent}, which has too little space. {advice}"
        )
    target = folder / file.name
    try:
        for part in parts:
            shutil.copyfile(part, folder / part.name)
        with closing(sqlite3.connect(target)) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA schema_version").fetchone()
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            database.execute("PRAGMA journal_mode = DELETE")
    except (OSError, sqlite3.Error) as error:
        raise DriveError(
            f"{file} was not finished, and the changes in {parts[-1].name} cannot be read: {error}."
        ) from error
    return target
