"""Properties of a robot: its size, its speed limits and its camera. `LOCOBOT` is the LoCoBot of the paper.

Owns the only definition of a robot's radius, speeds and camera. Drives nothing.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import OptionError
from ltvn_core.types import Twist


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """The largest speeds and the tightest curve that a drive command may ask for."""

    linear_m_s: float = 0.5
    angular_rad_s: float = 1.0
    turning_radius_m: float = 0.0
    """Radius of the tightest curve of a car (Ackermann steering); 0 for a base that turns on the spot."""

    def bounded(self, twist: Twist) -> Twist:
        """Return `twist` scaled down to the limits; both speeds by the same factor, so that the arc stays the same.

        An arc that is too tight is replaced by the tightest allowed one.

        Raises:
            ValueError: A speed is NaN or infinite.
        """
        if not (math.isfinite(twist.linear_m_s) and math.isfinite(twist.angular_rad_s)):
            raise ValueError(
                f"A drive command must be two finite speeds, got linear {twist.linear_m_s} m/s and angular "
                f"{twist.angular_rad_s} rad/s; the robot stops. Send speeds within +-{self.linear_m_s} m/s and "
                f"+-{self.angular_rad_s} rad/s."
            )
        excess = max(abs(twist.linear_m_s) / self.linear_m_s, abs(twist.angular_rad_s) / self.angular_rad_s, 1.0)
        return self.curved(Twist(twist.linear_m_s / excess, twist.angular_rad_s / excess))

    def curved(self, twist: Twist) -> Twist:
        """Return `twist` with a curve no tighter than the turning circle; a car that stands still cannot turn."""
        if not self.turning_radius_m:
            return twist
        most_rad_s = abs(twist.linear_m_s) / self.turning_radius_m
        return Twist(twist.linear_m_s, min(max(twist.angular_rad_s, -most_rad_s), most_rad_s))


@dataclass(frozen=True, slots=True)
class AccelerationLimits:
    """Maximum accelerations, for speeding up and for braking.

    Braking is firm on purpose: from full speed the robot stops within 42 ms, so that a lease of 250 ms plus braking
    takes less than 300 ms.
    """

    linear_m_s2: float = 1.5
    angular_rad_s2: float = 6.0
    linear_braking_m_s2: float = 12.0
    angular_braking_rad_s2: float = 24.0


_HEADROOM_M = 0.1
_SPACE_KEY = "needed_space"


@dataclass(frozen=True, slots=True)
class NeededSpace:
    """The space around a robot's centre that must be free where it drives; see `RobotSpec.needed_space`."""

    radius_m: float
    height_m: float

    @classmethod
    def assumed(cls, camera: CameraModel) -> Self:
        """Return the space for an unknown robot: that of a LoCoBot, but no lower than a little above its camera."""
        known = LOCOBOT.needed_space
        return cls(known.radius_m, max(known.height_m, round(camera.height_m + _HEADROOM_M, 3)))

    @classmethod
    def recorded(cls, config: Mapping[str, Any]) -> Self | None:
        """Return the space in the settings of a recording or a map; None if they have none, or an impossible one."""
        found = config.get(_SPACE_KEY)
        if not isinstance(found, Mapping) or found.keys() != {"radius_m", "height_m"}:
            return None
        lengths = [found["radius_m"], found["height_m"]]
        are_lengths = all(isinstance(each, int | float) and 0 < each < math.inf for each in lengths)
        return cls(*map(float, lengths)) if are_lengths else None

    def to_config(self) -> dict[str, Any]:
        """Return the space as an entry of the settings of a recording or a map."""
        return {_SPACE_KEY: asdict(self)}

    def covering(self, other: "NeededSpace") -> "NeededSpace":
        """Return the space in which both robots fit."""
        return NeededSpace(max(self.radius_m, other.radius_m), max(self.height_m, other.height_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSpec:
    """The size, speeds and camera of a robot. Raises OptionError when a length is not positive."""

    name: str
    """Name of the robot for people."""
    radius_m: float
    """Radius of the circle around the turning point that contains the body."""
    height_m: float
    """Height of the body; the robot cannot pass under anything lower."""
    ground_clearance_m: float
    """Height of obstacles that the robot drives over, such as a rug."""
    camera: CameraModel
    """The camera and its mounting."""
    speeds: SpeedLimits = field(default_factory=SpeedLimits)
    """Limits of drive commands."""
    accelerations: AccelerationLimits = field(default_factory=AccelerationLimits)
    """Limits of accelerations."""

    def __post_init__(self) -> None:
        """Check the lengths."""
        if not (0 < self.radius_m < math.inf and 0 <= self.ground_clearance_m < self.height_m < math.inf):
            raise OptionError(
                f"{self.name}: a robot needs a radius above 0 m and a body higher than its ground clearance, got "
                f"radius_m {self.radius_m}, height_m {self.height_m}, ground_clearance_m {self.ground_clearance_m}."
            )

    @property
    def clear_radius_m(self) -> float:
        """Radius around the robot's centre that obstacle avoidance and labels keep free, rounded up to whole
        centimetres."""
        return math.ceil(self.radius_m * 100 - 1e-6) / 100

    @property
    def clear_height_m(self) -> float:
        """Height above the floor that obstacle avoidance keeps free: a little above the robot, because a tilted camera
        sees things higher than they hang."""
        return round(self.height_m + _HEADROOM_M, 3)

    @property
    def needed_space(self) -> NeededSpace:
        """Space that must be free where the robot drives."""
        return NeededSpace(self.clear_radius_m, self.clear_height_m)


LOCOBOT = RobotSpec(
    name="LoCoBot",
    radius_m=0.178,
    height_m=0.8,
    ground_clearance_m=0.05,
    camera=CameraModel.from_fov(96, 72, math.radians(69.4), height_m=0.6),
)
"""The simulated robot of the paper. Its body is as high as a table, so that it does not drive under one."""
