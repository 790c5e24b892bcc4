"""Interface of the component that performs the actions of edges: a lift, a door, a person who carries the robot.

Owns the contract alone. `navigation.query_runner` waits until an action is done.
"""

from enum import StrEnum
from typing import Protocol

from ltvn_core.types import NodeId


class ActionState(StrEnum):
    """State of an action."""

    PENDING = "pending"
    DONE = "done"
    FAILED = "failed"


class ActionPerformer(Protocol):
    """Performs one action at a time. The navigator asks for its state at each control step, so no call may wait."""

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Begin an action for a robot that stands still at `source`; an earlier action that is still pending is
        cancelled."""
        ...

    def state(self) -> ActionState:
        """Return the state of the action that was begun last; done once the robot stands at the target."""
        ...
