"""What does the actions that some edges need: a lift, a door, a person who carries the robot.

Owns the contract alone. The navigator waits for it in `navigation.action_runner`.
"""

from enum import StrEnum
from typing import Protocol

from ltvn_core.types import NodeId


class ActionState(StrEnum):
    """How far an action is."""

    PENDING = "pending"
    DONE = "done"
    FAILED = "failed"


class ActionPerformer(Protocol):
    """Does one action at a time. The navigator asks for its state at each control step, so no call may wait."""

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Begin an action for a robot that stands still at `source`; an earlier action that is pending is over."""
        ...

    def state(self) -> ActionState:
        """Return the state of the action that was begun last; done once the robot stands at the target."""
        ...
