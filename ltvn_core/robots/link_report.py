"""How well a robot that is not simulated is heard. Owns when it counts as lost; speaks to no robot.

A robot of one's own may offer it as a method `link_report()`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

STALE_S = 0.5
"""An image older than this is no image of now."""
_OLD_S = 0.3
_FEW_HZ = 5.0
_MANY_LOST = 0.1


class LinkQuality(StrEnum):
    """How well a robot is heard, in a word."""

    GOOD = "good"
    WEAK = "weak"
    """It can be driven, but pictures are few, late or get lost."""
    LOST = "lost"
    """It stands, and is not driven."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """What is known of the link now."""

    is_connected: bool
    """Whether anybody is at the other end."""
    picture_age_s: float
    """Seconds since the newest picture came."""
    odometry_age_s: float
    """Seconds since the robot last said where it is."""
    pictures_hz: float
    """Pictures a second lately."""
    lost_share: float
    """Share of the pictures that were sent lately and never came, in [0, 1]."""
    battery: float | None = None
    """How full it is, in [0, 1]; None where the robot does not say."""
    stopped_because: str | None = None
    """Why nothing is driven until whoever drives lets go; None where all is well."""

    @property
    def quality(self) -> LinkQuality:
        """The word for it."""
        if not self.is_connected or self.picture_age_s > STALE_S:
            return LinkQuality.LOST
        is_weak = (
            max(self.picture_age_s, self.odometry_age_s) > _OLD_S
            or self.pictures_hz < _FEW_HZ
            or self.lost_share > _MANY_LOST
        )
        return LinkQuality.WEAK if is_weak else LinkQuality.GOOD


def link_of(robot: object) -> Callable[[], LinkReport] | None:
    """Return what a robot says of its link; None where it has none, as in simulation."""
    return getattr(robot, "link_report", None)
