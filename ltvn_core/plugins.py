"""Plug-ins: additions to the toolkit by entry points in the `pyproject.toml` of packages, including our own.

Owns the groups, the package that wins if two offer the same name, and the import of a plug-in: it is imported only when
it is requested, and a failure, also a later one of its code, names its package. The code that uses a plug-in checks it.
"""

import logging
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, distributions, entry_points
from traceback import walk_tb
from typing import Generic, NamedTuple, TypeVar

from ltvn_core.errors import LtvnError, PluginError
from ltvn_core.extras import naming_the_extra

log = logging.getLogger(__name__)

OWN_PACKAGE = "ltvn"

Loaded = TypeVar("Loaded")


class PluginGroup(NamedTuple):
    """A kind of plug-in."""

    name: str
    """Entry-point group, as in `[project.entry-points."ltvn.verbs"]`."""
    noun: str
    """Noun for one plug-in in messages."""


VERBS = PluginGroup("ltvn.verbs", "verb")
PREDICTORS = PluginGroup("ltvn.predictors", "predictor")
SYSTEMS = PluginGroup("ltvn.systems", "navigation system")
ROBOTS = PluginGroup("ltvn.robots", "robot")
READERS = PluginGroup("ltvn.readers", "reader")
SCENES = PluginGroup("ltvn.scenes", "scene")
QUESTIONS = PluginGroup("ltvn.questions", "question")

GROUPS = (VERBS, PREDICTORS, SYSTEMS, ROBOTS, READERS, SCENES, QUESTIONS)


@dataclass(frozen=True, slots=True)
class Plugin:
    """One name that a package offers in a group; the object is not imported yet."""

    group: PluginGroup
    entry: EntryPoint

    @property
    def name(self) -> str:
        """Name that the user types."""
        return self.entry.name

    @property
    def place(self) -> str:
        """Location of the object, as `package.module:object`."""
        return self.entry.value

    @property
    def package(self) -> str:
        """Name of the package; `unknown` if its metadata is missing."""
        return _package_of(self.entry)

    @property
    def version(self) -> str:
        """Version of the package; `unknown` if its metadata is missing."""
        return (self.entry.dist and self.entry.dist.version) or "unknown"

    @property
    def title(self) -> str:
        """Name in messages, such as `The robot turtle of the package turtles`."""
        known = f" of the package {self.package}" if self.entry.dist is not None else ""
        return f"The {self.group.noun} {self.name}{known}"

    def load(self) -> object:
        """Import the object.

        Raises:
            PluginError: It cannot be imported, for whatever reason.
            MissingLibraryError: It needs a library that an extra installs.
        """
        with self.running("cannot be loaded"):
            return self.entry.load()

    @contextmanager
    def running(self, failure: str) -> Iterator[None]:
        """Run code of the plug-in: whatever it raises becomes a PluginError with its title, `failure` and a remedy.

        Errors of the toolkit itself, which are written for the user, pass.
        """
        try:
            with naming_the_extra():
                yield
        except LtvnError:
            raise
        except (Exception, SystemExit) as error:  # Code of another package may raise anything.
            raise PluginError(f"{self.title} {failure} ({type(error).__name__}: {error}); {self.remedy}.") from error

    def refusal(self, reason: str) -> PluginError:
        """Return the error for an object that was loaded but cannot be used; `reason` completes the sentence after its
        location."""
        return PluginError(f"{self.title} is {self.place}, which {reason}; {self.remedy}.")

    @property
    def remedy(self) -> str:
        """Remedy for a broken plug-in."""
        if self.package == OWN_PACKAGE:
            return "reinstall the toolkit: pip install ltvn (or -e .)"
        return "update, repair or uninstall that package"


@dataclass(frozen=True, slots=True)
class LoadedPlugins(Generic[Loaded]):
    """The usable plug-ins of a group, and the errors of the others."""

    by_name: Mapping[str, Loaded]
    broken: Sequence[str]
    """One message for each plug-in that could not be loaded."""


