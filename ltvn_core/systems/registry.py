"""Navigation systems by name: those of this package, and those that other packages bring along.

Owns the table and how a name becomes an entry. A new system here is one file in this folder and one line in
`_OWN_SYSTEMS`; a foreign one is an entry point of the group `ltvn.systems`. An entry is imported when it is asked for,
so that listing the names costs nothing.
"""

from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from ltvn_core.errors import OptionError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.systems.entry import SystemEntry, SystemFactory

ENTRY_POINT_GROUP = "ltvn.systems"
"""Entry points of this group name a `SystemEntry`, or a function from a `Method` to a `NavigationSystem`."""

DEFAULT_SYSTEM = "ltvn"
"""The system where nobody names one, and that of maps and recordings that name none."""

_OWN_SYSTEMS = {
    "ltvn": "ltvn_core.systems.ltvn:LTVN",
    "sptm": "ltvn_core.systems.sptm:SPTM",
    "ving": "ltvn_core.systems.ving:VING",
}


def system_names() -> tuple[str, ...]:
    """Return the names of all systems: first those of this package in the order of tables, then foreign ones."""
    return tuple(_entry_points())


def own_systems() -> Iterator[SystemEntry]:
    """Yield the entries of this package in the order of tables."""
    return (system_entry(name) for name in _OWN_SYSTEMS)


def baseline_systems() -> Iterator[SystemEntry]:
    """Yield the entries of this package whose network learned labels of its own."""
    return (entry for entry in own_systems() if entry.weights != SHIPPED_WEIGHTS)


def system_entry(name: str) -> SystemEntry:
    """Return the entry of a navigation system; raises OptionError if there is none, or if it cannot be loaded."""
    found = _own_entry_point(name) or _entry_points().get(name)
    if found is None:
        raise OptionError(f"No navigation system is called {name!r}; choose one of: {', '.join(system_names())}.")
    return _load(found)


def recorded_system(config: Mapping[str, Any]) -> SystemEntry:
    """Return the system that a map or a recording was made with, by its configuration. Raises OptionError."""
    name = str(config.get("system", DEFAULT_SYSTEM))
    if (found := known_system(name)) is None:
        raise OptionError(
            f"This was made with the navigation system {name!r}, which is not installed here; known are: "
            f"{', '.join(system_names())}. Install the package that brings it."
        )
    return found


def known_system(name: str) -> SystemEntry | None:
    """Return the entry of a system, None where it is not installed here. Raises OptionError if it cannot be loaded."""
    return system_entry(name) if name in system_names() else None


def _own_entry_point(name: str) -> EntryPoint | None:
    value = _OWN_SYSTEMS.get(name)
    return None if value is None else EntryPoint(name, value, ENTRY_POINT_GROUP)


def _entry_points() -> dict[str, EntryPoint]:
    """Return where each system is found by name; a foreign one never takes the place of one of ours."""
    foreign = {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}
    own = {name: point for name in _OWN_SYSTEMS if (point := _own_entry_point(name)) is not None}
    return own | {name: point for name, point in sorted(foreign.items()) if name not in own}


def _load(point: EntryPoint) -> SystemEntry:
    package = f" of the package {point.dist.name}" if point.dist is not None else ""
    where = f"The navigation system {point.name!r}{package} ({point.value})"
    try:
        found = point.load()
    except Exception as error:  # Whatever a foreign module raises when it is imported.
        raise OptionError(
            f"{where} cannot be loaded ({type(error).__name__}: {error}). Repair or uninstall that package."
        ) from error
    if isinstance(found, SystemEntry) and found.name == point.name:
        return found
    if callable(found):
        return SystemEntry(name=point.name, label=point.name, factory=cast(SystemFactory, found))
    raise OptionError(
        f"{where} is neither a SystemEntry of that name nor a function from a Method to a NavigationSystem; "
        f"it is {found!r}."
    )
