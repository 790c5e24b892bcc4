"""A topological map with the images of its nodes: built from observations, saved to a file, loaded again.

Owns no step of the method: Algorithm 1 is `graph.builder`, the file format is `data.recording.map_file`. Programs that
build a map, or drive by a map, use this class.
"""

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from ltvn_core.analysis.manual_edits import connect_by_action
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import rectified_camera
from ltvn_core.data.recording.map_file import LoadedMap, check_fingerprint, load_map, save_map
from ltvn_core.errors import MapError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.graph.builder import ProgressCallback
from ltvn_core.graph.corrections import Correction, to_config
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import Localiser
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.image_validity import check_instant
from ltvn_core.maps.joined_drives import JoinedDrive
from ltvn_core.maps.joined_map import DriveReport, drive_findings, join_map
from ltvn_core.maps.map_check import MappedDrive, diagnose
from ltvn_core.maps.map_coverage import GoalReport, MapCoverage, goal_reports, map_coverage
from ltvn_core.maps.scale_check import scale_findings
from ltvn_core.navigation.action_performer import ActionPerformer
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.predictors.choice import AUTO, ImageSource
from ltvn_core.predictors.opening import NETWORK, open_method, open_predictor, opened_name
from ltvn_core.predictors.request import predictor_card
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_check import sequence_findings
from ltvn_core.systems.registry import DEFAULT_SYSTEM, recorded_system, system_entry
from ltvn_core.types import FrameId, NodeId, Observation, Predictor, Waypoint

log = logging.getLogger(__name__)


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
        with_reserve: bool = True,
    ) -> Self:
        """Return a map of a file, with the predictor that made it and the system that built it.

        Args:
            loaded: The contents of the file, or its path.
            preset: Name of the method's settings.
            predictor: Name of the predictor that compares images; `auto` is the one that made the map.
            weights: Weights to use instead of those that come with the map's system.
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
            name, meta.scene, entry.weights_for(name, None if weights is None else Path(weights)), camera=meta.camera
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
        nearest = Localiser(matcher, self.system.method.localising).nearest_nodes(features, self.graph, count)
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
                **to_config(self.corrections),
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
            self.system.method,
            np.random.default_rng(seed),
            system=self.system,
            bystanders=bystanders,
            world_time=world_time,
            actions=actions,
        )


def build_map(
    observations: Iterable[Observation],
    *,
    predictor: Predictor | None = None,
    predictor_name: str = "",
    system: NavigationSystem | None = None,
    scene: str = "",
    camera: CameraModel | None = None,
    is_lens_known: bool = True,
    seed: int = 0,
    goals: Collection[FrameId] = (),
    drives: Sequence[JoinedDrive] = (),
    progress: ProgressCallback | None = None,
) -> TopologicalMap:
    """Build a map from the observations of one or more drives (Algorithm 1 of the paper).

    Args:
        observations: RGB-D images with odometry, in any order; each has its own `step`, which names its node.
            Odometry does not relate images of different drives, unless one drive continues another, see `drives`.
        predictor: The predictor that compares images; None loads the shipped network.
        predictor_name: Name by which the predictor can be opened again, to be saved with the map; empty for the one by
            which `open_predictor` opened it.
        system: Strategies and thresholds; None is the paper's system with the `robust` preset.
        scene: Name of the place where the images were taken, to be saved with the map.
        camera: The camera of the images, `Recording.meta.camera`; the images are rectified to the predictor's camera.
            None if they were taken with that camera already.
        is_lens_known: Whether the lens of the camera was given. An unknown lens is named among the likely causes of a
            map that is unfit for navigation.
        seed: Seed of the order in which images are sampled.
        goals: Frames that must become nodes because they are goals.
        drives: The drives of the images, if there are several, see `maps.joined_drives`. Drives are joined where they
            recognise each other or where one continues another. Edges that a later drive finds blocked get an
            observation that they are blocked.
        progress: Called now and then with the number of images done and the number of all images.

    Raises:
        MapError: There are no observations, their steps repeat, one is something else, or a goal is not one of them.
        ImageError: An odometry, stamp or step is impossible.
        WeightsError: The shipped weights are damaged.
    """
    observations = _checked(observations)
    if predictor is None:
        predictor_name = NETWORK
        predictor = open_predictor(NETWORK, weights=system_entry(system.name if system else DEFAULT_SYSTEM).weights)
    system = system or system_entry(DEFAULT_SYSTEM).factory(open_method("robust", predictor))
    target = predictor.camera
    images = observations
    if camera is not None:
        images = [recorded_observation(seen, camera, target) for seen in observations]
    built = TopologicalMap.of(predictor, system)
    graph = built.graph
    keyframes = built.keyframes
    keyframes.begin_drives([each.first for each in drives], resumed=[each.first for each in drives if each.continues])
    built.build(images, rng=np.random.default_rng(seed), goals=goals, progress=progress)
    corrections = tuple(keyframes.corrections)
    resumed = keyframes.resumed_starts  # Drives whose images contradict the continued odometry are left out.
    drives = [each if each.first in resumed else replace(each, continues="") for each in drives]
    reports: tuple[DriveReport, ...] = ()
    if drives:
        joined = join_map(graph, keyframes, images, drives, predictor, system)
        graph = joined.graph
        keyframes = joined.keyframes
        reports = joined.reports
    in_order = sorted(observations, key=lambda seen: seen.step)
    coverage = map_coverage(in_order, graph, keyframes, predictor, system)
    drive = MappedDrive(
        observations=in_order,
        camera=camera,
        is_lens_known=is_lens_known,
        graph=graph,
        keyframes=keyframes,
        predictor=predictor,
        predictor_name=predictor_name,
        least_width_px=predictor_card(predictor).least_width_px,
    )
    standing = goal_reports(graph, [*goals], keyframes, predictor, system)
    told = [report.finding for report in standing if report.finding is not None]
    findings = (
        *drive_findings(reports),
        *_sequence_findings(in_order, drives),
        *scale_findings(graph, in_order),
        *diagnose(drive, coverage),
        *told,
    )
    for finding in findings:
        log.warning(finding)
    return TopologicalMap(
        graph=graph,
        keyframes=keyframes,
        predictor=predictor,
        system=system,
        scene=scene,
        camera=None if camera is None else rectified_camera(camera, target),
        predictor_name=predictor_name,
        coverage=coverage,
        drives=reports,
        goals=standing,
        corrections=corrections,
        findings=findings,
    )


def _sequence_findings(in_order: Sequence[Observation], drives: Sequence[JoinedDrive]) -> Iterator[Finding]:
    """Yield findings about the images of each drive; between two drives clock and odometry may jump."""
    if not drives:
        yield from sequence_findings(in_order)
    for drive in drives:
        found = sequence_findings([seen for seen in in_order if drive.holds(seen.step)])
        yield from (finding.of(drive.name) for finding in found)


def _checked(observations: Iterable[Observation]) -> list[Observation]:
    """Return the images that a program of another person hands over. Raises MapError and ImageError."""
    given: list[object] = list(observations) if isinstance(observations, Iterable) else [observations]
    images = list[Observation]()
    for image in given:
        if not isinstance(image, Observation):
            raise MapError(
                f"A map is built from images of the type ltvn_core.Observation, not from {type(image).__name__}. "
                "`preprocess_observation` makes one of colours, depth and odometry; of a recording, give "
                "[recording.observation(frame) for frame in recording.frames]."
            )
        check_instant(image.odometry, stamp=image.stamp, step=image.step, source=f"image {image.step}")
        images.append(image)
    return images
