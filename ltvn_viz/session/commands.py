"""What a person can ask of the app, as data.

Callbacks of the page build these and put them into the session's queue; the session alone carries them out. Driving
is not among them: the held keys are polled from the driver's seat, so that they can never pile up in a queue.
"""

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.types import NodeId, Rgb


@dataclass(frozen=True, slots=True, eq=False)
class LabelledCommand:
    """Something a person asked for."""

    label: ClassVar[str] = ""
    """What the page calls it."""


@dataclass(frozen=True, slots=True, eq=False)
class StopRobot(LabelledCommand):
    """Stop the robot now and give up navigating."""

    label: ClassVar[str] = "stop"


@dataclass(frozen=True, slots=True, eq=False)
class StartRecording(LabelledCommand):
    """Begin a new recording."""

    label: ClassVar[str] = "record"


@dataclass(frozen=True, slots=True, eq=False)
class KeepRecording(LabelledCommand):
    """End the recording and keep it under a name of its own."""

    label: ClassVar[str] = "keep"


@dataclass(frozen=True, slots=True, eq=False)
class DiscardRecording(LabelledCommand):
    """End the recording and move it to the folder of discarded ones."""

    label: ClassVar[str] = "discard"


@dataclass(frozen=True, slots=True, eq=False)
class BuildMap(LabelledCommand):
    """Build a map anew from all images driven so far, or of the open recording into a new file, Algorithm 1."""

    label: ClassVar[str] = "build the map"


LEAST_MINUTES = 1
MOST_MINUTES = 60
"""Fine-tuning takes at least and at most so many minutes."""


@dataclass(frozen=True, slots=True, eq=False)
class FineTune(LabelledCommand):
    """Fine-tune the network on the drive at hand."""

    label: ClassVar[str] = "learn from a drive"
    minutes: float


@dataclass(frozen=True, slots=True, eq=False)
class StopFineTuning(LabelledCommand):
    """Give up fine-tuning; the network stays as it is."""


@dataclass(frozen=True, slots=True, eq=False)
class UseWeights(LabelledCommand):
    """Take the weights that fine-tuning made into use and build the map anew with them."""

    label: ClassVar[str] = "use new weights"


@dataclass(frozen=True, slots=True, eq=False)
class DismissWeights(LabelledCommand):
    """Go on with the weights in use; those that fine-tuning made stay on disk."""


@dataclass(frozen=True, slots=True, eq=False)
class ChooseGoal(LabelledCommand):
    """Choose a node as the goal, and go there if the robot is free; what a click on a goal's image means."""

    label: ClassVar[str] = "choose a goal"
    node: NodeId


@dataclass(frozen=True, slots=True, eq=False)
class PickNode(LabelledCommand):
    """Choose a node as the goal, and go there if the robot is free."""

    node: NodeId


@dataclass(frozen=True, slots=True, eq=False)
class NavigateTo(LabelledCommand):
    """Drive to a node of the map, or to the one that was chosen."""

    label: ClassVar[str] = "navigate"
    node: NodeId | None = None


@dataclass(frozen=True, slots=True, eq=False)
class NavigateToImage(LabelledCommand):
    """Drive to the node that looks most like an image (72, 96, 3); in a replay, look for it in the map on show."""

    label: ClassVar[str] = "upload an image"
    rgb: Rgb
    original: Rgb | None = None
    """(H, W, 3) the image as it was uploaded, of moderate size."""


@dataclass(frozen=True, slots=True, eq=False)
class Pause(LabelledCommand):
    """Hold the query or the replay, or go on with it."""

    label: ClassVar[str] = "pause"


@dataclass(frozen=True, slots=True, eq=False)
class StepOnce(LabelledCommand):
    """Let one control step of the query happen, then hold it."""

    label: ClassVar[str] = "step"


@dataclass(frozen=True, slots=True, eq=False)
class KeepGoing(LabelledCommand):
    """Say whether a query goes on when the last page closes, or pauses."""

    is_on: bool


@dataclass(frozen=True, slots=True, eq=False)
class Cancel(LabelledCommand):
    """Give up the query or the building of a map."""

    label: ClassVar[str] = "cancel"


@dataclass(frozen=True, slots=True, eq=False)
class TakeOver(LabelledCommand):
    """Give up the query, because a person drives."""

    label: ClassVar[str] = "take over"


@dataclass(frozen=True, slots=True, eq=False)
class OpenRecording(LabelledCommand):
    """Show a recording of the recordings folder in the page."""

    label: ClassVar[str] = "open a recording"
    name: str
    """Path inside the recordings folder."""
    at_s: float = 0.0
    """Seconds after its beginning at which to show it first."""
    then: "tuple[Command, ...]" = ()
    """What to do once it is open."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportDrive(LabelledCommand):
    """Make a recording of a drive in another format that lies in the recordings folder, and open it."""

    label: ClassVar[str] = "import a drive"
    name: str
    """Path inside the recordings folder."""


@dataclass(frozen=True, slots=True, eq=False)
class CloseRecording(LabelledCommand):
    """Go back from the replay to the live robot."""

    label: ClassVar[str] = "back to the robot"


@dataclass(frozen=True, slots=True, eq=False)
class Seek(LabelledCommand):
    """Show the recording, or the live run, as it was so many seconds after its beginning."""

    label: ClassVar[str] = "seek"
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class PlayTime(LabelledCommand):
    """Let the time on show go on, or hold it: of the recording, or of the live run's past."""

    label: ClassVar[str] = "play"


