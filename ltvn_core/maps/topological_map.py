"""A topological map with the images of its nodes: built from observations, saved to a file, loaded again.

Owns no step of the method: Algorithm 1 is `graph.builder`, the file format is `data.recording.map_file`. Programs that
build a map, or drive by a map, use this class.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from ltvn_core.analysis.manual_edits import connect_by_action
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.map_file import LoadedMap, check_fingerprint, load_map, save_map
from ltvn_core.errors import MapError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.corrections import Correction, UnsurePlaces, to_config
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import nearest_nodes
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.joined_map import DriveReport
from ltvn_core.maps.map_coverage import GoalReport, MapCoverage, goal_reports
from ltvn_core.navigation.action_performer import ActionPerformer
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.predictors.choice import AUTO, ImageSource
from ltvn_core.predictors.opening import open_method, open_predictor, opened_name
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_spec import NeededSpace
from ltvn_core.systems.registry import recorded_system
from ltvn_core.types import FrameId, NodeId, Observation, Predictor, Waypoint


class FoundPlace(NamedTuple):
    """A node that resembles a picture."""

    node: NodeId
    reachability: float
    """r in [0, 1] between the picture and the node's image."""
    waypoint: Waypoint
    """(3,) pose of the node in the picture's frame: x and y in metres, yaw in radians."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TopologicalMap(WithDoubts):
    """A map: its nodes, its edges, and its images."""

    graph: TopologicalGraph
    """Nodes and directed edges with their beliefs; driving changes it."""
    keyframes: KeyframeStore
    """Images and features of all nodes and of the reserve."""
    predictor: Predictor
    """The predictor that compared the images; no other predictor can read their features."""
    system: NavigationSystem
    """The navigation system that built the map and drives by it."""
    scene: str = ""
    """Place of the images: the name or file of a scene, or any name that a person gave."""
    camera: CameraModel | None = None
    """The camera of the images; None if it is the predictor's camera."""
    predictor_name: str = ""
    """Name by which `predictor` can be opened again; empty if it has none."""
    scene_glb: bytes | None = None
    """The scene as binary glTF, to be drawn with the map; None if there is no model of it."""
    coverage: MapCoverage | None = None
    """Coverage of the drive when the map was built; None for a map that was loaded."""
    drives: tuple[DriveReport, ...] = ()
    """Reports of the drives when the map was built from several; empty for a single drive, or a map that was loaded."""
    goals: tuple[GoalReport, ...] = ()
    """Reports about the named goals when the map was built."""
    corrections: tuple[Correction, ...] = ()
    """What building the map corrected or added by itself; empty for a map that was loaded."""
    unsure: UnsurePlaces | None = None
    """Where its course stayed unsure when the map was built; None for a map that was loaded."""
    findings: tuple[Finding, ...] = ()
    """Problems of the drive and the map when it was built, with likely causes and advice."""

    @classmethod
    def of(
        cls,
        predictor: Predictor,
        system: NavigationSystem,
        graph: TopologicalGraph | None = None,
        observations: Sequence[Observation] = (),
    ) -> Self:
        """Return a map with a graph and the images of its frames; without a graph, return an empty map, to be built."""
        graph = TopologicalGraph() if graph is None else graph
        keyframes = KeyframeStore(predictor)
        keyframes.begin_drives(graph.drives)
        keyframes.add(observations)
        return cls(graph=graph, keyframes=keyframes, predictor=predictor, system=system)

    @classmethod
    def load(
        cls,
        path: Path | str,
        predictor: Predictor | None = None,
        *,
        system: NavigationSystem | None = None,
        with_reserve: bool = True,
    ) -> Self:
        """Load the map at the end of a map file, or of any recording in which one was built or used.

        Args:
            path: The file.
            predictor: The predictor that compares images; None opens the one that made the map, with its shipped
                weights.
            system: The navigation system that drives by the map; None is the system that built it, with the `robust`
                preset.
            with_reserve: Whether to encode the images of the reserve too; navigation needs them, but finding a place
                does not.

        Raises:
            RecordingError: The file is not a complete recording.
            MapError: The file contains no map, or another predictor made it.
            OptionError: The map's predictor or navigation system is not installed.
            WeightsError: The shipped weights are damaged.
        """
        loaded = load_map(path)
        if predictor is None:
            return cls.open(loaded, with_reserve=with_reserve)
        system = system or recorded_system(loaded.meta.config).factory(open_method("robust", predictor))
        return cls.take(loaded, predictor, system, with_reserve=with_reserve)

    @classmethod
    def open(
        cls,
        loaded: LoadedMap | Path | str,
        *,
        preset: str = "robust",
        predictor: str = AUTO,
        weights: Path | str | None = None,
        device: str = "cpu",
        with_reserve: bool = True,
    ) -> Self:
        """Return a map of a file, with the predictor that made it and the system that built it.

        Args:
            loaded: The contents of the file, or its path.
            preset: Name of the method's settings.
            predictor: Name of the predictor that compares images; `auto` is the one that made the map.
            weights: Weights to use instead of those that come with the map's system.
            device: Where a network computes, see `open_predictor`.
            with_reserve: Whether to encode the images of the reserve too.

        Raises:
            RecordingError: The path is not that of a complete recording.
            MapError: The file contains no map, or another predictor made it.
            OptionError: The predictor or the map's navigation system is not installed.
            WeightsError: The weights are missing or damaged.
        """
        if not isinstance(loaded, LoadedMap):
            loaded = load_map(loaded)
        meta = loaded.meta
        entry = recorded_system(meta.config)
        name = ImageSource.of(meta).choose(predictor).name
        opened = open_predictor(
            name,
            meta.scene,
            entry.weights_for(name, None if weights is None else Path(weights)),
            camera=meta.camera,
            device=device,
        )
        known = cls.take(loaded, opened, entry.factory(open_method(preset, opened)), with_reserve=with_reserve)
        return replace(known, predictor_name=name)

    @classmethod
    def take(
        cls, loaded: LoadedMap, predictor: Predictor, system: NavigationSystem, *, with_reserve: bool = True
    ) -> Self:
        """Return a map that was read from a file, with its predictor and system. Raises MapError if another predictor
        made it."""
        meta = loaded.meta
        graph = loaded.graph
        check_fingerprint(meta, predictor.fingerprint)
        seen = [each for frame, each in loaded.observations.items() if with_reserve or frame not in graph.reserve]
        known = cls.of(predictor, system, graph, seen)
        known.keyframes.space = NeededSpace.recorded(meta.config)
        return replace(known, scene=meta.scene, camera=meta.camera, scene_glb=loaded.scene_glb)

    @property
    def observations(self) -> list[Observation]:
        """The images that belong to the map, in the order they were taken: of its nodes and its reserve."""
        return [self.keyframes.observation(frame) for frame in sorted(self.graph.frames)]

    @property
    def images(self) -> list[Observation]:
        """All images in memory, in the order they were taken; after building, these include images that the map did not
        keep."""
        return [self.keyframes.observation(frame) for frame in self.keyframes.frames]

    def build(
        self,
        observations: Sequence[Observation],
        *,
        rng: np.random.Generator,
        goals: Collection[FrameId] = (),
        progress: ProgressCallback | None = None,
    ) -> Deltas:
        """Build this empty map as its system does; return the changes that build it.

        Raises MapError if there is no image, or if a goal is not one of the images.
        """
        deltas = self.system.build(
            observations, self.keyframes, self.predictor, rng=rng, goals=goals, progress=progress
        )
        for delta in deltas:
            self.graph.apply(delta)
        return deltas

    def find(self, picture: Observation, count: int = 3) -> tuple[FoundPlace, ...]:
        """Return the places that resemble a picture most, the best first.

        Args:
            picture: An image with the predictor's camera, see `preprocessing.recorded_observation` for others.
            count: Number of places, fewer if the map has fewer nodes.

        Raises:
            MapError: The map has no nodes.
        """
        if not self.graph.nodes:
            raise MapError("The map has no nodes, so no place can be found in it; build it from images first.")
        matcher = Matcher(self.predictor, self.keyframes, self.system.method.matching)
        features = self.predictor.encode([picture])
        nearest = nearest_nodes(features, self.graph, count, matcher)
        waypoints = matcher.match(features, tuple(node for node, _ in nearest)).waypoints
        return tuple(FoundPlace(*found, waypoint) for found, waypoint in zip(nearest, waypoints, strict=True))

    def connect(self, source: NodeId, target: NodeId, *, action: str, cost_m: float = 10.0) -> Deltas:
        """Join two nodes, in this direction, by an action that is not driving; return the changes of the map.

        Args:
            source: Node at which the action begins.
            target: Node at which it ends.
            action: What to do there, such as "Take the lift to floor 2".
            cost_m: Cost of the action in a plan, in metres of driving; an existing edge keeps its own.

        Raises:
            MapError: A node is not in the map, or both are the same.
            OptionError: The action or its cost is invalid.
        """
        deltas = connect_by_action(self.graph, source, target, action, cost_m)
        for delta in deltas:
            self.graph.apply(delta)
        return deltas

    def goal_reports(self, goals: Sequence[FrameId]) -> tuple[GoalReport, ...]:
        """Return a report on each goal: whether paths lead there from most of the map."""
        return goal_reports(self.graph, goals, self.keyframes, self.predictor, self.system)

    def save(
        self, path: Path | str, *, config: Mapping[str, Any] | None = None, origin: Path | str | None = None
    ) -> None:
        """Write the map to a new file, which appears only when it is complete.

        Args:
            path: The file to write; it must not exist yet. Its name ends in `.rrd`.
            config: Further information on how the map was built, to be stored as JSON.
            origin: A file whose compressed images are copied unchanged, because each compression loses quality.

        Raises:
            MapError: An image of a node is missing.
            RecordingError: The file exists or cannot be written.
        """
        save_map(
            path,
            self.graph,
            self.images,
            scene=self.scene,
            fingerprint=self.predictor.fingerprint,
            camera=self.camera or self.predictor.camera,
            scene_glb=self.scene_glb,
            config={
                "system": self.system.name,
                "method": asdict(self.system.method),
                **({"predictor": named} if (named := self.predictor_name or opened_name(self.predictor)) else {}),
                **({"drives": [asdict(each) for each in self.drives]} if self.drives else {}),
                **to_config(self.corrections, self.unsure),
                **(self.keyframes.space.to_config() if self.keyframes.space else {}),
                **(config or {}),
            },
            origin=None if origin is None else Path(origin),
        )

    def navigator(
        self,
        robot: Robot,
        *,
        seed: int | np.random.Generator = 0,
        bystanders: Bystanders | None = None,
        world_time: Callable[[], float] | None = None,
        actions: ActionPerformer | None = None,
    ) -> Navigator:
        """Return a navigator that drives `robot` by the map; driving updates the map.

        Args:
            robot: The robot to drive.
            seed: Seed, or random generator, that draws the images of the reserve to try if the map has no path.
            bystanders: The people that the robot met before, under another navigator.
            world_time: Returns the time of the world in seconds; needed if the world has another clock than the robot.
            actions: Performs the actions of edges, such as calling a lift; without it, each action fails.
        """
        return Navigator(
            robot,
            self.graph,
            self.keyframes,
            self.predictor,
            self.system,
            np.random.default_rng(seed),
            bystanders=bystanders,
            world_time=world_time,
            actions=actions,
        )
