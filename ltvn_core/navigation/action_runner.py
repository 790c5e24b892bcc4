"""Runs the action of an edge while the robot waits at the source of the edge.

Owns the events of an action and the belief update after it. The query decides where the robot stands before and
afterwards.
"""

from ltvn_core.graph.deltas import BeliefUpdated
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import ActionBegun, ActionEnded
from ltvn_core.navigation.motion import EventGenerator, QueryAborted
from ltvn_core.navigation.query import QueryState


def run_action(query: QueryState, edge: EdgeKey) -> EventGenerator[bool]:
    """Run the action of an edge while the robot stands still; tell whether the action succeeded.

    Waiting does not count against the step limit, because a lift may take its time. Without an action performer, every
    action fails at once.

    Raises:
        QueryAborted: If the query is cancelled while the action is pending.
    """
    action = query.context.graph.edges[edge].action
    yield ActionBegun(query.number, *edge, query.perception.observation.step, action)
    try:
        state = yield from _perform(query, edge, action)
    except QueryAborted as over:
        yield _ended(query, edge, f"cut short: {over.outcome.value}")
        raise
    is_tried = query.context.actions is not None
    failure = "it could not be done" if is_tried else "nobody performs actions here"
    succeeded = state is ActionState.DONE
    yield _ended(query, edge, "" if succeeded else failure)
    if is_tried:
        yield from _learn(query, edge, succeeded=succeeded)
    return succeeded


def _perform(query: QueryState, edge: EdgeKey, action: str) -> EventGenerator[ActionState]:
    yield from query.motion.wait_one_step()  # So that the robot stands, and no plan is repeated without end.
    performer = query.context.actions
    if performer is None:
        return ActionState.FAILED
    performer.begin(*edge, action)
    while (state := performer.state()) is ActionState.PENDING:
        yield from query.motion.stand_by()
    yield from query.motion.stand_by()  # So that the robot reads its sensors where it is now.
    return state


def _ended(query: QueryState, edge: EdgeKey, failure: str) -> ActionEnded:
    frame = query.perception.observation.step
    return ActionEnded(query.number, *edge, frame, succeeded=not failure, reason=failure)


def _learn(query: QueryState, edge: EdgeKey, *, succeeded: bool) -> EventGenerator[None]:
    """Update the belief in the edge's existence.

    The length of the edge was not measured, and only a person may remove it.
    """
    context = query.context
    known = context.graph.edges.get(edge)
    if known is None:
        return
    evidence = AttemptEvidence(*edge, distance=known.belief.mu, succeeded=succeeded, stamp=query.now_s)
    deltas = context.system.maintenance.after_attempt(context.graph, evidence)
    yield from query.apply(each for each in deltas if isinstance(each, BeliefUpdated))
