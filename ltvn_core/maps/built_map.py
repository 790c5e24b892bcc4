"""Builds a map from the observations of one or more drives, checks it, and says what is doubtful.

Owns the order of building, joining, checking and telling; Algorithm 1 is `graph.builder`.
"""

import logging
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import rectified_camera
from ltvn_core.errors import MapError
from ltvn_core.findings import Finding
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.image_validity import check_instant
from ltvn_core.maps.joined_drives import JoinedDrive
from ltvn_core.maps.joined_map import DriveReport, drive_findings, join_map
from ltvn_core.maps.map_check import MappedDrive, diagnose, place_findings
from ltvn_core.maps.map_coverage import goal_reports, map_coverage
from ltvn_core.maps.scale_check import scale_findings
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.predictors.opening import NETWORK, open_method, open_predictor
from ltvn_core.predictors.request import predictor_card
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.robots.robot_check import sequence_findings
from ltvn_core.robots.robot_spec import NeededSpace
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.types import FrameId, Observation, Predictor

log = logging.getLogger(__name__)


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
    space: NeededSpace | None = None,
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
        space: Space that the robot needs free, `RobotSpec.needed_space`; None if the robot is unknown.
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
    keyframes.space = space
    built.build(images, rng=np.random.default_rng(seed), goals=goals, progress=progress)
    corrections, unsure = tuple(keyframes.corrections), keyframes.unsure
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
        *place_findings(corrections, unsure, len(in_order)),
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
        unsure=unsure,
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
