"""The geometric predictor: compares images by local features, depth and poses, without trained weights.

SIFT key points are matched, the camera's motion follows from those with depth, and r is how sure that motion is after
all evidence, less where the way there cannot be driven straight. Owns the order of these steps, the shortlist for one
image against many, and the memory of pairs. Implements `ltvn_core.types.Predictor`.
"""

import hashlib
import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.predictors.geometric_calibration import (
    CALIBRATION_FILE,
    DEPTHS,
    Calibration,
    Logistic,
    read_calibration,
    shipped_calibration,
)
from ltvn_core.predictors.geometric_driving import shipped_likelihoods
from ltvn_core.predictors.geometric_epipolar import ROOM_DEPTH_M
from ltvn_core.predictors.geometric_features import FeatureExtractor, ImageFeatures
from ltvn_core.predictors.geometric_memory import NO_POSE, PairMemory, SurePose
from ltvn_core.predictors.geometric_reach import drivable_share
from ltvn_core.predictors.geometric_shortlist import WORDS_FILE, most_similar, votes
from ltvn_core.predictors.geometric_verification import verify, waypoint
from ltvn_core.predictors.request import PredictorRequest
from ltvn_core.types import Features, Observation, Prediction, Waypoint

log = logging.getLogger(__name__)

VERSION = 2
"""Increase it whenever equal images give another answer than before."""

MAX_IMAGE_SIDE_PX = 320
"""Larger images are not more exact for the time they take."""

SHORTLIST_FROM = 24
"""One image against at least so many others is compared in full with the most similar ones alone."""
SIMILAR = 64
"""Of the others so many are chosen by their place vectors,"""
SHORTLIST = 12
"""and of those so many by the votes of their key points."""

LEAST_WIDTH_PX = 160
"""In images 96 pixels wide it finds half as many near pairs as in those of 320."""

MERGE_DISTANCE = 0.3
"""D_m with this predictor. Of images that are 0.55 apart, the paper's D_m, it recognises about half, and beyond that
fewer: nodes that far apart leave the images between them unconnected."""

_NETWORK_SUFFIX = ".safetensors"
_UNRELATED = 0.01
"""Reachability of a pair that nothing speaks for. Not 0, because no evidence could revise such a belief."""


class GeometricPredictor:
    """f(o_i, o_j) -> (r, dx, dy, dtheta) from the geometry of two images; its features are objects (N, 1)."""

    needs_depth = False
    """Depth in one of two images is enough; without any, the distance is a guess, see `geometric_epipolar`."""
    merge_distance = MERGE_DISTANCE
    least_width_px = LEAST_WIDTH_PX

    def __init__(
        self,
        camera: CameraModel,
        *,
        calibration: Calibration | None = None,
        shortlist_from: int | None = SHORTLIST_FROM,
    ) -> None:
        """Take the camera whose images come, and a calibration, None being the one of the package.

        `shortlist_from` None compares every pair in full.
        """
        self._camera = camera
        self._extractor = FeatureExtractor(camera)
        self._shortlist_from = shortlist_from
        self._calibration = calibration or shipped_calibration()
        self._memory = PairMemory()

    @property
    def fingerprint(self) -> str:
        """Name the version, its fitted parameters and the camera."""
        numbers = self._calibration.fingerprint
        if numbers == shipped_calibration().fingerprint:
            calibration = CALIBRATION_FILE.read_bytes()  # As maps of earlier versions name it.
        else:
            calibration = numbers.encode()
        digest = hashlib.sha256(calibration + WORDS_FILE.read_bytes())
        digest.update(repr(self._camera).encode())
        return f"geometric-{VERSION}-{digest.hexdigest()[:12]}"

    @property
    def likelihoods(self) -> Likelihoods | None:
        """What `ltvn measure` measured of it in simulation."""
        return shipped_likelihoods()

    @property
    def camera(self) -> CameraModel:
        """The camera whose images it takes."""
        return self._camera

    @property
    def calibration(self) -> Calibration:
        """What evidence is worth."""
        return self._calibration

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, 1) features: one object an image. Raises ImageError for images of another size."""
        rows = np.empty((len(observations), 1), object)
        for k, observation in enumerate(observations):
            rows[k, 0] = self._extractor.extract(observation)
        return rows

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, 1) or (1, 1) with targets (N, 1).

        One source with many targets (24 or more, unless the shortlist is off) is compared in full only with the 12 most
        similar ones. The others get a reachability of 0.01 and a waypoint of zeros that has no meaning, as pairs do
        that nothing speaks for.
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
        """Return how many key points were found in each of N images, (N,) for features (N, 1)."""
        return np.array([len(row[0].rays) for row in features], np.intp)

    def shortlist(self, source: ImageFeatures, targets: Sequence[ImageFeatures]) -> list[int]:
        """Return which targets are compared in full, in order."""
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
        """Return where the target is and how sure that is; computed once a pair, whichever way it is asked."""
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
            raise ValueError(f"{len(sources)} sources cannot meet {len(targets)} targets one to one.")


def open_geometric(request: PredictorRequest) -> GeometricPredictor:
    """Take the camera of the request as it is, and a drive's own calibration (.json) as weights. Raises WeightsError.

    The scene is of no use here.
    """
    return GeometricPredictor(request.camera, calibration=requested_calibration(request))


def requested_calibration(request: PredictorRequest) -> Calibration | None:
    """Return the calibration that is asked for as weights; None for the one of the package. Raises WeightsError.

    Weights of a network are passed over, because who asks may have them in hand for other images.
    """
    weights = request.weights
    if weights is None:
        return None
    if weights.suffix == _NETWORK_SUFFIX:
        log.warning("The geometric predictor has no use for %s, weights of the network; it takes its own.", weights)
        return None
    return read_calibration(weights)
