"""A mapping drive through a scene, all of whose ordered image pairs are labelled and predicted.

Owns what is true and what is predicted of a drive. Drives no robot; the poses come from `ltvn_core.data.drives`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ltvn_core.data.generate import label_all
from ltvn_core.data.labels import Limits
from ltvn_core.data.worlds import World
from ltvn_core.evaluate.ground import Ground
from ltvn_core.geometry import relative
from ltvn_core.graph.views import Views
from ltvn_core.model.assessment import predict_pairs
from ltvn_core.types import CONTROL_STEP_S, Camera, Intrinsics, Observation, Pose, Prediction, Predictor, Waypoint

if TYPE_CHECKING:
    from ltvn_core.sim.scenes import Scene


@dataclass(frozen=True, eq=False)
class Survey:
    """N images of a drive; a frame's number is its place in the drive."""

    scene: "Scene"
    camera: Camera
    observations: tuple[Observation, ...]
    """N images; their odometry is exact."""
    views: Views
    """The same images, encoded."""
    poses: Pose
    """(N, 3)"""
    waypoints: Waypoint
    """(N, N, 3): the truth, target in the frame of the source."""
    reachable: NDArray[np.bool_]
    """(N, N) by the criteria of the dataset."""
    overlap: NDArray[np.float32]
    """(N, N) share of the target's points that the source sees; nan where not measured."""
    predicted: Prediction
    """(N, N) and (N, N, 3)."""

    @property
    def ground(self) -> Ground:
        """Where edges between the images can be driven."""
        return Ground(self.scene, self.camera, self.views, dict(enumerate(self.poses)))


def survey(scene: "Scene", camera: Camera, predictor: Predictor, poses: Pose) -> Survey:
    """Look from the poses (N, 3) of a drive, and label and predict all ordered pairs."""
    images = len(poses)
    seen = tuple(_look(camera, pose, frame) for frame, pose in enumerate(poses))
    views = Views(predictor)
    views.add(seen)
    first, second = np.divmod(np.arange(images**2), images)
    depth_mm = np.rint(np.stack([each.depth for each in seen]) * 1000).astype(np.uint16)
    labels = label_all(World(scene.name, scene.clearance, camera), poses, depth_mm, first, second, Limits())
    predicted = predict_pairs(predictor, views.features(range(images)), first, second)
    square = (images, images)
    return Survey(
        scene,
        camera,
        seen,
        views,
        poses,
        relative(poses[:, None], poses[None]),
        labels.reachable.reshape(square),
        labels.overlap.reshape(square),
        Prediction(predicted.reachability.reshape(square), predicted.waypoints.reshape(*square, 3)),
    )


def _look(camera: Camera, pose: Pose, frame: int) -> Observation:
    rgb, depth = camera.render(pose, Intrinsics())
    return Observation(rgb, depth, pose, frame * CONTROL_STEP_S, frame, pose)
