"""Maintenance strategies by name: how driving changes a map.

Owns the meaning of the names. Any navigation system can use any of them; by default it uses its own.
"""

from dataclasses import replace
from typing import TypeVar

from ltvn_core.config import PAPER, ROBUST, BeliefConfig
from ltvn_core.errors import OptionError
from ltvn_core.graph.ltvn import LifelongMaintenance, PresenceMaintenance
from ltvn_core.graph.navigation_system import NavigationSystem, NoMaintenance
from ltvn_core.graph.presence.edge_presence import ALWAYS_OPEN, EdgePresence, FilteredPresence
from ltvn_core.graph.presence.presence_filter import PERSISTENT, PresenceFilter
from ltvn_core.systems.brm import BayesianEdges, RoomOf
from ltvn_core.systems.maintenance_names import MAINTENANCE_NAMES
from ltvn_core.terminal_text import which_name

_Told = TypeVar("_Told")


def with_maintenance(
    system: NavigationSystem, name: str, *, truth: EdgePresence | None = None, room_of: RoomOf | None = None
) -> NavigationSystem:
    """Return the same system with another maintenance.

    Args:
        system: System to copy.
        name: One of `MAINTENANCE_NAMES`.
        truth: Presence of edges by ground truth; only for `truth`.
        room_of: Rooms of the nodes by ground truth; only for `brm-rooms`.

    Raises:
        OptionError: There is no such name, or its ground truth is missing.
    """
    if name == "static":
        return replace(system, maintenance=NoMaintenance(), presence=ALWAYS_OPEN)
    if name in ("paper", "robust"):
        preset = PAPER if name == "paper" else ROBUST
        method = replace(system.method, believing=_believing(preset.believing, system.method.believing))
        return replace(system, maintenance=LifelongMaintenance(method), presence=ALWAYS_OPEN)
    if name in ("brm", "brm-rooms"):
        rooms = _known(room_of, name, "which rooms its nodes lie in") if name == "brm-rooms" else None
        return replace(system, maintenance=BayesianEdges(rooms), presence=ALWAYS_OPEN)
    if name == "persistent":
        return with_presence_filter(system, PERSISTENT)
    if name != "truth":
        raise OptionError(f"No maintenance is called {name!r}. {which_name(name, MAINTENANCE_NAMES)}.")
    return _with_presence(system, _known(truth, name, "which edges are open"))


def with_presence_filter(system: NavigationSystem, presence_filter: PresenceFilter) -> NavigationSystem:
    """Return the same system, which plans by what a filter says of each edge: open now or not."""
    return _with_presence(system, FilteredPresence(presence_filter))


def _with_presence(system: NavigationSystem, presence: EdgePresence) -> NavigationSystem:
    return replace(system, maintenance=PresenceMaintenance(system.method), presence=presence)


def _known(told: _Told | None, name: str, what: str) -> _Told:
    """Return the ground truth; raises OptionError if it is missing."""
    if told is None:
        raise OptionError(
            f"The maintenance {name!r} needs to know from the simulator {what}, so it works only in simulated worlds "
            "that change. Choose another maintenance."
        )
    return told


def recorded_filter(name: str) -> PresenceFilter | None:
    """Return the presence filter of a recorded run by the name of its maintenance, which may be empty.

    None if its plans ignored presence. For an empty name, and for a filter that is no longer part of the package, the
    current filter is returned.
    """
    if name in ("static", "paper", "robust", "brm", "brm-rooms"):
        return None
    return PERSISTENT


def recorded_maintenance(system: NavigationSystem) -> str:
    """Return the name of a system's presence filter; empty if it has none."""
    presence = system.presence
    judges = presence.presence_filter if isinstance(presence, FilteredPresence) else None
    return "persistent" if judges is PERSISTENT else ""


def _believing(preset: BeliefConfig, measured: BeliefConfig) -> BeliefConfig:
    """Return the rules of a preset with the constants that were measured for the predictor."""
    return replace(
        preset,
        p_success_if_reachable=measured.p_success_if_reachable,
        p_success_if_not=measured.p_success_if_not,
        sigma2=measured.sigma2,
    )
