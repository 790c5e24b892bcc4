"""Verification of loop closures: where two parts of a drive meet, the images must agree along both parts, not at one
place alone.

Two rooms may look alike from one place, but the views one metre farther on, or after a turn, tell them apart. Odometry
is exact over such a short stretch. So a match predicts the relative poses of the images around its two ends, and the
network must confirm them. Owns this check (ours), for edges between two passes of a drive.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import agree, compose, distance, relative, tilt_distance
from ltvn_core.graph.keyframes import odometry_of
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.operators import connectable
from ltvn_core.types import Features, FrameId, Waypoint

_PAIRS = 8
"""Number of pairs of images that are compared for one match, those farthest from its ends."""
_NEAR = 0.9
"""Images expected within this d of each other are compared."""
_GAP = (0.35, 0.35)
"""Largest error of a waypoint that confirms a pair, in m and rad."""
_MIN_REACHABILITY = 0.5
_MIN_SHARE = 0.5
"""Least share of the compared pairs that agree with a match."""
_MIN_PAIRS = 3
"""Least number of pairs for a verdict; with fewer, the match is accepted."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservationSequence:
    """The images shortly before and after one image of a drive, without that image."""

    features: Features
    """(K, F) features of the images."""
    poses: Waypoint
    """(K, 3) poses of these images by odometry, in the frame of that image."""
    tilts: NDArray[np.float64] | None = None
    """(K, 2) pitch and roll of the camera in rad; None if it cannot tilt, or the tilt is unknown."""


def connections(frame: FrameId, matches: Matches, matcher: Matcher, thresholds: BuildingConfig) -> Matches:
    """Return the matches of a stored frame that become edges: those connectable before and after `supported` lowers
    r."""
    found = supported(frame, matches.take(connectable(matches, thresholds)), matcher, thresholds)
    return found.take(connectable(found, thresholds))


def supported(frame: FrameId, matches: Matches, matcher: Matcher, thresholds: BuildingConfig) -> Matches:
    """Return the matches of a stored frame, each r lowered by contradicting evidence.

    First the images near in time are compared, see `Matcher.with_mutual_support`. The matches that are then still
    connectable are verified along the drive, see `verified`.
    """
    lowered = matcher.with_mutual_support(matches, frame)
    return verified(frame, lowered, matcher, connectable(lowered, thresholds))


def verified(frame: FrameId, matches: Matches, matcher: Matcher, asked: NDArray[np.bool_]) -> Matches:
    """Return the matches of a stored frame, with r set to 0 for those of `asked` (N,) that do not fit along the drive.

    Matches with images close in time need no such proof.
    """
    reach = matcher.config.closure_reach
    if not reach or not asked.any():
        return matches
    trusted = matches.reachability.copy()
    here = None
    near = set(matcher.keyframes.temporal_window(frame, reach))
    for k in np.flatnonzero(asked):
        if matches.nodes[k] not in near:
            here = here or _sequence_around(frame, matcher)
            trusted[k] *= _fits(here, matches.nodes[k], matches.waypoints[k], matcher)
    return matches.with_reachability(trusted)


def _fits(here: ObservationSequence, node: FrameId, waypoint: Waypoint, matcher: Matcher) -> bool:
    """Tell whether a match with a node at `waypoint` (3,) fits along the drive; True if too few images overlap to
    decide."""
    there = _sequence_around(node, matcher)
    first, second, expected = _expected_overlaps(here, replace(there, poses=compose(waypoint, there.poses)))
    if len(first) < _MIN_PAIRS:
        return True
    reachability, waypoints = matcher.match_pairs(here.features[first], there.features[second])
    agreed = agree(expected, waypoints, _GAP) & (reachability > _MIN_REACHABILITY)
    return bool(agreed.mean() >= _MIN_SHARE)


def _sequence_around(frame: FrameId, matcher: Matcher) -> ObservationSequence:
    """Return the images of the drive shortly before and after a frame."""
    keyframes = matcher.keyframes
    beside = keyframes.temporal_window(frame, matcher.config.closure_reach)
    seen = [keyframes.observation(other) for other in beside]
    tilts = [each.tilt for each in seen if each.tilt is not None]
    return ObservationSequence(
        keyframes.features(beside),
        relative(keyframes.observation(frame).odometry, odometry_of(seen)),
        np.array(tilts).reshape(-1, 2) if len(tilts) == len(seen) else None,
    )


def _expected_overlaps(
    here: ObservationSequence, there: ObservationSequence
) -> tuple[NDArray[np.intp], NDArray[np.intp], Waypoint]:
    """Return the rows (P,) of images of two sequences that should overlap, and their relative poses (P, 3).

    Both sequences are in one frame.
    """
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
    """Return the first few pairs, in the given order, in which no image occurs twice."""
    chosen, used_first, used_second = list[int](), set[int](), set[int]()
    for k, a, b in zip(order.tolist(), first[order].tolist(), second[order].tolist(), strict=True):
        if a not in used_first and b not in used_second and len(chosen) < _PAIRS:
            chosen.append(k)
            used_first.add(a)
            used_second.add(b)
    return np.array(chosen, np.intp)
