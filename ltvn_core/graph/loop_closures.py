"""Loop closures: where two parts of a drive meet, the images must agree along both, not at one place alone.

Two rooms may look alike from one place; what is seen a metre on, or after a turn, tells them apart. Odometry over so
short a stretch is exact, so a match foretells how the images around its ends lie to each other, and the network is
asked whether they do. Owns that question (ours), for edges between two passes of a drive.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import compose, distance, relative, tilt_distance, wrap_angle
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.operators import OperatorThresholds, connectable
from ltvn_core.types import Features, FrameId, Waypoint

_PAIRS = 8
"""Number of pairs of images that are compared for one match, those farthest from its ends."""
_NEAR = 0.9
"""Images expected within this d of each other are compared."""
_GAP_M, _GAP_RAD = 0.35, 0.35
"""Largest error of an answer."""
_MIN_REACHABILITY = 0.5
_MIN_PAIRS = 3
"""With fewer images that should see each other there is no verdict."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservationSequence:
    """Images taken on the way past one place, without the one taken there."""

    features: Features
    """(K, F)."""
    poses: Waypoint
    """(K, 3): where odometry puts them, seen from that place."""
    tilts: NDArray[np.float64] | None = None
    """(K, 2) pitch and roll of the camera in rad; None if it cannot tilt, or the tilt is unknown."""


class LoopClosureVerifier:
    """Verifies a match along the two stretches of driving that it joins."""

    def __init__(self, matcher: Matcher) -> None:
        """Ask through `matcher`, whose views hold the drives."""
        self._matcher = matcher
        self._keyframes = matcher.keyframes
        self._reach = matcher.config.closure_reach
        self._min_share = matcher.config.closure_share

    def connections(self, frame: FrameId, matches: Matches, thresholds: OperatorThresholds) -> Matches:
        """Return the matches of a held frame that become edges: connectable before and after `supported`."""
        supported = self.supported(frame, matches.take(connectable(matches, thresholds)), thresholds)
        return supported.take(connectable(supported, thresholds))

    def supported(self, frame: FrameId, matches: Matches, thresholds: OperatorThresholds) -> Matches:
        """Return the matches of a held frame, each r lowered by contradicting evidence.

        First by images near in time, see `Matcher.with_mutual_support`; then those still connectable by the drive, see
        `verified`.
        """
        lowered = self._matcher.with_mutual_support(matches, frame)
        return self.verified(frame, lowered, connectable(lowered, thresholds))

    def verified(self, frame: FrameId, matches: Matches, asked: NDArray[np.bool_]) -> Matches:
        """Return the matches of a held frame; r of those of `asked` (N,) that do not fit along the drive becomes 0.

        Images close in time need no such proof.
        """
        if not self._reach or not asked.any():
            return matches
        trusted = matches.reachability.copy()
        here = None
        near = set(self._keyframes.temporal_window(frame, self._reach))
        for k in np.flatnonzero(asked):
            if matches.nodes[k] not in near:
                here = here or self._sequence_around(frame)
                trusted[k] *= self._fits(here, matches.nodes[k], matches.waypoints[k])
        return matches.with_reachability(trusted)

    def _fits(self, here: ObservationSequence, node: FrameId, waypoint: Waypoint) -> bool:
        """Tell whether a node at `waypoint` (3,) fits the stretch that leads here; True where that is unknown."""
        there = self._sequence_around(node)
        first, second, expected = _expected_overlaps(here, replace(there, poses=compose(waypoint, there.poses)))
        if len(first) < _MIN_PAIRS:
            return True
        agreed = self._pairs_agree(here.features[first], there.features[second], expected)
        return bool(agreed.mean() >= self._min_share)

    def _sequence_around(self, frame: FrameId) -> ObservationSequence:
        """Return what the drive saw before and after a frame."""
        beside = self._keyframes.temporal_window(frame, self._reach)
        seen = [self._keyframes.observation(other) for other in beside]
        odometry = np.array([each.odometry for each in seen]).reshape(-1, 3)
        tilts = [each.tilt for each in seen if each.tilt is not None]
        return ObservationSequence(
            self._keyframes.features(beside),
            relative(self._keyframes.observation(frame).odometry, odometry),
            np.array(tilts).reshape(-1, 2) if len(tilts) == len(seen) else None,
        )

    def _pairs_agree(self, first: Features, second: Features, expected: Waypoint) -> NDArray[np.bool_]:
        """Tell for P pairs of images whether the network confirms their expected relative poses (P, 3) in either
        direction."""
        reachability, waypoints = self._matcher.match_pairs(first, second)
        gap = relative(expected, waypoints)
        near = (np.hypot(gap[:, 0], gap[:, 1]) < _GAP_M) & (np.abs(wrap_angle(gap[:, 2])) < _GAP_RAD)
        return near & (reachability > _MIN_REACHABILITY)


def _expected_overlaps(
    here: ObservationSequence, there: ObservationSequence
) -> tuple[NDArray[np.intp], NDArray[np.intp], Waypoint]:
    """Return which images of two sequences, in one frame, should see each other, and their relative poses (P, 3)."""
    lie = relative(here.poses[:, None], there.poses[None])
    far = np.linalg.norm(here.poses[:, :2], axis=-1)[:, None] + np.linalg.norm(there.poses[:, :2], axis=-1)[None]
    first, second = np.nonzero(np.hypot(distance(lie), _tilt_distances(here, there)) < _NEAR)
    rows = _disjoint_pairs(first, second, np.argsort(-far[first, second], kind="stable"))
    return first[rows], second[rows], lie[first[rows], second[rows]]


def _tilt_distances(here: ObservationSequence, there: ObservationSequence) -> NDArray[np.float64]:
    """Return the (K, L) differences of tilt between two sequences, as d; 0 where unknown."""
    if here.tilts is None or there.tilts is None:
        return np.zeros((len(here.poses), len(there.poses)))
    return tilt_distance(here.tilts[:, None], there.tilts[None])


def _disjoint_pairs(first: NDArray[np.intp], second: NDArray[np.intp], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the first few pairs in which no image occurs twice."""
    chosen = list[int]()
    used_first = set[int]()
    used_second = set[int]()
    for k in order.tolist():
        a = int(first[k])
        b = int(second[k])
        if a not in used_first and b not in used_second and len(chosen) < _PAIRS:
            chosen.append(k)
            used_first.add(a)
            used_second.add(b)
    return np.array(chosen, np.intp)
