"""Context of a tool: all events so far, with the images and the predictor.

Owns one view of the live run and of an open recording. Computes nothing but what it caches.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.analysis.world_clock import latest_known_time, world_time_at
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Method
from ltvn_core.graph.presence.persistent import PERSISTENT
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.types import FrameId, NodeId, Observation, Pose, Predictor, is_usable
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.saved_files import SavedFile
from ltvn_viz.session.share_links import Viewpoint
from ltvn_viz.timeline.breakpoint_monitor import STAMP_EPSILON_S
from ltvn_viz.timeline.run_moment import RunMoment


class PredictorView(NamedTuple):
    """A run's images as a predictor looks at them; may be used in any thread."""

    camera: CameraModel
    """Of the run's images."""
    predictor: Predictor

    def of(self, seen: Observation) -> Observation | None:
        """Return an image as the predictor's camera would have taken it; None where it cannot be compared."""
        if not is_usable(seen, self.predictor):
            return None
        return recorded_observation(seen, self.camera, self.predictor.camera)


@dataclass(frozen=True, eq=False)
class DebugContext:
    """A run and a moment in it."""

    name: str
    """Of the recording; empty for the live run."""
    scene: str
    start_s: float
    """The stamp at which the run began; seconds on the page count from there."""
    moment: RunMoment
    """The moment that the page shows."""
    step: FrameId
    """The newest step that counts."""
    timeline: Timeline
    """All that happened, also after the moment; another thread must be given a copy."""
    known_events: int
    """Number of events that an answer about all of them includes; counted once a second during a run, because such
    answers take time."""
    observation: Callable[[FrameId], Observation | None]
    """Returns an image by its frame; None if it is not in memory. For the session's thread only."""
    camera: CameraModel
    """The camera of these images, which may be another than the predictor's."""
    method: Method
    """The thresholds in use."""
    predictor: Predictor
    """The predictor that compares the images; a recording may have been made with another."""
    weights: str
    """Fingerprint of the network that the run was made with; empty if unknown."""
    system: str
    """Name of the system that planned, as the recording says; empty where it does not say."""
    presence_filter: PresenceFilter | None
    """Filter that predicts which edges are open; None if plans ignore presence."""
    live_map: LiveMap | None
    """The live map and its images, to be touched within `in_background` alone; None in replay."""
    live: Timeline
    """The live run as it is now, also while a recording is on show."""
    in_background: BackgroundCache
    """Computes slowly, elsewhere."""
    library: RecordingLibrary
    """The other recordings."""
    rerun: Callable[[Path], str]
    """Serves a recording in Rerun's web viewer and returns its address; slow, and raises ServerError."""
    offer_file: Callable[[Path], SavedFile]
    """Lets the page hand out a file that was just written; may be called in any thread."""
    viewpoint: Viewpoint | None = None
    """From where the person looks, for the tool that hands it on; None for all others, which need not look again."""

    @property
    def instant(self) -> Instant:
        """The moment."""
        return Instant(self.step, self.moment.stamp)

    @property
    def is_live(self) -> bool:
        """Tell whether the robot itself is on show."""
        return self.live_map is not None

    @cached_property
    def graph(self) -> TopologicalGraph:
        """The map at the moment; linear in its changes when it is asked first."""
        return self.timeline.graph_at(self.instant)

    @property
    def known_filter(self) -> PresenceFilter:
        """Return the filter that predicts which edges are open, even for runs whose plans ignore presence."""
        return self.presence_filter or PERSISTENT

    @cached_property
    def world_s(self) -> float:
        """The time of the world at the moment, seconds from midnight of its first day."""
        return latest_known_time(self.graph, world_time_at(self.timeline, self.instant))

    @property
    def view(self) -> PredictorView:
        """Return the converter from an image of this run to one for the predictor in use."""
        return PredictorView(self.camera, self.predictor)

    def pose(self, node: NodeId) -> Pose | None:
        """Return where a node is drawn, (3,); None if unknown."""
        return self.timeline.frames.pose(node)

    def revision(self, *kinds: type) -> tuple[int, int]:
        """Return the number of map changes and of events of these kinds so far.

        An answer about both is out of date when this changes. Linear in the events.
        """
        before = self.timeline.count_until(self.instant)
        events = self.timeline.events[:before]
        return self.timeline.change_count_before(before), sum(isinstance(each.event, kinds) for each in events)

    def seconds(self, instant: Instant) -> float:
        """Return a moment in the page's time, rounded up so that seeking to it never ends just before it."""
        return max(0.0, instant.stamp - self.start_s + STAMP_EPSILON_S)
