"""What driving teaches a map, by name: from nothing at all to the truth of the moment.

Owns what the names stand for. Any navigation system can have any of them; without a name it has its own.
"""

from dataclasses import replace
from typing import TypeVar

from ltvn_core.config import PAPER, ROBUST, BeliefConfig
from ltvn_core.errors import OptionError
from ltvn_core.graph.ltvn import LifelongMaintenance
from ltvn_core.graph.navigation_system import NavigationSystem, NoMaintenance
from ltvn_core.graph.node_views import ViewConfig
from ltvn_core.graph.presence.edge_presence import ALWAYS_OPEN, EdgePresence, FilteredPresence
from ltvn_core.graph.presence.persistent import PERSISTENT
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.presence.presence_maintenance import PresenceMaintenance
from ltvn_core.systems.brm import BayesianEdges, RoomOf
from ltvn_core.systems.maintenance_names import MAINTENANCE_NAMES
from ltvn_core.terminal_text import which_name

_Told = TypeVar("_Told")


def with_maintenance(
    system: NavigationSystem, name: str, *, truth: EdgePresence | None = None, room_of: RoomOf | None = None
) -> NavigationSystem:
    """Return the same system with another maintenance.

    Args:
        system: What to change.
        name: One of `MAINTENANCE_NAMES`.
        truth: What is open now, for `truth` alone.
        room_of: Which rooms nodes lie in, for `brm-rooms` alone.

    Raises:
        OptionError: There is no such name, or nobody knows the truth.
    """
    if name == "static":
        return replace(system, maintenance=NoMaintenance(), presence=ALWAYS_OPEN, views=None)
    if name in ("paper", "robust"):
        preset = PAPER if name == "paper" else ROBUST
        method = replace(system.method, believing=_believing(preset.believing, system.method.believing))
        return replace(system, maintenance=LifelongMaintenance(method), presence=ALWAYS_OPEN, views=None)
    if name in ("brm", "brm-rooms"):
        rooms = _known(room_of, name, "which rooms its nodes lie in") if name == "brm-rooms" else None
        return replace(system, maintenance=BayesianEdges(rooms), presence=ALWAYS_OPEN, views=None)
    maintenance = PresenceMaintenance(system.method)
    return replace(system, maintenance=maintenance, presence=_presence(name, truth), views=ViewConfig())


def _presence(name: str, truth: EdgePresence | None) -> EdgePresence:
    if name == "persistent":
        return FilteredPresence(PERSISTENT)
    if name != "truth":
        raise OptionError(f"No maintenance is called {name!r}. {which_name(name, MAINTENANCE_NAMES)}.")
    return _known(truth, name, "which edges are open")


def _known(told: _Told | None, name: str, what: str) -> _Told:
    """Return what the world told; raises OptionError where nobody knows."""
    if told is None:
        raise OptionError(
            f"The maintenance {name!r} asks the world {what}; it is for simulated worlds that change. "
            "Choose another maintenance."
        )
    return told


def recorded_filter(name: str) -> PresenceFilter | None:
    """Return what judged which edges are open in a run whose recording names a maintenance, which may be empty.

    None where its plans took no account of that. Recordings that do not say, and those of filters that are no longer
    part of the package, are looked at with the one that is.
    """
    if name in ("static", "paper", "robust", "brm", "brm-rooms"):
        return None
    return PERSISTENT


def recorded_maintenance(system: NavigationSystem) -> str:
    """Return the name of the filter that judges which edges are open in a system; empty where none does."""
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
