"""The nouns everything else is said in: what a robot senses, does and predicts.

Owns the data that cross module borders and the three Protocols (`Robot`, `Renderer`, `Predictor`) through which graph,
navigation and analysis meet the simulator and the network. Owns no behaviour beyond checking its own fields.

Conventions: metres, radians, seconds; x forward, y left, yaw counter-clockwise in (-pi, pi].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

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

IMAGE_WIDTH = 96
IMAGE_HEIGHT = 72


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One look at the world. Build it from outside data with `ltvn_core.preprocessing.observation`, which checks."""

    rgb: Rgb
    """(72, 96, 3) for the method; any size is accepted at the door and resized there."""
    depth: Depth
    """(72, 96), metres along the optical axis; 0 = no return."""
    odometry: Pose
    """(3,) in the odometry frame; drifts."""
    stamp: float
    """Seconds on the robot's clock."""
    step: FrameId
    """Count of control steps; names the image."""
    exact_pose: Pose | None = None
    """(3,) in the world frame, in simulation only. Only the oracle, the evaluation, the recording and the page's
    drawing may read it; the method never does (a test checks)."""


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


class Intrinsics(NamedTuple):
    """A pinhole camera without distortion that looks ahead."""

    width: int = IMAGE_WIDTH
    height: int = IMAGE_HEIGHT
    horizontal_fov_rad: float = float(np.deg2rad(69.4))
    height_m: float = 0.6
    """Height of the optical centre above the floor."""
    pitch_rad: float = 0.0
    """Tilt of the optical axis, upwards positive; 0 is level."""

    @property
    def focal_px(self) -> float:
        """Focal length in pixels, the same for both axes."""
        return self.width / 2 / float(np.tan(self.horizontal_fov_rad / 2))


class Prediction(NamedTuple):
    """What the network says of N (source, target) pairs."""

    reachability: NDArray[np.float64]
    """(N,) in [0, 1]."""
    waypoints: Waypoint
    """(N, 3): the target in the source's frame."""


class Robot(Protocol):
    """A body that can be driven. A drive command is a lease: it expires by itself and then the robot stops once."""

    def observe(self) -> Observation:
        """Take a picture now."""
        ...

    def state(self) -> RobotState:
        """Feel the body without looking: odometry, clock and bumper."""
        ...

    def drive(self, twist: Twist) -> None:
        """Command a velocity until the lease runs out or the next command."""
        ...

    def stop(self) -> None:
        """Stop now; nothing moves until the next `drive`."""
        ...


class Renderer(Protocol):
    """Renders what a camera at a pose sees."""

    def render(self, pose: Pose, intrinsics: Intrinsics) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) uint8 and depth (H, W) float32 in metres seen from `pose` (3,)."""
        ...


class Predictor(Protocol):
    """f(o_i, o_j) -> (r, dx, dy, dtheta), in two halves so that each image is encoded once."""

    @property
    def fingerprint(self) -> str:
        """Name the weights; a map remembers it and refuses another's."""
        ...

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, F) features, one row per image."""
        ...

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) or (1, F) with targets (N, F) in one batch; a single source meets all targets."""
        ...
