"""Commands of a person to the app, as data, and the modes in which each is legal.

Callbacks of the page create commands and put them into the session's queue; only the session runs them. Driving is not
a command: the session polls the held keys from the driver's seat, so that outdated inputs cannot fill the queue. Their
names on the page are in `wish_table`.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, TypeAlias

from ltvn_core.analysis.timeline_records import MarkKind
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


@dataclass(frozen=True, eq=False)
class BaseCommand:
    """Base of all commands."""

    modes: ClassVar[frozenset[Mode]]
    """Modes in which the command is legal."""

    def __init_subclass__(cls, *, modes: frozenset[Mode]) -> None:
        """Set the modes of a kind of command."""
        cls.modes = modes


@dataclass(frozen=True, eq=False)
class StopRobot(BaseCommand, modes=ANYWHERE):
    """Stop the robot now and end whatever gives it its steps: a query, the story, the search for an image."""


@dataclass(frozen=True, eq=False)
class Cancel(BaseCommand, modes=ANYWHERE):
    """Cancel the query or the building of a map."""


@dataclass(frozen=True, eq=False)
class EndAction(BaseCommand, modes=UNDER_WAY):
    """Report whether the action that the robot waits for has succeeded."""

    succeeded: bool


@dataclass(frozen=True, eq=False)
class Pause(BaseCommand, modes=UNDER_WAY | {Mode.REPLAY}):
    """Pause the query or the replay, or continue it."""


@dataclass(frozen=True, eq=False)
class StepOnce(BaseCommand, modes=UNDER_WAY):
    """Run one control step of the query, then pause it."""


@dataclass(frozen=True, eq=False)
class KeepGoing(BaseCommand, modes=ANYWHERE):
    """Choose whether a query continues or pauses when the last page closes."""

    is_on: bool


@dataclass(frozen=True, eq=False)
class ShowLarger(BaseCommand, modes=ANYWHERE):
    """Choose between the larger picture for people and the image that the method sees."""

    is_on: bool


@dataclass(frozen=True, eq=False)
class TakeOver(BaseCommand, modes=ANYWHERE):
    """End whatever gives the robot its steps, because a person drives."""


@dataclass(frozen=True, eq=False)
class StartRecording(BaseCommand, modes=LIVE):
    """Start a new recording."""


@dataclass(frozen=True, eq=False)
class KeepRecording(BaseCommand, modes=LIVE):
    """End the recording and keep it under a new name."""


@dataclass(frozen=True, eq=False)
class DiscardRecording(BaseCommand, modes=LIVE):
    """End the recording and move it to the folder of discarded ones."""


@dataclass(frozen=True, eq=False)
class BuildMap(BaseCommand, modes=STANDING):
    """Run Algorithm 1: rebuild the live map from all images, or build a map of the open recording into a new file."""


@dataclass(frozen=True, eq=False)
class UndoBuild(BaseCommand, modes=DRIVING):
    """Restore the map from before it was rebuilt."""


@dataclass(frozen=True, eq=False)
class ImportDrive(BaseCommand, modes=STANDING):
    """Import a drive in another format from the recordings folder into a new recording, and open the recording."""

    name: str
    """Path inside the recordings folder."""


LEAST_MINUTES = 1
MOST_MINUTES = 60
"""Shortest and longest fine-tuning, in minutes."""


@dataclass(frozen=True, eq=False)
class FineTune(BaseCommand, modes=ANYWHERE):
    """Fine-tune the network on the current drive."""

    minutes: float


@dataclass(frozen=True, eq=False)
class StopFineTuning(BaseCommand, modes=ANYWHERE):
    """Cancel fine-tuning; the network does not change."""


@dataclass(frozen=True, eq=False)
class UseWeights(BaseCommand, modes=DRIVING):
    """Use the weights from fine-tuning, and rebuild the map with them."""


@dataclass(frozen=True, eq=False)
class DismissWeights(BaseCommand, modes=ANYWHERE):
    """Keep the weights in use; the weights from fine-tuning stay on disk."""


@dataclass(frozen=True, eq=False)
class ChooseQuestion(BaseCommand, modes=ANYWHERE):
    """Show a question of the debugger by its name on the page; for an unknown name, show none."""

    name: str


@dataclass(frozen=True, eq=False)
class FollowLink(BaseCommand, modes=ANYWHERE):
    """Follow a link in the answer on show."""

    link: int


@dataclass(frozen=True, eq=False)
class SubmitText(BaseCommand, modes=ANYWHERE):
    """Pass a text that a person typed to the question on show."""

    text: str


@dataclass(frozen=True, slots=True)
class QuestionRequest:
    """Request that a link sends to the question that drew it; each question defines its own kinds."""


@dataclass(frozen=True, eq=False)
class AskQuestion(BaseCommand, modes=ANYWHERE):
    """Send a request to the question on show."""

    request: QuestionRequest


@dataclass(frozen=True, eq=False)
class PointAt(BaseCommand, modes=ANYWHERE):
    """Select a node, or an edge from `node` to `target`, for the question on show."""

    node: NodeId
    target: NodeId | None = None


@dataclass(frozen=True, eq=False)
class ChooseGoal(BaseCommand, modes=LIVE):
    """Choose a node as the goal, and drive there if the robot is free; sent by a click on a goal's image."""

    node: NodeId


