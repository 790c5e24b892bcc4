"""People around the robot: detects their motion, and remembers the last position of each who is out of view.

A person is forgotten when an image shows the position to be free, or some seconds after the last sighting. People are
detected by motion alone; a person who never moved counts as an obstacle. Decides nothing.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ltvn_core.cameras.depth_scan import FREE_BEYOND_M, DepthScan
from ltvn_core.geometry import relative

BODY_M = 0.25
"""Radius of a person seen from above, in metres."""
_KEPT_S = 12.0
"""Time for which a person is remembered after the last sighting, in seconds."""
_ABOUT_S = 1800.0
"""Time after the last motion during which a person may come from anywhere, in seconds."""
_ONE_BODY_M = 0.3
"""Moving points nearer to each other than this belong to one body."""
MOVING_POINTS = 8
"""Least number of moving points that count as a person."""
_STEP_M = 0.7
"""Distance within which a moving person is matched to one seen before, in metres."""
_MIDDLE_M = 0.1
"""Half width of the strip of the scan that shows the middle of a body, in metres."""
_THROUGH_M = 0.08
"""A person is gone if the scan reaches to within this distance of the middle of the body, in metres."""


class Bystander(NamedTuple):
    """A person who was seen to move."""

    place: NDArray[np.float64]
    """(2,) middle of the body in the odometry frame."""
    seen_s: float
    """Time of the last sighting, in seconds on the robot's clock."""


class Bystanders:
    """Remembers people for a navigator, through all its queries."""

    def __init__(self) -> None:
        """Start without people."""
        self._moved_s = -math.inf
        self._known: list[Bystander] = []

    def are_about(self, stamp: float) -> bool:
        """Tell whether motion was seen in the time before `stamp` seconds, so that a person may come from anywhere."""
        return 0 <= stamp - self._moved_s < _ABOUT_S

    def near(self, stamp: float) -> NDArray[np.float64]:
        """Return (N, 2) last known positions of people at `stamp` seconds, in the odometry frame."""
        kept = [each.place for each in self._known if 0 <= stamp - each.seen_s < _KEPT_S]
        return np.array(kept, np.float64).reshape(-1, 2)

    def look(self, scan: DepthScan, moving: NDArray[np.float64], *, is_noticed: bool = False) -> None:
        """Update the people with an image: its scan, and its moving points (M, 2) in the odometry frame.

        If motion `is_noticed`, somebody is about, even one who is too far away to locate.
        """
        stamp = scan.stamp
        seen = [Bystander(_centred(_middle(scan, body), scan), stamp) for body in _bodies(moving)]
        if seen or is_noticed:
            self._moved_s = stamp
        others = [
            each
            for each in self._known
            if 0 <= stamp - each.seen_s < _KEPT_S
            and all(math.dist(each.place, other.place) > _STEP_M for other in seen)
        ]
        looked = (_looked_for(each, scan) for each in others)
        self._known = [*seen, *(each for each in looked if each is not None)]


