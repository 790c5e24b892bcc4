"""Everything that happens while the robot navigates, as data.

The navigator yields events; the recording stores them; the page and the analysis read them back. An event holds what
happened and the numbers behind the decision, so that the decision can be explained later without running it again.
`StampedEvent` adds the time. Owns no behaviour.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias

from ltvn_core.findings import Severity
from ltvn_core.graph.deltas import GraphDelta, PoseRow
from ltvn_core.types import FrameId, NodeId
from ltvn_core.worlds import Outline, WorldChange


class NavigatorState(StrEnum):
    """Activity of the navigator."""

    IDLE = "idle"
    LOCALISING = "localising"
    PLANNING = "planning"
    DRIVING = "driving"
    JUDGING = "judging"
    ACTING = "acting"
    """Standing still until the action of an edge is done."""
    RECOVERING = "recovering"


class AttemptEnd(StrEnum):
    """Why the robot stopped driving towards a subgoal."""

    REACHED = "reached"
    """The controller reached the waypoint."""
    COLLISION = "collision"
    """The bumper hit something."""
    BLOCKED = "blocked"
    """The depth image showed an obstacle in the way."""
    TIMEOUT = "timeout"
    """The attempt used up its steps."""
    LOST = "lost"
    """The subgoal's reachability fell too low on the way."""
    CANCELLED = "cancelled"
    """A person took over."""

    @property
    def failure(self) -> str:
        """The failure in words, for an attempt with this end that was judged a failure."""
        return "failed, though it got there" if self is AttemptEnd.REACHED else f"failed ({self})"


OBSTRUCTED_ENDS = (AttemptEnd.COLLISION, AttemptEnd.BLOCKED)
"""Ends of attempts that an obstacle stopped."""


class Outcome(StrEnum):
    """How a query ended, as the robot sees it."""

    ARRIVED = "arrived"
    """The robot judged that it is at the goal; only the evaluation knows whether that is true."""
    NO_PATH = "no path"
    LOST = "lost"
    STEP_LIMIT = "step limit"
    COLLISION_LIMIT = "collision limit"
    CANCELLED = "cancelled"


BY_IMAGE, BY_PLACE, BY_WAYPOINT = (
    "judging.arrive_reachability",
    "localising.follow_places",
    "driving.position_tolerance_m",
)
"""Names of the rules by which a robot arrives: the image shows the goal; the images in all directions show its place;
nothing is left to drive, for systems that localise by single images, which is no field of `config` any more."""


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The navigator changed its state."""

    state: NavigatorState


@dataclass(frozen=True, slots=True)
class QueryStarted:
    """A query started, with a node as its goal."""

    query: int
    goal: NodeId


@dataclass(frozen=True, slots=True)
class Localised:
    """The robot compared the current image with the map."""

    query: int
    frame: FrameId
    """The image that was compared."""
    node: NodeId | None
    """The node that the robot is at; None if no node is near enough."""
    distance: float
    """d of the best node, whether or not it was near enough; infinite in an empty map."""
    reachability: float
    runner_up: NodeId | None
    margin: float
    """Score of the runner-up minus score of the best; small means ambiguous. Infinite without a runner-up."""
    scope: str
    """Either "local", when a neighbour of the last plan matched, or "global"."""
    probability: float | None = None
    """Probability of this place among all hypotheses; None without hypotheses."""


@dataclass(frozen=True, slots=True)
class Planned:
    """The planner found a path, or none when `nodes` is empty."""

    query: int
    nodes: tuple[NodeId, ...]
    cost: float
    place_p: float | None = None
    """Probability of the robot's likeliest place; while the place is unsure, edges that no image supports cost more.
    None without a place belief and in older recordings."""


@dataclass(frozen=True, slots=True)
class AttemptStarted:
    """The robot departs towards a subgoal."""

    query: int
    attempt: int
    """Number of the attempt within the recording."""
    source: NodeId | None
    """The node at departure; None if the robot only approaches the node it is localised at."""
    target: NodeId
    frame: FrameId
    """The image o_a at departure."""
    waypoint: PoseRow
    """Waypoint of the target at departure, in the robot's frame."""
    reachability: float


