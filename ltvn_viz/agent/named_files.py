"""The files that a program may ask about: those that were named at the start, and no others.

Owns their names and which of them are open. A name that comes from a program is only ever looked up in the list.
"""

from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path

from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.terminal_text import which_name
from ltvn_viz.debugger.file_context import FileCase
from ltvn_viz.session.recording_library import SUFFIX, RecordingLibrary

_OPEN = 3
"""Largest number of open files; a long recording takes a gigabyte of memory."""
_SHOWN = 20


class NamedFiles:
    """Recordings and maps by the names under which a program knows them. For one thread at a time."""

    def __init__(self, paths: Iterable[Path]) -> None:
        """Take files, and all recordings that lie in the folders among them now. Raises OptionError."""
        found = dict.fromkeys(path for named in paths for path in _recordings(named))
        if not found:
            raise OptionError(
                "The named files and folders contain no recording; name .rrd files, or a folder that holds some."
            )
        self.by_name: Mapping[str, Path] = _short_names([*found])
        self._library = _NamedLibrary(self.by_name)
        self._open: OrderedDict[tuple[str, int, int], FileCase] = OrderedDict()

    def case(self, name: str) -> FileCase:
        """Return an open file. Raises OptionError for another name, and RecordingError for a damaged file."""
        path = self.path(name)
        try:
            stat = path.stat()
        except OSError as error:
            raise RecordingError(f"{name} cannot be read now ({error.strerror}).") from error
        key = name, stat.st_mtime_ns, stat.st_size
        if key not in self._open:
            self._open[key] = FileCase(path, self._library)
            while len(self._open) > _OPEN:
                self._open.popitem(last=False)
        self._open.move_to_end(key)
        return self._open[key]

    def path(self, name: str) -> Path:
        """Return where a file lies. Raises OptionError for any other name than those that there are."""
        if name not in self.by_name:
            listed = [*self.by_name][:_SHOWN]
            raise OptionError(
                f"There is no file {name[:100]!r}. {which_name(name[:100], listed)}; list_files returns all names."
            )
        return self.by_name[name]


class _NamedLibrary(RecordingLibrary):
    """The named files in place of a folder."""

    def __init__(self, by_name: Mapping[str, Path]) -> None:
        super().__init__(next(iter(by_name.values())).parent)
        self._by_name = by_name

    def names(self) -> tuple[str, ...]:
        return tuple(self._by_name)

    def sources(self) -> tuple[str, ...]:
        return ()

    def path(self, name: str) -> Path:
        if name not in self._by_name:
            raise RecordingError(f"There is no recording {name[:100]!r}; there are {', '.join(self.names()[:_SHOWN])}.")
        return self._by_name[name]


def _recordings(named: Path) -> list[Path]:
    if named.is_dir():
        return [named / name for name in sorted(RecordingLibrary(named).names())]
    if not named.is_file():
        raise OptionError(f"{named} does not exist; name .rrd files, or a folder that holds some.")
    if named.suffix != SUFFIX:
        raise OptionError(f"{named} is not a {SUFFIX} file; convert it with `ltvn import` first.")
    return [named]


def _short_names(paths: list[Path]) -> dict[str, Path]:
    """Name files by their last part, or by the whole path where two have the same."""
    names = [path.name for path in paths]
    return {path.name if names.count(path.name) == 1 else str(path): path for path in paths}
