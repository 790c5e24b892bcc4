"""Place belief: multi-hypothesis localisation, a Bayes filter over the places where the robot may be.

Where rooms look alike, one image says little: in an office of identical rooms, 22 nodes resemble an image, but only 2
or 3 of them are near the robot. But all images of a query must fit one trajectory. So every place that resembles an
image becomes a hypothesis that moves with odometry. Later images raise or lower its weight, depending on whether they
show what the map expects there (Jensfelt and Kristensen 2001, on metric maps), relative to the weight of all places
that are not followed. Owns the hypotheses and their weights (ours).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from ltvn_core.geometry import agree, compose, invert, relative, wrap_angle
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose, Waypoint

SAME_POSE = (0.5, 0.35)
"""Two estimates of where a node is agree if they differ by less than this, in m and rad."""
_CONTINUES = (0.7, 0.7)
"""Odometry is unbroken along an edge that contradicts it by less than this, in m and rad: in bare corridors, waypoints
are wrong by as much as the odometry gate lets pass."""
_FAR_M = 1e4
"""Distance between parts that no edge joins, large enough that no node of one is near the other, in metres."""

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class NodeLayout:
    """N nodes in one plane."""

    nodes: tuple[NodeId, ...]
    poses: Pose
    """(N, 3) poses of the nodes in that plane."""


def lay_out(graph: TopologicalGraph) -> NodeLayout:
    """Return the poses of a map's nodes in one plane."""
    nodes = tuple(graph.nodes)
    poses = np.array([graph.nodes[node].odometry for node in nodes]).reshape(-1, 3)
    row_of = {node: row for row, node in enumerate(nodes)}
    driven = graph.driven_edges
    edges = np.array([(row_of[source], row_of[target]) for source, target in driven], np.intp).reshape(-1, 2)
    waypoints = np.array([edge.waypoint for edge in driven.values()]).reshape(-1, 3)
    by_odometry = relative(poses[edges[:, 0]], poses[edges[:, 1]])
    # Odometry that never moves fits short edges, but says nothing.
    fit = agree(by_odometry, waypoints, _CONTINUES) & by_odometry.any(axis=1)
    joined = coo_array((np.ones(fit.sum()), (edges[fit, 0], edges[fit, 1])), shape=(len(nodes), len(nodes)))
    part_of = np.asarray(connected_components(joined, directed=False)[1], np.intp)
    between = part_of[edges[:, 0]] != part_of[edges[:, 1]]
    frames = _frames(poses, part_of, edges[between], waypoints[between])
    return NodeLayout(nodes, compose(frames[part_of], poses))


