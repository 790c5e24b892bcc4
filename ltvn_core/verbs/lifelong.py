"""`ltvn lifelong`: the paper's lifelong test, and the same test in a changing world."""

from dataclasses import dataclass

from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.evaluate import ProtocolOptions


@dataclass(frozen=True, kw_only=True)
class LifelongVerb(ProtocolOptions):
    """Test lifelong maintenance as in the paper: many queries with maintenance, and static episodes without it in
    between."""

    job = "ltvn_core.verbs.jobs.lifelong:run_lifelong_test"

    queries: int = 700
    """Number of queries with maintenance for each scene and seed."""
    every: int = 100
    """Number of queries between two static tests; there is also a test before the first query."""
    episodes: int = 500
    """Number of random episodes in each static test, the same ones every time."""

    maintenance: tuple[MaintenanceName, ...] = ()
    """How driving updates the map; by default as in the map's system. static: not at all; paper, robust: beliefs and
    pruning of that preset; brm: the posterior of BRM, which prunes nothing; brm-rooms: the same for connections between
    rooms; persistent: also learns when edges are open; truth: ground truth of the world, with --world. With --world,
    several are compared on the same queries."""
    world: str | None = None
    """Drive the queries in a changing world, without static tests: static, doors, daily, telegraph, moving, light,
    people, crowd, all, several of them (doors+moving), or a JSON file with a script. Goals are nodes that can be
    reached when the query begins."""
    days: float = 7.0
    """Number of simulated days over which the queries in a changing world are spread."""
