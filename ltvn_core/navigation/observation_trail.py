"""Observation trail: the last few observations of a query, with the odometry of each.

Owns which observations are kept. Odometry drifts, so only the observations of the last metres show where the robot is
now.
"""

from collections import deque
from collections.abc import Sequence

from ltvn_core.geometry import distance, relative
from ltvn_core.types import Features, Pose

_MAX_OBSERVATIONS = 24
"""Maximum number of observations kept."""
_MIN_SPACING = 0.2
"""Least d from the last kept observation at which a new one is kept."""


class ObservationTrail:
    """The observations of one query."""

    def __init__(self) -> None:
        """Start without any observation."""
        self._observations: deque[tuple[Pose, Features]] = deque(maxlen=_MAX_OBSERVATIONS)
        self.count = 0
        """Number of all observations that were kept, including those dropped since."""
        self.beginnings = 0
        """Number of times that the trail was restarted."""

    def add(self, odometry: Pose, features: Features) -> None:
        """Keep features (1, F) taken at an odometry pose (3,), unless the robot has hardly moved since the last."""
        if not self._observations or distance(relative(self._observations[-1][0], odometry)) > _MIN_SPACING:
            self._observations.append((odometry.copy(), features))
            self.count += 1

    def since(self, count: int) -> Sequence[tuple[Pose, Features]]:
        """Return the observations after the first `count` that are still kept, each a pose (3,) and features (1, F)."""
        return list(self._observations)[-(self.count - count) :] if self.count > count else ()

    def clear(self) -> None:
        """Restart the trail, because the way here was probably misjudged."""
        self._observations.clear()
        self.beginnings += 1
