"""Measures the constants of Eq. 3 and Eq. 4, and the errors of r and waypoints, on drives through simulated scenes.

Half of the attempts are at true edges and half at false ones, with the same number in each scene. The results of one
scene can be saved to a file, so that scenes can be measured separately.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.config import Method
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.edge_driver import EdgeDriver, MeasuredAttempt
from ltvn_core.evaluation.predicted_drive import EdgeProposal, EdgeProposals, PredictedDrive, predict_drive
from ltvn_core.geometry import distance
from ltvn_core.network.driving_calibration import DrivingMeasurements
from ltvn_core.network.metrics import SuccessRate, calibration_table, error_table
from ltvn_core.network.training_data.pose_sampling import sample_drive_poses
from ltvn_core.network.training_data.reachability_labels import ReachabilityLimits
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.types import Predictor, Renderer

if TYPE_CHECKING:
    from ltvn_core.simulation.scene_registry import Scene

Columns = NDArray[Any]
"""(N,) rows of named columns."""
_ERRORS = np.dtype([("position_m", "f8"), ("d", "f8"), ("straight_m", "f8"), ("overlap", "f8"), ("is_edge", "?")])
_PAIRS = np.dtype([("reachability", "f8"), ("is_reachable", "?")])
_ATTEMPTS = np.dtype([("true", "?"), ("connected", "?"), ("succeeded", "?"), ("arrived", "?")])


@dataclass(frozen=True, slots=True, eq=False)
class SceneFigures:
    """Measurements in one scene."""

    scene: str
    images: int
    errors: Columns
    """Per reachable pair: errors of position and d, straight distance, overlap, and whether the pair is an edge."""
    pairs: Columns
    """Per ordered pair: r, and whether it is reachable."""
    attempts: Columns
    """Per driven edge: whether it is true, whether the method would add it, whether it was judged a success, and
    whether the robot truly arrived."""
    not_begun: int

    def save(self, path: Path) -> None:
        """Write a file atomically. Raises OSError."""
        with atomic_replacement(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file,
                scene=self.scene,
                images=self.images,
                errors=self.errors,
                pairs=self.pairs,
                attempts=self.attempts,
                not_begun=self.not_begun,
            )

    @classmethod
    def load(cls, path: Path) -> "SceneFigures":
        """Read a file from `save`. Raises OptionError for any other file."""
        try:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                return cls(
                    scene=str(file["scene"]),
                    images=int(file["images"]),
                    errors=file["errors"],
                    pairs=file["pairs"],
                    attempts=file["attempts"],
                    not_begun=int(file["not_begun"]),
                )
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise OptionError(f"{path} is not the measurement of a scene: {error}") from error


def scene_figures(
    drive: PredictedDrive, edges: NDArray[np.bool_], attempted: Sequence[MeasuredAttempt], *, not_begun: int
) -> SceneFigures:
    """Return the measurements of a drive, of its edges (N, N) and of the driven edges."""
    true, predicted = (waypoints[drive.reachable] for waypoints in (drive.waypoints, drive.predicted.waypoints))
    errors = np.empty(len(true), _ERRORS)
    errors["position_m"] = np.hypot(*(predicted - true)[:, :2].T)
    errors["d"] = distance(predicted) - distance(true)
    errors["straight_m"] = np.hypot(true[:, 0], true[:, 1])
    errors["overlap"] = drive.overlap[drive.reachable]
    errors["is_edge"] = edges[drive.reachable]
    apart = ~np.eye(len(drive.poses), dtype=bool)
    pairs = np.empty(int(apart.sum()), _PAIRS)
    pairs["reachability"] = drive.predicted.reachability[apart]
    pairs["is_reachable"] = drive.reachable[apart]
    rows = [(each.edge.true, each.edge.connected, each.succeeded, each.arrived) for each in attempted]
    return SceneFigures(
        scene=drive.scene.name,
        images=len(drive.poses),
        errors=errors,
        pairs=pairs,
        attempts=np.array(rows, _ATTEMPTS),
        not_begun=not_begun,
    )


DISTANCE_BINS_M = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5)
OVERLAP_BINS = tuple(np.linspace(ReachabilityLimits().overlap, 1, 5).tolist())
"""Limits of the bins of overlap; pairs below the lowest limit are not reachable."""

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
    """Predict all pairs of a drive, and let a robot of `spec` drive `attempts` of its edges, or all if there are fewer.

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
    """Drive edges until `count` of them have started, or until there are no more."""
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
    there = attempts[attempts["true"]]
    not_there = attempts[~attempts["true"]]
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
