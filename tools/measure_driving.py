"""Measure the constants of Eq. 3 and Eq. 4, and the errors of r and waypoints, on drives through simulated scenes:
`python -m tools.measure_driving --predictor geometric --attempts 60 --write`.

Half of the attempts are at true edges and half at false ones, with the same number in each scene. `--write` puts the
result into the weights' card, or into the file of the geometric predictor, so that the method uses it.
"""

import argparse
import json
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.config import Method, preset
from ltvn_core.errors import WeightsError
from ltvn_core.evaluation.edge_driver import EdgeDriver, EdgeProposal, MeasuredAttempt
from ltvn_core.geometry import distance
from ltvn_core.network.driving_calibration import DRIVING_SECTION, DrivingMeasurements, likelihoods
from ltvn_core.network.metrics import ErrorBin, SuccessRate, calibration_table, in_bins, or_none, quantile
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.training_data.pose_sampling import sample_drive_poses
from ltvn_core.network.training_data.reachability_labels import ReachabilityLimits
from ltvn_core.network.weights_file import card_path, read_card, weights_fingerprint
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.predictors.geometric import DRIVING_FILE
from ltvn_core.predictors.opening import open_predictor, simulated_robot
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.training.held_out_scenes import TEST_SCENES
from ltvn_core.types import Predictor, Renderer
from tools.edge_proposals import EdgeProposals, PredictedDrive, predict_drive

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


def error_table(
    edges: Sequence[float], quantity: NDArray[np.float64], error_m: NDArray[np.float64]
) -> tuple[ErrorBin, ...]:
    """Return position errors (N,) in bins of a quantity (N,) between `edges`; values outside are left out."""
    return tuple(
        ErrorBin(
            low=low,
            high=high,
            pairs=int(inside.sum()),
            position_median_m=or_none(quantile(error_m[inside], 0.5)),
            position_p90_m=or_none(quantile(error_m[inside], 0.9)),
        )
        for low, high, inside in in_bins(edges, quantity)
    )


def _rate(successes: NDArray[np.bool_]) -> SuccessRate:
    return SuccessRate.of(int(successes.sum()), len(successes))


def _spread(numbers: NDArray[np.float64]) -> float:
    return float(numbers.std()) if len(numbers) else 0.0


def write_driving(measured: DrivingMeasurements, predictor: str, weights: Path) -> Path:
    """Write measurements to where the method reads its constants. Raises OSError and WeightsError."""
    likelihoods(measured)  # Refuses figures that cannot be the method's constants.
    if predictor != "geometric":
        return add_to_card(weights, DRIVING_SECTION, asdict(measured))
    with atomic_replacement(DRIVING_FILE) as part:
        part.write_text(json.dumps({DRIVING_SECTION: asdict(measured)}, indent=2) + "\n", encoding="utf-8")
    return DRIVING_FILE


def add_to_card(path: Path, section: str, content: Mapping[str, Any]) -> Path:
    """Write one section of the card of weights, keep the others, and return the path of the card.

    Raises WeightsError if there are no weights, if the card belongs to other ones, or if it cannot be written.
    """
    fingerprint = weights_fingerprint(path)
    card, target = read_card(path), card_path(path)
    if card.setdefault("fingerprint", fingerprint) != fingerprint:
        raise WeightsError(f"{target}: belongs to {card['fingerprint']}, not to the weights beside it ({fingerprint}).")
    try:
        with atomic_replacement(target) as part:
            part.write_text(json.dumps({**card, section: content}, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise WeightsError(f"{target}: the card could not be written ({error}); free some space.") from error
    return target


def main() -> int:
    """Parse the command line, drive, print the measurements as JSON, and write them if that is asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--predictor", choices=("network", "geometric"), default="network")
    parser.add_argument("--weights", type=Path, help="Weights of the network instead of the shipped ones.")
    parser.add_argument("--preset", choices=("robust", "paper"), default="robust")
    parser.add_argument("--attempts", type=int, default=200, help="Edges to drive in total.")
    parser.add_argument("--images", type=int, default=150, help="Images of the drive through each scene.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", nargs="+", default=list(TEST_SCENES))
    parser.add_argument("--body", choices=("auto", "bullet", "planar"), default="auto")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    share, more = divmod(options.attempts, len(options.scenes))
    found: list[SceneFigures] = []
    with tqdm(total=options.attempts, desc="measure", unit="edge") as bar:
        for number, name in enumerate(options.scenes):
            choice = ImageSource(camera=LOCOBOT.camera).choose(options.predictor)
            spec = simulated_robot(choice.name)
            scene = load_scene(name)
            found.append(
                measure_scene(
                    scene,
                    open_renderer(scene, spec.camera),
                    open_predictor(choice.name, name, options.weights, camera=spec.camera),
                    preset(options.preset),
                    attempts=share + (number < more),
                    images=options.images,
                    rng=np.random.default_rng([options.seed, number]),
                    progress=bar.update,
                    spec=spec,
                    body=options.body,
                )
            )
    measured = summarise_measurements(found, shlex.join(["python", "-m", "tools.measure_driving", *sys.argv[1:]]))
    sys.stdout.write(json.dumps(asdict(measured), indent=2) + "\n")
    if options.write:
        written = write_driving(measured, options.predictor, options.weights or SHIPPED_WEIGHTS)
        sys.stderr.write(f"{written} written\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
