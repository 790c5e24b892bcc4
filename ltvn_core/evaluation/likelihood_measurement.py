"""Measures the constants of Eq. 3 and Eq. 4, and the errors of r and waypoints, on drives through simulated scenes.

Half of the attempts are at true edges and half at false ones, with the same number in each scene.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.evaluation.edge_driver import EdgeDriver, MeasuredAttempt
from ltvn_core.evaluation.edge_proposals import EdgeProposal, EdgeProposals
from ltvn_core.evaluation.predicted_drive import predict_drive
from ltvn_core.evaluation.scene_figures import SceneFigures, scene_figures
from ltvn_core.network.driving_calibration import DrivingMeasurements
from ltvn_core.network.metrics.binned_metrics import calibration_table, error_table
from ltvn_core.network.metrics.success_rate import SuccessRate
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.body_names import BodyName
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
    body: BodyName = "auto",
) -> SceneFigures:
    """Predict all pairs of a drive, and let a robot of `spec` drive `attempts` of its edges or all if there are fewer.

    Raises SceneError.
    """
    drive = predict_drive(scene, camera, predictor, sample_drive_poses(scene.clearance, rng, images), spec)
    proposals = EdgeProposals(drive, predictor, method)
    tried: list[MeasuredAttempt | None] = []
    with closing(EdgeDriver(drive.imaged_scene, predictor, method, proposals.errors(), rng, body=body)) as robot:
        for edges in (proposals.true_edges(rng), proposals.false_edges(rng)):
            tried.extend(_drive_some(robot, edges, attempts // 2, progress))
    attempted = tuple(each for each in tried if each is not None)
    return scene_figures(drive, proposals.edges(), attempted, not_begun=len(tried) - len(attempted))


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


def summarise_measurements(scenes: Sequence[SceneFigures], command: str) -> DrivingMeasurements:
    """Combine the measurements of several scenes."""
    errors, pairs, attempts = (
        np.concatenate(columns)
        for columns in zip(*((each.errors, each.pairs, each.attempts) for each in scenes), strict=True)
    )
    there, not_there = attempts[attempts["true"]], attempts[~attempts["true"]]
    return DrivingMeasurements(
        command=command,
        scenes=tuple(scene.scene for scene in scenes),
        images=scenes[0].images,
        success_if_reachable=_rate(there["succeeded"]),
        success_if_not=_rate(not_there["succeeded"]),
        arrival_if_reachable=_rate(there["arrived"]),
        arrival_if_not=_rate(not_there["arrived"]),
        connected_if_not=int(not_there["connected"].sum()),
        not_begun=sum(scene.not_begun for scene in scenes),
        distance_sigma=_spread(errors["d"][errors["is_edge"]]),
        distance_sigma_all=_spread(errors["d"]),
        calibration=calibration_table(pairs["reachability"], pairs["is_reachable"]),
        error_by_distance=error_table(DISTANCE_BINS_M, errors["straight_m"], errors["position_m"]),
        error_by_overlap=error_table(OVERLAP_BINS, errors["overlap"], errors["position_m"]),
    )


def _rate(successes: NDArray[np.bool_]) -> SuccessRate:
    return SuccessRate.of(int(successes.sum()), len(successes))


def _spread(numbers: NDArray[np.float64]) -> float:
    return float(numbers.std()) if len(numbers) else 0.0
