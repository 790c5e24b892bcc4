"""Measures the constants of Eq. 3 and Eq. 4, and the errors of r and waypoints, on drives through simulated scenes.

Half of the attempts are at true edges and half at false ones, with the same number in each scene.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.evaluation.edge_driver import EdgeDriver, MeasuredAttempt
from ltvn_core.evaluation.edge_proposals import EdgeProposal, EdgeProposals
from ltvn_core.evaluation.predicted_drive import PredictedDrive, predict_drive
from ltvn_core.geometry import distance
from ltvn_core.network.cards.driving_calibration import DrivingMeasurements
from ltvn_core.network.metrics.binned_metrics import calibration_table, error_table
from ltvn_core.network.metrics.success_rate import SuccessRate
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.training_data.reachability_labels import ReachabilityLimits
from ltvn_core.training_data.simulated_drives import sample_drive_poses
from ltvn_core.types import Predictor, Renderer

if TYPE_CHECKING:
    from ltvn_core.simulation.scene_registry import Scene

DISTANCE_BINS_M = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5)
OVERLAP_BINS = tuple(np.linspace(ReachabilityLimits().overlap, 1, 5).tolist())
"""Pairs with less overlap are not reachable."""

AttemptCallback = Callable[[], object]
"""Called after every attempt."""


@dataclass(frozen=True, eq=False)
class SceneMeasurement:
    """The measurement in one scene."""

    drive: PredictedDrive
    edges: NDArray[np.bool_]
    """(N, N): reachable pairs that become edges."""
    attempted: tuple[MeasuredAttempt, ...]
    not_begun: int


def measure_scene(
    scene: "Scene",
    camera: Renderer,
    predictor: Predictor,
    method: Method,
    *,
    attempts: int,
    images: int,
    rng: np.random.Generator,
    progress: AttemptCallback,
    spec: RobotSpec = LOCOBOT,
) -> SceneMeasurement:
    """Predict all pairs of a drive, and let a robot of `spec` drive `attempts` of its edges or all if there are fewer.

    Raises SceneError.
    """
    drive = predict_drive(scene, camera, predictor, sample_drive_poses(scene.clearance, rng, images), spec)
    proposals = EdgeProposals(drive, predictor, method)
    tried: list[MeasuredAttempt | None] = []
    with closing(EdgeDriver(drive.imaged_scene, predictor, method, proposals.errors(), rng)) as robot:
        for edges in (proposals.true_edges(rng), proposals.false_edges(rng)):
            tried.extend(_drive_some(robot, edges, attempts // 2, progress))
    attempted = tuple(each for each in tried if each is not None)
    return SceneMeasurement(
        drive=drive, edges=proposals.edges(), attempted=attempted, not_begun=len(tried) - len(attempted)
    )


def _drive_some(
    robot: EdgeDriver, edges: Iterator[EdgeProposal], count: int, progress: AttemptCallback
) -> Iterator[MeasuredAttempt | None]:
    """Drive edges until the given number has started, or there are no more."""
    for edge in edges:
        done = robot.drive(edge)
        yield done
        if done is None:
            continue
        progress()
        count -= 1
        if count == 0:
            return


def summarise_measurements(scenes: Sequence[SceneMeasurement], command: str) -> DrivingMeasurements:
    """Combine the measurements of several scenes."""
    attempted = [each for scene in scenes for each in scene.attempted]
    there = [each for each in attempted if each.edge.true]
    not_there = [each for each in attempted if not each.edge.true]
    error_m, error_d, straight_m, overlap = (
        np.concatenate(column) for column in zip(*map(_errors, scenes), strict=True)
    )
    certainty, reachable = (
        np.concatenate(column) for column in zip(*map(_reachability_and_truth, scenes), strict=True)
    )
    edges = np.concatenate([scene.edges[scene.drive.reachable] for scene in scenes])
    return DrivingMeasurements(
        command=command,
        scenes=tuple(scene.drive.scene.name for scene in scenes),
        images=len(scenes[0].drive.poses),
        success_if_reachable=SuccessRate.of(sum(each.succeeded for each in there), len(there)),
        success_if_not=SuccessRate.of(sum(each.succeeded for each in not_there), len(not_there)),
        arrival_if_reachable=SuccessRate.of(sum(each.arrived for each in there), len(there)),
        arrival_if_not=SuccessRate.of(sum(each.arrived for each in not_there), len(not_there)),
        connected_if_not=sum(each.edge.connected for each in not_there),
        not_begun=sum(scene.not_begun for scene in scenes),
        distance_sigma=_spread(error_d[edges]),
        distance_sigma_all=_spread(error_d),
        calibration=calibration_table(certainty, reachable),
        error_by_distance=error_table(DISTANCE_BINS_M, straight_m, error_m),
        error_by_overlap=error_table(OVERLAP_BINS, overlap, error_m),
    )


def _errors(scene: SceneMeasurement) -> tuple[NDArray[np.float64], ...]:
    """Return (P,) position error, error of d, straight distance and overlap of all reachable pairs."""
    drive = scene.drive
    true = drive.waypoints[drive.reachable]
    predicted = drive.predicted.waypoints[drive.reachable]
    error_m = np.hypot(*(predicted - true)[:, :2].T)
    straight_m = np.hypot(true[:, 0], true[:, 1])
    return error_m, distance(predicted) - distance(true), straight_m, drive.overlap[drive.reachable].astype(np.float64)


def _reachability_and_truth(scene: SceneMeasurement) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return (P,) r and truth of all ordered pairs."""
    pairs = ~np.eye(len(scene.drive.poses), dtype=bool)
    return scene.drive.predicted.reachability[pairs], scene.drive.reachable[pairs]


def _spread(numbers: NDArray[np.float64]) -> float:
    return float(numbers.std()) if len(numbers) else 0.0
