"""Commands of a person to the app, as data, and the modes in which each is legal.

Callbacks of the page build these and put them into the session's queue; the session alone carries them out. Driving
is not among them: the held keys are polled from the driver's seat, so that they can never pile up in a queue. What
a page calls them is in `wish_table`.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, TypeAlias

from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.types import NodeId, Rgb


class Mode(StrEnum):
    """Activity of the app; the value is the word that the page shows."""

    TELEOP = "driving"
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
"""While a query is in progress."""
STANDING = frozenset({Mode.TELEOP, Mode.REPLAY})
"""While no query and no building of a map is in progress."""


@dataclass(frozen=True, eq=False)
class BaseCommand:
    """Base of all commands."""

    modes: ClassVar[frozenset[Mode]]
    """Modes in which the command is legal."""

    def __init_subclass__(cls, *, modes: frozenset[Mode]) -> None:
        """Make a kind of command."""
        cls.modes = modes


@dataclass(frozen=True, eq=False)
class StopRobot(BaseCommand, modes=ANYWHERE):
    """Stop the robot now and give up navigating."""


@dataclass(frozen=True, eq=False)
class Cancel(BaseCommand, modes=ANYWHERE):
    """Give up the query or the building of a map."""


@dataclass(frozen=True, eq=False)
class EndAction(BaseCommand, modes=UNDER_WAY):
    """Tell whether the action that the robot waits for is done."""

    succeeded: bool


@dataclass(frozen=True, eq=False)
class Pause(BaseCommand, modes=UNDER_WAY | {Mode.REPLAY}):
    """Pause the query or the replay, or continue it."""


@dataclass(frozen=True, eq=False)
class StepOnce(BaseCommand, modes=UNDER_WAY):
    """Let one control step of the query happen, then hold it."""


@dataclass(frozen=True, eq=False)
class KeepGoing(BaseCommand, modes=ANYWHERE):
    """Choose whether a query continues or pauses when the last page closes."""

    is_on: bool


@dataclass(frozen=True, eq=False)
class ShowLarger(BaseCommand, modes=ANYWHERE):
    """Say whether the page shows a larger picture that is drawn for people, or what the method sees."""

    is_on: bool


@dataclass(frozen=True, eq=False)
class TakeOver(BaseCommand, modes=UNDER_WAY):
    """Give up the query, because a person drives."""


@dataclass(frozen=True, eq=False)
class StartRecording(BaseCommand, modes=LIVE):
    """Begin a new recording."""


@dataclass(frozen=True, eq=False)
class KeepRecording(BaseCommand, modes=LIVE):
    """End the recording and keep it under a new name."""


@dataclass(frozen=True, eq=False)
class DiscardRecording(BaseCommand, modes=LIVE):
    """End the recording and move it to the folder of discarded ones."""


@dataclass(frozen=True, eq=False)
class BuildMap(BaseCommand, modes=STANDING):
    """Rebuild the map from all images driven so far, or build one of the open recording into a new file, Algorithm
    1."""


@dataclass(frozen=True, eq=False)
class UndoBuild(BaseCommand, modes=DRIVING):
    """Bring the map back that was there before it was rebuilt."""


@dataclass(frozen=True, eq=False)
class ImportDrive(BaseCommand, modes=STANDING):
    """Make a recording of a drive in another format that lies in the recordings folder, and open it."""

    name: str
    """Path inside the recordings folder."""


LEAST_MINUTES = 1
MOST_MINUTES = 60
"""Shortest and longest fine-tuning, in minutes."""


@dataclass(frozen=True, eq=False)
class FineTune(BaseCommand, modes=ANYWHERE):
    """Fine-tune the network on the drive at hand."""

    minutes: float


@dataclass(frozen=True, eq=False)
class StopFineTuning(BaseCommand, modes=ANYWHERE):
    """Give up fine-tuning; the network stays as it is."""


@dataclass(frozen=True, eq=False)
class UseWeights(BaseCommand, modes=DRIVING):
    """Use the weights that fine-tuning made and rebuild the map with them."""


@dataclass(frozen=True, eq=False)
class DismissWeights(BaseCommand, modes=ANYWHERE):
    """Go on with the weights in use; those that fine-tuning made stay on disk."""


@dataclass(frozen=True, eq=False)
class ChooseQuestion(BaseCommand, modes=ANYWHERE):
    """Show a tool of the debugger, by the name that the page calls it; an unknown one shows none."""

    name: str


@dataclass(frozen=True, eq=False)
class FollowLink(BaseCommand, modes=ANYWHERE):
    """Follow a link in what the tool shows."""

    link: int


@dataclass(frozen=True, eq=False)
class SubmitText(BaseCommand, modes=ANYWHERE):
    """Hand what a person typed to the tool."""

    text: str


@dataclass(frozen=True, slots=True)
class QuestionRequest:
    """Request of a link in an answer to the question that drew it; each question has its own kinds."""


@dataclass(frozen=True, eq=False)
class AskQuestion(BaseCommand, modes=ANYWHERE):
    """Ask something of the question on show."""

    request: QuestionRequest


@dataclass(frozen=True, eq=False)
class PointAt(BaseCommand, modes=ANYWHERE):
    """Select a node, or an edge from `node` to `target`, for the tool."""

    node: NodeId
    target: NodeId | None = None


@dataclass(frozen=True, eq=False)
class ChooseGoal(BaseCommand, modes=LIVE):
    """Choose a node as the goal, and go there if the robot is free; what a click on a goal's image means."""

    node: NodeId


