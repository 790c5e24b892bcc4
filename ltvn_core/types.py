"""Data types that modules share: observations, commands and predictions of a robot.

Also owns two Protocols: `Predictor`, the interface between network and method, and `Renderer`, that of a simulator. The
interface of robots is `ltvn_core.robots.robot.Robot`. Contains no behaviour except the checks of its own fields.

Conventions: metres, radians, seconds; x forward, y left, yaw counter-clockwise in (-pi, pi].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import ImageError

Pose: TypeAlias = NDArray[np.float64]
"""(3,) or (..., 3): x_m, y_m, yaw_rad of a body in a world frame."""

Waypoint: TypeAlias = NDArray[np.float64]
"""(3,) or (..., 3): dx_m, dy_m, dtheta_rad of a target in the frame of a source."""

Rgb: TypeAlias = NDArray[np.uint8]
"""(H, W, 3) colours."""

Depth: TypeAlias = NDArray[np.float32]
"""(H, W), metres along the optical axis; 0 means no return."""

Features: TypeAlias = NDArray[np.generic]
"""(N, F): one opaque row per image, which only the predictor that encoded it can read."""

FrameId: TypeAlias = int
"""The step at which an image was taken; unique within a recording and within a map."""

NodeId: TypeAlias = FrameId
"""Id of a node, which equals the id of the frame that is its image."""

CONTROL_STEP_S = 0.1
"""Time between two control steps, in seconds of the robot's clock."""


class Tilt(NamedTuple):
    """Tilt of a camera relative to the ground, with the conventions of `CameraModel`."""

    pitch_rad: float
    """Tilt of the optical axis in radians, upwards positive."""
    roll_rad: float
    """Roll about the optical axis in radians; positive lowers the camera's right side."""


@dataclass(frozen=True, slots=True, eq=False)
class OriginalImage:
    """An image in the original form from the robot's camera, before it was rectified for a predictor."""

    jpeg: bytes
    """Compressed colours; may be smaller than the camera's image, with the same aspect ratio."""
    camera: CameraModel
    """The camera, scaled to the size of this image."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Observation:
    """One image with depth and odometry. Create it from external data with `preprocessing.preprocess_observation`."""

    rgb: Rgb
    """Colours (H, W, 3); after preprocessing they have the size that the predictor needs."""
    depth: Depth | None
    """Depth (H, W) in metres along the optical axis, 0 = no return; None if the robot has no depth camera. An image
    with only zeros also counts as one without depth: the camera is close to a wall, or nothing is in its range."""
    odometry: Pose
    """Pose (3,) in the odometry frame; drifts."""
    stamp: float
    """Time in seconds on the robot's clock."""
    step: FrameId
    """Number of the control step, which is the id of the image."""
    exact_pose: Pose | None = None
    """True pose (3,) in the world frame, in simulation only. Only the oracle, the evaluation, the recording and the
    page's drawing may read it; the method never does (a test checks this)."""
    original: OriginalImage | None = None
    """The camera's original image, if it was kept and differs from `rgb`."""
    tilt: Tilt | None = None
    """Tilt of the camera at this image, for a camera that is held by hand or mounted on a moving head; None if the tilt
    is that of its `CameraModel`."""

    @property
    def has_depth(self) -> bool:
        """Whether any pixel has depth. An image without depth is recorded, but not used where depth is needed."""
        return self.depth is not None and bool(self.depth.any())

    def require_depth(self, user: str) -> Depth:
        """Return the depth. Raises ImageError with the name of the `user` that needs it if there is none."""
        if self.depth is None:
            raise ImageError(
                f"Image {self.step} has no depth, and {user} needs it. Use a robot with a depth camera, or a predictor "
                "that works without depth."
            )
        return self.depth


class Twist(NamedTuple):
    """A velocity command."""

    linear_m_s: float
    """Forward speed in m/s; negative is backwards."""
    angular_rad_s: float
    """Turning rate in rad/s, counter-clockwise."""


ZERO_TWIST = Twist(0.0, 0.0)


class RobotState(NamedTuple):
    """State of a robot without an image: odometry, time and bumper."""

    odometry: Pose
    """Pose (3,) in the odometry frame."""
    stamp: float
    """Time in seconds on the robot's clock."""
    step: FrameId
    """Number of control steps so far."""
    bumper_pressed: bool
    """Whether the bumper is in contact now."""


class Prediction(NamedTuple):
    """Predictions for N (source, target) pairs."""

    reachability: NDArray[np.float64]
    """Reachability r (N,) in [0, 1]."""
    waypoints: Waypoint
    """Poses (N, 3) of the targets in the frames of the sources."""


class HeldFeatures(NamedTuple):
    """Features of N of the M images of a map, for a predictor that reads only few of them in full."""

    features: Features
    """Features (M, F) of all M images."""
    keys: Features
    """Short keys (M, K), by which the predictor selects the images to read."""
    rows: NDArray[np.intp]
    """Indices (N,) of the N images among the M."""
    stamps: NDArray[np.int64] | None = None
    """Numbers (M,) above 0, equal only for equal features, by which a predictor may keep a copy; None if unknown."""


class Renderer(Protocol):
    """Renders the image of a camera on a robot at a pose; exists only in simulation."""

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) uint8 and depth (H, W) float32 in metres seen from `pose` (3,)."""
        ...


class Predictor(Protocol):
    """f(o_i, o_j) -> (r, dx, dy, dtheta), in two halves so that each image is encoded once.

    A predictor that needs depth has an attribute `needs_depth = True`, see `is_usable`.
    """

    @property
    def fingerprint(self) -> str:
        """Identifier of the weights; a map stores it and rejects any other."""
        ...

    @property
    def camera(self) -> CameraModel:
        """The camera whose images `encode` takes; `preprocessing` rectifies the images of other cameras to it."""
        ...

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, F) features, one row per image."""
        ...

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) with targets (N, F) in one batch; a single source (1, F) is used for all targets."""
        ...


def is_usable(observation: Observation, predictor: Predictor) -> bool:
    """Tell whether a predictor can compare an image; one that needs depth cannot compare an image without depth."""
    return observation.has_depth or not getattr(predictor, "needs_depth", False)
