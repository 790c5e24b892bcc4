"""Commands of a person to the app, as data: wishes of the page's table with their values, and those that carry more.

Callbacks of the page create commands and put them into the session's queue; only the session runs them. Driving is not
a command: the session polls the held keys from the driver's seat, so that outdated inputs cannot fill the queue. Words,
keys and legal modes of the wishes are in `wish_table`.
"""

from dataclasses import dataclass
from typing import TypeAlias

from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.types import NodeId, Rgb
from ltvn_viz.wishes.wish import Value
from ltvn_viz.wishes.wish_table import Action


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


OtherCommand: TypeAlias = (
    AskQuestion | AskAbout | PointAt | NavigateToImage | OpenRecording | Seek | EditMap | ReportError
)
"""Commands that carry more than the value of a wish."""
Command: TypeAlias = Ask | OtherCommand
"""All commands to the session; pyright reports each place that must handle a new one."""