@dataclass(frozen=True, slots=True)
class AttemptEnded:
    """The robot stopped driving and judged the attempt."""

    query: int
    attempt: int
    source: NodeId | None
    target: NodeId
    frame: FrameId
    """The image o_d at arrival."""
    end: AttemptEnd
    distance: float
    """d(w) from the arrival image to the target."""
    reachability: float
    succeeded: bool
    reason: str
    """Reason for the verdict, in words."""
    rule: str = ""
    """Name in `config` of the rule that decided, such as judging.success_distance; empty without any and in older
    recordings."""


@dataclass(frozen=True, slots=True)
class ActionBegun:
    """The robot stands still at the source of an edge until the edge's action is done."""

    query: int
    source: NodeId
    target: NodeId
    frame: FrameId
    """The image at the source."""
    action: str


@dataclass(frozen=True, slots=True)
class ActionEnded:
    """The action of an edge was done, failed, or was given up."""

    query: int
    source: NodeId
    target: NodeId
    frame: FrameId
    """The image at the end."""
    succeeded: bool
    reason: str = ""
    """Reason of a failure, in words."""


@dataclass(frozen=True, slots=True)
class Collided:
    """The bumper hit something; once per collision."""

    query: int
    count: int
    """Number of collisions in this query so far."""


@dataclass(frozen=True, slots=True)
class GraphChanged:
    """A delta was applied to the map."""

    delta: GraphDelta
    query: int | None = None
    attempt: int | None = None


@dataclass(frozen=True, slots=True)
class QueryEnded:
    """A query ended."""

    query: int
    goal: NodeId
    outcome: Outcome
    steps: int
    collisions: int
    path_m: float
    """Driven length by odometry, in metres."""
    rule: str = ""
    """Name in `config` of the rule by which the robot arrived, such as `BY_IMAGE`; empty without an arrival and in
    older recordings."""
    reachability: float | None = None
    """r of the goal in the last image; None without an arrival and in older recordings."""
    distance: float | None = None
    """d of the goal by the image or by the place belief, whichever decided; None as above."""


@dataclass(frozen=True, slots=True)
class Judged:
    """In simulation, the evaluation's verdict by the paper's criterion (0.72 m, 0.4 rad)."""

    query: int
    reached: bool
    position_error_m: float
    yaw_error_rad: float


@dataclass(frozen=True, slots=True)
class Note:
    """Something a person should read in the log."""

    text: str
    severity: Severity = Severity.INFO
    rule: str = ""
    """Name in `config` of the rule behind the note; empty without any."""


class ChangedBy(StrEnum):
    """Who changed the world."""

    SCRIPT = "script"
    HAND = "hand"


@dataclass(frozen=True, slots=True)
class WorldChanged:
    """In simulation, the world changed. The method never reads this event."""

    change: WorldChange
    by: ChangedBy = ChangedBy.SCRIPT
    at_s: float = 0.0
    """Time of the world in seconds from midnight of its first day; while it passes, the robot's clock may stand
    still."""
    outline: Outline | None = None
    """Outline of the door, thing or person now, for viewers without a model of the scene; None if there is none."""


Event: TypeAlias = (
    StateChanged
    | QueryStarted
    | Localised
    | Planned
    | AttemptStarted
    | AttemptEnded
    | ActionBegun
    | ActionEnded
    | Collided
    | GraphChanged
    | QueryEnded
    | Judged
    | Note
    | WorldChanged
)


class StampedEvent(NamedTuple):
    """An event and its time."""

    step: FrameId
    stamp: float
    """Seconds on the robot's clock."""
    event: Event


@dataclass(frozen=True, slots=True)
class Tick:
    """The navigator has commanded the robot and hands back control until the next control step.

    Not an event: it is never recorded.
    """
