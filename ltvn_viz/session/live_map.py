"""The live map with its images and its predictor; everything here runs in the worker's thread.

Owns the replacement of the whole map. The mapping algorithm is in `ltvn_core.graph`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.analysis.image_similarity import most_similar_nodes
from ltvn_core.errors import MapError
from ltvn_core.evaluation.query_run import QueryRun, judge_goal_reached
from ltvn_core.findings import Finding
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import Cause, DriveBegun, FramesReleased, GraphDelta, NodeDropped
from ltvn_core.graph.keyframes import ODOMETRY_JUMP, KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem, OnlineStrategy
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.map_check import MappedDrive, diagnose
from ltvn_core.maps.map_coverage import GoalReport, map_coverage
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.action_performer import ActionPerformer
from ltvn_core.navigation.events import Event, Judged, Tick
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.predictors.request import predictor_card
from ltvn_core.types import FrameId, NodeId, Observation, Pose, Predictor, Rgb, is_usable
from ltvn_viz.session.live_run import LiveRobot

IMAGES_AT_ONCE = 64


class LiveMap:
    """The map of the live robot: it grows, can be rebuilt, and is used for navigation."""

    def __init__(
        self, known: TopologicalMap, rng: np.random.Generator, *, world_time: Callable[[], float] | None = None
    ) -> None:
        """Start with a map, usually an empty one; `world_time` returns the time in seconds of a world with its own
        clock."""
        self._world_time = world_time
        self._map = known
        self._rng = rng
        self.findings: Sequence[Finding] = ()
        """Doubtful findings about the last map that was built."""
        self._rebuilt_from: TopologicalMap | None = None
        self._online = self._new_online()
        self._navigator: Navigator | None = None
        self._next_drive: FrameId | None = None
        self._last_odometry: Pose | None = None

    @property
    def graph(self) -> TopologicalGraph:
        """The map's nodes and edges."""
        return self._map.graph

    @property
    def keyframes(self) -> KeyframeStore:
        """Return the pictures in memory with their features."""
        return self._map.keyframes

    @property
    def predictor(self) -> Predictor:
        """The network in use."""
        return self._map.predictor

    @property
    def system(self) -> NavigationSystem:
        """The navigation system in use."""
        return self._map.system

    @property
    def fingerprint(self) -> str:
        """Name of the weights in use."""
        return self.predictor.fingerprint

    def use_system(self, system: NavigationSystem) -> None:
        """Use another navigation system for all further queries, in the same map."""
        self._map = replace(self._map, system=system)
        self._navigator = None

    def change(self, deltas: Sequence[GraphDelta]) -> Sequence[GraphDelta]:
        """Change the map by hand; returns the deltas. Raises MapError, and changes nothing, if one does not fit."""
        if len(deltas) > 1:
            trial = self.graph.copy()
            for delta in deltas:
                trial.apply(delta)
        for delta in deltas:
            self.graph.apply(delta)
        return deltas

    def load(self, known: TopologicalMap) -> Sequence[GraphDelta]:
        """Replace the present map with another one and return the deltas that build it."""
        self._replace(known)
        if frames := known.keyframes.frames:
            # Further driving has another odometry frame, so it is another drive.
            self._next_drive = frames[-1] + 1
            self.keyframes.begin_drives([self._next_drive])
        return known.graph.deltas(Cause.LOAD)

    def _begun_drive(self, observation: Observation) -> Sequence[GraphDelta]:
        """Start another drive after a map was loaded, or after the robot was moved to another place."""
        before, self._last_odometry = self._last_odometry, observation.odometry
        first, self._next_drive = self._next_drive, None
        if first is None and (before is None or distance(relative(before, observation.odometry)) < ODOMETRY_JUMP):
            return ()
        frame = observation.step if first is None else first
        self.keyframes.begin_drives([frame])
        return self.change([DriveBegun(frame, f"live, image {observation.step} on", Cause.ONLINE)])

    def offer(self, observation: Observation) -> Sequence[GraphDelta]:
        """Add an image to the map; returns the changes.

        If the navigation system only builds whole maps, the image is kept for the next `rebuild`. An image without the
        depth that the network needs changes nothing.
        """
        if not is_usable(observation, self.predictor):
            return ()
        if self._online is None:
            self.keyframes.add([observation])
            return ()
        begun = self._begun_drive(observation)
        deltas = self._online.offer(observation)
        for delta in deltas:
            self.graph.apply(delta)
        return [*begun, *deltas]

    def rebuild(self, progress: Callable[[int, int], None]) -> Sequence[GraphDelta]:
        """Rebuild from all pictures in memory; returns every change from the old map. Raises MapError if there are
        none."""
        seen = self._map.images
        if not seen:
            raise MapError("There are no images to build a map from; hold W A S D and drive a little first.")
        before = self._map
        fresh = replace(self._map, graph=TopologicalGraph())
        deltas = self._replaced(fresh, fresh.build(seen, rng=self._rng, progress=progress), seen)
        self._rebuilt_from = before
        return deltas

    @property
    def can_undo_rebuild(self) -> bool:
        """Tell whether the map was rebuilt, and has not been replaced since."""
        return self._rebuilt_from is not None

    def undo_rebuild(self) -> Sequence[GraphDelta]:
        """Restore the map from before `rebuild`; returns every change. Raises MapError if there is none."""
        before = self._rebuilt_from
        if before is None:
            raise MapError("There is no map to bring back: the map shown was not rebuilt.")
        cleared = self._cleared()
        self._replace(before)
        self.findings = ()
        return [*cleared, *before.graph.deltas(Cause.BUILD)]

    def rebuild_with(
        self, predictor: Predictor, system: NavigationSystem, progress: Callable[[int, int], None]
    ) -> Sequence[GraphDelta]:
        """Rebuild from all pictures in memory with another network, and use it from then on.

        Nothing changes until the new map is complete. Without pictures there is no map either, and only the network
        changes.
        """
        seen = [each for each in self._map.images if is_usable(each, predictor)]
        fresh = TopologicalMap.of(predictor, system)
        fresh.keyframes.begin_drives(self.graph.drives)
        fresh.keyframes.space = self.keyframes.space
        for first in range(0, len(seen), IMAGES_AT_ONCE):
            progress(0, len(seen))  # The encoding of images can be cancelled, too.
            fresh.keyframes.add(seen[first : first + IMAGES_AT_ONCE])
        built = fresh.build(seen, rng=self._rng, progress=progress) if seen else ()
        return self._replaced(fresh, built, seen)

    def observations(self) -> Sequence[Observation]:
        """Return all pictures in memory in the order they were taken."""
        return self._map.images

    def _replaced(
        self, fresh: TopologicalMap, built: Sequence[GraphDelta], seen: Sequence[Observation]
    ) -> Sequence[GraphDelta]:
        cleared = self._cleared()
        drives = [DriveBegun(frame, name, Cause.BUILD) for frame, name in self.graph.drives.items()]
        for delta in drives:
            fresh.graph.apply(delta)
        self._replace(fresh)
        self.findings = self._diagnosed(seen)
        return [*cleared, *built, *drives]

    def _cleared(self) -> list[GraphDelta]:
        """Return the deltas that empty the present map."""
        released = [FramesReleased(tuple(self.graph.reserve), Cause.BUILD)] if self.graph.reserve else []
        return [*(NodeDropped(node, Cause.BUILD) for node in self.graph.nodes), *released]

    def _diagnosed(self, seen: Sequence[Observation]) -> Sequence[Finding]:
        """Return doubtful findings about the map built from `seen`, images in order, with likely causes."""
        drive = MappedDrive(
            observations=seen,
            camera=None,
            is_lens_known=True,
            graph=self.graph,
            keyframes=self.keyframes,
            predictor=self.predictor,
            least_width_px=predictor_card(self.predictor).least_width_px,
        )
        return diagnose(drive, map_coverage(seen, self.graph, self.keyframes, self.predictor, self.system))

    def query(self, robot: LiveRobot, goal: NodeId, query: int, actions: ActionPerformer) -> Iterator[Event | Tick]:
        """Start a navigation task; its last event is the verdict. Raises MapError if the goal is not in the map.

        Until the map is replaced, later tasks use the same `robot` and `actions`.
        """
        if self._navigator is None:
            self._navigator = self._map.navigator(robot, seed=self._rng, world_time=self._world_time, actions=actions)
        run = QueryRun(self._navigator, goal, query, verdict=lambda: self._verdict(robot, goal, query))
        return run.events()

    def cancel(self) -> None:
        """End the navigation task at its next pull, with its last events. Safe from any thread."""
        if self._navigator is not None:
            self._navigator.cancel()

    def _verdict(self, robot: LiveRobot, goal: NodeId, query: int) -> Judged | None:
        """Check the robot's localisation at its present place; None if the true poses are unknown."""
        truth = self.keyframes.observation(goal).exact_pose
        exact = robot.exact_pose
        return None if truth is None or exact is None else judge_goal_reached(query, exact, truth)

    def map_observations(self) -> Sequence[Observation]:
        """Return the images of the map: of its nodes and its reserve."""
        return self._map.observations

    def copied(self) -> tuple[TopologicalGraph, Sequence[Observation]]:
        """Return a copy of the map, which no longer changes, with its images."""
        return self.graph.copy(), self.map_observations()

    def node_images(self, frames: Sequence[FrameId]) -> Sequence[tuple[FrameId, Rgb]]:
        """Return the pictures of those of `frames` that are still in memory."""
        return [(frame, self.keyframes.observation(frame).rgb) for frame in frames if frame in self.keyframes]

    def goal_report(self, goal: NodeId) -> GoalReport:
        """Return the map's report of a goal before any drive."""
        (report,) = self._map.goal_reports([goal])
        return report

    def similar_nodes(self, rgb: Rgb, count: int) -> Sequence[tuple[NodeId, float]]:
        """Return the nodes most similar to an image (H, W, 3), best first, with their similarity in [-1, 1].

        Raises MapError in an empty map.
        """
        if not self.graph.nodes:
            raise MapError("The map is empty, so there is nowhere to go yet; hold W A S D and drive a little first.")
        return most_similar_nodes(rgb, self.keyframes, list(self.graph.nodes), count)

    def _replace(self, known: TopologicalMap) -> None:
        self._map = known
        self._rebuilt_from = None
        self._online = self._new_online()
        self._navigator = None

    def _new_online(self) -> OnlineStrategy | None:
        online = self.system.online
        return None if online is None else online(self.graph, self.keyframes, self.predictor)
