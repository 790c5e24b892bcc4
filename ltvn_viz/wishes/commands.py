"""Commands of a person to the app, as data: wishes of the page's table with their values, and those that carry more.

Callbacks of the page create commands and put them into the session's queue; only the session runs them. Driving is not
a command: the session polls the held keys from the driver's seat, so that outdated inputs cannot fill the queue. Words,
keys and legal modes of the wishes are in `wish_table`.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.types import NodeId, Rgb


class Mode(StrEnum):
    """Activity of the app; the value is the word that the page shows."""

    TELEOP = "manual"
    """A person drives; the map may grow."""
    BUILDING = "building"
    """Algorithm 1 runs; the robot is stopped."""
    NAVIGATING = "navigating"
    """The robot navigates to a goal."""
    PAUSED = "paused"
    """A query is paused; the robot is stopped."""
    REPLAY = "replay"
    """The page shows a recording; the robot is stopped."""


ANYWHERE = frozenset(Mode)
LIVE = frozenset({Mode.TELEOP, Mode.NAVIGATING, Mode.PAUSED})
DRIVING = frozenset({Mode.TELEOP})
UNDER_WAY = frozenset({Mode.NAVIGATING, Mode.PAUSED})
"""Modes in which a query is in progress."""
STANDING = frozenset({Mode.TELEOP, Mode.REPLAY})
"""Modes in which neither a query nor the building of a map is in progress."""
REPLAYING = frozenset({Mode.REPLAY})
IN_TIME = LIVE | REPLAYING
"""Modes in which the moment on show can be chosen."""


class Action(StrEnum):
    """An action that a press or a click requests; the value is its name between page and server."""

    STOP = "stop"
    TAKE_OVER = "take_over"
    RELEASE = "release"
    RECORD = "record"
    KEEP = "keep"
    DISCARD = "discard"
    BUILD = "build"
    UNDO_BUILD = "undo_build"
    LEARN = "learn"
    STOP_LEARNING = "stop_learning"
    USE_WEIGHTS = "use_weights"
    LEAVE_WEIGHTS = "leave_weights"
    GOAL = "goal"
    SELECT = "select"
    PICK = "pick"
    PICK_EDGE = "pick_edge"
    CANCEL = "cancel"
    END_ACTION = "end_action"
    PAUSE = "pause"
    STEP = "step"
    PLAY_DRIVE = "play_drive"
    KEEP_GOING = "keep_going"
    OPEN = "open"
    IMPORT = "import"
    CLOSE = "close"
    SEEK_BACK = "seek_back"
    SEEK_FORWARD = "seek_forward"
    SEEK = "seek"
    PLAY = "play"
    SPEED = "speed"
    SHOW_NOW = "show_now"
    EVENT_BEFORE = "event_before"
    EVENT_AFTER = "event_after"
    QUERY_BEFORE = "query_before"
    QUERY_AFTER = "query_after"
    DOOR = "door"
    AIM_BOX = "aim_box"
    PUT_BOX = "put_box"
    TAKE_BOX = "take_box"
    LIGHT = "light"
    UNDO_CHANGE = "undo_change"
    WATCH_IT_LEARN = "watch_it_learn"
    SHOW_FLOOR = "show_floor"
    ALIGN_PLAN = "align_plan"
    POINT_ON_PLAN = "point_on_plan"
    UNDO_PLAN_CLICK = "undo_plan_click"
    USE_ALIGNMENT = "use_alignment"
    QUESTION = "question"
    TELL = "tell"
    FOLLOW = "follow"
    HELP = "help"


LEAST_MINUTES = 1
MOST_MINUTES = 60
"""Shortest and longest fine-tuning, in minutes."""


Value: TypeAlias = int | str | tuple[float, float] | None
"""Value that comes with a wish; `server.drive_messages` checks those of a page."""


@dataclass(frozen=True, slots=True)
class Ask:
    """Fulfil a wish of the page's table. TAKE_OVER means that a person drives, which ends whatever gives the robot its
    steps; the seat itself changes hands before."""

    action: Action
    value: Value = None


@dataclass(frozen=True, slots=True)
class QuestionRequest:
    """Request that a link sends to the question that drew it; each question defines its own kinds."""


@dataclass(frozen=True, eq=False)
class AskQuestion:
    """Send a request to the question on show."""

    request: QuestionRequest


@dataclass(frozen=True, eq=False)
class AskAbout:
    """Ask a question of the debugger with its arguments."""

    question: str
    """Name of the question."""
    edge: tuple[NodeId, NodeId] | None = None
    """The edge to select."""
    request: QuestionRequest | None = None
    at_s: float | None = None
    """The time to show, in seconds after the beginning."""


@dataclass(frozen=True, eq=False)
class PointAt:
    """Select a node, or an edge from `node` to `target`, for the question on show."""

    node: NodeId
    target: NodeId | None = None


@dataclass(frozen=True, eq=False)
class NavigateToImage:
    """Drive to the node that is most similar to an image (72, 96, 3); in a replay, find it in the map on show."""

    rgb: Rgb
    original: Rgb | None = None
    """The uploaded image (H, W, 3), scaled down to a moderate size; shown beside the similar nodes."""


@dataclass(frozen=True, eq=False)
class OpenRecording:
    """Show a recording of the recordings folder in the page."""

    name: str
    """Path inside the recordings folder."""
    at_s: float = 0.0
    """Initial time in seconds after the recording's beginning."""
    then: "tuple[Command, ...]" = ()
    """Commands that run after the recording is open."""


@dataclass(frozen=True, eq=False)
class Seek:
    """Show the recording, or the live run, at a time in seconds after its beginning."""

    time_s: float


@dataclass(frozen=True, eq=False)
class EditMap:
    """Change the live map by hand."""

    deltas: tuple[GraphDelta, ...]


@dataclass(frozen=True, eq=False)
class ReportError:
    """Show a message in the page, about an error from outside the session, such as a broken upload."""

    text: str


Command: TypeAlias = (
    Ask | AskQuestion | AskAbout | PointAt | NavigateToImage | OpenRecording | Seek | EditMap | ReportError
)
"""All commands to the session; pyright reports each place that must handle a new one."""
