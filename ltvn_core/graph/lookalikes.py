"""Places that look alike, as the images of the map show: what a robot sees at one of them says little about which of
them it is at.

Two places look alike if images taken around one show the same as images taken at the same poses relative to the other.
Owns this measure (ours) and what was compared so far. `graph.place_belief` weighs images by it.
"""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import agree, relative
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.node_layout import SAME_POSE, NodeLayout, apart
from ltvn_core.types import NodeId, Pose, Waypoint

_AROUND_M, _SAME_VIEW_M = 1.5, 0.6
"""Radius around a place within which images are compared, in metres, and the greatest difference of their poses."""
_PAIRS = 8
"""Largest number of pairs of images that are compared for two places."""
_ALIKE = 0.8
"""Share of the pairs that show the same above which two places are look-alikes: of equal rooms, not all pairs are."""
MIN_REACHABILITY = 0.5
"""r above which two images show one place."""


Pair = tuple[NodeId, NodeId]


class Lookalikes:
    """How much places of a map look alike."""

    def __init__(self, matcher: Matcher) -> None:
        """Compare images with `matcher`, each pair once."""
        self._matcher = matcher
        self._seen = dict[Pair, tuple[float, Waypoint]]()

    def alike(self, layout: NodeLayout, here: Pose, others: Pose) -> NDArray[np.float64]:
        """Return (M,) how much a place (3,) and other places (M, 3) look alike: 1 for equal rooms, 0 where all differs,
        NaN where no images can be compared."""
        pairs = [_comparable(layout, here, other) for other in others]
        self._compare({pair for each in pairs for pair in each if pair not in self._seen})
        shares = [np.mean([self._shows(*item) for item in each.items()]) if each else np.nan for each in pairs]
        return np.minimum(np.array(shares, np.float64) / _ALIKE, 1.0)

    def _compare(self, pairs: Collection[Pair]) -> None:
        if not pairs:
            return
        features = self._matcher.keyframes.features
        reachability, waypoints = self._matcher.match_pairs(*map(features, zip(*pairs, strict=True)))
        self._seen.update(zip(pairs, zip(reachability.tolist(), waypoints, strict=True), strict=True))

    def _shows(self, pair: Pair, expected: Waypoint) -> bool:
        """Tell whether one image of a pair shows the other at the waypoint (3,) that equal rooms would give."""
        reachability, waypoint = self._seen[pair]
        return reachability > MIN_REACHABILITY and bool(agree(expected, waypoint, SAME_POSE))


def _comparable(layout: NodeLayout, here: Pose, other: Pose) -> dict[Pair, Waypoint]:
    """Return pairs of images around two places, taken at similar poses relative to them, with the waypoint (3,) between
    these poses."""
    rows, others = (np.array(layout.tree.query_ball_point(place[:2], _AROUND_M), np.intp) for place in (here, other))
    between = relative(relative(here, layout.poses[rows])[:, None], relative(other, layout.poses[others])[None])
    differ_m = np.where(rows[:, None] == others, np.inf, apart(between))
    if not differ_m.size:
        return {}
    closest, least_m = differ_m.argmin(axis=1), differ_m.min(axis=1)
    chosen = [k for k in np.argsort(least_m, kind="stable")[:_PAIRS].tolist() if least_m[k] < _SAME_VIEW_M]
    return {(layout.nodes[rows[k]], layout.nodes[others[closest[k]]]): between[k, closest[k]] for k in chosen}
