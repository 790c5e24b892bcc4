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
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.navigation.events import ActionBegun, Severity
from ltvn_core.robots.link_report import LinkReport
from ltvn_core.simulation.scene import Scene, door_names
from ltvn_core.types import Depth, NodeId, Rgb
from ltvn_viz.session.inspection import NO_INSPECTION, Inspection
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.wishes.modes import Mode

BOX_SIZE_M = (0.4, 0.4, 0.5)
"""Width, depth and height of a placed box, in metres."""


@dataclass(frozen=True, slots=True)
class DoorView:
    """A door that a person may close or open."""

    door: int
    """Its number among the scene's doors."""
    label: str
    """Description of the rooms that the door joins."""
    x: float
    y: float
    """Position of the door's centre along y, like `x` in metres."""
    along_x: bool
    """Whether the door's wall runs along x."""
    width_m: float
    is_open: bool = True


@dataclass(frozen=True, slots=True)
class BoxView:
    """A box that a person placed."""

    number: int
    x: float
    y: float
    """Position of the box's centre along y, like `x` in metres."""


@dataclass(frozen=True, slots=True)
class WorldView:
    """The changes of a world that are possible now."""

    doors: tuple[DoorView, ...]
    boxes: tuple[BoxView, ...]
    aimed: int | None
    """Number of the box that waits for a click on the floor, 0 for a new one; None without such a box."""
    light: float
    """Brightness of the light; 1 is the original brightness of the scene."""
    undo: str
    """Description of the change that undo would revert; empty if there is none."""


@dataclass(frozen=True, slots=True)
class FloorPlanView:
    """The floor plan under the map, and its alignment by clicks."""

    plan: FloorPlan
    """The plan as it is drawn, in the frame of the map."""
    align: str = ""
    """Option of the command line with the alignment in use; empty before a person made one."""
    is_aligning: bool = False
    pairs: int = 0
    """Number of nodes whose place on the plan was clicked."""
    node: NodeId | None = None
    """The node whose place on the plan is clicked next; None if a node is clicked next."""
    error_m: float | None = None
    """Root mean square distance of the pairs in metres; None with fewer than two pairs."""
    marks: tuple[tuple[float, float], ...] = ()
    """Positions of the clicked nodes and of their places on the plan, in metres in the frame of the map."""


class FloorChoice(NamedTuple):
    """The floor on show, of a map with several."""

    floor: int
    """Number of the floor, from 0; 0 is the largest."""
    floors: int
    """Number of floors."""
    follows_robot: bool
    """Whether the floor is the robot's, and not one that a person chose."""
    robots: int | None
    """Number of the robot's floor; None before it was localised."""


def doors_of(scene: Scene) -> tuple[DoorView, ...]:
    """Return the doors of a scene, all open."""
    named = enumerate(zip(door_names(scene), scene.parts.doors, strict=True))
    return tuple(
        DoorView(number, name, *door.middle, along_x=door.axis == 1, width_m=door.width_m)
        for number, (name, door) in named
    )


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """What the method sees, of any size."""

    rgb: Rgb
    """(H, W, 3) colours."""
    depth: Depth | None
    """(H, W) depth in metres; None if the robot has no depth camera."""
    original: bytes = b""
    """The robot's own image as a JPEG, if it differs."""


@dataclass(frozen=True, slots=True)
class LoopRates:
    """Measured rates and delays of the session loop."""

    loop_hz: float = 0.0
    frame_age_ms: float = 0.0
    """Age of the picture on show, in milliseconds."""
    dropped: int = 0
    """Number of pictures since the start that were replaced before they were shown."""


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """State of the running recording."""

    name: str | None = None
    """Name of the file; None without a recording."""
    frames: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class TimelineStatus:
    """The moment on show, and the number of marks on the timeline."""

    run: int = 0
    """Number of the run's marks, see `ltvn_viz.timeline.strip_marks`; 0 for none."""
    marks: int = 0
    time_s: float = 0.0
    """Time of the moment on show, in seconds since the beginning of the run."""
    length_s: float = 0.0
    is_now: bool = True
    """Whether the page shows the robot now, and not its past or a recording."""
    is_replay: bool = False
    is_playing: bool = False
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Message:
    """A message that the person must read."""

    text: str
    severity: Severity
    number: int
    """Number of the message, so that a repeated text is a new message."""
    title: str = ""
    """Title in a few words; empty for the title of its severity."""
    is_trouble: bool = False
    """Whether the app itself is at fault, and not what was asked of it."""


@dataclass(frozen=True, slots=True)
class JobProgress:
    """Progress of a long job."""

    label: str
    images: int = 0
    """Number of images that are done."""
    of_images: int | None = None
    """Number of all images; None if it is unknown."""

    @property
    def share(self) -> float | None:
        """Return the share that is done, in [0, 1]; None if unknown."""
        return min(1.0, self.images / self.of_images) if self.of_images else None


