"""Registry of the formats that can be read: readers of installed packages in the entry-point group `ltvn.readers`.

Owns the choice of a reader for a path. The toolkit's own readers are found in the same way as those of other packages,
and a reader's module is imported only when it is needed.
"""

import logging
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from itertools import islice
from pathlib import Path
from typing import cast

from ltvn_core.data.importing.foreign_files import require_own_files, require_plain
from ltvn_core.data.importing.guarded_reader import guarded_reader
from ltvn_core.data.importing.raw_frame import DriveReader, ReaderClass, ReadOptions
from ltvn_core.errors import DriveError, LtvnError, PluginError
from ltvn_core.plugins import OWN_PACKAGE, READERS, Plugin, find_plugins

log = logging.getLogger(__name__)

AUTO = "auto"
_MOST_ENTRIES = 100
"""Largest number of entries that are checked in a folder that no reader recognises."""
_MOST_NAMED = 10
_SCENES = (".glb", ".gltf", ".obj", ".ply")
"""Endings of scene files, as in `simulation.meshes.mesh_file.FORMATS`, which readers must not import."""
LAST = "folder"
"""Name of the reader that is tried last, because folders of most formats also look like a folder of pictures."""


def reader_names() -> tuple[str, ...]:
    """Return the names of all readers, in the order in which `open_drive` tries them."""
    return tuple(_readers())


def open_drive(path: Path | str, name: str = AUTO, options: ReadOptions | None = None) -> DriveReader:
    """Open a drive with the reader of that name, or the first one that recognises it.

    Raises DriveError if there is no such file or no reader recognises it, PluginError and MissingLibraryError where the
    reader cannot be loaded.
    """
    path = Path(path)
    if not path.exists():
        raise DriveError(f"There is no file or folder {path}.")
    readers = _readers()
    if name not in (AUTO, *readers):
        raise DriveError(f"No reader is called {name!r}; there are {AUTO}, {', '.join(readers)}.")
    plugins = _recognising(path) if name == AUTO else iter([readers[name]])
    for plugin in plugins:
        try:
            require_own_files(path)
        except OSError as error:
            raise DriveError(f"{path} cannot be looked through ({error!s:.120}); change its permissions.") from error
        try:
            return open_with(plugin, path, options or ReadOptions())
        except PluginError as error:
            if name != AUTO:
                raise
            log.warning(str(error))
    raise _refusal(path)


def open_with(plugin: Plugin, path: Path, options: ReadOptions) -> DriveReader:
    """Open a drive with one reader. Raises DriveError for the drive, and PluginError for a broken reader."""
    reader = load_reader(plugin)
    if plugin.package == OWN_PACKAGE:
        return reader.open(path, options)
    with plugin.running(f"could not open {path}"):
        return guarded_reader(plugin, reader.open(path, options))


def is_drive(path: Path) -> bool:
    """Tell whether any reader recognises a file or folder; a reader that fails or cannot be loaded is skipped."""
    return recognised_format(path) is not None


def recognised_format(path: Path) -> str | None:
    """Return the name of the first reader that recognises a file or folder; None if none does."""
    for plugin in _readers().values():
        try:
            if load_reader(plugin).recognises(path):
                return plugin.name
        except Exception as error:  # A reader of another package may raise anything; the list must appear nevertheless.
            log.debug("the reader %s cannot look at %s: %s", plugin.name, path, error)
    return None


def _recognising(path: Path) -> Iterator[Plugin]:
    """Yield the readers that recognise a path; a broken one is logged.

    Raises MissingLibraryError if none does and a library is missing.
    """
    missing: list[LtvnError] = []
    found = False
    for plugin in _readers().values():
        try:
            reader = load_reader(plugin)
            with nullcontext() if plugin.package == OWN_PACKAGE else plugin.running(f"could not look at {path}"):
                recognised = bool(reader.recognises(path))
        except PluginError as error:
            log.warning(str(error))
            continue
        except LtvnError as error:
            missing.append(error)
            continue
        if recognised:
            found = True
            yield plugin
    if missing and not found:
        raise missing[0]


def _refusal(path: Path) -> DriveError:
    """Return what to say about a path that no reader can open."""
    if inside := _drives_in(path):
        more = f", and {len(inside) - _MOST_NAMED} more" if len(inside) > _MOST_NAMED else ""
        return DriveError(
            f"{path} is not a drive, but contains {len(inside)}; import each by its own path: "
            f"{', '.join(map(str, inside[:_MOST_NAMED]))}{more}."
        )
    if path.suffix.lower() in _SCENES:
        return DriveError(f"{path} is a scene, not a drive: `ltvn app --scene {path}` opens it, to drive in.")
    if path.is_file() and path.stat().st_size == 0:
        return DriveError(f"{path} is empty (0 bytes); copy or record it again.")
    if path.is_dir() and not any(path.iterdir()):
        return DriveError(f"{path} is an empty folder; name the file or folder of one drive.")
    from ltvn_core.data.importing.folder_reader import most_pictures  # A reader is imported only when it is needed.

    if path.is_dir() and most_pictures(path) == 1:
        return DriveError(f"{path} holds one picture, and a drive has at least two; name the folder of all its images.")
    require_plain(path)  # No reader may recognise a Git LFS pointer as the file that it stands for.
    return DriveError(
        f"{path} is not in a supported format ({', '.join(reader_names())}); name the file or folder of one drive, "
        "and its format with --format if it was not recognised."
    )


def _drives_in(path: Path) -> list[Path]:
    """Return those of the first entries of a folder that are drives: folders of pictures last, and among them those
    that hold no colours, such as depth or masks, after the others."""
    if not path.is_dir():
        return []
    from ltvn_core.data.importing.folder_reader import shows_colours  # As above.

    found = {each: recognised_format(each) for each in sorted(islice(path.iterdir(), _MOST_ENTRIES))}
    drives = [each for each, name in found.items() if name is not None]
    return sorted(drives, key=lambda each: (found[each] == LAST and 1 + (not shows_colours(each)), each))


def load_reader(plugin: Plugin) -> ReaderClass:
    """Import a reader's class. Raises PluginError if it lacks a method."""
    reader = plugin.load()
    if not (callable(getattr(reader, "recognises", None)) and callable(getattr(reader, "open", None))):
        raise plugin.refusal("is not a reader: it lacks the class methods recognises and open")
    return cast(ReaderClass, reader)


def _readers() -> Mapping[str, Plugin]:
    found = find_plugins(READERS)
    return {name: found[name] for name in sorted(found, key=lambda name: (name == LAST, name))}