def find_plugins(
    group: PluginGroup, *, first: Sequence[str] = (), entries: Iterable[EntryPoint] | None = None
) -> dict[str, Plugin]:
    """Return the plug-ins of a group by name. Nothing is imported.

    If several packages offer the same name, the toolkit's own plug-in wins, otherwise that of the package whose name
    comes first.

    Args:
        group: Which kind.
        first: Names to put first, in this order; the others follow by name.
        entries: Where to look instead of in the installed packages.
    """
    offered = _installed(tuple(sys.path)) if entries is None else _own_first(entries)
    found: dict[str, Plugin] = {}
    for entry in offered:
        if entry.group == group.name:
            found.setdefault(entry.name, Plugin(group, entry))
    places = {name: place for place, name in enumerate(first)}
    return {name: found[name] for name in sorted(found, key=lambda name: (places.get(name, len(places)), name))}


def left_out_plugins(group: PluginGroup) -> Iterator[tuple[Plugin, Plugin]]:
    """Yield each plug-in whose name another package has already, with the plug-in that is used."""
    used = find_plugins(group)
    for entry in _installed(tuple(sys.path)):
        if entry.group == group.name and entry != used[entry.name].entry:
            yield Plugin(group, entry), used[entry.name]


def plugin_at_fault(error: BaseException) -> Plugin | None:
    """Return the plug-in of another package in whose code an error arose; None if it arose in none.

    A package with several plug-ins in one module is named by its first one.
    """
    foreign = {
        entry.module.partition(".")[0]: Plugin(group, entry)
        for group in reversed(GROUPS)
        for entry in _installed(tuple(sys.path))
        if entry.group == group.name and _package_of(entry) != OWN_PACKAGE
    }
    modules = [str(frame.f_globals.get("__name__")).partition(".")[0] for frame, _ in walk_tb(error.__traceback__)]
    return next((foreign[module] for module in reversed(modules) if module in foreign), None)


def require_own(group: PluginGroup, name: str, own: Sequence[str]) -> None:
    """Raise PluginError if `name` is one of the toolkit's own plug-ins whose code exists, but which is not
    installed."""
    if name in own:
        raise PluginError(
            f"The {group.noun} {name} of the toolkit itself is not installed: its code is newer than its installation. "
            "Install it again: pip install -e . (or pip install ltvn)."
        )


def load_plugins(plugins: Mapping[str, Plugin], load: Callable[[Plugin], Loaded]) -> LoadedPlugins[Loaded]:
    """Load plug-ins by a function that raises LtvnError; a failing plug-in is reported, and the others are still
    loaded."""
    by_name: dict[str, Loaded] = {}
    broken: list[str] = []
    for name, plugin in plugins.items():
        try:
            by_name[name] = load(plugin)
        except LtvnError as error:
            broken.append(str(error))
    return LoadedPlugins(by_name, broken)


@lru_cache(maxsize=8)
def _installed(_path: tuple[str, ...]) -> Sequence[EntryPoint]:
    """Return the entry points of all groups from the packages on the import path, ours first.

    This takes some 80 ms, half of it for the names of the packages, each of which is in a separate file.
    """
    try:
        found = entry_points()
        return _own_first(entry for group in GROUPS for entry in found.select(group=group.name))
    except Exception:  # The entry points of one package are invalid.
        names = {group.name for group in GROUPS}
        return _own_first(entry for entry in _readable_entries() if entry.group in names)


def _package_of(entry: EntryPoint) -> str:
    return (entry.dist and entry.dist.name) or "unknown"


def _own_first(entries: Iterable[EntryPoint]) -> Sequence[EntryPoint]:
    """Sort entry points by package, the toolkit's own first."""

    def place(entry: EntryPoint) -> tuple[bool, str]:
        package = _package_of(entry)
        return package != OWN_PACKAGE, package

    return sorted(entries, key=place)


def _readable_entries() -> Iterator[EntryPoint]:
    """Yield the entry points of each package whose list is valid, and log the names of the other packages."""
    seen: set[str] = set()
    for package in distributions():
        name = "a package without a name"
        try:
            name = str(package.name)
            entries = list(package.entry_points)
        except Exception as error:
            log.warning("The plug-ins of the package %s cannot be read (%s); update or uninstall it.", name, error)
            continue
        if name not in seen:
            yield from entries
        seen.add(name)