class FineTuningPhase(StrEnum):
    """Phase of fine-tuning."""

    IDLE = "idle"
    LEARNING = "learning"
    LEARNED = "learned"
    """New weights are offered."""
    WORSE = "worse"
    """New weights are on disk, but predict more far pairs reachable than the old ones."""
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class FineTuningStatus:
    """State of the fine-tuning for the page."""

    phase: FineTuningPhase = FineTuningPhase.IDLE
    drive: str = ""
    """The drive to learn from."""
    share: float = 0.0
    """Share that is done, in [0, 1]."""
    doing: str = ""
    left: str = ""
    """Remaining time, in words."""
    besides_s: float | None = None
    """Time in seconds that the last fine-tuning took beyond the requested time; None before the first one."""
    lines: tuple[str, ...] = ()
    """Results of the last fine-tuning."""
    path: str = ""
    """Path of the new weights."""
    is_possible: bool = True
    """False if the predictor has no weights to train."""


class LikePlace(NamedTuple):
    """A node that looks like an image."""

    node: NodeId
    likeness: float
    """Similarity in [-1, 1]; 1 means the same image."""


class WayNodes(NamedTuple):
    """Pictures of the nodes along a running query."""

    at: NodeId | None
    """Node at which the robot is localised; None while it is lost."""
    next: NodeId | None
    """The current subgoal; None while the robot looks around."""
    goal: NodeId


@dataclass(frozen=True, slots=True)
class UploadMatch:
    """An uploaded image and the nodes that look like it."""

    picture: str
    """Data URL of a small copy of the image."""
    places: tuple[LikePlace, ...]
    """Nodes that look like the image, best first."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Everything the page shows at one instant."""

    mode: Mode = Mode.TELEOP
    scene: str = ""
    """Name of the scene to draw."""
    moment: RunMoment = field(default_factory=RunMoment)
    camera: CameraImage | None = None
    larger: bytes = b""
    """A larger image for people, a JPEG; empty if there is none."""
    rates: LoopRates = LoopRates()
    recording: RecordingStatus = RecordingStatus()
    recordings: Mapping[str, str] = field(default_factory=dict)
    """Files in the folder of recordings, newest first, each with a description of its time and size."""
    sources: tuple[str, ...] = ()
    """Drives in other formats in the folder of recordings, which can be imported."""
    is_making: bool = False
    """Whether a new recording is being made from a file of the folder."""
    replay: str | None = None
    """Name of the open recording; `timeline` tells where it stands."""
    timeline: TimelineStatus = TimelineStatus()
    course: NDArray[np.float64] = field(default_factory=lambda: NO_TRAJECTORY, repr=False)
    """(T, 3) all poses of the open recording, thinned; empty for the live run, whose future is unknown."""
    lone_camera: CameraModel | None = None
    """The camera that took the images if the robot is unknown; None for a known robot."""
    pause_notice: str = ""
    """Reason why the app itself paused a query; empty if it did not."""
    keeps_going: bool | None = None
    """Whether a query continues when the last page closes; None if that is not offered."""
    is_open_loop: bool = False
    """Whether a recorded drive replaces the robot, so that it obeys no command."""
    drive_is_over: bool | None = None
    """Whether the recorded drive in the robot's place is over; None for a robot."""
    destination: NodeId | None = None
    """Goal of the running or paused query; None while a person drives."""
    selected: NodeId | None = None
    """The chosen goal; shown with a pin."""
    gallery: tuple[NodeId, ...] = ()
    """Nodes offered as goals by their pictures."""
    way: WayNodes | None = None
    """Nodes of the running query whose pictures are in memory; None without a query."""
    upload: UploadMatch | None = None
    """Matches of the last uploaded image; None without any."""
    message: Message | None = None
    work: JobProgress | None = None
    can_undo_build: bool = False
    """Whether the map was rebuilt and the earlier one can be restored."""
    fine_tuning: FineTuningStatus = FineTuningStatus()
    weights: str = ""
    """Fingerprint of the weights in use."""
    world: WorldView | None = None
    """Possible changes of the simulated world; None in a replay, and for a real robot."""
    floor_plan: FloorPlanView | None = None
    """The floor plan under the map; None without one."""
    floor: FloorChoice | None = None
    """The floor on show, to which the map of `moment` is limited; None if the map has one floor."""
    link: LinkReport | None = None
    """Quality of the link to the robot; None in simulation, and in a replay."""
    story: tuple[str, ...] = ()
    """Captions of “Watch it learn” so far."""
    story_goes_on: bool = False
    """Whether the story is still running."""
    no_story: str = ""
    """Why “Watch it learn” cannot be played, and what to do; empty if it can."""
    story_query: int | None = None
    """The last query of the story; None before the first one."""
    inspection: Inspection = NO_INSPECTION
    """The debugger's state."""
    hint: str = ""
    """Hint about the next thing to do."""

    @property
    def waiting(self) -> ActionBegun | None:
        """Return the action that the robot waits for now; None if it waits for none, or a person looks at the past."""
        is_now = self.mode is Mode.NAVIGATING and self.timeline.is_now
        return self.moment.progress.action if is_now else None
