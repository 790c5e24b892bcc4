"""State owned by the session thread: the live run, the map, and the current activity.

Owns the rule how an activity ends. `command_handlers` runs commands, and `snapshot_builder` makes the state visible.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeAlias

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.importing.played_drive import PlayedDrive
from ltvn_core.errors import OptionError
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.maps.recorded_map import BuildOptions
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Severity
from ltvn_core.types import FrameId, NodeId, Observation, Predictor
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.activities.teleop import Teleop
from ltvn_viz.session.asked_actions import AskedActions
from ltvn_viz.session.camera_feed import LargerFeed, ObservationFeed
from ltvn_viz.session.changeable_world import ChangeableWorld
from ltvn_viz.session.fine_tuning import FineTuning
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.goals import Goals, PlaceLookup
from ltvn_viz.session.inspection import Inspection
from ltvn_viz.session.job import Job
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.live_run import LiveRun
from ltvn_viz.session.recording_library import MadeRecording, RecordingLibrary, rerun_unavailable
from ltvn_viz.session.robot_link import RobotLink
from ltvn_viz.session.saved_files import SavedFiles
from ltvn_viz.session.shown_floor import ShownFloor
from ltvn_viz.session.snapshot import JobProgress, Message
from ltvn_viz.session.story_teller import StoryTeller
from ltvn_viz.session.worker import Worker
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.timeline.strip_marks import StripLibrary
from ltvn_viz.wishes.commands import Command, QuestionRequest

Activity: TypeAlias = Teleop | Navigation | MapBuilding | Playback

REPEATS_S = 1.0
"""Time in seconds within which the same message again is one message, as for an error that repeats at every tick."""


class Debugger(Protocol):
    """The session's interface to the debugger, which reads the whole state."""

    @property
    def is_on(self) -> bool:
        """Tell whether a person asked a question, so that clicks on the map are meant for it."""
        ...

    @property
    def shown(self) -> Inspection:
        """The debugger's state for the page."""
        ...

    @property
    def words(self) -> Mapping[str, str]:
        """The names of the questions by their words in an address."""
        ...

    def choose(self, question: str) -> None:
        """Show a question."""
        ...

    def point_at(self, node: NodeId, target: NodeId | None = None) -> None:
        """Select a node, or the edge from it to `target`."""
        ...

    def handle_text(self, text: str) -> Command | None:
        """Pass typed text to the question; return the request, if any. Raises OptionError, MapError."""
        ...

    def handle_request(self, request: QuestionRequest) -> Command | None:
        """Pass the request of a link to its question; return its command for the session, if any. Raises LtvnError."""
        ...

    def link(self, number: int) -> Command | None:
        """Return the request of a link; None if it was drawn for another question, or is too old."""
        ...

    def refresh(self, state: "AppState", moment: RunMoment) -> None:
        """Refresh the answer if anything changed that it may show."""
        ...

    def mark_stale(self) -> None:
        """Let the question refresh its answer although no event happened."""
        ...

    def take_in_all_events(self) -> None:
        """Include the latest events in the answers, because a person waits to see a change."""
        ...


