"""Meng et al. (2020), "Scaling Local Control to Large-Scale Topological Navigation", as the paper compares it.

Owns its rules: each anchor is the last image that is surely reachable from the one before, older nodes are reused where
they can replace an anchor, and drives are joined where a whole window of anchors is reachable. Paths are the most
probable ones, and the map does not change while driving. The constants are those of the published configuration
(rmp_nav, `space8/graph_config.yaml`); replacements are marked "ours". A tour is split into several trajectories,
because their maps are built from many.
"""

import itertools
from collections.abc import Callable, Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import invert
from ltvn_core.graph.localiser import GLOBAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.rival import DriveImages, EdgeCandidate, on_last_path
from ltvn_core.types import Features, Waypoint

Reach = Callable[[Sequence[int], Sequence[int]], tuple[NDArray[np.float64], Waypoint]]
"""Returns r (P,) and waypoints (P, 3) from P images of the tour to P others, all by their row in it."""
_PAIRS_AT_ONCE = 512
"""Number of pairs that are compared at once."""


class RememberedReach:
    """Cache of compared pairs; with `both_directions`, one comparison also gives the result of the reversed pair."""

    def __init__(self, reach: Reach, *, both_directions: bool) -> None:
        """Cache the results of `reach`; `both_directions` means that r is the same for an edge and the edge back."""
        self._reach = reach
        self._both = both_directions
        self._known: dict[tuple[int, int], tuple[float, NDArray[np.float64]]] = {}

    def __call__(self, sources: Sequence[int], targets: Sequence[int]) -> tuple[NDArray[np.float64], Waypoint]:
        """Return r (P,) and waypoints (P, 3) of P pairs."""
        pairs = list(zip(sources, targets, strict=True))
        new: dict[tuple[int, int], None] = {}
        for source, target in pairs:
            if (source, target) not in self._known and not (self._both and (target, source) in new):
                new[source, target] = None
        self._ask(list(new))
        answers = [self._known[pair] for pair in pairs]
        return np.array([r for r, _ in answers]), np.array([waypoint for _, waypoint in answers]).reshape(-1, 3)

    def _ask(self, pairs: Sequence[tuple[int, int]]) -> None:
        for first in range(0, len(pairs), _PAIRS_AT_ONCE):
            asked = pairs[first : first + _PAIRS_AT_ONCE]
            reachability, waypoints = self._reach(*zip(*asked, strict=True))
            for pair, r, waypoint, back in zip(asked, reachability, waypoints, invert(waypoints), strict=True):
                self._known[pair] = float(r), waypoint
                if self._both:
                    self._known.setdefault((pair[1], pair[0]), (float(r), back))


SURE_REACHABILITY = 0.9
"""Least r of a pair of anchors (ours; theirs is 0.99, for a network that saturates, but some predictors here return at
most 0.95)."""
ADJACENT_P = 0.9999
"""Probability that the robot can go from one image of its drive to the next."""
WINDOW = 2
"""Number of anchors before and after both ends that must also be reachable for an edge between trajectories."""
SAMPLED_NODES = 100
"""Largest number of older nodes that are compared with a trajectory."""
TRAJECTORY_IMAGES = 100
"""Number of images of a trajectory, into which a tour is split (ours)."""
IMAGES_AHEAD = 64
"""Largest number of images between consecutive anchors (ours; it is never reached)."""
_IMAGES_AT_ONCE = 16
"""Number of images ahead that are compared at once."""
AT_NODE_REACHABILITY = 0.9
"""Least r of a node at which the robot, or the goal, is localised."""
ON_PATH_REACHABILITY = 0.7
"""Least r of a node on the last path at which the robot is localised."""


def localise_on_anchors(
    features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
) -> Localisation:
    """Find the most reachable anchor on the last path, else among all."""
    if found := on_last_path(features, graph, prior, matcher, ON_PATH_REACHABILITY):
        return found
    matches = matcher.match(features, prior.candidates(graph))
    return best_localisation(matches, -matches.reachability, matches.reachability > AT_NODE_REACHABILITY, GLOBAL)


def keep_anchors(drive: DriveImages) -> tuple[Sequence[int], list[EdgeCandidate]]:
    """Keep anchors, including all goals; the generator of the drive draws the older nodes that are compared."""
    matcher = Matcher(drive.predictor, drive.keyframes, drive.method.matching)
    both = drive.may_reverse

    def reach(sources: Sequence[int], targets: Sequence[int]) -> tuple[NDArray[np.float64], Waypoint]:
        first = drive.features[list(sources)]
        second = drive.features[list(targets)]
        if both:
            return matcher.match_pairs(first, second)
        answer = drive.predictor.predict(first, second)
        return np.asarray(answer.reachability, np.float64), answer.waypoints

    anchors = AnchorMap(RememberedReach(reach, both_directions=both), drive.goals, drive.rng, both_directions=both)
    count = len(drive.rows)
    for first in range(0, max(count - 1, 1), TRAJECTORY_IMAGES):
        anchors.add(first, min(first + TRAJECTORY_IMAGES, count - 1))
        if drive.progress is not None:
            drive.progress(min(first + TRAJECTORY_IMAGES, count), count)
    return anchors.nodes, list(anchors.edges.values())


