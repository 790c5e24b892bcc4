"""Context of a question: all events so far, with the images and the predictor.

Owns the common interface to the live run and to an open recording. Computes only the values that it caches.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ltvn_core.analysis.replanning import Rules
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, QueryRecord
from ltvn_core.analysis.world_clock import latest_known_time, world_time_at
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Method
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.graph.corrections import UnsurePlaces
from ltvn_core.graph.presence.presence_filter import PERSISTENT, PresenceFilter
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.palette import Rgb8
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.systems.registry import DEFAULT_SYSTEM, known_system
from ltvn_core.types import FrameId, NodeId, Observation, Pose, Predictor, is_usable
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.session.activities.playback import ReplayMethod
from ltvn_viz.session.inspection import Stroke, stroke
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.saved_files import SavedFile
from ltvn_viz.timeline.breakpoint_monitor import STAMP_EPSILON_S
from ltvn_viz.timeline.run_moment import RunMoment


@dataclass(frozen=True, eq=False)
class DebugContext:
    """A run and a moment in it."""

    name: str
    """Name of the recording; empty for the live run."""
    scene: str
    start_s: float
    """Stamp of the run's beginning, in seconds; times on the page are relative to it."""
    moment: RunMoment
    """The moment that the page shows."""
    step: FrameId
    """Newest step that answers include."""
    timeline: Timeline
    """All events, including those after the moment; another thread must get a copy."""
    known_events: int
    """Number of events that an answer about all of them includes; counted once a second during a run, because such
    answers take time."""
    observation: Callable[[FrameId], Observation | None]
    """Returns an image by its frame; None if it is not in memory. For the session's thread only."""
    camera: CameraModel
    """Camera of the run's images, which may differ from the predictor's."""
    comparison: Callable[[], ReplayMethod]
    """Returns how the images are compared; the first call may open a predictor, which takes seconds."""
    weights: str
    """Fingerprint of the network that the run was made with; empty if unknown."""
    system: str
    """Name of the navigation system in the recording; empty if unknown."""
    presence_filter: PresenceFilter | None
    """Filter that predicts which edges are open; None if plans ignore presence."""
    live_map: LiveMap | None
    """The live map and its images, to be used only within `in_background`; None in replay."""
    live: Timeline
    """The present live run, also while a recording is on show."""
    in_background: BackgroundCache
    """Cache that computes slow answers in the worker's thread."""
    library: RecordingLibrary
    """The other recordings."""
    rerun: Callable[[Path], str]
    """Serves a recording in Rerun's web viewer and returns its address; slow, and raises ServerError."""
    offer_file: Callable[[Path], SavedFile]
    """Offers a new file for download in the page; may be called in any thread."""
    floor_plan: FloorPlan | None = None
    """The floor plan under the map, as the page shows it now."""
    unsure: UnsurePlaces | None = None
    """Where the course of the mapped drive stayed unsure; None if that is unknown, as in a live run."""

    @property
    def method(self) -> Method:
        """The thresholds in use."""
        return self.comparison().method

    @property
    def predictor(self) -> Predictor:
        """The predictor that compares the images; a recording may have been made with another."""
        return self.comparison().predictor

    @property
    def instant(self) -> Instant:
        """The moment."""
        return Instant(self.step, self.moment.stamp)

    @property
    def is_live(self) -> bool:
        """Whether the page shows the live run."""
        return self.live_map is not None

    @cached_property
    def graph(self) -> TopologicalGraph:
        """The map at the moment; the first access takes time linear in its changes."""
        return self.timeline.graph_at(self.instant)

    def query(self, number: int) -> QueryRecord | None:
        """Return a query by its number; None if there is none, or if it begins after the moment."""
        begun = (each for each in self.timeline.queries if each.id == number and each.begin.step <= self.step)
        return next(begun, None)

    @property
    def latest_query(self) -> QueryRecord | None:
        """The last query that began before the moment; one that begins at the moment counts only if it is the first."""
        begun = [each for each in self.timeline.queries if each.begin.step <= self.step]
        before = [each for each in begun if each.begin.step < self.step]
        return (before or begun or [None])[-1]

    @property
    def known_filter(self) -> PresenceFilter:
        """Return the filter that predicts which edges are open, even for runs whose plans ignore presence."""
        return self.presence_filter or PERSISTENT

    @cached_property
    def world_s(self) -> float:
        """Time of the world at the moment, in seconds from midnight of its first day."""
        return latest_known_time(self.graph, world_time_at(self.timeline, self.instant))

    def as_compared(self, seen: Observation) -> Observation | None:
        """Return an image as the predictor's camera would have taken it; None if it cannot be compared."""
        if not is_usable(seen, self.predictor):
            return None
        return recorded_observation(seen, self.camera, self.predictor.camera)

    def pose(self, node: NodeId) -> Pose | None:
        """Return the pose (3,) at which a node is drawn; None if unknown."""
        return self.timeline.frames.pose(node)

    def strokes(self, edges: Iterable[EdgeKey], colour: Rgb8) -> tuple[Stroke, ...]:
        """Return a line for each edge whose ends have a known pose."""
        ends = ((self.pose(source), self.pose(target)) for source, target in edges)
        return tuple(stroke(start, end, colour) for start, end in ends if start is not None and end is not None)

    @property
    def rules(self) -> Rules:
        """The rules by which the run plans, with the edge costs of its system, or else those of the paper."""
        entry = known_system(self.system)
        rules = Rules(self.method, presence_filter=self.presence_filter)
        return (
            rules if entry is None else rules._replace(edge_weight_of=lambda method: entry.factory(method).edge_weight)
        )

    @property
    def rules_note(self) -> str:
        """What a person should know about the edge costs of another plan; usually empty."""
        entry = known_system(self.system)
        if entry is not None:
            return "" if entry.name == DEFAULT_SYSTEM else f"Both plans use the edge costs of {entry.name}."
        named = f"names the system “{self.system}”, which is not known here" if self.system else "names no system"
        return f"The recording {named}; both plans use the edge costs of {DEFAULT_SYSTEM}."

    def revision(self, *kinds: type) -> tuple[int, int]:
        """Return two numbers: the map changes so far, and the events of these kinds so far.

        An answer that depends on the map and these events is out of date when either number changes. Linear in the
        events.
        """
        before = self.timeline.count_until(self.instant)
        events = self.timeline.events[:before]
        return self.timeline.change_count_before(before), sum(isinstance(each.event, kinds) for each in events)

    def seconds(self, instant: Instant) -> float:
        """Return a moment in seconds of the page's time, rounded up so that a seek never ends just before it."""
        return max(0.0, instant.stamp - self.start_s + STAMP_EPSILON_S)