@dataclass(frozen=True, eq=False)
class PickNode(BaseCommand, modes=ANYWHERE):
    """Choose a node as the goal, and go there if the robot is free."""

    node: NodeId


@dataclass(frozen=True, eq=False)
class NavigateTo(BaseCommand, modes=DRIVING):
    """Drive to a node of the map, or to the one that was chosen."""

    node: NodeId | None = None


@dataclass(frozen=True, eq=False)
class NavigateToImage(BaseCommand, modes=STANDING):
    """Drive to the node that looks most like an image (72, 96, 3); in a replay, look for it in the map on show."""

    rgb: Rgb
    original: Rgb | None = None
    """(H, W, 3) the image as it was uploaded, of moderate size."""


@dataclass(frozen=True, eq=False)
class OpenRecording(BaseCommand, modes=STANDING):
    """Show a recording of the recordings folder in the page."""

    name: str
    """Path inside the recordings folder."""
    at_s: float = 0.0
    """Seconds after its beginning at which to show it first."""
    then: "tuple[Command, ...]" = ()
    """Commands that follow when it is open."""


@dataclass(frozen=True, eq=False)
class CloseRecording(BaseCommand, modes=frozenset({Mode.REPLAY})):
    """Go back from the replay to the live robot."""


@dataclass(frozen=True, eq=False)
class Seek(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Show the recording, or the live run, at a time in seconds after its beginning."""

    time_s: float


@dataclass(frozen=True, eq=False)
class EditMap(BaseCommand, modes=DRIVING):
    """Change the live map by hand."""

    deltas: tuple[GraphDelta, ...]


@dataclass(frozen=True, eq=False)
class SeekMark(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Show the moment of the next mark on the time line, or of the one before."""

    kind: MarkKind | None
    """None means anything that happened, with a mark or without."""
    forwards: bool


@dataclass(frozen=True, eq=False)
class SeekBy(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Show the replay some seconds later (positive) or earlier (negative)."""

    seconds: float


@dataclass(frozen=True, eq=False)
class PlayTime(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Play or pause the time shown, of the recording or of the live run's past."""


@dataclass(frozen=True, eq=False)
class SetPlaySpeed(BaseCommand, modes=ANYWHERE):
    """Set the playback speed as a factor of real time."""

    speed: float


@dataclass(frozen=True, eq=False)
class ShowNow(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Show the live run as it is now, after a look back."""


@dataclass(frozen=True, eq=False)
class ToggleDoor(BaseCommand, modes=LIVE):
    """Close an open door of the simulated world, open a closed one."""

    door: int


@dataclass(frozen=True, eq=False)
class AimBox(BaseCommand, modes=LIVE):
    """Wait for a click on the floor for the place of a box; a second command cancels this."""

    number: int
    """Number of an existing box to move; 0 for a new one."""


@dataclass(frozen=True, eq=False)
class PutBox(BaseCommand, modes=LIVE):
    """Put a box down in the simulated world, the one that waits for its place or a new one."""

    place: tuple[float, float] | None = None
    """x and y in metres; None is in front of the robot."""


@dataclass(frozen=True, eq=False)
class TakeBox(BaseCommand, modes=LIVE):
    """Take a box away from the simulated world."""

    number: int


@dataclass(frozen=True, eq=False)
class SetLight(BaseCommand, modes=LIVE):
    """Make the simulated world's light brighter or darker."""

    percent: int
    """100 is the scene as it was made."""


@dataclass(frozen=True, eq=False)
class UndoWorldChange(BaseCommand, modes=LIVE):
    """Take the last change of the simulated world by hand back."""


@dataclass(frozen=True, eq=False)
class WatchItLearn(BaseCommand, modes=DRIVING):
    """Close a door on a planned path, let the robot find out, open it again, and tell what the map learns."""


@dataclass(frozen=True, eq=False)
class ShowFloor(BaseCommand, modes=ANYWHERE):
    """Show one floor of a map with several."""

    floor: int | None = None
    """Number of the floor from 0; None shows the robot's floor."""


@dataclass(frozen=True, eq=False)
class AlignFloorPlan(BaseCommand, modes=ANYWHERE):
    """Start to align the floor plan with the map by clicks; asked for again, leave the alignment as it was."""


@dataclass(frozen=True, eq=False)
class PointOnFloorPlan(BaseCommand, modes=ANYWHERE):
    """Say where on the floor plan the node is that was clicked last."""

    place: tuple[float, float]
    """x and y in metres, in the frame of the map."""


@dataclass(frozen=True, eq=False)
class UndoPlanClick(BaseCommand, modes=ANYWHERE):
    """Take the last click of the alignment back."""


@dataclass(frozen=True, eq=False)
class UseAlignment(BaseCommand, modes=ANYWHERE):
    """Keep the alignment that fits the clicks."""


@dataclass(frozen=True, eq=False)
class ReportError(BaseCommand, modes=ANYWHERE):
    """Show a message in the page; for errors met outside the session, such as a broken upload."""

    text: str


RecordingCommand: TypeAlias = StartRecording | KeepRecording | DiscardRecording
PlaybackCommand: TypeAlias = Pause | StepOnce | OpenRecording | CloseRecording
"""Commands for a running query or replay."""
TimeCommand: TypeAlias = Seek | SeekMark | SeekBy | PlayTime | SetPlaySpeed | ShowNow
"""Commands that change the time shown, in a recording or in the live run's past."""
DebuggerCommand: TypeAlias = ChooseQuestion | PointAt | SubmitText | AskQuestion | FollowLink
WorldCommand: TypeAlias = ToggleDoor | AimBox | PutBox | TakeBox | SetLight | UndoWorldChange | WatchItLearn
"""Commands that change the simulated world."""
FloorPlanCommand: TypeAlias = AlignFloorPlan | PointOnFloorPlan | UndoPlanClick | UseAlignment
"""Commands that align the floor plan with the map."""
OtherCommand: TypeAlias = (
    StopRobot
    | BuildMap
    | UndoBuild
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
    | ShowLarger
    | ShowFloor
    | Cancel
    | EndAction
    | TakeOver
    | EditMap
    | ReportError
)
Command: TypeAlias = (
    RecordingCommand | WorldCommand | PlaybackCommand | TimeCommand | DebuggerCommand | FloorPlanCommand | OtherCommand
)
"""All commands to the session; pyright reports each place that must handle a new one."""