@dataclass(frozen=True, slots=True, eq=False)
class SetPlaySpeed(LabelledCommand):
    """Play so many times as fast as it happened."""

    label: ClassVar[str] = "play faster or slower"
    speed: float


@dataclass(frozen=True, slots=True, eq=False)
class ShowNow(LabelledCommand):
    """Show the live run as it is now, after a look back."""

    label: ClassVar[str] = "back to now"


@dataclass(frozen=True, slots=True, eq=False)
class SeekBy(LabelledCommand):
    """Show the replay so many seconds later, or earlier."""

    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class SeekMark(LabelledCommand):
    """Show the moment of the next mark on the time line, or of the one before."""

    label: ClassVar[str] = "go to an event"
    kind: MarkKind | None
    """None means anything that happened, with a mark or without."""
    forwards: bool


@dataclass(frozen=True, slots=True, eq=False)
class ChooseQuestion(LabelledCommand):
    """Show a tool of the debugger, by the name that the page calls it; an unknown one shows none."""

    label: ClassVar[str] = "ask why"
    name: str


@dataclass(frozen=True, slots=True, eq=False)
class FollowLink(LabelledCommand):
    """Follow a link in what the tool shows."""

    link: int


@dataclass(frozen=True, slots=True, eq=False)
class SubmitText(LabelledCommand):
    """Hand what a person typed to the tool."""

    text: str


@dataclass(frozen=True, slots=True)
class QuestionRequest:
    """What a link in an answer asks of the question that drew it; each question has its own kinds."""


@dataclass(frozen=True, slots=True, eq=False)
class AskQuestion(LabelledCommand):
    """Ask something of the question on show."""

    request: QuestionRequest


@dataclass(frozen=True, slots=True, eq=False)
class PointAt(LabelledCommand):
    """Select a node, or an edge from `node` to `target`, for the tool."""

    node: NodeId
    target: NodeId | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EditMap(LabelledCommand):
    """Change the live map by hand."""

    label: ClassVar[str] = "change the map by hand"
    deltas: tuple[GraphDelta, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ToggleDoor(LabelledCommand):
    """Close an open door of the simulated world, open a closed one."""

    label: ClassVar[str] = "change the world"
    door: int


@dataclass(frozen=True, slots=True, eq=False)
class AimBox(LabelledCommand):
    """Wait for a click on the floor that says where a box shall stand; asked for again, wait no longer."""

    label: ClassVar[str] = "put down a box"
    number: int
    """A box that stands there already, to move it; 0 for a new one."""


@dataclass(frozen=True, slots=True, eq=False)
class PutBox(LabelledCommand):
    """Put a box down in the simulated world, the one that waits for its place or a new one."""

    label: ClassVar[str] = "put down a box"
    place: tuple[float, float] | None = None
    """x and y in metres; None is in front of the robot."""


@dataclass(frozen=True, slots=True, eq=False)
class TakeBox(LabelledCommand):
    """Take a box away from the simulated world."""

    label: ClassVar[str] = "take away a box"
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class SetLight(LabelledCommand):
    """Make the simulated world's light brighter or darker."""

    label: ClassVar[str] = "change the light"
    percent: int
    """100 is the scene as it was made."""


@dataclass(frozen=True, slots=True, eq=False)
class UndoWorldChange(LabelledCommand):
    """Take the last change of the simulated world by hand back."""

    label: ClassVar[str] = "undo"


@dataclass(frozen=True, slots=True, eq=False)
class WatchItLearn(LabelledCommand):
    """Close a door on a planned way, let the robot find out, open it again, and tell what the map learns."""

    label: ClassVar[str] = "watch it learn"


@dataclass(frozen=True, slots=True, eq=False)
class ReportError(LabelledCommand):
    """Show a message in the page; for errors met outside the session, such as a broken upload."""

    text: str


RecordingCommand: TypeAlias = StartRecording | KeepRecording | DiscardRecording
PlaybackCommand: TypeAlias = Pause | StepOnce | OpenRecording | CloseRecording
"""What means something to a query or a replay under way."""
TimeCommand: TypeAlias = Seek | SeekMark | SeekBy | PlayTime | SetPlaySpeed | ShowNow
"""What moves the time on show, in a recording or in the live run's past."""
DebuggerCommand: TypeAlias = ChooseQuestion | PointAt | SubmitText | AskQuestion | FollowLink
WorldCommand: TypeAlias = ToggleDoor | AimBox | PutBox | TakeBox | SetLight | UndoWorldChange | WatchItLearn
"""What changes the simulated world."""
Command: TypeAlias = (
    RecordingCommand
    | WorldCommand
    | PlaybackCommand
    | TimeCommand
    | DebuggerCommand
    | StopRobot
    | BuildMap
    | ImportDrive
    | FineTune
    | StopFineTuning
    | UseWeights
    | DismissWeights
    | ChooseGoal
    | PickNode
    | NavigateTo
    | NavigateToImage
    | KeepGoing
    | Cancel
    | TakeOver
    | EditMap
    | ReportError
)
"""Everything that can be asked of the session; pyright names each place that must know a new one."""
