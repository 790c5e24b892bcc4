"""A simulated mapping drive with labels and predictions for all ordered image pairs. No robot is driven."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.imaged_scene import ImagedScene
from ltvn_core.geometry import relative
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.network.metrics.pair_evaluation import predict_pairs
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.training_data.reachability_labels import ReachabilityLimits
from ltvn_core.training_data.scene_protocols import DatasetScene
from ltvn_core.training_data.shard_generation import label_image_pairs
from ltvn_core.types import CONTROL_STEP_S, Observation, Pose, Prediction, Predictor, Renderer, Waypoint

if TYPE_CHECKING:
    from ltvn_core.simulation.scene_registry import Scene


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
    """(N, N) by the criteria of the dataset."""
    overlap: NDArray[np.float32]
    """(N, N) share of the target's points that the source sees; nan where not measured."""
    predicted: Prediction
    """(N, N) and (N, N, 3)."""
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
    # Labels are of poses and not of cameras, so they come from the depth of the dataset's.
    depth_mm = np.rint(np.stack([renderer.render(pose, LOCOBOT.camera)[1] for pose in poses]) * 1000).astype(np.uint16)
    labels = label_image_pairs(
        DatasetScene(scene.name, scene.clearance, renderer), poses, depth_mm, first, second, ReachabilityLimits()
    )
    predicted = predict_pairs(predictor, keyframes.features(range(images)), first, second)
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


def _observe(renderer: Renderer, pose: Pose, frame: int, spec: RobotSpec) -> Observation:
    rgb, depth = renderer.render(pose, spec.camera)
    return Observation(rgb=rgb, depth=depth, odometry=pose, stamp=frame * CONTROL_STEP_S, step=frame, exact_pose=pose)
