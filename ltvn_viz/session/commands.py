"""What a person can ask of the app, as data.

Callbacks of the page build these and put them into the session's queue; the session alone carries them out. Driving
is not among them: the held keys are polled from the driver's seat, so that they can never pile up in a queue.
"""

from dataclasses import dataclass
from typing import ClassVar

from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.types import NodeId, Rgb


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """Something a person asked for."""

    label: ClassVar[str] = ""
    """What the page calls it."""


@dataclass(frozen=True, slots=True, eq=False)
class StopRobot(Command):
    """Stop the robot now and give up navigating."""

    label: ClassVar[str] = "stop"


@dataclass(frozen=True, slots=True, eq=False)
class StartRecording(Command):
    """Begin a new recording."""

    label: ClassVar[str] = "record"


@dataclass(frozen=True, slots=True, eq=False)
class KeepRecording(Command):
    """End the recording and keep it under a name of its own."""

    label: ClassVar[str] = "keep"


@dataclass(frozen=True, slots=True, eq=False)
class DiscardRecording(Command):
    """End the recording and move it to the folder of discarded ones."""

    label: ClassVar[str] = "discard"


@dataclass(frozen=True, slots=True, eq=False)
class BuildMap(Command):
    """Build a map anew from all images driven so far, Algorithm 1."""

    label: ClassVar[str] = "build the map"


LEAST_MINUTES = 1
MOST_MINUTES = 60
"""Fine-tuning takes at least and at most so many minutes."""


@dataclass(frozen=True, slots=True, eq=False)
class FineTune(Command):
    """Fine-tune the network on the drive at hand."""

    label: ClassVar[str] = "learn from a drive"
    minutes: float


@dataclass(frozen=True, slots=True, eq=False)
class StopFineTuning(Command):
    """Give up fine-tuning; the network stays as it is."""


@dataclass(frozen=True, slots=True, eq=False)
class UseWeights(Command):
    """Take the weights that fine-tuning made into use and build the map anew with them."""

    label: ClassVar[str] = "use new weights"


@dataclass(frozen=True, slots=True, eq=False)
class DismissWeights(Command):
    """Go on with the weights in use; those that fine-tuning made stay on disk."""


@dataclass(frozen=True, slots=True, eq=False)
class SelectGoal(Command):
    """Choose a node as the goal without going there yet."""

    label: ClassVar[str] = "choose a goal"
    node: NodeId


@dataclass(frozen=True, slots=True, eq=False)
class PickNode(Command):
    """Choose a node as the goal, and go there if the robot is free."""

    node: NodeId


@dataclass(frozen=True, slots=True, eq=False)
class NavigateTo(Command):
    """Drive to a node of the map, or to the one that was chosen."""

    label: ClassVar[str] = "navigate"
    node: NodeId | None = None


@dataclass(frozen=True, slots=True, eq=False)
class NavigateToImage(Command):
    """Drive to the node that looks most like a picture (H, W, 3)."""

    label: ClassVar[str] = "upload a goal picture"
    rgb: Rgb


@dataclass(frozen=True, slots=True, eq=False)
class Pause(Command):
    """Hold the navigation task or the replay, or go on with it."""

    label: ClassVar[str] = "pause"


@dataclass(frozen=True, slots=True, eq=False)
class StepOnce(Command):
    """Let one control step of the navigation task happen, then hold it."""

    label: ClassVar[str] = "step"


@dataclass(frozen=True, slots=True, eq=False)
class Cancel(Command):
    """Give up the navigation task or the building of a map."""

    label: ClassVar[str] = "cancel"


@dataclass(frozen=True, slots=True, eq=False)
class TakeOver(Command):
    """Give up the navigation task, because a person drives."""

    label: ClassVar[str] = "take over"


@dataclass(frozen=True, slots=True, eq=False)
class OpenRecording(Command):
    """Show a recording of the recordings folder in the page."""

    label: ClassVar[str] = "open a recording"
    name: str
    """Path inside the recordings folder."""
    at_s: float = 0.0
    """Seconds after its beginning at which to show it first."""
    then: tuple[Command, ...] = ()
    """What to do once it is open."""


@dataclass(frozen=True, slots=True, eq=False)
class CloseRecording(Command):
    """Go back from the replay to the live robot."""

    label: ClassVar[str] = "back to the robot"


@dataclass(frozen=True, slots=True, eq=False)
class Seek(Command):
    """Show the recording, or the live run, as it was so many seconds after its beginning."""

    label: ClassVar[str] = "seek"
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class SeekBy(Command):
    """Show the replay so many seconds later, or earlier."""

    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class SeekMark(Command):
    """Show the moment of the next mark on the time line, or of the one before."""

    label: ClassVar[str] = "go to an event"
    kind: MarkKind | None
    """None means anything that happened, with a mark or without."""
    forwards: bool


@dataclass(frozen=True, slots=True, eq=False)
class ChooseQuestion(Command):
    """Show a tool of the debugger, by the name that the page calls it; an unknown one shows none."""

    label: ClassVar[str] = "ask why"
    name: str


@dataclass(frozen=True, slots=True, eq=False)
class FollowLink(Command):
    """Follow a link in what the tool shows."""

    link: int


@dataclass(frozen=True, slots=True, eq=False)
class SubmitText(Command):
    """Hand what a person typed to the tool."""

    text: str


@dataclass(frozen=True, slots=True, eq=False)
class PointAt(Command):
    """Select a node, or an edge from `node` to `target`, for the tool."""

    node: NodeId
    target: NodeId | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EditMap(Command):
    """Change the live map by hand."""

    label: ClassVar[str] = "change the map by hand"
    deltas: tuple[GraphDelta, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ReportError(Command):
    """Show a message in the page; for errors met outside the session, such as a broken upload."""

    text: str
