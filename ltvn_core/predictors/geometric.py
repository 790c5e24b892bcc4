"""The geometric predictor: compares images by local features, depth and poses, without trained weights.

SIFT key points are matched, and those with depth give the motion of the camera. Reachability r is the probability that
this motion is right, times a factor below 1 where the robot cannot drive straight to the target.

Owns the order of these steps, the cache of compared pairs, and the driving limits; each limit falls gradually, so that
a small change of an image never changes r abruptly. Also reads the file of driving measurements in simulation.
Implements `ltvn_core.types.Predictor`.
"""

import hashlib
import logging
from collections import OrderedDict
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.errors import WeightsError
from ltvn_core.geometry import invert
from ltvn_core.network.driving_calibration import likelihoods, read_driving
from ltvn_core.predictors.geometric_evidence import (
    CALIBRATION_FILE,
    DEPTHS,
    Calibration,
    Logistic,
    read_calibration,
    shipped_calibration,
)
from ltvn_core.predictors.geometric_features import (
    WORDS_FILE,
    FeatureExtractor,
    ImageFeatures,
    ImageGrid,
    most_similar,
    votes,
)
from ltvn_core.predictors.geometric_pose import ROOM_DEPTH_M, points
from ltvn_core.predictors.geometric_verification import verify, waypoint
from ltvn_core.predictors.request import PredictorRequest
from ltvn_core.structured_text import parse_json
from ltvn_core.types import Features, Observation, Prediction, Waypoint

log = logging.getLogger(__name__)


DRIVING_FILE = Path(__file__).with_name("geometric_driving.json")
"""File of the driving measurements in the package."""


@lru_cache(maxsize=1)
def shipped_likelihoods() -> Likelihoods | None:
    """Return the constants of Eq. 3 and Eq. 4; None if they were not measured. Raises WeightsError for an invalid
    file."""
    if not DRIVING_FILE.is_file():
        return None
    try:
        measured = read_driving(parse_json(DRIVING_FILE.read_text(encoding="utf-8")))
    except ValueError as error:
        raise WeightsError(f"{DRIVING_FILE} is damaged ({error}); install the package again.") from error
    return None if measured is None else likelihoods(measured)


MAX_PAIRS = 50_000
"""Largest number of pairs in the cache, which take about 20 MB."""


class SurePose(NamedTuple):
    """Pose of the second image relative to the first, and the probability that it is right."""

    certainty: float
    """Probability that the pose is right, in [0, 1]."""
    waypoint: Waypoint
    """(3,) pose of the second image in the frame of the first."""
    moved_m: float
    """Length of the camera's translation in space, in metres."""
    turned_rad: float
    """Angle of the camera's rotation in space, in radians."""

    def inverse(self) -> "SurePose":
        """Return the pose of the first image relative to the second."""
        return self._replace(waypoint=invert(self.waypoint))

    def scaled(self, factor: float) -> "SurePose":
        """Return the pose with its distances multiplied by a factor and the same rotation."""
        return self._replace(waypoint=self.waypoint * [factor, factor, 1.0], moved_m=self.moved_m * factor)


NO_POSE = SurePose(0.0, np.zeros(3), 0.0, 0.0)
"""Result for a pair without any supported pose."""


class PairMemory:
    """Cache of the last compared pairs, keyed by the hashes of both images."""

    def __init__(self) -> None:
        self._poses: OrderedDict[bytes, SurePose] = OrderedDict()
        self._lock = Lock()

    def recall(self, first: bytes, second: bytes) -> SurePose | None:
        """Return the pose in the cache for a pair; None if there is none."""
        with self._lock:
            return self._poses.get(first + second)

    def keep(self, first: bytes, second: bytes, pose: SurePose) -> None:
        """Add a pair, and drop the oldest ones if there are too many."""
        with self._lock:
            self._poses[first + second] = pose
            if len(self._poses) > MAX_PAIRS:
                self._poses.popitem(last=False)


RANGE_M = 1.55
"""Distance in metres that halves reachability, because depth gets uncertain and edges should be short."""
RANGE_WIDTH_M = 0.1
TURN_RAD = float(np.deg2rad(54))
TURN_WIDTH_RAD = float(np.deg2rad(3))
BESIDE_RAD = float(np.deg2rad(105))
"""Bearing that halves reachability: places farther to the side or behind are reached by driving an edge in reverse."""
BESIDE_WIDTH_RAD = float(np.deg2rad(5))
AT_PLACE_M = 0.25
"""Distance in metres below which no free path is needed, because the robot is already at the place."""

_CORRIDOR_M = 0.18
"""Half the width of the straight corridor that must be free, in metres."""
_FLOOR_M = 0.1
"""Height above the floor in metres below which points are ignored: the floor with its noise, and low objects."""
_EYE_BAND_M = 0.1
"""Largest height of an obstacle above the camera, and below it if the height above the floor is unknown, in metres."""
_MAX_ROBOT_CAMERA_M = 0.9
"""Largest height of a camera on a robot, in metres; a higher camera is hand-held, and no robot's shape is known."""
_MANY_POINTS = 12.0
"""Number of obstacle points of the coarse depth image that halves reachability."""