@dataclass(frozen=True, eq=False)
class PickNode(BaseCommand, modes=ANYWHERE):
    """Report a click on a node: it aligns the floor plan, selects the node for a question, or chooses it as the
    goal."""

    node: NodeId


@dataclass(frozen=True, eq=False)
class PickEdge(BaseCommand, modes=ANYWHERE):
    """Report a click on an edge, which is asked about: by the question on show, or by the one about edges."""

    node: NodeId
    target: NodeId


@dataclass(frozen=True, eq=False)
class NavigateTo(BaseCommand, modes=DRIVING):
    """Drive to a node of the map; None means the chosen goal."""

    node: NodeId | None = None


@dataclass(frozen=True, eq=False)
class NavigateToImage(BaseCommand, modes=STANDING):
    """Drive to the node that is most similar to an image (72, 96, 3); in a replay, find it in the map on show."""

    rgb: Rgb
    original: Rgb | None = None
    """The uploaded image (H, W, 3), scaled down to a moderate size; shown beside the similar nodes."""


@dataclass(frozen=True, eq=False)
class OpenRecording(BaseCommand, modes=STANDING):
    """Show a recording of the recordings folder in the page."""

    name: str
    """Path inside the recordings folder."""
    at_s: float = 0.0
    """Initial time in seconds after the recording's beginning."""
    then: "tuple[Command, ...]" = ()
    """Commands that run after the recording is open."""


@dataclass(frozen=True, eq=False)
class CloseRecording(BaseCommand, modes=frozenset({Mode.REPLAY})):
    """Return from the replay to the live robot."""


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
    """Show the moment of the next mark on the timeline, or of the previous one."""

    kind: MarkKind | None
    """Kind of the mark; None means any event, with a mark or without."""
    forwards: bool


@dataclass(frozen=True, eq=False)
class SeekBy(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Show the replay at a later time (positive), or an earlier time (negative), by a number of seconds."""

    seconds: float


@dataclass(frozen=True, eq=False)
class PlayTime(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Play or pause the recording, or the look back at the live run."""


@dataclass(frozen=True, eq=False)
class SetPlaySpeed(BaseCommand, modes=ANYWHERE):
    """Set the playback speed as a factor of real time."""

    speed: float


@dataclass(frozen=True, eq=False)
class ShowNow(BaseCommand, modes=LIVE | {Mode.REPLAY}):
    """Show the live run as it is now, after a look back."""


@dataclass(frozen=True, eq=False)
class ToggleDoor(BaseCommand, modes=LIVE):
    """Close an open door of the simulated world, or open a closed one."""

    door: int


@dataclass(frozen=True, eq=False)
class AimBox(BaseCommand, modes=LIVE):
    """Wait for a click on the floor for the place of a box; a second command cancels this."""

    number: int
    """Number of an existing box to move; 0 for a new one."""


@dataclass(frozen=True, eq=False)
class PutBox(BaseCommand, modes=LIVE):
    """Put the selected box, or a new one, at a place in the simulated world."""

    place: tuple[float, float] | None = None
    """Position (x, y) in metres; None means in front of the robot."""


@dataclass(frozen=True, eq=False)
class TakeBox(BaseCommand, modes=LIVE):
    """Remove a box from the simulated world."""

    number: int


@dataclass(frozen=True, eq=False)
class SetLight(BaseCommand, modes=LIVE):
    """Make the simulated world's light brighter or darker."""

    percent: int
    """Brightness in percent; 100 is the original brightness of the scene."""


@dataclass(frozen=True, eq=False)
class UndoWorldChange(BaseCommand, modes=LIVE):
    """Undo the last manual change of the simulated world."""


@dataclass(frozen=True, eq=False)
class WatchItLearn(BaseCommand, modes=DRIVING):
    """Close a door on a planned path, let the robot discover it, open the door again, and show what the map learned."""


@dataclass(frozen=True, eq=False)
class ShowFloor(BaseCommand, modes=ANYWHERE):
    """Show one floor of a map with several."""

    floor: int | None = None
    """Number of the floor from 0; None shows the robot's floor."""


@dataclass(frozen=True, eq=False)
class AlignFloorPlan(BaseCommand, modes=ANYWHERE):
    """Start to align the floor plan with the map by clicks; during an alignment, cancel it."""


@dataclass(frozen=True, eq=False)
class PointOnFloorPlan(BaseCommand, modes=ANYWHERE):
    """Report the place on the floor plan of the node that was clicked last."""

    place: tuple[float, float]
    """Position (x, y) in metres, in the frame of the map."""


@dataclass(frozen=True, eq=False)
class UndoPlanClick(BaseCommand, modes=ANYWHERE):
    """Undo the last click of the alignment."""


@dataclass(frozen=True, eq=False)
class UseAlignment(BaseCommand, modes=ANYWHERE):
    """Use the alignment that fits the clicks."""


@dataclass(frozen=True, eq=False)
class ReportError(BaseCommand, modes=ANYWHERE):
    """Show a message in the page, about an error from outside the session, such as a broken upload."""

    text: str


RecordingCommand: TypeAlias = StartRecording | KeepRecording | DiscardRecording
PlaybackCommand: TypeAlias = Pause | StepOnce | OpenRecording | CloseRecording
"""Commands for a running query or replay."""
TimeCommand: TypeAlias = Seek | SeekMark | SeekBy | PlayTime | SetPlaySpeed | ShowNow
"""Commands that change the time on show, in a recording or in the live run's past."""
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
    | PickEdge
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
