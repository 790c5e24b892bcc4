"""Meng et al. (2020), "Scaling Local Control to Large-Scale Topological Navigation", as the paper compares it.

Owns its rules: anchors as far apart as the robot can just still see its way, older nodes used again where they serve as
well, and edges between drives where a whole window of anchors can be reached. Paths are the most probable ones, and
driving teaches nothing. The numbers are those of the published configuration (rmp_nav, `space8/graph_config.yaml`);
what stands in for theirs is marked "ours". A tour counts as several trajectories, as their maps are made of many.
"""

import itertools
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.geometry import invert
from ltvn_core.graph.builder import ProgressCallback
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import GLOBAL, LOCAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.graph.planner import surprise_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.all_image_map import EdgeCandidate, all_image_deltas, encode_trajectory
from ltvn_core.systems.entry import SystemEntry
from ltvn_core.types import Features, FrameId, Observation, Predictor, Waypoint

Reach = Callable[[Sequence[int], Sequence[int]], tuple[NDArray[np.float64], Waypoint]]
"""Returns r (P,) and waypoints (P, 3) from P images of the tour to P others, all by their place in it."""
_PAIRS_AT_ONCE = 512
"""So many pairs are compared at once."""


class RememberedReach:
    """Asks about no pair twice, nor about its way back where the answer holds for both; the answers are the same."""

    def __init__(self, reach: Reach, *, both_directions: bool) -> None:
        """Remember what `reach` says; `both_directions` means that it says the same of a way and the way back."""
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
"""Least r of a pair of anchors (ours: theirs is 0.99, of a network that saturates; some predictors here say 0.95 at
most)."""
ADJACENT_P = 0.9999
"""Probability that the robot can go from one image of its drive to the next."""
WINDOW = 2
"""An edge between trajectories needs so many anchors before and after both of its ends to be reachable, too."""
SAMPLED_NODES = 100
"""Each trajectory is joined with at most so many older nodes."""
TRAJECTORY_IMAGES = 100
"""A tour is taken for trajectories of so many images (ours)."""
IMAGES_AHEAD = 64
"""No anchor is farther from the one before it (ours; no image is)."""
_IMAGES_AT_ONCE = 16
"""So many images ahead are compared at once."""
AT_NODE_REACHABILITY = 0.9
"""The robot, or the goal, is at a node with an r above this."""
ON_PATH_REACHABILITY = 0.7
"""The robot is at a node of the last path with an r above this."""


def meng_system(method: Method) -> NavigationSystem:
    """Return the system; `method` has the thresholds of the controller and of judging."""
    return NavigationSystem(
        name="meng",
        method=method,
        build=partial(_build, method=method),
        edge_weight=surprise_cost,
        localise=_localise,
        subgoal=choose_first_node,
        maintenance=NoMaintenance(),
    )


def _localise(features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher) -> Localisation:
    """Find the most reachable anchor of the last path, else of all."""
    ahead = [node for node in prior.plan if node in graph.nodes and node not in prior.doubted]
    near = matcher.match(features, ahead)
    if len(near) and near.reachability.max() > ON_PATH_REACHABILITY:
        return best_localisation(near, -near.reachability, near.reachability > ON_PATH_REACHABILITY, LOCAL)
    matches = matcher.match(features, prior.candidates(graph))
    return best_localisation(matches, -matches.reachability, matches.reachability > AT_NODE_REACHABILITY, GLOBAL)


def _build(
    observations: Sequence[Observation],
    keyframes: KeyframeStore,
    predictor: Predictor,
    *,
    method: Method,
    rng: np.random.Generator,
    goals: Collection[FrameId] = (),
    progress: ProgressCallback | None = None,
) -> Deltas:
    """Return a map of anchors, the goals among them; `rng` draws the older nodes that are compared."""
    ordered, features = encode_trajectory(observations, keyframes, predictor, goals)
    matcher = Matcher(predictor, keyframes, method.matching)
    both = method.matching.both_directions

    def reach(sources: Sequence[int], targets: Sequence[int]) -> tuple[NDArray[np.float64], Waypoint]:
        first = features[list(sources)]
        second = features[list(targets)]
        if both:
            return matcher.match_pairs(first, second)
        answer = predictor.predict(first, second)
        return np.asarray(answer.reachability, np.float64), answer.waypoints

    wanted = frozenset(k for k, seen in enumerate(ordered) if seen.step in goals)
    anchors = AnchorMap(RememberedReach(reach, both_directions=both), wanted, rng, both_directions=both)
    for first in range(0, max(len(ordered) - 1, 1), TRAJECTORY_IMAGES):
        anchors.add(first, min(first + TRAJECTORY_IMAGES, len(ordered) - 1))
        if progress is not None:
            progress(min(first + TRAJECTORY_IMAGES, len(ordered)), len(ordered))
    kept = [ordered[k] for k in anchors.nodes]
    row = {k: place for place, k in enumerate(anchors.nodes)}
    joined = [each._replace(source=row[each.source], target=row[each.target]) for each in anchors.edges.values()]
    keyframes.keep_only([seen.step for seen in kept])
    return tuple(all_image_deltas(kept, joined, method.believing))


def sparsify(reach: Reach, first: int, last: int, goals: Collection[int] = ()) -> list[int]:
    """Return the anchors from one image of a tour to another: each the last one that is surely reachable from before.

    Goals are anchors, too.
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
        """Begin without any; where a robot may reverse, what it drove is an edge `both_directions`."""
        self._reach = reach
        self._goals = goals
        self._rng = rng
        self._both = both_directions
        self._window_of: dict[int, list[int]] = {}
        """For each node the anchors around it in its own trajectory, (2 * WINDOW + 1)."""
        self.edges: dict[tuple[int, int], EdgeCandidate] = {}

    @property
    def nodes(self) -> list[int]:
        """The anchors in the order in which they were seen."""
        return sorted(self._window_of)

    def add(self, first: int, last: int) -> None:
        """Add a trajectory from one image of the tour to another; it begins where the last one ended."""
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
        """Return the anchors, with older nodes in place of those that they can stand for; goals and ends stay."""
        replaced = list(anchors)
        latest = -1
        for place in range(1, len(anchors) - 1):
            free = [node for node in old if node > latest]  # Else the trajectory would go back along an older one.
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
        """Join new and older nodes where their whole windows are reachable from each other."""
        chosen = [old[k] for k in sorted(self._rng.permutation(len(old))[:SAMPLED_NODES])]
        pairs = [pair for a, b in itertools.product(new, chosen) for pair in ((a, b), (b, a))]
        for (source, target), r, waypoint in self._reachable_windows(pairs):
            if (source, target) not in self.edges:
                self._join(EdgeCandidate(source, target, r, waypoint))

    def _reachable_windows(
        self, pairs: Sequence[tuple[int, int]]
    ) -> Iterator[tuple[tuple[int, int], float, NDArray[np.float64]]]:
        """Yield the pairs whose windows are surely reachable, with the least r of the window and the waypoint."""
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


MENG = SystemEntry(name="meng", label="Meng et al.", factory=meng_system)
