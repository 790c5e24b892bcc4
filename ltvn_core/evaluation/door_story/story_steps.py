"""What a story asks of whoever plays it, one step at a time."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds.world_change import WorldChange


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive to a node now."""

    node: NodeId


@dataclass(frozen=True, slots=True)
class Change:
    """Change the world now."""

    change: WorldChange


@dataclass(frozen=True, slots=True)
class CallBack:
    """End the query under way now."""


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """Put the robot somewhere else now."""

    pose: Pose
    """(3,) in the world frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """Drive the robot by hand, and let the map grow from what it sees."""

    path: NDArray[np.float64]
    """(M, 2) x and y in metres."""


StoryStep: TypeAlias = GoTo | Change | CallBack | Carry | Lead
