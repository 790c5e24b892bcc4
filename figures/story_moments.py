"""The moments of a recorded story: what map, world and plan were when a node appeared, an edge faded and so on."""

import itertools
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ltvn_core.data.recording.reader import Recording
from ltvn_core.graph.deltas import Cause, EdgeAdded, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Event, GraphChanged, Planned, QueryEnded, QueryStarted, WorldChanged
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds import AS_MADE, WorldState


@dataclass(frozen=True, eq=False)
class StoryMoment:
    """One moment."""

    title: str
    scene: Scene
    """As it was then."""
    closed: tuple[Doorway, ...]
    """Where a door was closed."""
    places: dict[NodeId, Pose]
    """Where the nodes really are, (3,)."""
    edges: frozenset[EdgeKey]
    new: frozenset[EdgeKey]
    """Those of them that came while the robot was led."""
    absent: frozenset[EdgeKey]
    """Those that were seen blocked last."""
    plan: tuple[NodeId, ...]
    robot: Pose | None
    """Where the robot was, (3,)."""


@dataclass
class _Told:
    """What is so after the events so far."""

    graph: TopologicalGraph = field(default_factory=TopologicalGraph)
    world: WorldState = AS_MADE
    new: set[EdgeKey] = field(default_factory=set)
    absent: set[EdgeKey] = field(default_factory=set)
    plan: tuple[NodeId, ...] = ()

    def take(self, event: Event) -> None:
        match event:
            case WorldChanged(change):
                self.world = self.world.after(change)
            case Planned(nodes=nodes):
                self.plan = nodes
            case QueryEnded():
                self.plan = ()
            case GraphChanged(delta):
                self.graph.apply(delta)
                if isinstance(delta, EdgeAdded) and delta.cause is Cause.ONLINE:
                    self.new.add((delta.edge.source, delta.edge.target))
                if isinstance(delta, PresenceObserved):
                    edge = (delta.source, delta.target)
                    (self.absent.discard if delta.present else self.absent.add)(edge)
            case _:
                pass


def story_moments(recording: Recording) -> Sequence[StoryMoment]:
    """Return the moments that there are, in order; none where nothing was seen closed. Raises SceneError."""
    events = [stamped.event for stamped in recording.events]
    moments = list(_moments(events))
    if "Edges fade" not in [title for _, title in moments]:
        return []
    scene, told, found = load_scene(recording.meta.scene), _Told(), list[StoryMoment]()
    scenes = ChangedScenes(scene)
    for number, stamped in enumerate(recording.events):
        titles = [title for at, title in moments if at == number]
        found += [_moment(title, told, scenes, recording, stamped.step) for title in titles]
        told.take(stamped.event)
    return found


def _moments(events: Sequence[Event]) -> Iterator[tuple[int, str]]:
    """Yield the numbers of the events just before which something is to be seen, and what."""
    ever_absent = {(d.source, d.target) for d in _observed(events) if not d.present}
    begun = next((k for k, event in enumerate(events) if isinstance(event, WorldChanged)), None)
    led = next((k for k, event in enumerate(events) if isinstance(event, QueryStarted)), None)
    if begun is None or led is None:
        return
    yield begun, "One way is known"
    if any(isinstance(event, GraphChanged) for event in events[begun:led]):
        yield led, "Nodes appear"
    plans = [k for k, event in enumerate(events) if isinstance(event, Planned)]
    blocked = [k for k, event in enumerate(events) if _presence(event) is False]
    faded = next((k for k in plans if blocked and k > blocked[0]), None)
    if faded is None:
        return
    yield faded, "Edges fade"
    turned = (k for k in plans if k >= faded and not ever_absent & set(itertools.pairwise(events[k].nodes)))  # type: ignore[union-attr]
    if (first := next(turned, None)) is not None:
        yield _after(plans, first, len(events)), "The plan changes"
    if any(_presence(event) for event in events[faded:]):
        yield len(events) - 1, "Edges return"


def _after(plans: Sequence[int], first: int, count: int) -> int:
    """Return the moment of the second plan after one, when the robot is on its way."""
    later = [k for k in plans if k > first]
    return later[min(1, len(later) - 1)] if later else count - 1


def _observed(events: Sequence[Event]) -> Iterator[PresenceObserved]:
    for event in events:
        if isinstance(event, GraphChanged) and isinstance(event.delta, PresenceObserved):
            yield event.delta


def _presence(event: Event) -> bool | None:
    """Return whether an edge was seen open; None where an event is about something else."""
    return next((delta.present for delta in _observed([event])), None)


def _moment(title: str, told: _Told, scenes: ChangedScenes, recording: Recording, step: int) -> StoryMoment:
    doors = scenes.base.parts.doors
    places = {node: recording.observation(node).exact_pose for node in told.graph.nodes}
    before = bisect_right(recording.frames, step) - 1
    return StoryMoment(
        title=title,
        scene=scenes.at(told.world),
        closed=tuple(doors[door] for door in sorted(told.world.closed_doors)),
        places={node: np.asarray(pose) for node, pose in places.items() if pose is not None},
        edges=frozenset(told.graph.edges),
        new=frozenset(told.new & told.graph.edges.keys()),
        absent=frozenset(told.absent & told.graph.edges.keys()),
        plan=told.plan,
        robot=None if before < 0 else recording.observation(recording.frames[before]).exact_pose,
    )
