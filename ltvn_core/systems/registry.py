"""Navigation systems by name: those of this package, and plug-ins of other packages.

Owns their order and the loading of an entry by name. All are entry points of the group `ltvn.systems`, which name a
`SystemEntry`, or a function from a `Method` to a `NavigationSystem`. A new one here is one row in
`system_table`, one line in pyproject.toml and one in `OWN_SYSTEMS`. Entries are imported lazily, so that listing the
names is fast.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

from ltvn_core.errors import OptionError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS, shipped_weights
from ltvn_core.plugins import OWN_PACKAGE, SYSTEMS, Plugin, find_plugins, require_own
from ltvn_core.systems.entry import SystemEntry, SystemFactory
from ltvn_core.terminal_text import which_name

if TYPE_CHECKING:  # The command line reads the names of systems and must not wait for numpy.
    from ltvn_core.config import Method
    from ltvn_core.graph.navigation_system import NavigationSystem

DEFAULT_SYSTEM = "ltvn"
"""The default system, also for maps and recordings that name none."""

OWN_SYSTEMS = ("ltvn", "sptm", "ving", "meng", "sgm", "sorb", "htm", "brm", "placenav")
"""The systems of this package, in the order in which tables list them."""


def system_names() -> tuple[str, ...]:
    """Return the names of all systems: first those of this package in the order of tables, then plug-ins."""
    return tuple(_systems())


def own_systems() -> Iterator[SystemEntry]:
    """Yield the entries of this package in the order of tables."""
    return (system_entry(name) for name in OWN_SYSTEMS)


def baseline_systems() -> Iterator[SystemEntry]:
    """Yield the entries of this package with their own network, trained on their own labels."""
    return (entry for entry in own_systems() if entry.weights == shipped_weights(entry.name) != SHIPPED_WEIGHTS)


def network_owner(name: str) -> str:
    """Return the first system with the same initial weights and learning as the named one, which may be itself."""
    entry = system_entry(name)
    alike = (each.name for each in own_systems() if (each.weights, each.learning) == (entry.weights, entry.learning))
    return next(alike, name)


def system_entry(name: str) -> SystemEntry:
    """Return the entry of a navigation system; raises OptionError if there is none, PluginError if it is broken."""
    found = _systems().get(name)
    if found is None:
        require_own(SYSTEMS, name, OWN_SYSTEMS)
        raise OptionError(f"No navigation system is called {name!r}. {which_name(name, system_names())}.")
    return load_system(found)


def open_system(name: str, method: "Method") -> "NavigationSystem":
    """Return a navigation system by its name.

    Args:
        name: `ltvn`, `sptm`, `ving`, or a name that another package adds to the entry points `ltvn.systems`.
        method: Thresholds of the system.

    Raises:
        OptionError: No system has that name; the message lists the known ones.
    """
    return system_entry(name).factory(method)


def recorded_system(config: Mapping[str, Any]) -> SystemEntry:
    """Return the system that a map or a recording was made with, by its configuration.

    Raises OptionError if it is not installed, and PluginError if it is broken.
    """
    name = str(config.get("system", DEFAULT_SYSTEM))
    if (found := known_system(name)) is None:
        raise OptionError(
            f"This was made with the navigation system {name!r}, which is not installed here; known are: "
            f"{', '.join(system_names())}. Install the package that contains it."
        )
    return found


def known_system(name: str) -> SystemEntry | None:
    """Return the entry of a system; None if it is not installed. Raises PluginError if it is broken."""
    return system_entry(name) if name in system_names() else None


def _systems() -> dict[str, Plugin]:
    return find_plugins(SYSTEMS, first=OWN_SYSTEMS)


def load_system(plugin: Plugin) -> SystemEntry:
    """Import a system's entry. Raises PluginError if it cannot be loaded or is not an entry."""
    found = plugin.load()
    if isinstance(found, SystemEntry) and found.name == plugin.name and callable(found.factory):
        return (
            found if plugin.package == OWN_PACKAGE else replace(found, factory=_CheckedFactory(plugin, found.factory))
        )
    if callable(found):
        factory = _CheckedFactory(plugin, cast(SystemFactory, found))
        return SystemEntry(name=plugin.name, label=plugin.name, factory=factory)
    raise plugin.refusal("is neither a SystemEntry with that name nor a function from a Method to a NavigationSystem")


@dataclass(frozen=True, slots=True)
class _CheckedFactory:
    """The factory of another package, which raises PluginError where that one fails or makes something else."""

    plugin: Plugin
    factory: SystemFactory

    def __call__(self, method: "Method") -> "NavigationSystem":
        from ltvn_core.graph.navigation_system import NavigationSystem

        with self.plugin.running("cannot be made"):
            made: object = self.factory(method)
        if not isinstance(made, NavigationSystem):
            raise self.plugin.refusal(f"makes {type(made).__name__}, not a ltvn_core.NavigationSystem")
        return made