def _bodies(moving: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Split moving points (M, 2) into bodies, each with its points (K, 2)."""
    if len(moving) < MOVING_POINTS:
        return []
    near = KDTree(moving).sparse_distance_matrix(KDTree(moving), _ONE_BODY_M, output_type="coo_matrix")
    count, labels = connected_components(near, directed=False)
    bodies = [moving[labels == label] for label in range(count)]
    return [body for body in bodies if len(body) >= MOVING_POINTS]


def _middle(scan: DepthScan, body: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middle (2,) of a body from the points (K, 2) of its near side."""
    gaps = body - scan.pose[:2]
    away_m = np.hypot(*gaps.T)
    direction = (gaps / np.maximum(away_m, 1e-6)[:, None]).mean(axis=0)
    direction /= max(float(np.hypot(*direction)), 1e-6)
    return scan.pose[:2] + (float(np.quantile(away_m, 0.1)) + BODY_M) * direction


def _looked_for(known: Bystander, scan: DepthScan) -> Bystander | None:
    """Return a person after a look at an image: still there, moved, or unchanged if out of view; None if gone."""
    ahead, left, _ = relative(scan.pose, np.array([*known.place, 0.0]))
    away_m = math.hypot(ahead, left)
    half_rad = math.asin(min(1.0, _MIDDLE_M / max(away_m, _MIDDLE_M)))
    bearing = math.atan2(left, ahead)
    ranges_m = scan.between(bearing - half_rad, bearing + half_rad)
    if ranges_m is None:
        return known
    nearest_m = float(ranges_m.min())
    if nearest_m > away_m - _THROUGH_M:
        return None
    if nearest_m < away_m - 2 * BODY_M:
        return known  # Something hides the person.
    gap = known.place - scan.pose[:2]
    place = scan.pose[:2] + gap / max(away_m, 1e-6) * (nearest_m + BODY_M)
    return Bystander(_centred(place, scan), scan.stamp)


def _centred(place: NDArray[np.float64], scan: DepthScan) -> NDArray[np.float64]:
    """Return the middle (2,) of the body that a scan shows at `place` (2,); `place` itself if no body is that wide."""
    bearings, ranges_m = scan.things()
    gap = place - scan.pose[:2]
    aside = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1) * ranges_m[:, None] - gap
    here = np.hypot(*aside.T) < 2 * BODY_M
    here &= ranges_m < np.min(ranges_m, where=here, initial=np.inf) + BODY_M
    if not here.any():
        return place
    nearest_m = float(ranges_m[here].min())
    turn = math.atan2(gap[1], gap[0])
    across = np.angle(np.exp(1j * (bearings[here] - turn)))
    if not BODY_M < nearest_m * np.ptp(across) < 2.4 * BODY_M:
        return place
    middle = turn + float(across.min() + across.max()) / 2
    return scan.pose[:2] + (nearest_m + BODY_M) * np.array([math.cos(middle), math.sin(middle)])


_YOUNGEST_S, _OLDEST_S = 0.3, 3.0
"""Least and greatest age of the earlier images that an image is compared with, in seconds."""
_SAME_PLACE_M = 0.2
"""Distance to a point of an earlier image within which a point counts as static, in metres."""
_SOMEBODY_POINTS, _SOMEBODY_BEARINGS = 16, 4
"""Least numbers of moving points and of bearings that count as a person, rather than as a pole between two pixels."""
_PLACED_M = 2.5
"""Distance beyond which a moving person is noticed but not located, in metres."""


class MovingObstacles:
    """Detects moving points by comparison with the depth images of the last seconds."""

    def __init__(self, bystanders: Bystanders) -> None:
        """Start with an empty memory; moving people are reported to `bystanders`."""
        self._bystanders = bystanders
        self._scans: deque[DepthScan] = deque(maxlen=24)

    def moving(self, scan: DepthScan, things: NDArray[np.float64], nearby: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return (M,) which solid points (M, 3) of an image have moved, and remember the image.

        A point is its position in the odometry frame and its height. If the moving points are not as wide as a person,
        only those that are `nearby` (M,) can be a person.
        """
        moved = self._moved(scan.stamp, things)
        things = things[:, :2]
        bearings = scan.bins(scan.polar(things[moved])[1])
        is_wide = len(bearings) >= _SOMEBODY_POINTS and len(np.unique(bearings)) >= _SOMEBODY_BEARINGS
        placed = np.hypot(*(things - scan.pose[:2]).T) < _PLACED_M if is_wide else nearby
        self._bystanders.look(scan, things[moved & placed], is_noticed=is_wide)
        self._scans.append(scan)
        return moved

    def _moved(self, stamp: float, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        free = np.zeros(len(points), bool)
        asked = np.arange(len(points))
        for scan in reversed(self._scans):
            if not len(asked):
                break
            if _YOUNGEST_S <= stamp - scan.stamp <= _OLDEST_S:
                was_free, was_there = _votes(scan, points[asked])
                free[asked] |= was_free
                free[asked[was_there]] = False
                asked = asked[~was_there]  # A point that stood still is not moving, whatever older images show.
        return free


def _votes(scan: DepthScan, points: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points (M, 3) an earlier image showed to be free (M,), and which as an obstacle (M,)."""
    away_m, bearing = scan.polar(points)
    inside = scan.inside(bearing)
    beside = scan.beside(bearing)
    free = inside & scan.shows_past(bearing, away_m + FREE_BEYOND_M)
    free &= points[:, 2] > scan.seen_above(bearing, away_m)
    return free, inside & (np.abs(beside - away_m) < _SAME_PLACE_M).any(axis=0)
