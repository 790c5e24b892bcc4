"""Quality of the connection to a real robot. Owns the limits beyond which it counts as weak or lost; connects to
nothing.

A robot of your own may provide a method `link_report()`.
"""

from dataclasses import dataclass
from enum import StrEnum

STALE_S = 0.5
"""Age above which an image is stale, in seconds."""
_OLD_S = 0.3
_FEW_HZ = 5.0
_MANY_LOST = 0.1


class LinkQuality(StrEnum):
    """Quality of the connection to a robot."""

    GOOD = "good"
    WEAK = "weak"
    """The robot can be driven, but images are rare, late or lost."""
    LOST = "lost"
    """The robot stands still and is not driven."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """Current state of the connection."""

    is_connected: bool
    """Whether the other end is connected."""
    picture_age_s: float
    """Time since the newest image arrived, in seconds."""
    odometry_age_s: float
    """Time since the newest odometry arrived, in seconds."""
    pictures_hz: float
    """Recent rate of images per second."""
    lost_share: float
    """Share of recently sent images that were lost, in [0, 1]."""
    battery: float | None = None
    """Charge of the battery, in [0, 1]; None if the robot does not report it."""
    stopped_because: str | None = None
    """Reason why commands are ignored until the driver releases the controls; None if they are not."""
    restrained_because: str | None = None
    """Reason why a guard on the robot refuses to drive forwards, as commanded; None if it does not."""

    @property
    def quality(self) -> LinkQuality:
        """How good the connection is."""
        if not self.is_connected or self.picture_age_s > STALE_S:
            return LinkQuality.LOST
        is_weak = (
            max(self.picture_age_s, self.odometry_age_s) > _OLD_S
            or self.pictures_hz < _FEW_HZ
            or self.lost_share > _MANY_LOST
        )
        return LinkQuality.WEAK if is_weak else LinkQuality.GOOD
