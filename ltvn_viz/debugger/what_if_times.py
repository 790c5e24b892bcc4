"""Another time of day, imagined: which edges would be open then. Owns what is offered and said of it."""

from collections.abc import Mapping

from ltvn_core.analysis.edge_presence_history import PresenceState, presence_state
from ltvn_core.analysis.what_if_changes import WithTime
from ltvn_core.analysis.what_if_scenario import PlanDifference, PresenceMoment
from ltvn_core.analysis.world_clock import DAY_S, TimeAway, TimeOfDay
from ltvn_core.graph.presence.presence_plan import OPEN_ABOVE
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder
from ltvn_viz.session.commands import PointAt

_ROWS = 12
OFFERED_TIMES = (WithTime(TimeOfDay(18 * 3600.0)), WithTime(TimeAway(3600.0)), WithTime(TimeAway(DAY_S)))
"""Others may be typed."""


def presence_moment(context: DebugContext) -> PresenceMoment | None:
    """Return by what plans know which edges are open; None where they take no account of it."""
    judge = context.presence_filter
    return None if judge is None or not context.graph.presence else PresenceMoment(judge, context.world_s)


def add_open_edges(plans: PlanDifference, builder: AnswerBuilder) -> None:
    """Say which edges would be open then and are not now, or the other way round."""
    then = plans.new_open
    count = sum(p >= OPEN_ABOVE for p in then.values())
    before = sum(p >= OPEN_ABOVE for p in plans.old_open.values())
    builder.add_text(f"Of {len(then)} edges that were ever seen blocked {count} would be taken for open, now {before}.")
    changed = [edge for edge in then if _state_of(plans.old_open, edge) is not _state_of(then, edge)]
    rows = [
        (
            builder.link(f"{edge[0]} → {edge[1]}", PointAt(*edge)),
            f"{plans.old_open.get(edge, 1.0):.2f} {_state_of(plans.old_open, edge)}",
            f"{then[edge]:.2f} {_state_of(then, edge)}",
        )
        for edge in changed[:_ROWS]
    ]
    if rows:
        builder.add_table(("edge", "p open now", "p open then"), rows)
    if len(changed) > _ROWS:
        builder.add_text(f"… and {len(changed) - _ROWS} more.")


def _state_of(probabilities: Mapping[EdgeKey, float], edge: EdgeKey) -> PresenceState:
    return presence_state(probabilities.get(edge, 1.0))
