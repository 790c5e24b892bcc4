"""A simulated mapping drive with labels and predictions for all ordered image pairs, and its edges for measuring Eq. 3.

These are the edges that the method would add to a map, true and false ones. An edge is true if the pair is reachable in
the direction of the prediction. If the method predicts both directions and drives one of them in reverse, the pair may
be reachable in either direction. An edge is false if the robot could not drive it. Some pairs are drivable, but have
too little overlap to be labelled reachable; they are not evidence for Eq. 3. Drives no robot.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.evaluation.edge_driver import EdgeProposal, ImagedScene
from ltvn_core.geometry import distance, invert, relative
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import connectable, mergeable
from ltvn_core.network.training_data.pose_sampling import DatasetScene
from ltvn_core.network.training_data.reachability_labels import ReachabilityLimits
from ltvn_core.network.training_data.shards import label_image_pairs
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.oracle_predictor import is_drivable
from ltvn_core.types import (
    CONTROL_STEP_S,
    Features,
    FrameId,
    Observation,
    Pose,
    Prediction,
    Predictor,
    Renderer,
    Waypoint,
)

if TYPE_CHECKING:
    from ltvn_core.simulation.scene import Scene

_PAIRS_AT_ONCE = 8192


@dataclass(frozen=True, eq=False)
class PredictedDrive:
    """The N images of a drive with labels and predictions; the number of a frame is its index."""

    scene: "Scene"
    renderer: Renderer
    observations: tuple[Observation, ...]
    """N images; their odometry is exact."""
    keyframes: KeyframeStore
    """The same images, encoded."""
    poses: Pose
    """(N, 3)"""
    waypoints: Waypoint
    """(N, N, 3) true pose of the target in the frame of the source."""
    reachable: NDArray[np.bool_]
    """(N, N) whether a pair is reachable by the criteria of the dataset."""
    overlap: NDArray[np.float32]
    """(N, N) share of the target's points that the source sees; nan if not measured."""
    predicted: Prediction
    """Predicted r (N, N) and waypoints (N, N, 3)."""
    spec: RobotSpec = LOCOBOT
    """The robot that took the images."""

    @property
    def imaged_scene(self) -> ImagedScene:
        """The scene with these images, for driving edges between them."""
        return ImagedScene(
            scene=self.scene,
            camera=self.renderer,
            keyframes=self.keyframes,
            poses=dict(enumerate(self.poses)),
            spec=self.spec,
        )


def predict_drive(
    scene: "Scene", renderer: Renderer, predictor: Predictor, poses: Pose, spec: RobotSpec = LOCOBOT
) -> PredictedDrive:
    """Render the images at the poses (N, 3) of a drive, and label and predict all ordered pairs."""
    images = len(poses)
    observations = tuple(_observe(renderer, pose, frame, spec) for frame, pose in enumerate(poses))
    keyframes = KeyframeStore(predictor)
    keyframes.add(observations)
    first, second = np.divmod(np.arange(images**2), images)
    # Labels depend on poses and not on cameras, so they use depth of the dataset's camera.
    depth_mm = np.rint(np.stack([renderer.render(pose, LOCOBOT.camera)[1] for pose in poses]) * 1000).astype(np.uint16)
    labels = label_image_pairs(
        DatasetScene(scene.name, scene.clearance, renderer), poses, depth_mm, first, second, ReachabilityLimits()
    )
    predicted = _predict_pairs(predictor, keyframes.features(range(images)), first, second)
    square = (images, images)
    return PredictedDrive(
        scene=scene,
        renderer=renderer,
        observations=observations,
        keyframes=keyframes,
        poses=poses,
        waypoints=relative(poses[:, None], poses[None]),
        reachable=labels.reachable.reshape(square),
        overlap=labels.overlap.reshape(square),
        predicted=Prediction(predicted.reachability.reshape(square), predicted.waypoints.reshape(*square, 3)),
        spec=spec,
    )


