"""Recovery of a robot that is lost or has no path: it turns round, looks, and finally gives up.

Owns the order of these steps and when an unrecognised image is offered to the map.
"""

from collections.abc import Iterator

from ltvn_core.graph.maintenance import UnrecognisedObservation
from ltvn_core.navigation.events import Event, Outcome, Tick
from ltvn_core.navigation.motion import EventGenerator, QueryAborted
from ltvn_core.navigation.query import QueryState

TURN_RAD, LOOKS_PER_TURN = 0.52, 12
"""Angle of the turn on the spot between two observations, and number of observations in a full turn."""


def recover(query: QueryState, why: Outcome) -> EventGenerator[None]:
    """Turn on the spot to look again; finally give up.

    Raises:
        QueryAborted: If the robot has looked around often enough.
    """
    if query.consecutive_failures == 0 or why is Outcome.NO_PATH:
        query.give_up_outcome = why
    query.consecutive_failures += 1
    query.plan = ()
    if why is Outcome.LOST and query.perception.is_usable:
        yield from _remember_novel(query)
    if query.consecutive_failures >= query.method.recovering.give_up_after_looks:
        raise QueryAborted(query.give_up_outcome)
    if query.consecutive_failures % LOOKS_PER_TURN == 0:
        # The robot may be wrong about its way here, about doubted nodes, and about closed edges.
        query.begin_anew()
    yield from turn(query)


def turn_to_see(query: QueryState) -> EventGenerator[None]:
    """Turn as a lost robot does, but keep the plan, because localisation searches around it first."""
    plan = query.plan
    query.assumed_node = None  # After a turn the robot is no longer at the assumed node.
    yield from recover(query, Outcome.LOST)
    query.plan = plan


def turn(query: QueryState) -> Iterator[Event | Tick]:
    """Turn on the spot towards the direction of the next observation."""
    yield from query.driver.turn(TURN_RAD)


def _remember_novel(query: QueryState) -> Iterator[Event]:
    """Offer an unrecognised image to the system, which may make it a node."""
    context = query.context
    perception = query.perception
    seen = perception.observation
    unrecognised = UnrecognisedObservation(seen, perception.features, query.consecutive_failures)
    deltas = context.system.maintenance.unrecognised(context.graph, unrecognised, context.matcher)
    if deltas:
        context.keyframes.add([seen], perception.features)
        yield from query.apply(deltas)
