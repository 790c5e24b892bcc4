"""Every change a map can undergo, as data, together with its cause.

The builder and the maintenance return deltas; `TopologicalGraph.apply` is the only place where a map changes. So the
history of a map is a list, and time travel, difference and blame are folds over it. Owns no decision.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias

from ltvn_core.types import FrameId, NodeId


class Cause(StrEnum):
    """Why the map changed."""

    BUILD = "build"
    """Algorithm 1, from a whole recording."""
    ONLINE = "online"
    """The same operators, during driving."""
    ATTEMPT = "attempt"
    """An edge was driven: Eq. 3 and Eq. 4, and pruning."""
    NOVEL = "novel"
    """The robot was lost, and its observation became a node."""
    EXPAND = "expand"
    """No path existed, and images left over from mapping were sampled until one did."""
    GOAL = "goal"
    """A goal image was connected to the map."""
    LOAD = "load"
    """The map came out of a file."""
    SIGHT = "sight"
    """The robot saw that an obstruction blocks other edges too, or that it is gone."""
    HAND = "hand"
    """A person changed the map."""


BULK_CAUSES = (Cause.BUILD, Cause.LOAD)
"""Causes of changes that come in bulk while a map is made; changes of other causes count as news."""


class PoseRow(NamedTuple):
    """A pose or waypoint as plain numbers, so that a delta compares and writes exactly."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Belief:
    """Belief about one edge: existence ~ Bernoulli(p), length ~ N(mu, sigma2)."""

    p: float
    """Probability that the edge can be driven, in [0, 1]."""
    mu: float
    """Mean of d(w), Eq. 2."""
    sigma2: float
    """Variance of that mean."""


@dataclass(frozen=True, slots=True)
class Node:
    """A place, represented by the image with this id."""

    id: NodeId
    odometry: PoseRow
    """Odometry pose when the image was taken; for drawing and as evidence, never for planning."""
    name: str = ""
    """Name given by a person, unique in the map; empty if there is none."""
    goal: bool = False
    """Whether a person marked the place as a goal."""


@dataclass(frozen=True, slots=True)
class Edge:
    """An edge: the robot can drive from `source` to `target` along `waypoint`."""

    source: NodeId
    target: NodeId
    waypoint: PoseRow
    """The target in the frame of the source."""
    belief: Belief
    attempts: int = 0
    """Number of attempts to drive the edge."""
    successes: int = 0
    """Number of attempts that led to the target."""
    protected: bool = False
    """Whether a person protects the edge from maintenance."""
    by_odometry: bool = False
    """Whether only odometry joins the two nodes; no predictor recognised one in the image of the other."""
    action: str = ""
    """What must be done between the two nodes because the robot cannot drive there, such as taking a lift; empty for an
    edge that is driven. An edge with an action has no geometry: its waypoint is ignored."""


@dataclass(frozen=True, slots=True)
class NodeAdded:
    """A node was added, without edges yet."""

    node: Node
    cause: Cause


@dataclass(frozen=True, slots=True)
class NodeDropped:
    """A node was removed together with all its edges."""

    node: NodeId
    cause: Cause


@dataclass(frozen=True, slots=True)
class EdgeAdded:
    """An edge was added; both its nodes are already in the map."""

    edge: Edge
    cause: Cause


@dataclass(frozen=True, slots=True)
class BeliefUpdated:
    """An edge's belief and its counts changed to these values."""

    source: NodeId
    target: NodeId
    belief: Belief
    attempts: int
    successes: int
    cause: Cause


@dataclass(frozen=True, slots=True)
class EdgePruned:
    """An edge was removed."""

    source: NodeId
    target: NodeId
    cause: Cause


@dataclass(frozen=True, slots=True)
class EdgeProtected:
    """An edge was protected by a person, or is no longer."""

    source: NodeId
    target: NodeId
    protected: bool
    cause: Cause


@dataclass(frozen=True, slots=True)
class EdgeActionSet:
    """An edge got this action instead of being driven; an empty one makes it an edge that is driven."""

    source: NodeId
    target: NodeId
    action: str
    cause: Cause


@dataclass(frozen=True, slots=True)
class PresenceObserved:
    """An edge was seen to be open or blocked at a moment; its existence is not affected."""

    source: NodeId
    target: NodeId
    present: bool
    stamp: float
    """Seconds on the clock of the world."""
    cause: Cause


@dataclass(frozen=True, slots=True)
class NodeNamed:
    """A node got this name, which may be empty, and is marked as a goal or not."""

    node: NodeId
    name: str
    goal: bool
    cause: Cause


@dataclass(frozen=True, slots=True)
class DriveBegun:
    """Images from this frame on belong to another drive, whose odometry usually restarts."""

    frame: FrameId
    """The first image."""
    name: str
    """Name of the drive for a person, such as its file name."""
    cause: Cause


@dataclass(frozen=True, slots=True)
class FramesReserved:
    """Images were added to T', the reserve from which the map can be expanded."""

    frames: tuple[FrameId, ...]
    cause: Cause


@dataclass(frozen=True, slots=True)
class FramesReleased:
    """Images were removed from T', because they became nodes or were given up."""

    frames: tuple[FrameId, ...]
    cause: Cause


GraphDelta: TypeAlias = (
    NodeAdded
    | NodeDropped
    | EdgeAdded
    | BeliefUpdated
    | EdgePruned
    | EdgeProtected
    | EdgeActionSet
    | PresenceObserved
    | NodeNamed
    | DriveBegun
    | FramesReserved
    | FramesReleased
)
