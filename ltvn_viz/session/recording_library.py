"""The folder of recordings: its content, and file names that never overwrite.

Owns all paths that the page may use. A name from a browser is only looked up in the list of existing files. The names
of the list are readable, also where the name of a file is not valid UTF-8.
Recordings that the page opens in Rerun are served until the app ends.
"""

import os
from contextlib import ExitStack
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import NamedTuple

from ltvn_core.atomic_files import MIN_FREE_DISK_BYTES, require_new_path
from ltvn_core.data.importing.reader_registry import is_drive
from ltvn_core.errors import RecordingError, ServerError
from ltvn_core.findings import Finding
from ltvn_core.readable_text import readable

SUFFIX = ".rrd"
DISCARDED = "discarded"
OTHER_SUFFIXES = (".safetensors", ".json")
"""Endings of other files that the toolkit writes beside recordings."""


class MadeRecording(NamedTuple):
    """A new recording of the library."""

    name: str
    text: str
    """Description of the recording's content."""
    findings: tuple[Finding, ...] = ()
    """Doubtful findings about the recording."""


class RecordingLibrary:
    """Recordings in one folder. Paths for new files are returned only if they can be written."""

    def __init__(self, folder: Path) -> None:
        """Use `folder`, which is created for the first recording."""
        self.folder = folder
        self._seen: dict[tuple[str, int], bool] = {}
        """Whether an entry, by its name and time, is a drive in another format."""

    def names(self) -> tuple[str, ...]:
        """Return the names of the recordings, newest first."""
        return tuple(self.words())

    def words(self) -> dict[str, str]:
        """Return the recordings, newest first, each with a short description of its file: time and size."""
        try:
            with os.scandir(self.folder) as entries:
                found = [(entry.stat(), readable(entry.name)) for entry in entries if _is_recording(entry)]
        except OSError:
            return {}  # The folder does not exist or is unreadable; the start of a recording reports which.
        found.sort(key=lambda each: (each[0].st_mtime, each[1]), reverse=True)
        return {
            name: f"{datetime.fromtimestamp(stat.st_mtime):%Y-%m-%d %H:%M}, {stat.st_size / 1e6:.1f} MB"
            for stat, name in found
        }

    def path(self, name: str) -> Path:
        """Return the path of a recording of the list; raises RecordingError for anything else."""
        if name not in self.names():
            raise RecordingError(
                f"There is no recording “{name}” in {self.folder}. Choose one from the list; files elsewhere must be "
                "copied into that folder first."
            )
        return self._place(name)

    def sources(self) -> tuple[str, ...]:
        """Return the names of the drives in other formats, which can be imported: bags, databases, folders."""
        try:
            with os.scandir(self.folder) as entries:
                found = {(entry.name, entry.stat().st_mtime_ns) for entry in entries if _may_be_drive(entry)}
        except OSError:
            return ()
        self._seen = {key: self._seen[key] if key in self._seen else is_drive(self.folder / key[0]) for key in found}
        return tuple(sorted(readable(name) for (name, _), known in self._seen.items() if known))

    def source(self, name: str) -> Path:
        """Return the path of a drive in another format of the list; raises RecordingError for anything else."""
        if name not in self.sources():
            raise RecordingError(
                f"There is no drive “{name}” in {self.folder} that can be imported. Choose one from the list; files "
                "elsewhere must be copied into that folder first, or imported by `ltvn import`."
            )
        return self._place(name)

    def new_path(self, now: datetime) -> Path:
        """Return an unused path for a new recording; raises RecordingError if there is none."""
        return _free(self.folder, f"drive-{now:%Y%m%d-%H%M%S}")

    def new_file(self, stem: str, suffix: str = SUFFIX) -> Path:
        """Return an unused path for a file made from a recording; raises RecordingError."""
        return _free(self.folder, stem, suffix)

    def new_weights(self, drive: str, now: datetime) -> Path:
        """Return an unused path for weights trained on a drive; raises RecordingError."""
        return _free(self.folder, f"{Path(drive).stem}-learned-{now:%Y%m%d-%H%M%S}", ".safetensors")

    def discard(self, path: Path) -> Path:
        """Move a recording to the folder of discarded ones and return its new path."""
        return path.rename(_free(self.folder / DISCARDED, path.stem))

    def _place(self, name: str) -> Path:
        """Return the path of the entry that is listed by a name."""
        return self.folder / next((each for each in os.listdir(self.folder) if readable(each) == name), name)


def _is_recording(entry: os.DirEntry[str]) -> bool:
    return entry.name.endswith(SUFFIX) and entry.is_file(follow_symlinks=False)


def _may_be_drive(entry: os.DirEntry[str]) -> bool:
    if entry.is_symlink() or entry.name.startswith(".") or entry.name == DISCARDED:
        return False
    return not entry.name.endswith((SUFFIX, *OTHER_SUFFIXES))


def _free(folder: Path, stem: str, suffix: str = SUFFIX) -> Path:
    try:
        # A recording shows private rooms, so other users of the machine have no access by default.
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(
            f"Cannot write into {folder}: {error.strerror}. Choose another folder with --recordings."
        ) from error
    for number in count(1):
        place = folder / (f"{readable(stem)}{suffix}" if number == 1 else f"{readable(stem)}-{number}{suffix}")
        if not os.path.lexists(place):
            require_new_path(place, free_bytes=MIN_FREE_DISK_BYTES if suffix == SUFFIX else 0)
            return place
    raise AssertionError("count() never ends")


class RerunViewers:
    """Web viewers, one per recording, on free ports of this machine."""

    def __init__(self, stack: ExitStack) -> None:
        """Let `stack` close them."""
        self._stack = stack
        self._addresses: dict[Path, str] = {}

    def address(self, recording: Path) -> str:
        """Return the address of a recording, and start to serve it if necessary. Raises RecordingError, ServerError.

        Runs in one thread; the very first time takes seconds, because the viewer is unpacked.
        """
        if recording not in self._addresses:
            from ltvn_core.data.recording.viewer_server import serve_viewer

            self._addresses[recording] = self._stack.enter_context(serve_viewer(recording)).url
        return self._addresses[recording]


def rerun_unavailable(recording: Path) -> str:
    """Refuse to open Rerun, because the viewer could not be closed again."""
    raise ServerError(f"This page cannot open Rerun; run `ltvn view {recording}`.")
