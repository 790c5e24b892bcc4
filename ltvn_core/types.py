"""The data that cross module borders: what a robot senses, does and predicts.

Owns these types and two Protocols: `Predictor`, the network's side of the border to the method, and `Renderer`, the
simulator's. The robot's side is `ltvn_core.robots.robot.Robot`. Owns no behaviour beyond checking its own fields.

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
"""(3,) or (..., 3): x_m, y_m, yaw_rad of a body in some world frame."""

Waypoint: TypeAlias = NDArray[np.float64]
"""(3,) or (..., 3): dx_m, dy_m, dtheta_rad of a target in the frame of a source."""

Rgb: TypeAlias = NDArray[np.uint8]
"""(H, W, 3)."""

Depth: TypeAlias = NDArray[np.float32]
"""(H, W), metres along the optical axis; 0 means no return."""

Features: TypeAlias = NDArray[np.generic]
"""(N, F): one opaque row per image; only the predictor that made it can read it."""

FrameId: TypeAlias = int
"""The step at which an image was taken; unique within a recording and within a map."""

NodeId: TypeAlias = FrameId
"""A node is named after the frame that is its image."""

CONTROL_STEP_S = 0.1
"""Robot time between two control steps."""


class Tilt(NamedTuple):
    """How a camera is tilted against the ground, as `CameraModel` says it."""

    pitch_rad: float
    """Tilt of the optical axis, upwards positive."""
    roll_rad: float
    """Turn about the optical axis; positive lowers the camera's right side."""


@dataclass(frozen=True, slots=True, eq=False)
class OriginalImage:
    """The picture that a robot's camera delivered, before it was rectified for a predictor."""

    jpeg: bytes
    """Compressed colours; perhaps smaller than the camera's own picture, never of another aspect."""
    camera: CameraModel
    """The camera, scaled to the size of this picture."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Observation:
    """One image with depth and odometry. Make it from outside data with `preprocessing.preprocess_observation`."""

    rgb: Rgb
    """(H, W, 3); of the size that the predictor asks for once it has come through the door."""
    depth: Depth | None
    """(H, W), metres along the optical axis, 0 = no return; None where the robot has no depth camera at all. Zero
    everywhere is an image without depth too: the camera stands before a wall, or looks into the open."""
    odometry: Pose
    """(3,) in the odometry frame; drifts."""
    stamp: float
    """Seconds on the robot's clock."""
    step: FrameId
    """Count of control steps; names the image."""
    exact_pose: Pose | None = None
    """(3,) in the world frame, in simulation only. Only the oracle, the evaluation, the recording and the page's
    drawing may read it; the method never does (a test checks)."""
    original: OriginalImage | None = None
    """The camera's own picture where it was kept and is another than `rgb`."""
    tilt: Tilt | None = None
    """How the camera was tilted when it took this image, where that changes: a camera that is held by hand or on a
    moving head. None where it is tilted as its `CameraModel` says."""

    @property
    def has_depth(self) -> bool:
        """Whether any pixel has depth. An image without is kept and recorded, and used by nothing that needs depth."""
        return self.depth is not None and bool(self.depth.any())

    def require_depth(self, user: str) -> Depth:
        """Return the depth. Raises ImageError, naming the `user` that cannot do without, where there is none."""
        if self.depth is None:
            raise ImageError(
                f"Image {self.step} has no depth, and {user} needs it. Use a robot with a depth camera, or a predictor "
                "that works from colours alone."
            )
        return self.depth


class Twist(NamedTuple):
    """A velocity command."""

    linear_m_s: float
    """Forward speed; negative backs up."""
    angular_rad_s: float
    """Turning rate, counter-clockwise."""


ZERO_TWIST = Twist(0.0, 0.0)


class RobotState(NamedTuple):
    """What the body feels without looking."""

    odometry: Pose
    """(3,) in the odometry frame."""
    stamp: float
    """Seconds on the robot's clock."""
    step: FrameId
    """Count of control steps so far."""
    bumper_pressed: bool
    """The bumper touches something now."""


class Prediction(NamedTuple):
    """What the network says of N (source, target) pairs."""

    reachability: NDArray[np.float64]
    """(N,) in [0, 1]."""
    waypoints: Waypoint
    """(N, 3): the target in the source's frame."""


class HeldFeatures(NamedTuple):
    """The features of N of the M images that a map holds, for a predictor that reads few of them in full."""

    features: Features
    """(M, F)."""
    keys: Features
    """(M, K): by which the predictor finds out which images are worth reading."""
    rows: NDArray[np.intp]
    """(N,): which of the M."""


class Renderer(Protocol):
    """Renders what a camera on a robot at a pose sees; only a simulator has one."""

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) uint8 and depth (H, W) float32 in metres seen from `pose` (3,)."""
        ...


class Predictor(Protocol):
    """f(o_i, o_j) -> (r, dx, dy, dtheta), in two halves so that each image is encoded once.

    A predictor that cannot work without depth says so by an attribute `needs_depth = True`, see `is_usable`.
    """

    @property
    def fingerprint(self) -> str:
        """Name the weights; a map remembers it and refuses another's."""
        ...

    @property
    def camera(self) -> CameraModel:
        """The camera whose images `encode` takes; `preprocessing` rectifies those of any other camera to it."""
        ...

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, F) features, one row per image."""
        ...

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) or (1, F) with targets (N, F) in one batch; a single source meets all targets."""
        ...


def is_usable(observation: Observation, predictor: Predictor) -> bool:
    """Tell whether a predictor can compare an image: one that needs depth cannot compare an image without any."""
    return observation.has_depth or not getattr(predictor, "needs_depth", False)
