"""The files that a program may ask about: only those that were named at the start.

Owns their names, and the choice of which files stay open. A name from a program is only looked up in the list; it is
never used as a path.
"""

from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path

from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.readable_text import readable
from ltvn_core.terminal_text import which_name
from ltvn_viz.debugger.file_context import FileCase
from ltvn_viz.session.recording_library import SUFFIX, RecordingLibrary

_OPEN = 3
"""Largest number of open files; a long recording takes a gigabyte of memory."""
_SHOWN = 20


class NamedFiles:
    """Recordings and maps, each with the name that a program uses for it. For one thread at a time."""

    def __init__(self, paths: Iterable[Path]) -> None:
        """Use the given files; a folder stands for all recordings that are in it now. Raises OptionError."""
        found = dict.fromkeys(path for named in paths for path in _recordings(named))
        if not found:
            raise OptionError(
                "The named files and folders contain no recording; name .rrd files, or a folder that holds some."
            )
        self.by_name: Mapping[str, Path] = _short_names([*found])
        self._library = _NamedLibrary(self.by_name)
        self._open: OrderedDict[tuple[str, int, int], FileCase] = OrderedDict()

    def case(self, name: str) -> FileCase:
        """Return an open file. Raises OptionError for an unknown name, and RecordingError for a damaged file."""
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
        """Return the path of a file. Raises OptionError for an unknown name."""
        if name not in self.by_name:
            listed = [*self.by_name][:_SHOWN]
            raise OptionError(
                f"There is no file {name[:100]!r}. {which_name(name[:100], listed)}; list_files returns all names."
            )
        return self.by_name[name]


class _NamedLibrary(RecordingLibrary):
    """A library of the named files, in place of a folder."""

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
        library = RecordingLibrary(named)
        return [library.path(name) for name in sorted(library.names())]
    if not named.is_file():
        raise OptionError(f"{named} does not exist; name .rrd files, or a folder that holds some.")
    if named.suffix != SUFFIX:
        raise OptionError(f"{named} is not a {SUFFIX} file; convert it with `ltvn import` first.")
    return [named]


def _short_names(paths: list[Path]) -> dict[str, Path]:
    """Return the files by name: the last part of the path, or the whole path if several files have the same last
    part."""
    names = [path.name for path in paths]
    return {readable(path.name if names.count(path.name) == 1 else str(path)): path for path in paths}
