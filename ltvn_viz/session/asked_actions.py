"""Actions of edges that the person at the page does, such as taking the lift with the robot.

Owns the question that waits for the person's answer. The navigator calls `begin` and `state` in the worker's thread;
everything else runs in the session's thread.
"""

from collections.abc import Callable

from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.types import NodeId


class AskedActions:
    """Performs actions by asking the person. Implements `ltvn_core.navigation.action_performer.ActionPerformer`."""

    def __init__(self) -> None:
        """Start without an action."""
        self._target: NodeId | None = None
        self._state = ActionState.FAILED
        self._answer: bool | None = None

    def forget(self) -> None:
        """Forget the action and the answer of a query that is over; they must not move the robot of the next one."""
        self._target = self._answer = None
        self._state = ActionState.FAILED

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Wait for the person's answer; the page shows the action, because it is an event."""
        self._target = target
        self._answer = None
        self._state = ActionState.PENDING

    def state(self) -> ActionState:
        """Return the state of the action that was begun last."""
        return self._state

    def answer(self, outcome: int) -> None:
        """Take the person's answer, 1 for success and 0 for failure; nothing happens if no action is pending."""
        if self._state is ActionState.PENDING:
            self._answer = bool(outcome)

    def settle(self, put_at: Callable[[NodeId], None]) -> None:
        """End the action if the person has answered; `put_at` puts the robot at the node where the action ends.

        Nothing else may use the robot during the call.
        """
        if self._answer is None or self._target is None:
            return
        if self._answer:
            put_at(self._target)
        self._state = ActionState.DONE if self._answer else ActionState.FAILED
        self._answer = None
