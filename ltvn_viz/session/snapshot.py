"""The page's content as one frozen value.

Live and replay make the same `Snapshot`; a layer or panel cannot tell which one it draws. Arrays are shared between
snapshots while they do not change, so comparing by identity tells what to redraw.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.recorded_frames import NO_TRAJECTORY
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.navigation.events import Severity
from ltvn_core.robots.link_report import LinkReport
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.scene import Scene, door_names
from ltvn_core.types import Depth, NodeId, Rgb
from ltvn_viz.server.driver_seat import ClientId
from ltvn_viz.session.inspection import NO_INSPECTION, Inspection
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.wishes.commands import Mode

BOX_SIZE_M = (0.4, 0.4, 0.5)
"""Width, depth and height of a box that is put down."""


@dataclass(frozen=True, slots=True)
class DoorView:
    """A door that a person may close or open."""

    door: int
    """Its number among the scene's doors."""
    label: str
    """Which rooms it joins."""
    x: float
    y: float
    """Its middle in metres."""
    along_x: bool
    """Whether its wall runs along x."""
    width_m: float
    is_open: bool = True


@dataclass(frozen=True, slots=True)
class BoxView:
    """A box that was put down."""

    number: int
    x: float
    y: float
    """Its middle in metres."""


class FloorView(NamedTuple):
    """The rectangle around all of a scene's floor, in metres."""

    x0: float
    y0: float
    x1: float
    y1: float


@dataclass(frozen=True, slots=True)
class WorldView:
    """The changes of a world that are possible now."""

    floor: FloorView
    doors: tuple[DoorView, ...]
    boxes: tuple[BoxView, ...]
    aimed: int | None
    """Number of the box that waits for a click on the floor, 0 for a new one; None where none does."""
    light: float
    """Brightness; 1 is the scene as it was made."""
    undo: str
    """Description of the change that undo would revert; empty without one."""


def doors_of(scene: Scene) -> tuple[DoorView, ...]:
    """Return the doors of a scene, all open."""
    named = zip(door_names(scene), scene.parts.doors, strict=True)
    return tuple(_door(number, name, doorway) for number, (name, doorway) in enumerate(named))


def floor_of(scene: Scene) -> FloorView:
    """Return where the floor of a scene is."""
    clearance = scene.clearance
    rows, columns = clearance.blocked.shape
    x, y = clearance.origin.tolist()
    return FloorView(x, y, x + columns * clearance.resolution_m, y + rows * clearance.resolution_m)


def _door(number: int, name: str, doorway: Doorway) -> DoorView:
    x, y = doorway.middle
    return DoorView(
        door=number,
        label=name,
        x=x,
        y=y,
        along_x=doorway.axis == 1,
        width_m=doorway.width_m,
    )


class ImageSource(StrEnum):
    """Which image of the robot's surroundings is on show."""

    OBSERVATION = "observation"
    """The one that the method works with."""
    RENDERED = "rendered"
    """One that the simulator draws larger, for people alone."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """The camera's picture for people, of any size."""

    rgb: Rgb
    """(H, W, 3)."""
    depth: Depth | None
    """(H, W) metres; None where the robot has no depth camera."""
    source: ImageSource = ImageSource.OBSERVATION


@dataclass(frozen=True, slots=True)
class LoopRates:
    """How well the loop keeps up."""

    loop_hz: float = 0.0
    frame_age_ms: float = 0.0
    """Age of the picture on show."""
    dropped: int = 0
    """Pictures that were replaced before they were shown, since the start."""


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """Whether something is being recorded, and into what."""

    name: str | None = None
    """File under way; None when nothing is recorded."""
    frames: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class PlaybackStatus:
    """Which recording is open and where in it we are."""

    name: str
    length_s: float
    time_s: float
    """Seconds since its beginning."""
    playing: bool


@dataclass(frozen=True, slots=True)
class TimelineStatus:
    """Where in time the page is, and how many marks its timeline has."""

    run: int = 0
    """Number of the run's marks, see `ltvn_viz.timeline.strip_marks`; 0 for none."""
    marks: int = 0
    time_s: float = 0.0
    """Of the moment on show, seconds since the beginning of the run."""
    length_s: float = 0.0
    is_now: bool = True
    """The robot itself is on show, and not its past or a recording."""
    is_replay: bool = False
    is_playing: bool = False
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Message:
    """Something the person must read."""

    text: str
    severity: Severity
    number: int
    """Counts messages, so that the same words twice are two messages."""
    title: str = ""
    """Title in a few words; empty for the title of its severity."""


@dataclass(frozen=True, slots=True)
class JobProgress:
    """A job that takes a while."""

    label: str
    images: int = 0
    """Number of images that are done."""
    of_images: int | None = None
    """Number of all images; None where it is unknown."""

    @property
    def share(self) -> float | None:
        """Return the share that is done, in [0, 1]; None if unknown."""
        return min(1.0, self.images / self.of_images) if self.of_images else None