def _frames(poses: Pose, part_of: Rows, edges: Rows, waypoints: Waypoint) -> Pose:
    """Return the origins (P, 3) of the parts' frames in the common plane."""
    count = int(part_of.max(initial=-1)) + 1
    back = part_of[edges[:, 0]] > part_of[edges[:, 1]]
    edges = np.where(back[:, None], edges[:, ::-1], edges)
    waypoints = np.where(back[:, None], invert(waypoints), waypoints)
    pairs, which = np.unique(part_of[edges], axis=0, return_inverse=True)
    found = [_joint(poses, edges[rows], waypoints[rows]) for rows in which.ravel() == np.arange(len(pairs))[:, None]]
    joints = {(first, second): joint for (first, second), (joint, _) in zip(pairs.tolist(), found, strict=True)}
    unsure = np.array([1 / agreeing for _, agreeing in found], np.float64)
    tree = minimum_spanning_tree(coo_array((unsure, (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr())
    frames = np.zeros((count, 3))
    placed = np.zeros(count, bool)
    for rank, root in enumerate(np.argsort(-np.bincount(part_of, minlength=count), kind="stable").tolist()):
        if placed[root]:
            continue
        frames[root, 0] = _FAR_M * rank
        order, before = breadth_first_order(tree, root, directed=False)
        placed[order] = True
        for part in order[1:].tolist():
            from_ = int(before[part])
            joint = joints[from_, part] if (from_, part) in joints else invert(joints[part, from_])
            frames[part] = compose(frames[from_], joint)
    return frames


def _joint(poses: Pose, edges: Rows, waypoints: Waypoint) -> tuple[Pose, int]:
    """Return the frame (3,) of a second part in that of a first, from the edge that most other edges agree with, and
    the number of edges that agree.

    Edges lie far from the origins of the frames, so they are compared at their ends.
    """
    seen = compose(poses[edges[:, 0]], waypoints)
    frames = compose(seen, invert(poses[edges[:, 1]]))
    count = agree(compose(frames[:, None], poses[edges[:, 1]][None]), seen[None], SAME_POSE).sum(axis=1)
    best = int(np.argmax(count))
    return frames[best], int(count[best])


FloatArray = NDArray[np.float64]

_MOST, _LEAST_LOG_WEIGHT = 120, -14.0
"""Largest number of hypotheses, and the lowest ln weight relative to the best."""
_OVERLAP_M, _M_PER_RAD = 0.7, 0.6
"""Distance within which a node should be recognised, in metres, and the metres that a radian counts as."""
_MIN_REACHABILITY = 0.5
_DISAGREES, _NOTHING_NEAR = -1.2, -0.3
"""ln likelihood ratios of an image at a place: if it disagrees, and if no node is near."""
_AGREES, _PER_LOG_ODDS = 1.5, 0.7
"""ln likelihood ratio of an image that agrees with the highest r of the query, and its change per log odds of r.
Measured in six scenes for tuning: places that merely look alike agree with half of the images, but seldom with r above
0.99 (`docs/method.md`)."""
_NEWS = 0.5
"""Share of an image's ln likelihood ratio that counts, because the images just before show much of the same."""
_HIGHEST_R = (0.95, 0.99)
"""Limits of that highest r, because predictors differ in how sure they are at best."""
_ELSEWHERE_LEAST, _NEW = -4.0, -2.0
"""Least ln weight, relative to the best hypothesis, of a place that is not followed, and the ln weight of a new
hypothesis relative to that."""
_SAME_PLACE = (0.6, 0.4)
"""Distance from a hypothesis, in m and rad, within which a match starts no new hypothesis."""
_MERGED = (0.3, 0.25)
"""Distance within which two hypotheses merge, in m and rad."""
_TRUST_IN_MATCH = 0.5
"""Share of the way to a match by which a hypothesis is corrected."""
_SURE = 0.95
"""Probability above which only the nodes around the followed places are compared."""
_AROUND_M = 3.0
"""Distance within which nodes count as around a place, in metres."""
AT_PLACE = (0.9, 0.5)
"""Largest error of a node's pose relative to the robot's place, in m and rad."""
LIKELY, SURE = 0.5, 0.8
"""Probability of a place above which the robot drives by it, and above which it judges attempts by it."""


class BelievedPlace(NamedTuple):
    """The place where the robot probably is."""

    nodes: Mapping[NodeId, Pose]
    """Poses (3,) of the nodes around, in the robot's frame, the nearest first."""
    probability: float
    """Probability of this place among all hypotheses."""
    is_recognised: bool
    """Whether the last image shows a node where this place expects it; false where the world has changed."""

    @property
    def expects_image(self) -> bool:
        """Whether a node is so near that an image taken here should show it."""
        return bool(self.nodes) and bool(_apart(next(iter(self.nodes.values()))) < _OVERLAP_M)

    def rules_out(self, node: NodeId, waypoint: Waypoint, probability: float) -> bool:
        """Tell whether this place, if it is more probable than `probability`, contradicts that a node is at a waypoint
        (3,)."""
        if self.probability <= probability or not self.is_recognised:
            return False
        known = self.nodes.get(node)
        return known is None or not agree(known, waypoint, AT_PLACE)


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """M hypotheses of where the robot is."""

    poses: FloatArray
    """(M, 3) in the layout of the map."""
    log_weights: FloatArray
    """(M,) ln of each hypothesis's weight."""
    elsewhere: float = 0.0
    """ln of the weight of all other places, to which the likelihood ratios refer."""

    @property
    def probabilities(self) -> FloatArray:
        """(M,) probability of each hypothesis."""
        weights = np.exp(self.log_weights)
        return np.asarray(weights / (weights.sum() + np.exp(self.elsewhere)), np.float64)

    def __len__(self) -> int:
        return len(self.poses)


_NO_PLACES = _Places(np.empty((0, 3)), np.empty(0))


class PlaceBelief:
    """Belief over the places of a robot in one query."""

    def __init__(self, graph: TopologicalGraph) -> None:
        """Start without hypotheses; `graph` may change later."""
        self._graph = graph
        self._lay_out()
        self.forget()
        self._odometry = np.zeros(3)
        self._highest_r = 0.0

    def forget(self) -> None:
        """Start over after the belief has proved wrong."""
        self._places = _NO_PLACES
        self._is_sure = self._is_recognised = False

    def begin_at(self, node: NodeId, odometry: Pose) -> None:
        """Believe that the robot at an odometry pose (3,) stands at a node, and nowhere else."""
        self._lay_out()
        self._odometry = odometry.copy()
        self._places = _Places(self._layout.poses[[self._row_of[node]]], np.zeros(1), _ELSEWHERE_LEAST)
        self._is_sure = self._is_recognised = False

    def nodes_to_ask(self, odometry: Pose) -> tuple[NodeId, ...]:
        """Return the nodes to compare with an image taken at an odometry pose (3,).

        While the robot knows where it is, these are the nodes near the hypotheses, otherwise all nodes.
        """
        if self._version != self._graph.version and self._layout.nodes != tuple(self._graph.nodes):
            self._lay_out()
        self._version = self._graph.version
        self._move_to(odometry)
        if not self._is_sure:
            return self._layout.nodes
        found = self._tree.query_ball_point(self._places.poses[:, :2], _OVERLAP_M)
        return tuple(self._layout.nodes[row] for row in sorted({row for rows in found for row in rows}))

    def see(self, odometry: Pose, matches: Matches, near_enough: NDArray[np.bool_]) -> None:
        """Weigh all hypotheses by an image taken at an odometry pose (3,), given its matches with `nodes_to_ask`.

        Matches that are `near_enough` (N,) start new hypotheses. Images taken at one place are not independent, so only
        one of them should be given.
        """
        self._move_to(odometry)
        self._highest_r = max(self._highest_r, float(matches.reachability.max(initial=0.0)))
        begins = not len(self._places)
        agrees = self._weigh(matches)
        self._begin_to_follow(matches.take(near_enough))
        self._keep_likeliest(self._weigh(matches) if begins else agrees)

    def best(self, odometry: Pose, doubted: Collection[NodeId] = ()) -> BelievedPlace | None:
        """Return the likeliest place at an odometry pose (3,) whose nearest node is not doubted; None without any."""
        self._move_to(odometry)
        for k, (pose, p) in enumerate(zip(self._places.poses, self._places.probabilities, strict=True)):
            nodes = self._nodes_around(pose)
            if nodes and next(iter(nodes)) not in doubted:
                return BelievedPlace(nodes, float(p), k == 0 and self._is_recognised)
        return None

    def probability_at(self, odometry: Pose, node: NodeId, waypoint: Waypoint) -> float:
        """Return the probability that a node is at a waypoint (3,) from a robot at an odometry pose (3,)."""
        self._move_to(odometry)
        expected = relative(self._places.poses, self._layout.poses[self._row_of[node]])
        return float(self._places.probabilities[agree(expected, waypoint, AT_PLACE)].sum())

    def _lay_out(self) -> None:
        self._layout = lay_out(self._graph)
        self._version = self._graph.version
        self._row_of = {node: row for row, node in enumerate(self._layout.nodes)}
        self._tree = KDTree(self._layout.poses[:, :2])

    def _matches_of(self, matches: Matches) -> NDArray[np.intp]:
        """Return for each of the N nodes of the layout its row among the matches, -1 without any."""
        if matches.nodes is self._layout.nodes:
            return np.arange(len(matches))
        row_of_match = np.full(len(self._layout.nodes), -1, np.intp)
        rows = np.array([self._row_of.get(node, -1) for node in matches.nodes], np.intp)
        row_of_match[rows[rows >= 0]] = np.flatnonzero(rows >= 0)
        return row_of_match

    def _move_to(self, odometry: Pose) -> None:
        """Move all hypotheses by the motion of the robot."""
        step, self._odometry = relative(self._odometry, odometry), odometry.copy()
        self._places = replace(self._places, poses=compose(self._places.poses, step))

    def _weigh(self, matches: Matches) -> NDArray[np.bool_]:
        """Check for each hypothesis whether a node is recognised where expected; return (M,) the results."""
        poses = self._places.poses
        count = len(self._places)
        place, row = _pairs(self._tree.query_ball_point(poses[:, :2], _OVERLAP_M))
        expected = relative(poses[place], self._layout.poses[row])
        apart = _apart(expected)
        near = apart < _OVERLAP_M
        match = self._matches_of(matches)[row]
        recognised = (match >= 0) & (matches.reachability[match] > _MIN_REACHABILITY)
        agrees = near & recognised & agree(expected, matches.waypoints[match], SAME_POSE)
        says = np.full(count, _NOTHING_NEAR)
        says[place[near]] = _DISAGREES
        np.maximum.at(says, place[agrees], self._log_ratios(matches.reachability[match[agrees]]))
        is_right = np.zeros(count, bool)
        is_right[place[agrees]] = True
        chosen = np.flatnonzero(agrees)
        chosen = chosen[np.argsort(apart[chosen], kind="stable")]
        rights, first = np.unique(place[chosen], return_index=True)
        pair = chosen[first]
        measured = compose(self._layout.poses[row[pair]], invert(matches.waypoints[match[pair]]))
        corrected = poses.copy()
        corrected[rights] = compose(poses[rights], _TRUST_IN_MATCH * relative(poses[rights], measured))
        self._places = replace(self._places, poses=corrected, log_weights=self._places.log_weights + _NEWS * says)
        return is_right

    def _log_ratios(self, reachability: FloatArray) -> FloatArray:
        """Return the ln likelihood ratios (N,) of images that agree with r (N,)."""
        below = _log_odds(reachability) - _log_odds(np.clip(self._highest_r, *_HIGHEST_R))
        return np.clip(_AGREES + _PER_LOG_ODDS * below, _DISAGREES, _AGREES)

    def _begin_to_follow(self, matches: Matches) -> None:
        """Start a hypothesis at each match that is not near an existing one."""
        log_weight = self._places.elsewhere + _NEW if len(self._places) else 0.0
        poses = self._places.poses
        for k in np.argsort(matches.distances, kind="stable"):
            if matches.nodes[k] in self._row_of:
                pose = compose(self._layout.poses[self._row_of[matches.nodes[k]]], invert(matches.waypoints[k]))
                if not agree(pose, poses, _SAME_PLACE).any():
                    poses = np.concatenate([poses, pose[None]])
        new = np.full(len(poses) - len(self._places), log_weight)
        self._places = replace(self._places, poses=poses, log_weights=np.concatenate([self._places.log_weights, new]))

    def _keep_likeliest(self, agrees: NDArray[np.bool_]) -> None:
        """Keep the likeliest hypotheses, the best first with weight 0, and merge those that now agree."""
        places = self._places
        kept = list[int]()
        best = places.log_weights.max(initial=-np.inf)
        for k in np.argsort(-places.log_weights, kind="stable").tolist():
            if places.log_weights[k] < best + _LEAST_LOG_WEIGHT or len(kept) >= _MOST:
                break
            if not agree(places.poses[k], places.poses[kept], _MERGED).any():
                kept.append(k)
        # Images that disagree with all places do not make other places likelier, because the world may have changed.
        elsewhere = max(places.elsewhere - max(best, 0.0), _ELSEWHERE_LEAST) if kept else 0.0
        self._places = _Places(places.poses[kept], places.log_weights[kept] - best, elsewhere)
        self._is_recognised = bool(kept) and kept[0] < len(agrees) and bool(agrees[kept[0]])
        self._is_sure = self._is_recognised and self._places.probabilities[0] > _SURE

    def _nodes_around(self, pose: Pose) -> dict[NodeId, Pose]:
        rows = np.array(self._tree.query_ball_point(pose[:2], _AROUND_M), np.intp)
        poses = relative(pose, self._layout.poses[rows])
        return {self._layout.nodes[rows[k]]: poses[k] for k in np.argsort(_apart(poses), kind="stable")}


def _log_odds(p: ArrayLike) -> FloatArray:
    p = np.clip(np.asarray(p, np.float64), 1e-6, 1 - 1e-6)
    return np.asarray(np.log(p / (1 - p)), np.float64)


def _pairs(found: NDArray[np.object_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all pairs of a place and a node, as rows (P,), from the list of nodes found for each place."""
    counts = [len(rows) for rows in found]
    return np.repeat(np.arange(len(found)), counts), np.array([row for rows in found for row in rows], np.intp)


def _apart(waypoint: FloatArray) -> FloatArray:
    """Return the lengths (...) in metres of waypoints (..., 3); turns are converted to metres."""
    return np.hypot(waypoint[..., 0], waypoint[..., 1]) + _M_PER_RAD * np.abs(wrap_angle(waypoint[..., 2]))