def drivable_share(source: ImageFeatures, pose: SurePose, camera: CameraModel, grid: ImageGrid) -> float:
    """Return the factor in [0, 1] by which the path from the source to a pose lowers reachability."""
    waypoint = pose.waypoint
    turned = max(abs(float(waypoint[2])), pose.turned_rad)
    share = _falling(pose.moved_m, RANGE_M, RANGE_WIDTH_M) * _falling(turned, TURN_RAD, TURN_WIDTH_RAD)
    if np.hypot(waypoint[0], waypoint[1]) < AT_PLACE_M:
        return share
    bearing = abs(float(np.arctan2(waypoint[1], waypoint[0])))
    blocked = _points_in_the_way(source, waypoint, camera, grid) / _MANY_POINTS
    return share * _falling(bearing, BESIDE_RAD, BESIDE_WIDTH_RAD) / (1 + blocked**2)


def _points_in_the_way(source: ImageFeatures, waypoint: Waypoint, camera: CameraModel, grid: ImageGrid) -> int:
    """Return the number of points of the source's depth image that block the straight path."""
    seen = np.flatnonzero(source.grid_depth)
    if not len(seen):
        return 0
    places = points(grid.rays[seen], source.grid_depth[seen]) @ source.level.T
    low, high = _obstacle_band(source, camera)
    places = places[(places[:, 2] > low) & (places[:, 2] < high), :2]
    length = float(np.hypot(waypoint[0], waypoint[1]))
    ahead = np.asarray(waypoint[:2], np.float64) / length
    along = places @ ahead
    beside = np.abs(places[:, 0] * ahead[1] - places[:, 1] * ahead[0])
    return int(np.count_nonzero((along > 0.05) & (along < length) & (beside < _CORRIDOR_M)))


def _obstacle_band(source: ImageFeatures, camera: CameraModel) -> tuple[float, float]:
    """Return the lowest and highest height of obstacles, relative to the camera, in metres."""
    if 0 < camera.height_m <= _MAX_ROBOT_CAMERA_M and not source.has_own_tilt:
        return _FLOOR_M - camera.height_m, _EYE_BAND_M
    return -_EYE_BAND_M, _EYE_BAND_M


def _falling(value: float, middle: float, width: float) -> float:
    """Return a falling logistic function: 1 far below the middle, 0 far above it."""
    return float(1 / (1 + np.exp(np.clip((value - middle) / width, -50, 50))))


VERSION = 2
"""Version of the predictor; maps of another version are refused. Increase it whenever the same images get other
distances than before, not where only more of them are recognised."""

SHORTLIST_FROM = 24
"""Least number of targets with which one image is compared in full with only the most similar targets."""
SIMILAR = 64
"""Number of targets that are chosen by their place vectors."""
SHORTLIST = 12
"""Number of the chosen targets that are compared in full, by the votes of their key points."""

LEAST_WIDTH_PX = 160
"""Least useful image width in pixels: at 96 it recognises half as many near pairs as at 320."""

MERGE_DISTANCE = 0.3
"""D_m with this predictor. At a distance of 0.55, the paper's D_m, it recognises only about half of the images, so with
nodes that far apart the images between them would stay unconnected."""

_NETWORK_SUFFIX = ".safetensors"
_UNRELATED = 0.01
"""Reachability of a pair without evidence; not 0, because Eq. 3 could never revise that."""