class FineTuningPhase(StrEnum):
    """Where fine-tuning stands."""

    IDLE = "idle"
    LEARNING = "learning"
    LEARNED = "learned"
    """New weights are on offer."""
    WORSE = "worse"
    """New weights are on disk, but call more far pairs reachable than the old ones."""
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class FineTuningStatus:
    """State of the fine-tuning for the page."""

    phase: FineTuningPhase = FineTuningPhase.IDLE
    drive: str = ""
    """The drive to learn from."""
    share: float = 0.0
    """How much is done in [0, 1]."""
    doing: str = ""
    left: str = ""
    """How long it still takes, in words."""
    besides_s: float | None = None
    """Seconds that the last lesson took on top of the time asked for; None before there was one."""
    lines: tuple[str, ...] = ()
    """Results of the last fine-tuning."""
    path: str = ""
    """Where the new weights lie."""
    is_possible: bool = True
    """False if the predictor has no weights to train."""


class LikePlace(NamedTuple):
    """A node that looks like an image."""

    node: NodeId
    likeness: float
    """In [-1, 1]; 1 is the same image."""


class WayNodes(NamedTuple):
    """Pictures of the nodes along a running query."""

    at: NodeId | None
    """Where the robot thinks it is; None while it is lost."""
    next: NodeId | None
    """The subgoal that it drives to; None while it looks around."""
    goal: NodeId


@dataclass(frozen=True, slots=True)
class UploadMatch:
    """An uploaded image and the nodes that look like it."""

    picture: str
    """Address of a small copy, which holds the copy itself."""
    places: tuple[LikePlace, ...]
    """Best first."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Everything the page shows at one instant."""

    mode: Mode = Mode.TELEOP
    scene: str = ""
    """Name of the scene to draw."""
    moment: RunMoment = field(default_factory=RunMoment)
    camera: CameraImage | None = None
    shows_larger: bool | None = None
    """That image is a larger one, drawn for people; None where that is not on offer."""
    rates: LoopRates = LoopRates()
    recording: RecordingStatus = RecordingStatus()
    recordings: Mapping[str, str] = field(default_factory=dict)
    """Files of the recordings folder, newest first, with when each was written and how large it is."""
    sources: tuple[str, ...] = ()
    """Drives in other formats in that folder, which can be imported."""
    is_making: bool = False
    """Whether a new recording is being made of one of these."""
    replay: PlaybackStatus | None = None
    timeline: TimelineStatus = TimelineStatus()
    course: NDArray[np.float64] = field(default_factory=lambda: NO_TRAJECTORY, repr=False)
    """(T, 3) all poses of the open recording, thinned; empty for the live run, whose future is unknown."""
    lone_camera: CameraModel | None = None
    """The camera that took the images if the robot is unknown; None for a known robot."""
    pause_notice: str = ""
    """Why the app itself paused a query; empty when it did not."""
    keeps_going: bool | None = None
    """Whether a query continues when the last page closes; None if that is not offered."""
    is_open_loop: bool = False
    """A recorded drive plays the robot, so that nothing can be driven."""
    destination: NodeId | None = None
    """Where a query under way drives to, also while it is paused; None when the robot is a person's."""
    selected: NodeId | None = None
    """The goal that was chosen; shown with a pin."""
    gallery: tuple[NodeId, ...] = ()
    """Nodes offered as goals by their pictures."""
    way: WayNodes | None = None
    """Nodes of the running query whose pictures are in memory; None without a query."""
    upload: UploadMatch | None = None
    """Matches of the last uploaded image; None without any."""
    message: Message | None = None
    work: JobProgress | None = None
    can_undo_build: bool = False
    """The map was rebuilt, and the one before can be brought back."""
    fine_tuning: FineTuningStatus = FineTuningStatus()
    weights: str = ""
    """Fingerprint of the weights in use."""
    world: WorldView | None = None
    """Possible changes of the simulated world; None in a replay, and for a real robot."""
    link: LinkReport | None = None
    """How well the robot is heard; None in simulation, and in a replay."""
    story: tuple[str, ...] = ()
    """Captions of “Watch it learn” so far."""
    story_goes_on: bool = False
    """More of it is to come."""
    story_door: int | None = None
    """The door that it is about, once that is known."""
    story_query: int | None = None
    """The query that it began last; None before it began one."""
    inspection: Inspection = NO_INSPECTION
    """The debugger's state."""
    own_inspections: Mapping[ClientId, Inspection] = field(default_factory=dict)
    """The debugger's state on pages that only watch and have a question of their own."""
    hint: str = ""
    """What to do next."""
