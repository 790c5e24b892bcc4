"""What the planner knew at one moment of a query: where it was, where to, and which edges had failed.

Owns reading that back from the events. Does not plan (`analysis.what_if`).
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import AttemptEnded, Localised, Planned, QueryStarted, StampedEvent
from ltvn_core.types import FrameId, NodeId


@dataclass(frozen=True, slots=True)
class PlannerState:
    """A question to the planner."""

    source: NodeId | None
    """Where the robot held itself to be; None when it was lost or nobody asked yet."""
    goal: NodeId | None
    """None outside of queries."""
    failures: dict[EdgeKey, int] = field(default_factory=dict)
    """How often each edge had failed in this query, each time at the price of `Planning.failure_penalty`."""
    localised: Localised | None = None
    """The look that told the source."""


def planner_state_at(events: Iterable[StampedEvent], step: FrameId) -> PlannerState:
    """Return what the planner knew after everything that happened up to and in `step`.

    Failed legs count against all edges of the plan that they went along, as the navigator counts them. Linear in the
    events. Events of a query whose beginning was cut off are used as far as they go.
    """
    found, plan = PlannerState(None, None), ()
    for stamped in events:
        if stamped.step > step:
            continue
        event = stamped.event
        if isinstance(event, QueryStarted):
            found, plan = PlannerState(None, event.goal), ()
        elif isinstance(event, Localised):
            found = replace(found, source=event.node, localised=event)
        elif isinstance(event, Planned):
            plan = event.nodes
        elif isinstance(event, AttemptEnded) and not event.succeeded and event.source is not None:
            driven = _edges_between(plan, event.source, event.target)
            found = replace(found, failures=_counted(found.failures, driven))
    return found


def _edges_between(plan: tuple[NodeId, ...], source: NodeId, target: NodeId) -> list[EdgeKey]:
    """Return the edges of the plan between two of its nodes, or the edge that joins them if they are not on it."""
    if source in plan and target in plan[plan.index(source) :]:
        return list(itertools.pairwise(plan[plan.index(source) : plan.index(target) + 1]))
    return [(source, target)]


def _counted(failures: dict[EdgeKey, int], edges: list[EdgeKey]) -> dict[EdgeKey, int]:
    return failures | {edge: failures.get(edge, 0) + 1 for edge in edges}