def _predict_pairs(
    predictor: Predictor, features: Features, sources: NDArray[np.intp], targets: NDArray[np.intp]
) -> Prediction:
    """Compare pairs of rows (P,) of features, in batches of bounded memory."""
    parts = [slice(first, first + _PAIRS_AT_ONCE) for first in range(0, len(sources), _PAIRS_AT_ONCE)]
    found = [predictor.predict(features[sources[part]], features[targets[part]]) for part in parts]
    return Prediction(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _observe(renderer: Renderer, pose: Pose, frame: int, spec: RobotSpec) -> Observation:
    rgb, depth = renderer.render(pose, spec.camera)
    return Observation(rgb=rgb, depth=depth, odometry=pose, stamp=frame * CONTROL_STEP_S, step=frame, exact_pose=pose)


_MIN_FRAME_GAP = 2
"""Length in frames of a block; of the pairs whose images lie in the same two blocks, only one is used."""


class EdgeProposals:
    """The edges of one drive."""

    def __init__(self, drive: PredictedDrive, predictor: Predictor, method: Method) -> None:
        """Predict all pairs as the method would, but without temporal support, which is computed later for single
        pairs."""
        self._drive = drive
        self._method = method
        self._matcher = Matcher(predictor, drive.keyframes, method.matching)
        self._odometry_gate = OdometryGate(drive.observations, method.building)
        self._thresholds = method.building
        self._reachability, self._waypoints = _most_reachable_direction(drive, method)
        both = drive.reachable.T if method.matching.both_directions else np.zeros_like(drive.reachable)
        self._true = drive.reachable | both
        np.fill_diagonal(self._true, False)
        self._false = ~self._true & ~_drivable(drive)

    def edges(self) -> NDArray[np.bool_]:
        """Return which reachable pairs (N, N) become edges, judged only by r and d."""
        return self._near() & (self._reachability > self._thresholds.connect_reachability) & self._drive.reachable

    def errors(self) -> Waypoint:
        """Return the errors (E, 3) of waypoints of true edges, in the frame of the true target."""
        i, j = np.nonzero(self._true & self._near() & (self._reachability > self._thresholds.connect_reachability))
        return relative(self._drive.waypoints[i, j], self._waypoints[i, j])

    def true_edges(self, rng: np.random.Generator) -> Iterator[EdgeProposal]:
        """Yield true edges that the method would make, in random order."""
        pairs = np.argwhere(self._true & self._near() & (self._reachability > self._thresholds.connect_reachability))
        found = (self._proposal(i, j) for i, j in _scattered(rng.permutation(pairs)))
        return (proposal for proposal in found if proposal.connected)

    def false_edges(self, rng: np.random.Generator) -> Iterator[EdgeProposal]:
        """Yield false edges: first those that the method would add, then the others in order of r.

        Edges with an r so low that the method would stop an attempt are left out, because no edge of a map has such an
        r.
        """
        likely = self._near() & (self._reachability > self._method.driving.lost_reachability)
        pairs = rng.permutation(np.argwhere(self._false & likely))
        order = np.argsort(-self._reachability[tuple(pairs.T)], kind="stable")
        certain = [self._proposal(i, j) for i, j in _scattered(pairs[order])]
        yield from sorted(certain, key=lambda proposal: not proposal.connected)

    def _near(self) -> NDArray[np.bool_]:
        """Return which pairs (N, N) are predicted to be close enough for an edge; False on the diagonal."""
        near = distance(self._waypoints) < self._thresholds.connect_distance
        np.fill_diagonal(near, False)
        return near

    def _proposal(self, source: FrameId, target: FrameId) -> EdgeProposal:
        found = self._matcher.match(self._drive.keyframes.features([source]), (target,))
        found = self._matcher.with_mutual_support(found, source)
        true = bool(self._true[source, target])
        r = float(found.reachability[0])
        return EdgeProposal(
            source=source,
            target=target,
            waypoint=found.waypoints[0],
            reachability=r,
            true=true,
            connected=self._connects(source, found),
        )

    def _connects(self, source: FrameId, found: Matches) -> bool:
        apart = not mergeable(found, self._thresholds).any()
        return apart and bool(
            connectable(found, self._thresholds).all() and self._odometry_gate.plausible(source, found).all()
        )


def _drivable(drive: PredictedDrive) -> NDArray[np.bool_]:
    """Return which pairs (N, N) a robot could drive, in either direction along the same line."""
    count = len(drive.poses)
    first, second = np.divmod(np.arange(count**2), count)
    one_way = is_drivable(drive.scene.clearance, drive.poses[first], drive.poses[second]).reshape(count, count)
    return one_way | one_way.T


def _most_reachable_direction(drive: PredictedDrive, method: Method) -> tuple[NDArray[np.float64], Waypoint]:
    """Return r (N, N) and waypoints (N, N, 3) of the more reachable direction, if the method predicts both."""
    r, ahead = drive.predicted
    if not method.matching.both_directions:
        return r, ahead
    backwards = (r < r.T) & (distance(ahead) < method.matching.reverse_within)
    back = invert(np.swapaxes(ahead, 0, 1))
    return np.where(backwards, r.T, r), np.where(backwards[..., None], back, ahead)


def _scattered(pairs: NDArray[np.intp]) -> Iterator[tuple[int, int]]:
    """Yield pairs (P, 2), leaving out those that are nearly the same as an earlier pair."""
    seen: set[tuple[int, int]] = set()
    for i, j in pairs.tolist():
        if (i // _MIN_FRAME_GAP, j // _MIN_FRAME_GAP) not in seen:
            seen.add((i // _MIN_FRAME_GAP, j // _MIN_FRAME_GAP))
            yield i, j
