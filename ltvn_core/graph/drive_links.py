"""Links between drives with unrelated odometry: pairs of images, one of each drive, that surely show one place.

One match may be a perceptual alias. Several matches that agree on the transform between the two odometry frames are
not, unless whole areas look alike. So the matches vote, and the transform with the most votes counts if it has at least
a few votes (ours). Owns that vote; the matches come from the network.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import distance, relative, tilt_distance
from ltvn_core.graph import loop_closures
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.odometry_gate import DriveLink, OdometryGate
from ltvn_core.graph.operators import connectable
from ltvn_core.types import FrameId, Observation

_APART = 0.35
"""Least d between two images of a drive that are both compared."""
_MOST_ASKED, _MOST_MET = 60, 300
"""Largest number of images of the later drive, and of the earlier one, that are compared, evenly spread."""
_ASKED_EVERY, _MET_EVERY = 5, 3
"""Number of images of which one is compared in a short drive, so that joining drives costs less than mapping them."""
_LEAST_ASKED, _LEAST_MET = 20, 60
_BEST = 3
_VOTE_EVERY = 4
"""Number of images of the later drive after which the links found so far are counted."""
_SURE = 6
"""Number of images that must agree before the others are compared only with images that are near by their links."""
_ENOUGH = 30
"""Number of agreeing links beyond which more would hardly tell more."""
_LEAST_AGREEING = 3
"""Least number of matches that must agree; fewer count as perceptual aliases."""


def drive_links(
    observations: Sequence[Observation], drive_starts: Sequence[FrameId], matcher: Matcher, config: BuildingConfig
) -> tuple[DriveLink, ...]:
    """Return the links between all drives of one map; a few thousand comparisons for each pair of drives."""
    drives: dict[int, list[Observation]] = {}
    for seen in sorted(observations, key=lambda seen: seen.step):
        drives.setdefault(bisect_right(drive_starts, seen.step), []).append(seen)
    found = list[DriveLink]()
    for earlier, later in combinations(drives.values(), 2):
        gate = OdometryGate([*earlier, *later], config, drive_starts=drive_starts)
        found += _links_between(earlier, later, gate, matcher, config)
    return tuple(found)


def _links_between(
    earlier: Sequence[Observation],
    later: Sequence[Observation],
    gate: OdometryGate,
    matcher: Matcher,
    config: BuildingConfig,
) -> list[DriveLink]:
    """Return the links between two drives that agree.

    The images of the later drive are compared in an order that covers it ever more densely. When many agree on the
    transform, the others are compared only with the images that are near by it.
    """
    met = _spread(earlier, min(_MOST_MET, max(len(earlier) // _MET_EVERY, _LEAST_MET)))
    asked = _spread(later, min(_MOST_ASKED, max(len(later) // _ASKED_EVERY, _LEAST_ASKED)))
    links = _Votes(gate)
    for number, frame in enumerate(_ever_denser(asked)):
        if number and number % _VOTE_EVERY == 0:
            links.vote(least=_SURE)
        if not links.gate.knows(frame, met[0]):
            links.add(surest_links(frame, met, matcher, config))
        elif len(links.agreed) < _ENOUGH:
            links.add(surest_links(frame, links.gate.may_be_near(frame, met), matcher, config, best=1))
    links.vote(least=min(_LEAST_AGREEING, len(asked)))
    return links.agreed


class _Votes:
    """The links between two drives that were found so far, and those of them that agree."""

    def __init__(self, gate: OdometryGate) -> None:
        """Judge by the odometry of both drives."""
        self.agreed: list[DriveLink] = []
        self.gate = gate
        self._found: list[DriveLink] = []
        self._alone: list[OdometryGate] = []
        """For each link the gate with this link only."""
        self._supporters: list[set[int]] = []
        """For each link the numbers of the links that agree with it, itself included."""

    def add(self, links: Sequence[DriveLink]) -> None:
        """Add links that were found."""
        for link in links:
            number = len(self._found)
            self._found.append(link)
            self._alone.append(self.gate.linked([link]))
            self._supporters.append({k for k, other in enumerate(self._found) if self._alone[-1].allows(other)})
            for k in range(number):
                if self._alone[k].allows(link):
                    self._supporters[k].add(number)

    def vote(self, *, least: int) -> None:
        """Find the links that agree: again and again the most of those left, if they are of `least` images."""
        agreed = list[int]()
        left = set(range(len(self._found)))
        along = sorted(left, key=lambda number: self._found[number].frame)
        while left:
            best = max((self._supporters[number] & left for number in along if number in left), key=len)
            if len({self._found[number].frame for number in best}) < least:
                break
            agreed += [number for number in along if number in best]
            # Where odometry jumps within a drive, the images after the jump may be linked as well.
            gate = self.gate.linked([self._found[number] for number in agreed])
            left -= best
            left = {n for n in left if not gate.knows(self._found[n].frame, self._found[n].other)}
        self.agreed = [self._found[number] for number in agreed]
        self.gate = self.gate.linked(self.agreed)


def _ever_denser(frames: Sequence[FrameId]) -> list[FrameId]:
    """Return all frames, first few that are evenly spread, then those between them."""
    ordered = dict[FrameId, None]()
    step = len(frames)
    while step:
        ordered |= dict.fromkeys(frames[step // 2 :: step])
        step //= 2
    return [*ordered]


def surest_links(
    frame: FrameId,
    others: Sequence[FrameId],
    matcher: Matcher,
    config: BuildingConfig,
    *,
    gate: OdometryGate | None = None,
    best: int = _BEST,
) -> list[DriveLink]:
    """Return the best matches of an image that may become edges, verified along both stretches of driving.

    With a `gate`, odometry must allow them, too.
    """
    found = matcher.match(matcher.keyframes.features([frame]), others)
    found = found.take(connectable(found, config))
    if gate is not None:
        found = found.take(gate.plausible(frame, found))
    found = found.take(np.argsort(-found.reachability, kind="stable")[:best])
    found = loop_closures.connections(frame, found, matcher, config)
    return [DriveLink(frame, other, waypoint) for other, waypoint in zip(found.nodes, found.waypoints, strict=True)]


def _spread(drive: Sequence[Observation], most: int) -> list[FrameId]:
    """Return images of a drive that lie apart by odometry and tilt, evenly spread and limited in number.

    All images of a drive without odometry count as apart.
    """
    kept = list(drive[:1])
    for seen in drive[1:]:
        gap = float(distance(relative(kept[-1].odometry, seen.odometry)))
        if kept[-1].tilt is not None and seen.tilt is not None:
            gap = math.hypot(gap, float(tilt_distance(kept[-1].tilt, seen.tilt)))
        if gap >= _APART:
            kept.append(seen)
    kept = kept if len(kept) > 1 else list(drive)
    rows = np.unique(np.linspace(0, len(kept) - 1, min(len(kept), most)).astype(int)).tolist()
    return [kept[row].step for row in rows]