class GeometricPredictor:
    """f(o_i, o_j) -> (r, dx, dy, dtheta) from the geometry of two images; its features are objects (N, 1)."""

    needs_depth = False
    """Depth is optional, and one image of a pair with depth is enough; without any depth, the distance is a guess, see
    `epipolar_motion`."""
    merge_distance = MERGE_DISTANCE
    least_width_px = LEAST_WIDTH_PX

    def __init__(
        self,
        camera: CameraModel,
        *,
        calibration: Calibration | None = None,
        shortlist_from: int | None = SHORTLIST_FROM,
    ) -> None:
        """Compare images of `camera`; without a calibration, the one in the package is used.

        `shortlist_from` None compares every pair in full.
        """
        self._camera = camera
        self._extractor = FeatureExtractor(camera)
        self._shortlist_from = shortlist_from
        self._calibration = calibration or shipped_calibration()
        self._memory = PairMemory()

    @property
    def fingerprint(self) -> str:
        """Identifier of the version, its fitted parameters and the camera."""
        numbers = self._calibration.fingerprint
        if numbers == shipped_calibration().fingerprint:
            calibration = CALIBRATION_FILE.read_bytes()  # The same fingerprint as in maps of earlier versions.
        else:
            calibration = numbers.encode()
        digest = hashlib.sha256(calibration + WORDS_FILE.read_bytes())
        digest.update(repr(self._camera).encode())
        return f"geometric-{VERSION}-{digest.hexdigest()[:12]}"

    @property
    def likelihoods(self) -> Likelihoods | None:
        """Constants that were measured for it in simulation."""
        return shipped_likelihoods()

    @property
    def camera(self) -> CameraModel:
        """The camera of the images."""
        return self._camera

    @property
    def calibration(self) -> Calibration:
        """Weights of the evidence."""
        return self._calibration

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, 1) features: one object per image. Raises ImageError for images of another size."""
        rows = np.empty((len(observations), 1), object)
        for k, observation in enumerate(observations):
            rows[k, 0] = self._extractor.extract(observation)
        return rows

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, 1) or (1, 1) with targets (N, 1).

        One source with many targets (24 or more, unless the shortlist is off) is compared in full only with the 12 most
        similar ones. The others get a reachability of 0.01 and a waypoint of zeros that has no meaning, like pairs
        without evidence.
        """
        self._check(sources, targets)
        chosen = np.arange(len(targets))
        if len(sources) == 1 and self._shortlist_from is not None and len(targets) >= self._shortlist_from:
            chosen = self.shortlist(sources[0, 0], [row[0] for row in targets])
        reachability = np.full(len(targets), _UNRELATED)
        waypoints = np.zeros((len(targets), 3))
        for k in chosen:
            source = sources[0 if len(sources) == 1 else k, 0]
            reachability[k], waypoints[k] = self._compare(source, targets[k, 0])
        return Prediction(reachability, waypoints)

    def key_point_counts(self, features: Features) -> NDArray[np.intp]:
        """Return the number of clear key points (N,) of images, from features (N, 1)."""
        return np.array([min(row[0].clear, len(row[0].rays)) for row in features], np.intp)

    def shortlist(self, source: ImageFeatures, targets: Sequence[ImageFeatures]) -> list[int]:
        """Return the rows of the targets to compare in full, in order."""
        similar = most_similar(source.place, [target.place for target in targets], SIMILAR)
        counted = [votes(source.descriptors, targets[k].descriptors) for k in similar]
        order = np.argsort([-count for count in counted], kind="stable")[:SHORTLIST]
        return sorted(int(similar[k]) for k in order)

    def _compare(self, source: ImageFeatures, target: ImageFeatures) -> tuple[float, Waypoint]:
        pose = self._sure_pose(source, target)
        if pose.certainty <= _UNRELATED:
            return _UNRELATED, np.zeros(3)
        share = drivable_share(source, pose, self._camera, self._extractor.grid)
        return max(_UNRELATED, pose.certainty * share), pose.waypoint

    def _sure_pose(self, source: ImageFeatures, target: ImageFeatures) -> SurePose:
        """Return the target's pose and its certainty; computed once for both directions of a pair."""
        first, second = sorted((source, target), key=lambda each: each.key)
        pose = self._memory.recall(first.key, second.key)
        if pose is None:
            pose = self._verified_pose(first, second)
            self._memory.keep(first.key, second.key, pose)
        return pose if first is source else pose.inverse()

    def _verified_pose(self, first: ImageFeatures, second: ImageFeatures) -> SurePose:
        verified = verify(first, second, self._camera, self._extractor.grid)
        if verified is None:
            return NO_POSE
        pose = SurePose(
            certainty=self._logistic(first, second).probability(verified.evidence._asdict()),
            waypoint=waypoint(verified.motion, first, second),
            moved_m=float(np.linalg.norm(verified.motion.translation)),
            turned_rad=verified.motion.turned_rad,
        )
        if first.has_depth or second.has_depth:
            return pose
        return pose.scaled(self._calibration.room_depth_m / ROOM_DEPTH_M)

    def _logistic(self, first: ImageFeatures, second: ImageFeatures) -> Logistic:
        return self._calibration.logistics[DEPTHS[first.has_depth + second.has_depth]]

    def _check(self, sources: Features, targets: Features) -> None:
        if sources.shape[1:] != (1,) or targets.shape[1:] != (1,) or object not in (sources.dtype, targets.dtype):
            raise ValueError(
                f"Features must be (N, 1) objects as `encode` returns them, got {sources.shape} of {sources.dtype} and "
                f"{targets.shape} of {targets.dtype}."
            )
        if len(sources) not in (1, len(targets)):
            raise ValueError(f"{len(sources)} sources cannot be paired with {len(targets)} targets one to one.")


def open_geometric(request: PredictorRequest) -> GeometricPredictor:
    """Return the predictor for the request's camera; its weights may name a drive's own calibration (.json).

    The scene is ignored. Raises WeightsError for a calibration that cannot be read.
    """
    return GeometricPredictor(request.camera, calibration=requested_calibration(request))


def requested_calibration(request: PredictorRequest) -> Calibration | None:
    """Return the calibration that a request names as weights; None for the one in the package. Raises WeightsError.

    Weights of a network are ignored, because the caller may need them for other images.
    """
    weights = request.weights
    if weights is None:
        return None
    if weights.suffix == _NETWORK_SUFFIX:
        log.warning("The geometric predictor ignores %s (weights of the network) and uses its calibration.", weights)
        return None
    return read_calibration(weights)
