"""Bridges: joins images that Algorithm 1 leaves over to the map, through a merged image or by odometry.

A predictor may recognise an image from a merged image but from no node, because the node is farther away. Where two
consecutive images show nothing in common, as in front of a bare wall, the robot still drove from one to the other, and
odometry is accurate over such a short way. All bridges are ours. Owns which images are joined; changes no map.
"""

import itertools
from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import distance
from ltvn_core.graph import loop_closures
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.types import FrameId, Observation

REACH = 30
"""Number of images before and after that are compared first."""
_BESIDE = 4
"""An image joined by odometry must be recognised from one of this many left-over images before or after it."""
_MOST_HOPS = 12
"""Largest number of edges, about ten metres of driving, over which odometry is followed to a left-over image."""
_BROKEN = 1e6
"""Length of a step at which odometry breaks off, larger than any reach."""


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
        thresholds: BuildingConfig,
    ) -> None:
        """Join images that are connectable by `thresholds`, the thresholds of the last pass."""
        self._frames = sorted(seen.step for seen in observations)
        self._row = {frame: row for row, frame in enumerate(self._frames)}
        self._matcher = matcher
        self._odometry_gate = odometry_gate
        self._thresholds = thresholds
        self._asked: dict[FrameId, NDArray[np.intp]] = {}
        """For each image the rows of the few beside it that it was compared with while both were left over."""
        self._is_judged = np.zeros(len(self._frames), bool)
        """(N,) whether each left-over image was compared with those beside it; goals are not."""
        steps = [odometry_gate.driven(*pair) for pair in itertools.pairwise(self._frames)]
        lengths = [np.inf if step is None else float(distance(step)) for step in steps]
        self._driven = np.concatenate([[0.0], np.cumsum(np.minimum(lengths, _BROKEN))])
        """(N,) d driven before each image."""

    def by_merged_image(self, frame: FrameId, merged: NDArray[np.int32]) -> Bridge | None:
        """Return the bridge from a left-over image to the most reachable one of the merged images in some rows, which
        it was not compared with yet; None if it can be connected with none.

        An image near in time is preferred, because two images near in time are hardly ever perceptual aliases.
        """
        merged = np.sort(merged[~np.isin(merged, self._asked.get(frame, ()))])
        is_beside = np.abs(merged - self._row[frame]) <= REACH
        return self._recognised(frame, merged[is_beside]) or self._recognised(frame, merged[~is_beside])

    def by_odometry(self, left: NDArray[np.bool_], goals: Collection[FrameId]) -> tuple[Bridge, ...]:
        """Return the shortest chain of bridges by odometry from a node or a merged image to a left-over image, in the
        order to cross them; none if there is none.

        `left` (N,) tells which images are left over; all others are nodes or merged. The left-over image must be a
        goal, or recognised from another left-over image near it in time. Otherwise no other image could join the map
        through it.
        """
        candidates = left & ~self._is_judged
        for row, step in self._nearest_first(np.flatnonzero(candidates), np.flatnonzero(~left)):
            frame = self._frames[row]
            is_useful = frame in goals
            if not is_useful:
                self._is_judged[row] = True
                first = max(row - _BESIDE, 0)
                beside = first + np.flatnonzero(left[first : row + 1 + _BESIDE])
                self._asked[frame] = beside[beside != row]
                is_useful = self._recognised(frame, self._asked[frame]) is not None
            if is_useful and (chain := self._chain(frame, left, step)):
                return chain
        return ()

    def _nearest_first(self, rows: NDArray[np.intp], ends: NDArray[np.intp]) -> Iterator[tuple[int, int]]:
        """Yield the rows of left-over images in reach of a placed one, the nearest along the drive first, each with -1
        if the placed image comes before it, or 1 if it comes after it."""
        after = np.searchsorted(ends, rows)
        driven = np.concatenate([[-np.inf], self._driven[ends], [np.inf]])
        gaps = np.stack([self._driven[rows] - driven[after], driven[after + 1] - self._driven[rows]])
        nearest = gaps.min(axis=0)
        for k in np.lexsort((rows, nearest)):
            if nearest[k] >= _MOST_HOPS * self._thresholds.connect_distance:
                return
            yield int(rows[k]), -1 if gaps[0, k] <= gaps[1, k] else 1

    def _chain(self, frame: FrameId, left: NDArray[np.bool_], step: int) -> tuple[Bridge, ...]:
        """Follow odometry from an image to the next placed one, backwards or forwards in time, in the longest hops."""
        bridges = list[Bridge]()
        here = frame
        while left[self._row[here]]:
            hops = [*self._hops(here, left, step)]
            if not hops or len(bridges) == _MOST_HOPS:
                return ()
            bridges.append(hops[-1])
            (here,) = hops[-1].matches.nodes
        return tuple(reversed(bridges))

    def _hops(self, frame: FrameId, left: NDArray[np.bool_], step: int) -> Iterator[Bridge]:
        """Yield bridges from an image to those before or after it, nearest in time first, up to the next placed one."""
        row = self._row[frame] + step
        while 0 <= row < len(self._frames):
            other = self._frames[row]
            driven = self._odometry_gate.driven(frame, other)
            if driven is None or distance(driven) >= self._thresholds.connect_distance:
                return
            # No image supports the edge, so it gets the lowest p that an edge supported by images can have.
            yield Bridge(frame, Matches.of_one(other, self._thresholds.connect_reachability, driven), by_odometry=True)
            if not left[row]:
                return
            row += step

    def _recognised(self, frame: FrameId, rows: NDArray[np.integer[Any]]) -> Bridge | None:
        """Return the bridge from an image to the most reachable one of those in some rows; None if none is."""
        fresh = self._odometry_gate.may_be_near(frame, [self._frames[row] for row in rows])
        if not fresh:
            return None
        found = self._matcher.match(self._matcher.keyframes.features([frame]), fresh)
        found = found.take(self._odometry_gate.plausible(frame, found))
        found = loop_closures.connections(frame, found, self._matcher, self._thresholds)
        return Bridge(frame, found.take(np.array([found.reachability.argmax()]))) if len(found) else None
