"""What the planner knew at one moment of a query: where it was, where to, and which edges had failed.

Owns the question to the planner. Does not plan (`analysis.what_if_replanning`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Localised
from ltvn_core.types import NodeId


@dataclass(frozen=True, slots=True)
class PlannerState:
    """A question to the planner."""

    source: NodeId | None
    """Where the robot held itself to be; None when it was lost or nobody asked yet."""
    goal: NodeId | None
    """None outside of queries."""
    failures: Mapping[EdgeKey, int] = field(default_factory=dict)
    """How often each edge had failed in this query, each time at the price of `Planning.failure_penalty`."""
    localised: Localised | None = None
    """The localisation that told the source."""
    tries: int = 0
    """How often something was in the way in this query."""


def planner_state_at(timeline: Timeline, instant: Instant | None = None) -> PlannerState:
    """Return what the planner knew after everything that happened up to and in a step, at the end without one.

    Failed attempts count against all edges of the plan that they went along, as the navigator counts them. Events of a
    query whose beginning was cut off are used as far as they go. Logarithmic.
    """
    progress = timeline.progress_before(timeline.count_until(instant))
    return PlannerState(
        source=progress.localised.node if progress.localised else None,
        goal=progress.goal,
        failures=progress.failures,
        localised=progress.localised,
        tries=progress.obstructions,
    )
