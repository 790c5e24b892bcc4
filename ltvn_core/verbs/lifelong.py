"""`ltvn lifelong`: the paper's lifelong test, and the same in a world that changes."""

from dataclasses import dataclass

from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.evaluate import ProtocolOptions


@dataclass(frozen=True, kw_only=True)
class LifelongVerb(ProtocolOptions):
    """Test lifelong maintenance as the paper does: many queries with it, and static episodes without it in between."""

    job = "ltvn_core.verbs.jobs.lifelong:run_lifelong_test"

    queries: int = 700
    """Queries with maintenance for each scene and seed."""
    every: int = 100
    """Queries between two static tests; there is one before the first query too."""
    episodes: int = 500
    """Random episodes of each static test, always the same."""

    maintenance: tuple[MaintenanceName, ...] = ()
    """How driving updates the map; by default as its system does. static: nothing; paper, robust: beliefs and
    pruning as in that preset; brm: BRM's posterior, which prunes nothing; brm-rooms: the same of ways between rooms;
    persistent: also what is open at which time; truth: what the world knows, with --world. Several
    are compared on the same queries of a --world."""
    world: str | None = None
    """Drive the queries in a world that changes instead, with no static tests: static, doors, daily, telegraph, moving,
    light, people, crowd, all, several of them (doors+moving), or a JSON file with a script. Goals are those that can be
    reached when a query begins."""
    days: float = 7.0
    """Simulated days over which the queries in a changing world are spread."""
