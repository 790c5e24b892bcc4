"""Bridges: joins images that Algorithm 1 leaves over to the map, through a merged image or by odometry.

A predictor may recognise an image from a merged image but from no node, because the node is farther away. Where two
consecutive images show nothing in common, as in front of a bare wall, the robot still drove from one to the other, and
odometry is accurate over such a short way. A goal is joined over several such images, so that a path leads to it. All
bridges are ours. Owns which images are joined; changes no map.
"""

from collections.abc import Collection, Container, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ltvn_core.geometry import distance
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.types import FrameId, Observation

REACH = 30
"""Number of images before and after that are compared first, and that odometry may join."""
_BESIDE = 4
"""An image joined by odometry must be recognised from one of this many left-over images before or after it."""
_MOST_HOPS = 12
"""Largest number of edges, about ten metres of driving, over which odometry is followed to a goal."""


class Bridge(NamedTuple):
    """A left-over image and what joins it to the map."""

    frame: FrameId
    matches: Matches
    """One image that is a node or merged."""
    by_odometry: bool = False
    """Whether only odometry gives the relative pose of the two images."""


class BridgeSearch:
    """Searches bridges along one trajectory; compares each pair of images at most once."""

    def __init__(
        self,
        observations: Sequence[Observation],
        matcher: Matcher,
        odometry_gate: OdometryGate,
        loop_closures: LoopClosureVerifier,
        thresholds: OperatorThresholds,
    ) -> None:
        """Join images that are connectable by `thresholds`, the thresholds of the last pass."""
        self._frames = sorted(seen.step for seen in observations)
        self._row = {frame: row for row, frame in enumerate(self._frames)}
        self._matcher = matcher
        self._odometry_gate = odometry_gate
        self._loop_closures = loop_closures
        self._thresholds = thresholds
        self._asked: dict[FrameId, set[FrameId]] = {}

    def by_merged_image(self, frame: FrameId, merged: Collection[FrameId]) -> Bridge | None:
        """Return the bridge from a left-over image to the most reachable merged image; None if it can be connected with
        none.

        An image near in time is preferred, because two images near in time are hardly ever perceptual aliases.
        """
        beside = [other for other in self._beside(frame, REACH) if other in merged]
        return self._recognised(frame, beside) or self._recognised(frame, sorted(merged))

    def by_odometry(self, left: Collection[FrameId], placed: Container[FrameId]) -> Bridge | None:
        """Return the shortest path by odometry from a left-over image to a node or a merged image; None if there is
        none.

        The left-over image must be recognised from another left-over image near it in time. Otherwise no other image
        could join the map through it.
        """
        ways = [way for frame in left for way in self._ways(frame, placed)]
        for way in sorted(ways, key=lambda way: (way.matches.distances[0], way.frame)):
            beside = [other for other in self._beside(way.frame, _BESIDE) if other in left]
            if self._recognised(way.frame, beside) is not None:
                return way
        return None

    def _beside(self, frame: FrameId, reach: int) -> Sequence[FrameId]:
        """Return up to `reach` frames before and after a frame, without itself."""
        row = self._row[frame]
        return [*self._frames[max(row - reach, 0) : row], *self._frames[row + 1 : row + 1 + reach]]

    def _recognised(self, frame: FrameId, others: Sequence[FrameId]) -> Bridge | None:
        asked = self._asked.setdefault(frame, set())
        fresh = self._odometry_gate.may_be_near(frame, [other for other in others if other not in asked])
        asked.update(fresh)
        found = self._matcher.match(self._matcher.keyframes.features([frame]), fresh)
        found = found.take(self._odometry_gate.plausible(frame, found))
        found = self._loop_closures.connections(frame, found, self._thresholds)
        return Bridge(frame, found.take(np.array([found.reachability.argmax()]))) if len(found) else None

    def to_goal(self, goal: FrameId, placed: Container[FrameId]) -> tuple[Bridge, ...]:
        """Return the shortest chain of bridges by odometry from a placed image to a goal, in the order to cross them.

        None if odometry breaks off, or if the chain would be too long.
        """
        chains = [chain for step in (-1, 1) if (chain := self._chain(goal, placed, step))]
        return min(chains, key=lambda chain: sum(bridge.matches.distances[0] for bridge in chain), default=())

    def _chain(self, goal: FrameId, placed: Container[FrameId], step: int) -> tuple[Bridge, ...]:
        """Follow odometry from a goal to the next placed image, backwards or forwards in time, in the longest hops."""
        bridges = list[Bridge]()
        here = goal
        while here not in placed and len(bridges) < _MOST_HOPS:
            row = self._row[here]
            beside = self._frames[row + 1 :] if step > 0 else self._frames[:row][::-1]
            hop = None
            for other in beside:
                if (onward := self._by_odometry(here, other)) is None:
                    break
                hop = onward
                if other in placed:
                    break
            if hop is None:
                return ()
            bridges.append(hop)
            (here,) = hop.matches.nodes
        return tuple(reversed(bridges)) if here in placed else ()

    def _ways(self, frame: FrameId, placed: Container[FrameId]) -> Iterator[Bridge]:
        """Yield the paths by odometry from a frame to the nearest placed image before it, and to the nearest one after
        it."""
        row = self._row[frame]
        before = self._frames[max(row - REACH, 0) : row][::-1]
        for beside in (before, self._frames[row + 1 : row + 1 + REACH]):
            other = next((other for other in beside if other in placed), None)
            if other is not None and (way := self._by_odometry(frame, other)) is not None:
                yield way

    def _by_odometry(self, frame: FrameId, other: FrameId) -> Bridge | None:
        """Return the bridge between two images by odometry; None if they are too far apart, or odometry breaks off."""
        driven = self._odometry_gate.driven(frame, other)
        if driven is None or distance(driven) >= self._thresholds.connect_distance:
            return None
        # No image supports the edge, so it gets the lowest p that an edge supported by images can have.
        return Bridge(frame, Matches.of_one(other, self._thresholds.connect_reachability, driven), by_odometry=True)
