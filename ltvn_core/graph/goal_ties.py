"""Ties: connect goals that Algorithm 1 leaves over, so that a path leads to each (ours).

The robot drove past its goal images, so odometry usually gives a path. Otherwise the most reachable node may agree with
the goal in both directions, though with a lower r than an edge needs; such an edge gets a lower p than any other. Owns
which images are tied to what; changes no map.
"""

from collections.abc import Collection, Container, Iterator, Sequence

import numpy as np

from ltvn_core.geometry import distance, invert, relative, wrap_angle
from ltvn_core.graph.bridges import Bridge
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.types import FrameId, Observation

UNSURE_P = 0.45
"""Largest p of an unsure edge; an edge below one half probably does not exist."""
_MAX_HOPS = 12
"""Number of images, about ten metres of driving, over which odometry is followed to a goal."""
_MIN_AGREED = 0.2
"""Least r of an unsure edge to a goal, as the smaller r of both directions."""
_GAP_M, _GAP_RAD = 0.35, 0.35
"""Largest disagreement between the waypoints of both directions, in m and rad."""


class GoalTies:
    """Searches for ties of goals along one trajectory."""

    def __init__(
        self,
        observations: Sequence[Observation],
        matcher: Matcher,
        odometry_gate: OdometryGate,
        thresholds: OperatorThresholds,
    ) -> None:
        """Tie goals within the distance D_c of `thresholds`, the thresholds of the last pass."""
        self._frames = sorted(seen.step for seen in observations)
        self._row = {frame: row for row, frame in enumerate(self._frames)}
        self._matcher = matcher
        self._odometry_gate = odometry_gate
        self._thresholds = thresholds

    def ties(self, goal: FrameId, placed: Collection[FrameId]) -> tuple[Bridge, ...]:
        """Return bridges from the images `placed` in the map to a goal, in the order in which to cross them.

        The bridges follow odometry if it gives a path. Otherwise a single bridge joins the goal to the image that
        agrees best with it, if there is one.
        """
        chains = [chain for step in (-1, 1) if (chain := self._chain(goal, placed, step))]
        if chains:
            return min(chains, key=lambda chain: sum(bridge.matches.distances[0] for bridge in chain))
        unsure = self._unsure(goal, sorted(placed))
        return () if unsure is None else (unsure,)

    def _chain(self, goal: FrameId, placed: Container[FrameId], step: int) -> tuple[Bridge, ...]:
        """Follow odometry from the goal to the next placed image, in hops no longer than an edge may be."""
        bridges = list[Bridge]()
        here = goal
        while here not in placed and len(bridges) < _MAX_HOPS:
            hops = list(self._hops(here, step))
            hop = next((hop for hop in hops if hop.matches.nodes[0] in placed), hops[-1] if hops else None)
            if hop is None:
                return ()
            bridges.append(hop)
            here = hop.matches.nodes[0]
        return tuple(reversed(bridges)) if here in placed else ()

    def _hops(self, frame: FrameId, step: int) -> Iterator[Bridge]:
        """Yield edges from an image to those that follow it, or come before it, nearest in time first."""
        row = self._row[frame] + step
        while 0 <= row < len(self._frames):
            driven = self._odometry_gate.driven(frame, self._frames[row])
            if driven is None or distance(driven) >= self._thresholds.connect_distance:
                return
            matches = Matches.of_one(self._frames[row], self._thresholds.connect_reachability, driven)
            yield Bridge(frame, matches, by_odometry=True)
            row += step

    def _unsure(self, goal: FrameId, placed: Sequence[FrameId]) -> Bridge | None:
        """Return the image with which the goal agrees best in both directions; None without any."""
        others = self._odometry_gate.may_be_near(goal, placed)
        if not others:
            return None
        keyframes = self._matcher.keyframes
        own = np.repeat(keyframes.features([goal]), len(others), axis=0)
        there, back = self._matcher.match_both_ways(own, keyframes.features(others))
        gap = relative(there.waypoints, invert(back.waypoints))
        agreed = (np.hypot(gap[:, 0], gap[:, 1]) < _GAP_M) & (np.abs(wrap_angle(gap[:, 2])) < _GAP_RAD)
        agreed &= distance(there.waypoints) < self._thresholds.connect_distance
        surely = np.where(agreed, np.minimum(there.reachability, back.reachability), 0.0)
        best = int(surely.argmax())
        if surely[best] < _MIN_AGREED:
            return None
        return Bridge(goal, Matches.of_one(others[best], min(float(surely[best]), UNSURE_P), there.waypoints[best]))
