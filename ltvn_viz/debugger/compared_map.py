"""Two maps to compare, with the events before them: this one, and another from a recording or before the first query.

Owns the search for the other map. The differences are computed in `ltvn_core.analysis`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.analysis.map_comparison import MapDifference, MapMetrics, compare_maps, map_metrics
from ltvn_core.analysis.presence_forecast import PresenceChange, presence_as_if, presence_changes
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.world_clock import (
    latest_known_time,
    world_time_before,
)
from ltvn_core.data.recording.reader import Recording
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import StampedEvent, WorldChanged
from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds import AS_MADE, PersonLeft, PersonMoved, WorldChange, WorldState
from ltvn_viz.debugger.context import DebugContext

BEFORE_FIRST_QUERY = "before its first query"


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedMap:
    """One of the two maps, with the events before it."""

    name: str
    scene: str
    graph: TopologicalGraph
    events: Sequence[StampedEvent]
    poses: Mapping[NodeId, Pose]
    world_s: float
    """Time of the world at the map's moment, in seconds from midnight of its first day."""

    @property
    def world(self) -> WorldState:
        """Return, in simulation, the state of the world; linear in the events."""
        state = AS_MADE
        for stamped in self.events:
            if isinstance(stamped.event, WorldChanged):
                state = state.after(stamped.event.change)
        return state


@dataclass(frozen=True, eq=False)
class MapComparison:
    """The differences between two maps."""

    here: ComparedMap
    there: ComparedMap
    figures: tuple[MapMetrics, MapMetrics]
    difference: MapDifference | None
    """Differences of nodes and edges; None if the scenes differ."""
    presence: tuple[PresenceChange, ...]
    """Edges of both maps whose presence differs between them."""
    world: tuple[WorldChange, ...]
    """In simulation, the changes that turn this world into the other; people are left out."""


def map_of_moment(context: DebugContext) -> ComparedMap:
    """Return the map on show."""
    return _map_before(context, context.timeline.count_until(context.instant), context.name, context.world_s)


def map_before_first_query(context: DebugContext) -> ComparedMap:
    """Return the map from before the run's first query; if there is no query yet, the map on show."""
    return _map_before(context, first_query_event(context), BEFORE_FIRST_QUERY)


def _map_before(context: DebugContext, count: int, name: str, at_s: float | None = None) -> ComparedMap:
    timeline = context.timeline
    graph = timeline.graph_before(count)
    return ComparedMap(
        name=name,
        scene=context.scene,
        graph=graph,
        events=timeline.events[:count],
        poses={node: pose for node in graph.nodes if (pose := context.pose(node)) is not None},
        world_s=latest_known_time(graph, world_time_before(timeline, count) if at_s is None else at_s),
    )


def first_query_event(context: DebugContext) -> int:
    """Return the number of the event that begins the first query, or of the next event after the moment."""
    timeline = context.timeline
    known = timeline.count_until(context.instant)
    return min(timeline.queries[0].first, known) if timeline.queries else known


def opened_map(path: Path) -> ComparedMap:
    """Open the map at the end of a recording; raises RecordingError."""
    recording = Recording.open(path)
    poses = recording.poses
    drawn = poses.odometry if poses.exact is None else poses.exact
    graph = recording.final_graph()
    timeline = Timeline.of(recording.events)
    return ComparedMap(
        name=path.name,
        scene=recording.meta.scene,
        graph=graph,
        events=recording.events,
        poses=dict(zip(poses.steps.tolist(), drawn, strict=True)),
        world_s=latest_known_time(graph, world_time_before(timeline, len(timeline.events))),
    )


def compare(here: ComparedMap, there: ComparedMap, presence_filter: PresenceFilter) -> MapComparison:
    """Return the differences between two maps; as slow as `compare_maps`."""
    both = map_metrics(here.graph, here.events), map_metrics(there.graph, there.events)
    if here.scene != there.scene:
        return MapComparison(here, there, both, None, (), ())
    difference = compare_maps(here.graph, there.graph, poses_a=here.poses, poses_b=there.poses)
    now, before = (presence_as_if(each.graph, presence_filter, each.world_s) for each in (here, there))
    presence = presence_changes(before, now, difference.edges)
    changes = there.world.changes_to(here.world)
    world = tuple(each for each in changes if not isinstance(each, PersonMoved | PersonLeft))
    return MapComparison(here, there, both, difference, presence, world)
