"""Runs the action of an edge while the robot waits at the source of the edge.

Owns the events of an action and the belief update after it. The query decides where the robot stands before and
afterwards.
"""

from ltvn_core.graph.deltas import BeliefUpdated
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.events import ActionBegun, ActionEnded
from ltvn_core.navigation.motion import EventGenerator, MotionExecutor, QueryAborted
from ltvn_core.navigation.perception import Perception


class ActionRunner:
    """Runs the actions of one query."""

    def __init__(self, context: NavigationContext, motion: MotionExecutor, perception: Perception, query: int) -> None:
        """Use the action performer of `context`; without one, every action fails at once."""
        self._context = context
        self._motion = motion
        self._perception = perception
        self._query = query

    def run(self, edge: EdgeKey) -> EventGenerator[bool]:
        """Run the action of an edge while the robot stands still; tell whether the action succeeded.

        Waiting does not count against the step limit, because a lift may take its time.

        Raises:
            QueryAborted: If the query is cancelled while the action is pending.
        """
        action = self._context.graph.edges[edge].action
        yield ActionBegun(self._query, *edge, self._perception.observation.step, action)
        try:
            state = yield from self._perform(edge, action)
        except QueryAborted as over:
            yield self._ended(edge, f"cut short: {over.outcome.value}")
            raise
        is_tried = self._context.actions is not None
        failure = "it could not be done" if is_tried else "nobody performs actions here"
        succeeded = state is ActionState.DONE
        yield self._ended(edge, "" if succeeded else failure)
        if is_tried:
            yield from self._learn(edge, succeeded=succeeded)
        return succeeded

    def _perform(self, edge: EdgeKey, action: str) -> EventGenerator[ActionState]:
        yield from self._motion.wait_one_step()  # So that the robot stands, and no plan is repeated without end.
        performer = self._context.actions
        if performer is None:
            return ActionState.FAILED
        performer.begin(*edge, action)
        while (state := performer.state()) is ActionState.PENDING:
            yield from self._motion.stand_by()
        yield from self._motion.stand_by()  # So that the robot reads its sensors where it is now.
        return state

    def _ended(self, edge: EdgeKey, failure: str) -> ActionEnded:
        frame = self._perception.observation.step
        return ActionEnded(self._query, *edge, frame, succeeded=not failure, reason=failure)

    def _learn(self, edge: EdgeKey, *, succeeded: bool) -> EventGenerator[None]:
        """Update the belief in the edge's existence.

        The length of the edge was not measured, and only a person may remove it.
        """
        context = self._context
        known = context.graph.edges.get(edge)
        if known is None:
            return
        stamp = context.world_time_s(self._motion.stamp)
        evidence = AttemptEvidence(*edge, distance=known.belief.mu, succeeded=succeeded, stamp=stamp)
        deltas = context.system.maintenance.after_attempt(context.graph, evidence)
        yield from context.apply_deltas([each for each in deltas if isinstance(each, BeliefUpdated)], self._query)
