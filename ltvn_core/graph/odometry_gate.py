"""What odometry knows of two images of one trajectory: how far apart they can be at most, allowing for its drift.

Owns the allowance. It is evidence against false edges between perceptual aliases, and saves comparing what cannot be
near; it places a node only where images in a row show nothing in common (`graph.bridges`). Where odometry jumps, as
after a restart, it knows nothing, and nowhere where it stands still for the whole drive, which is how a drive without
odometry is recorded.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.graph.matching import Matches
from ltvn_core.types import FrameId, NodeId, Observation, Waypoint

_JUMP_M = 1.5
"""Two images in a row that are farther apart were not driven from one to the other."""
_SLACK_M, _SLACK_RAD = 0.6, 0.6
"""By so much the network's waypoint may be wrong."""
_PAUSE_S = 5.0
"""In a longer pause between two images a robot may be carried away without its odometry knowing."""
_DRIFT_RAD_PER_M = 0.02


class OdometryGate:
    """Odometry along one trajectory."""

    def __init__(self, observations: Sequence[Observation], config: BuildingConfig) -> None:
        """Take the images in the order of their frames."""
        ordered = sorted(observations, key=lambda seen: seen.step)
        self._row = {seen.step: k for k, seen in enumerate(ordered)}
        self._poses = np.array([seen.odometry for seen in ordered])
        steps_m = np.hypot(*np.diff(self._poses[:, :2], axis=0).T)
        self._path_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        stands_still = not np.ptp(self._poses, axis=0).any()
        self._segment = np.concatenate([[0], np.cumsum((steps_m > _JUMP_M) | stands_still)])
        self._stamps_s = np.array([seen.stamp for seen in ordered])
        self._config = config

    def may_be_near(self, frame: FrameId, nodes: Sequence[NodeId]) -> tuple[NodeId, ...]:
        """Return the nodes that could be within D_c or D_m of a frame, all of them if odometry is not used."""
        if not nodes or not self._config.odometry_drift:
            return tuple(nodes)
        here, there = self._row[frame], self._rows(nodes)
        apart = self._poses[there] - self._poses[here]
        reach = max(self._config.connect_distance, self._config.merge_distance)
        near = np.hypot(apart[:, 0], apart[:, 1]) <= reach + self._allowance_m(here, there)
        # d is at least sqrt(2) per radian, so what is turned far enough away is too far as well.
        near &= np.abs(wrap_angle(apart[:, 2])) <= reach / np.sqrt(2) + self._allowance_rad(here, there)
        return tuple(node for node, is_near in zip(nodes, near, strict=True) if is_near)

    def plausible(self, frame: FrameId, matches: Matches) -> NDArray[np.bool_]:
        """Tell for each match (N,) whether odometry allows its waypoint."""
        if not len(matches) or not self._config.odometry_drift:
            return np.ones(len(matches), bool)
        here, there = self._row[frame], self._rows(matches.nodes)
        driven = relative(self._poses[here], self._poses[there])
        gap_m = np.hypot(*(driven - matches.waypoints)[:, :2].T)
        gap_rad = np.abs(wrap_angle(driven[:, 2] - matches.waypoints[:, 2]))
        return (gap_m <= self._allowance_m(here, there)) & (gap_rad <= self._allowance_rad(here, there))

    def driven(self, frame: FrameId, other: FrameId) -> Waypoint | None:
        """Return where an image lies (3,) seen from another, by odometry alone.

        None where odometry is not used, jumps between the two, or cannot know because there is a pause between them.
        """
        here, there = self._row[frame], self._row[other]
        between = slice(min(here, there), max(here, there) + 1)
        if not self._config.odometry_drift or self._segment[here] != self._segment[there]:
            return None
        if (np.abs(np.diff(self._stamps_s[between])) > _PAUSE_S).any():
            return None
        return relative(self._poses[here], self._poses[there])

    def _rows(self, nodes: Sequence[NodeId]) -> NDArray[np.intp]:
        return np.array([self._row[node] for node in nodes], np.intp)

    def _allowance_m(self, here: int, there: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._within_segment(here, there, _SLACK_M, self._config.odometry_drift)

    def _allowance_rad(self, here: int, there: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._within_segment(here, there, _SLACK_RAD, _DRIFT_RAD_PER_M)

    def _within_segment(
        self, here: int, there: NDArray[np.intp], slack: float, drift_per_m: float
    ) -> NDArray[np.float64]:
        path_m = np.abs(self._path_m[there] - self._path_m[here])
        return np.where(self._segment[there] == self._segment[here], slack + drift_per_m * path_m, np.inf)