def sparsify(reach: Reach, first: int, last: int, goals: Collection[int] = ()) -> list[int]:
    """Return the anchors from one image of a tour to another; each is the last image that is surely reachable from the
    previous anchor.

    Goals are also anchors.
    """
    anchors = [first]
    while anchors[-1] < last:
        source = anchors[-1]
        farthest = max(_last_in_reach(reach, source, min(source + IMAGES_AHEAD, last)), source + 1)
        anchors.append(min((goal for goal in goals if source < goal < farthest), default=farthest))
    return anchors


def _last_in_reach(reach: Reach, source: int, last: int) -> int:
    """Return the last image before the first one that is not surely reachable from `source`."""
    for first in range(source + 1, last + 1, _IMAGES_AT_ONCE):
        ahead = range(first, min(first + _IMAGES_AT_ONCE, last + 1))
        surely = reach([source] * len(ahead), ahead)[0] > SURE_REACHABILITY
        if not surely.all():
            return first - 1 + int(np.argmin(surely))
    return last


class AnchorMap:
    """The anchors of all trajectories so far, and the edges between them."""

    def __init__(
        self, reach: Reach, goals: Collection[int], rng: np.random.Generator, *, both_directions: bool
    ) -> None:
        """Start with an empty map; `both_directions` adds the edge back of each edge, driven in reverse."""
        self._reach = reach
        self._goals = goals
        self._rng = rng
        self._both = both_directions
        self._window_of: dict[int, list[int]] = {}
        """Anchors around each node in its own trajectory, (2 * WINDOW + 1)."""
        self.edges: dict[tuple[int, int], EdgeCandidate] = {}

    @property
    def nodes(self) -> list[int]:
        """The anchors in order of time."""
        return sorted(self._window_of)

    def add(self, first: int, last: int) -> None:
        """Add a trajectory from one image of the tour to another, which starts at the end of the last one."""
        anchors = sparsify(self._reach, first, last, self._goals)
        old = [node for node in self.nodes if node != first]
        replaced = self._replace(anchors, old)
        for place, anchor in enumerate(anchors):
            around = [anchors[min(max(k, 0), len(anchors) - 1)] for k in range(place - WINDOW, place + WINDOW + 1)]
            if replaced[place] == anchor:
                self._window_of[anchor] = around
        self._join_consecutive(replaced)
        self._join_across([node for node in replaced if node in anchors], old)

    def _replace(self, anchors: Sequence[int], old: Sequence[int]) -> list[int]:
        """Return the anchors, some replaced by older nodes that serve as well; goals and both ends stay."""
        replaced = list(anchors)
        latest = -1
        for place in range(1, len(anchors) - 1):
            free = [node for node in old if node > latest]  # Otherwise the trajectory would go back along an older one.
            if anchors[place] in self._goals or not free:
                continue
            there, _ = self._reach([replaced[place - 1]] * len(free), free)
            free = [node for node, r in zip(free, there, strict=True) if r > SURE_REACHABILITY]
            if not free:
                continue
            onward, _ = self._reach(free, [anchors[place + 1]] * len(free))
            joint = np.where(onward > SURE_REACHABILITY, onward * there[there > SURE_REACHABILITY], 0.0)
            if joint.any():
                replaced[place] = latest = free[int(np.argmax(joint))]
        return replaced

    def _join_consecutive(self, nodes: Sequence[int]) -> None:
        steps = [(a, b) for a, b in itertools.pairwise(nodes) if a != b]
        if not steps:
            return
        reachability, waypoints = self._reach(*zip(*steps, strict=True))
        for (a, b), r, waypoint in zip(steps, reachability, waypoints, strict=True):
            self._join(EdgeCandidate(a, b, ADJACENT_P if b == a + 1 else float(r), waypoint))

    def _join_across(self, new: Sequence[int], old: Sequence[int]) -> None:
        """Join new and older nodes whose whole windows are reachable."""
        chosen = [old[k] for k in sorted(self._rng.permutation(len(old))[:SAMPLED_NODES])]
        pairs = [pair for a, b in itertools.product(new, chosen) for pair in ((a, b), (b, a))]
        for (source, target), r, waypoint in self._reachable_windows(pairs):
            if (source, target) not in self.edges:
                self._join(EdgeCandidate(source, target, r, waypoint))

    def _reachable_windows(
        self, pairs: Sequence[tuple[int, int]]
    ) -> Iterator[tuple[tuple[int, int], float, NDArray[np.float64]]]:
        """Yield the pairs whose windows are surely reachable, each with the least r in the window and the waypoint."""
        if not pairs:
            return
        middle, waypoints = self._reach(*zip(*pairs, strict=True))
        for k in np.flatnonzero(middle > SURE_REACHABILITY).tolist():
            windows = (self._window_of[node] for node in pairs[k])
            least = float(self._reach(*windows)[0].min())
            if least > SURE_REACHABILITY:
                yield pairs[k], least, waypoints[k]

    def _join(self, candidate: EdgeCandidate) -> None:
        for each in (candidate, candidate.reversed())[: 1 + self._both]:
            self.edges.setdefault((each.source, each.target), each)