@dataclass
class AppState:
    """State of the app."""

    scene: str
    live: LiveRun
    live_map: LiveMap
    worker: Worker
    library: RecordingLibrary
    open_replay: Callable[[str], Playback]
    """Reads a recording by its name in the library; runs in the worker's thread."""
    fine_tuning: FineTuning
    predictor_for: Callable[[Path], tuple[Predictor, NavigationSystem]]
    """Opens weights and the navigation system with the constants measured for them; runs in the worker's thread."""
    debugger: Debugger
    build_options: BuildOptions = BuildOptions()  # noqa: RUF009
    """How maps are built from recordings."""
    making: Job[MadeRecording] = field(default_factory=lambda: Job(Worker(ThreadPoolExecutor(1, "new recordings"))))
    """The making of a new recording from a file in the folder."""
    places: PlaceLookup = field(default_factory=PlaceLookup)
    """Finds the place of images in the maps of recordings; only for the worker's thread."""
    last_recording: str | None = None
    """Name of the last recording that was kept."""
    message: Message | None = None
    work: JobProgress | None = None
    """A job for which the page shows progress; the activity may have its own progress."""
    queries: int = 0
    larger_feed: LargerFeed | None = None
    """Renders a larger picture for people; None if it cannot be rendered."""
    shows_camera: Callable[[], bool] = lambda: True
    """Tells whether a page shows the camera."""
    floor: ShownFloor = field(default_factory=ShownFloor)
    """The floor of the map that the page shows."""
    actions: AskedActions = field(default_factory=AskedActions)
    """The actions of edges that the person at the page performs."""
    keeps_going: bool = False
    """Whether a query continues when the last page closes."""
    rerun: Callable[[Path], str] = rerun_unavailable
    """Serves a recording in Rerun's web viewer and returns its address; runs in the worker's thread."""
    saved_files: SavedFiles = field(default_factory=SavedFiles)
    """Files written for download from the page."""
    world: ChangeableWorld | None = None
    """The simulated world that a person may change; None for a real robot."""
    alignment: FloorPlanClicks | None = None
    """The floor plan under the map, and the clicks that align it; None without a plan."""
    link: RobotLink | None = None
    """The link to a real robot that reports its state; None in simulation."""
    open_loop: str = ""
    """Reason why the robot obeys no command; empty if it does."""
    played: PlayedDrive | None = None
    """The recorded drive in the robot's place; None for a robot."""
    story: StoryTeller | None = None
    """The current story, or the last one."""
    search: object | None = None
    """The search for an image's place that lets the robot drive there when it ends; None without one."""
    shown_stamp: float | None = None
    """Stamp of an earlier moment of the live run that the page shows; None for the present."""
    plays_past: bool = False
    """Whether a look back at the live run is playing; it stops when it reaches the present."""
    play_speed: float = 1.0
    """Playback speed of a recording or a look back, as a factor of real time."""
    strips: StripLibrary = field(default_factory=StripLibrary)
    """The marks of the runs on show, for the pages' timelines."""
    clock: Callable[[], float] = time.monotonic
    said_s: float = float("-inf")
    """Time when the message was last said, by the clock."""

    def __post_init__(self) -> None:
        """Start with teleoperation."""
        self.feed = ObservationFeed(lambda: self.live.view, self.live.robot.clock)
        self.goals = Goals(self.live_map, self.worker)
        self.teleop = Teleop(self.live, self.worker, self.live_map.offer)
        self.activity: Activity = self.teleop

    def start_with(self, known: TopologicalMap, observations: Iterable[Observation]) -> None:
        """Start the run with a map and its images."""
        for seen in observations:
            pose = seen.odometry if seen.exact_pose is None else seen.exact_pose
            self.live.timeline.place_frame(seen.step, pose)
        self.live.emit_changes(self.live_map.load(known))

    @property
    def shown_run(self) -> Timeline:
        """The run that the page shows: the open recording, or else the live run."""
        return self.activity.timeline if isinstance(self.activity, Playback) else self.live.timeline

    def shown_observation(self, frame: FrameId) -> Observation | None:
        """Return an image of the run on show; None if it has none. Raises LtvnError. May be called in any thread."""
        if isinstance(self.activity, Playback):
            return self.activity.observation(frame)
        return self.live_map.keyframes.observation(frame)

    @property
    def is_now(self) -> bool:
        """Tell whether the page shows the robot as it is now."""
        return self.shown_stamp is None and not isinstance(self.activity, Playback)

    def say(self, text: str, severity: Severity = Severity.INFO, *, title: str = "", is_trouble: bool = False) -> None:
        """Show a message in the page, with a title or else the title of its severity.

        `is_trouble` says that the app itself, not a request, is at fault.
        """
        now = self.clock()
        repeats = self.message is not None and (text, severity) == (self.message.text, self.message.severity)
        if not repeats or now > self.said_s + REPEATS_S:
            number = 1 if self.message is None else self.message.number + 1
            self.message = Message(text, severity, number, title, is_trouble)
        self.said_s = now

    @property
    def changeable(self) -> ChangeableWorld:
        """The simulated world, whose changes are queued. Raises OptionError without one."""
        if self.world is None:
            raise OptionError("Only a simulated world can be changed here; this robot drives in a real one.")
        return self.world

    @property
    def plan_clicks(self) -> FloorPlanClicks:
        """The alignment of the floor plan. Raises OptionError without a plan."""
        if self.alignment is None:
            raise OptionError("There is no floor plan. Start the page with --floor-plan map.yaml to see one.")
        return self.alignment

    @property
    def steps_from(self) -> str:
        """What gives the robot its steps now or later, in words; empty if only a person can drive it."""
        if self.story is not None and not self.story.is_over:
            return "the story"
        if isinstance(self.activity, Navigation) and not self.activity.is_stopping:
            return "the query"
        return "" if self.search is None else "the search for your image"

    def end_steps(self, why: str) -> str:
        """Stop the robot and end whatever gives it its steps, so that it stays until somebody asks for a new goal.

        Every way to stop ends here. `why` continues “The story ends here: ”. Returns what ended, as `steps_from`.
        """
        ended = self.steps_from
        self.search = None
        if self.story is not None and not self.story.is_over:
            self.story.stop(f"The story ends here: {why}.")
        self.live.robot.stop()
        if isinstance(self.activity, Navigation):
            self.activity.cancel()
        return ended

    def cancel(self, how: str, why: str) -> None:
        """End whatever gives the robot its steps, or the building of a map, and say `how`; see `end_steps`."""
        ended = self.end_steps(why)
        if isinstance(self.activity, MapBuilding):
            self.activity.cancel()
            ended = "the building of the map"
        if ended:
            self.say(f"{how}; {ended} was cancelled.")

    def fail(self, text: str) -> None:
        """After an error, stop the robot, drop the query and show the reason."""
        self.drop()
        self.say(text, Severity.ERROR, is_trouble=True)

    def drop(self) -> None:
        """Stop the robot and drop the query."""
        self.end_steps("an error stopped the robot")
        self.work = None
        if isinstance(self.activity, Navigation | MapBuilding):
            self.activity = self.teleop
