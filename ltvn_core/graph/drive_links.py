"""Links between drives with unrelated odometry: pairs of images, one of each drive, that surely show one place.

One match may be a perceptual alias. Several matches that agree on the transform between the two odometry frames are
not, unless whole areas look alike. So the matches vote, and the transform with the most votes counts if it has at least
a few votes (ours). Owns that vote; the matches come from the network.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import distance, relative, tilt_distance
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import DriveLink, OdometryGate
from ltvn_core.graph.operators import OperatorThresholds, connectable
from ltvn_core.types import FrameId, Observation

_APART = 0.35
"""Least d between two images of a drive that are both compared."""
_MOST_ASKED, _MOST_MET = 60, 300
"""Largest number of images of the later drive, and of the earlier one, that are compared, evenly spread."""
_BEST = 3
_MOST_MATCHES = 60
_LEAST_AGREEING = 3
"""Least number of matches that must agree; fewer count as perceptual aliases."""


@dataclass(frozen=True, slots=True, eq=False)
class DriveLinkSearch:
    """Searches for links between the drives of one map."""

    observations: Sequence[Observation]
    drive_starts: Sequence[FrameId]
    matcher: Matcher
    loop_closures: LoopClosureVerifier
    config: BuildingConfig

    def links(self) -> tuple[DriveLink, ...]:
        """Return the links between all drives; a few thousand comparisons for each pair of drives."""
        drives: dict[int, list[Observation]] = {}
        for seen in sorted(self.observations, key=lambda seen: seen.step):
            drives.setdefault(bisect_right(self.drive_starts, seen.step), []).append(seen)
        return tuple(link for pair in combinations(drives.values(), 2) for link in self._between(*pair))

    def _between(self, earlier: Sequence[Observation], later: Sequence[Observation]) -> list[DriveLink]:
        met = _spread(earlier, _MOST_MET)
        asked = _spread(later, _MOST_ASKED)
        search = self.matcher, self.loop_closures, self.config
        found = [link for frame in asked for link in surest_links(frame, met, *search)]
        rows = np.unique(np.linspace(0, len(found) - 1, min(len(found), _MOST_MATCHES)).astype(int)).tolist()
        left = [found[row] for row in rows]
        agreed = list[DriveLink]()
        while left:
            supporters = [self._agreeing(link, left) for link in left]
            best = max(supporters, key=len)
            if len({link.frame for link in best}) < min(_LEAST_AGREEING, len(asked)):
                break
            agreed += best
            # Where odometry jumps within a drive, the images after the jump may be linked as well.
            gate = self._gate(agreed)
            left = [link for link in left if link not in best and not gate.knows(link.frame, link.other)]
        return agreed

    def _agreeing(self, link: DriveLink, others: Sequence[DriveLink]) -> list[DriveLink]:
        """Return the links that agree with this one, itself included."""
        gate = self._gate([link])
        return [
            other
            for other in others
            if gate.plausible(other.frame, Matches.of_one(other.other, 1.0, other.waypoint)).all()
        ]

    def _gate(self, links: Sequence[DriveLink]) -> OdometryGate:
        return OdometryGate(self.observations, self.config, drive_starts=self.drive_starts, links=links)


def surest_links(
    frame: FrameId,
    others: Sequence[FrameId],
    matcher: Matcher,
    loop_closures: LoopClosureVerifier,
    config: BuildingConfig,
    *,
    gate: OdometryGate | None = None,
) -> list[DriveLink]:
    """Return the best matches of an image that may become edges, verified along both stretches of driving.

    With a `gate`, odometry must allow them, too.
    """
    thresholds = OperatorThresholds.building(config)
    found = matcher.match(matcher.keyframes.features([frame]), others)
    found = found.take(connectable(found, thresholds))
    if gate is not None:
        found = found.take(gate.plausible(frame, found))
    found = found.take(np.argsort(-found.reachability, kind="stable")[:_BEST])
    found = loop_closures.connections(frame, found, thresholds)
    return [DriveLink(frame, other, waypoint) for other, waypoint in zip(found.nodes, found.waypoints, strict=True)]


def _spread(drive: Sequence[Observation], most: int) -> list[FrameId]:
    """Return images of a drive that lie apart by odometry, evenly spread and limited in number.

    All images of a drive without odometry count as apart.
    """
    kept = list(drive[:1])
    for seen in drive[1:]:
        if _gap(kept[-1], seen) >= _APART:
            kept.append(seen)
    kept = kept if len(kept) > 1 else list(drive)
    rows = np.unique(np.linspace(0, len(kept) - 1, min(len(kept), most)).astype(int)).tolist()
    return [kept[row].step for row in rows]


def _gap(first: Observation, second: Observation) -> float:
    """Return the distance d between two images of a drive, by odometry and by the camera's tilt."""
    gap = float(distance(relative(first.odometry, second.odometry)))
    if first.tilt is None or second.tilt is None:
        return gap
    return math.hypot(gap, float(tilt_distance(first.tilt, second.tilt)))
