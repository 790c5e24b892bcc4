"""Learns views: images taken at a node that the robot does not recognise but locates by odometry.

Owns which image becomes a view, and the check of its place: the robot must recognise nodes before the image and for
some metres after it, or arrive, and odometry must agree with all of them. A short check is not enough, because a robot
that mistakes one room for another is consistent for a while. `graph.node_views` limits the number of views of a node.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ltvn_core.geometry import agree, compose, distance, invert, relative
from ltvn_core.graph.deltas import Cause, NodeView, ViewDropped, ViewUsed
from ltvn_core.graph.localiser import Localisation
from ltvn_core.graph.node_views import ViewConfig, view_deltas
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.presence.obstruction import nearby_poses
from ltvn_core.navigation.events import Event
from ltvn_core.navigation.query import Query
from ltvn_core.types import Features, FrameId, NodeId, Observation, Pose, Waypoint

_TRUSTED_M = 4.0
"""Distance over which odometry is trusted after a node was recognised, in metres."""
_GAP = (0.35, 0.35)
"""Largest difference between the waypoint of a recognised node and the one by odometry, in metres and radians."""
_PROOF_M = 2.0
"""Distance that the robot must drive without contradiction before an image becomes a view, in metres; 0 at the
goal."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """An image that may become a view."""

    node: NodeId
    pose: Pose
    """(3,) pose of the image in the frame of the node."""
    observation: Observation
    features: Features
    """(1, F) features of the image."""
    path_m: float
    """Length that the robot had driven when the image was taken, in metres."""

    @property
    def distance(self) -> float:
        """Distance d from the node."""
        return float(distance(self.pose))


class ViewLearner:
    """Finds views during one query."""

    def __init__(self, query: Query) -> None:
        """Start without candidates."""
        self._query = query
        self._context = query.context
        self._motion = query.motion
        self._perception = query.perception
        self._config = query.context.system.views
        self._seen: tuple[NodeId, Waypoint, Pose] | None = None
        """The last node that was surely recognised, its waypoint (3,), and the odometry there (3,)."""
        self._candidates: dict[NodeId, _Candidate] = {}
        self._used: set[FrameId] = set()
        self._recognised_at_m = -np.inf

    def learn(self, localisation: Localisation) -> Iterator[Event]:
        """Check earlier candidates against a localisation, and look for a new candidate here."""
        config = self._config
        if config is None:
            return
        if localisation.node is not None and self._query.is_recognised(localisation.reachability):
            yield from self._count_use(localisation.node, localisation.view)
            yield from self._prove(localisation.node, localisation.waypoint, config, after_m=_PROOF_M)
            self._seen = localisation.node, localisation.waypoint, self._motion.odometry
            self._recognised_at_m = self._motion.path_m
        if self._motion.path_m - self._recognised_at_m > _TRUSTED_M:
            self._candidates.clear()
        else:
            self._look(config)

    def arrive(self, goal: NodeId) -> Iterator[Event]:
        """Check candidates at the goal, because recognising the goal is stronger evidence than recognising a node on
        the way."""
        match = self._perception.node_match(goal)
        if self._config is not None and match.reachability > self._context.method.judging.arrive_reachability:
            yield from self._prove(goal, match.waypoint, self._config, after_m=0.0)

    def _count_use(self, node: NodeId, frame: FrameId | None) -> Iterator[Event]:
        """Count the use of a view, once per query."""
        if frame is not None and frame not in self._used:
            self._used.add(frame)
            used = ViewUsed(node, frame, self._query.now_s, Cause.SIGHT)
            yield from self._query.apply([used])

    def _prove(self, node: NodeId, waypoint: Waypoint, config: ViewConfig, *, after_m: float) -> Iterator[Event]:
        """Make candidates views if a node is recognised where odometry expects it; otherwise discard all candidates."""
        if not self._candidates:
            return
        expected = self._places().get(node)
        if expected is None or not agree(expected, waypoint, _GAP):
            self._candidates.clear()
            return
        for candidate in [*self._candidates.values()]:
            if self._motion.path_m - candidate.path_m >= after_m:
                yield from self._add(self._candidates.pop(candidate.node), config)

    def _add(self, candidate: _Candidate, config: ViewConfig) -> Iterator[Event]:
        graph = self._context.graph
        keyframes = self._context.keyframes
        frame = candidate.observation.step
        if candidate.node not in graph.nodes or frame in graph.frames:
            return
        keyframes.add([candidate.observation], candidate.features)
        view = NodeView(frame, pose_row(candidate.pose), self._query.now_s)
        deltas = view_deltas(graph.views, candidate.node, view, config)
        yield from self._query.apply(deltas)
        keyframes.drop(delta.frame for delta in deltas if isinstance(delta, ViewDropped))

    def _look(self, config: ViewConfig) -> None:
        """Make the image a candidate for the nearest node, if that node is near and not recognised."""
        places = self._places() if self._perception.is_usable else {}
        if not places:
            return
        node = min(places, key=lambda each: float(distance(places[each])))
        candidate = _Candidate(
            node=node,
            pose=invert(places[node]),
            observation=self._perception.observation,
            features=self._perception.features,
            path_m=self._motion.path_m,
        )
        known = self._candidates.get(node)
        least = config.distance if known is None else known.distance
        if candidate.distance < least and self._perception.node_match(node).reachability <= config.recognised_above:
            self._candidates[node] = candidate

    def _places(self) -> dict[NodeId, Waypoint]:
        """Return the waypoints (3,) by odometry of the nodes around the last recognised one; empty without one."""
        if self._seen is None or self._seen[0] not in self._context.graph.nodes:
            return {}
        node, waypoint, odometry = self._seen
        here = compose(invert(waypoint), relative(odometry, self._motion.odometry))
        poses = nearby_poses(self._context.graph, node)
        return {other: relative(here, pose) for other, pose in poses.items()}
