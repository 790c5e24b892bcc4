"""Place belief: multi-hypothesis localisation, a Bayes filter over the places where the robot may be.

Where rooms look alike, one image says little: in an office of identical rooms, 22 nodes resemble an image, but only 2
or 3 of them are near the robot. But all images of a query must fit one trajectory. So every place that resembles an
image becomes a hypothesis that moves with odometry. Later images raise or lower its weight, depending on whether they
show what the map expects there (Jensfelt and Kristensen 2001, on metric maps), relative to the weight of all places
that are not followed. Where the map's own images of two places look alike (`graph.lookalikes`), an image hardly changes
which of them is likelier. Owns the hypotheses and their weights (ours).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.geometry import agree, compose, invert, relative
from ltvn_core.graph.lookalikes import MIN_REACHABILITY, Lookalikes
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.node_layout import SAME_POSE, apart, lay_out
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose, Waypoint

FloatArray = NDArray[np.float64]

_MOST, _LEAST_LOG_WEIGHT = 120, -14.0
"""Largest number of hypotheses, and the lowest ln weight relative to the best."""
_OVERLAP_M = 0.7
"""Distance within which a node should be recognised, in metres."""
_NEAREST_M, _DISAGREES = (0.0, 0.2, 0.4, 0.7), (-1.2, -1.0, -0.5, 0.3)
"""ln likelihood ratio of an image that disagrees with a place, by the distance of the nearest node in metres: images
from the same spot seldom miss each other. Where no node is near, an image says nothing."""
_AGREES, _LEAST_AGREES, _PER_LOG_ODDS = 1.5, -0.3, 0.7
"""ln likelihood ratios of an image that agrees: with the highest r of the query, at least, and the change per log odds
of r. Measured in six scenes for tuning: places that merely look alike agree with half of the images, but seldom with r
above 0.99 (`docs/method.md`)."""
_NEWS, _NEWS_OF_TWINS = 0.8, 0.2
"""Share of an image's ln likelihood ratio that counts, because the images just before show much of the same: in
general, and between places that look alike."""
_COMPARED = 30
"""Number of places, the likeliest ones, that are compared with each other."""
_UNKNOWN, _LEARNS, _FORGETS = 0.5, 0.3, 0.1
"""How much two places look alike at first; the share of the way to what a comparison says; and the share that is lost
where no images can be compared, because at a wrong place a robot leaves the map."""
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
_TOLD_APART = 10
"""Number of places, the likeliest ones, of which the robot asks where they differ."""
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
        return bool(self.nodes) and bool(apart(next(iter(self.nodes.values()))) < _OVERLAP_M)

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
    alike: FloatArray
    """(M,) how much each has looked like the likeliest one so far, from 0 to 1."""
    elsewhere: float = 0.0
    """ln of the weight of all other places, to which the likelihood ratios refer."""

    @property
    def probabilities(self) -> FloatArray:
        """(M,) probability of each hypothesis."""
        weights = np.exp(self.log_weights)
        return np.asarray(weights / (weights.sum() + np.exp(self.elsewhere)), np.float64)

    def __len__(self) -> int:
        return len(self.poses)


_NO_PLACES = _Places(np.empty((0, 3)), np.empty(0), np.empty(0))


class PlaceBelief:
    """Belief over the places of a robot in one query."""

    def __init__(self, graph: TopologicalGraph, matcher: Matcher) -> None:
        """Start without hypotheses; `graph` may change later, and `matcher` compares its images."""
        self._graph = graph
        self._lookalikes = Lookalikes(matcher)
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
        self._places = _Places(
            self._layout.poses[[self._layout.row_of[node]]], np.zeros(1), np.ones(1), _ELSEWHERE_LEAST
        )
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
        found = self._layout.tree.query_ball_point(self._places.poses[:, :2], _OVERLAP_M)
        return tuple(self._layout.nodes[row] for row in sorted({row for rows in found for row in rows}))

    def see(self, odometry: Pose, matches: Matches, near_enough: NDArray[np.bool_]) -> None:
        """Weigh all hypotheses by an image taken at an odometry pose (3,), given its matches with `nodes_to_ask`.

        Matches that are `near_enough` (N,) start new hypotheses. Images taken at one place are not independent, so only
        one of them should be given.
        """
        self._move_to(odometry)
        self._highest_r = max(self._highest_r, float(matches.reachability.max(initial=0.0)))
        begins = not len(self._places)
        if not begins:
            self._note_lookalikes()
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

    def nodes_within(self, odometry: Pose, reach_m: float) -> dict[NodeId, Pose]:
        """Return the poses (3,) of the nodes within `reach_m` of the likeliest place, in the frame of a robot at an
        odometry pose (3,), the nearest first."""
        self._move_to(odometry)
        return self._nodes_around(self._places.poses[0], reach_m) if len(self._places) else {}

    def look_alike_p(self) -> float:
        """Return the probability that the robot is at a look-alike of the likeliest place."""
        return float(self._places.probabilities[1:] @ self._places.alike[1:])

    def told_apart(self, waypoints: Waypoint) -> FloatArray:
        """Return (K,) the probability of the places that would look different from the likeliest one, if the robot were
        at waypoints (K, 3) from here."""
        poses, p = self._places.poses[:_TOLD_APART], self._places.probabilities[:_TOLD_APART]
        there = compose(poses[None], waypoints[:, None])
        alike = np.array([self._lookalikes.alike(self._layout, places[0], places[1:]) for places in there])
        return np.asarray((1 - np.where(np.isnan(alike), _UNKNOWN, alike)) @ p[1:])

    def probability_at(self, odometry: Pose, node: NodeId, waypoint: Waypoint) -> float:
        """Return the probability that a node is at a waypoint (3,) from a robot at an odometry pose (3,)."""
        self._move_to(odometry)
        expected = relative(self._places.poses, self._layout.poses[self._layout.row_of[node]])
        return float(self._places.probabilities[agree(expected, waypoint, AT_PLACE)].sum())

    def _lay_out(self) -> None:
        self._layout = lay_out(self._graph)
        self._version = self._graph.version

    def _matches_of(self, matches: Matches) -> NDArray[np.intp]:
        """Return for each of the N nodes of the layout its row among the matches, -1 without any."""
        if matches.nodes is self._layout.nodes:
            return np.arange(len(matches))
        row_of_match = np.full(len(self._layout.nodes), -1, np.intp)
        rows = np.array([self._layout.row_of.get(node, -1) for node in matches.nodes], np.intp)
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
        place, row = _pairs(self._layout.tree.query_ball_point(poses[:, :2], _OVERLAP_M))
        expected = relative(poses[place], self._layout.poses[row])
        away_m = apart(expected)
        near = away_m < _OVERLAP_M
        match = self._matches_of(matches)[row]
        recognised = (match >= 0) & (matches.reachability[match] > MIN_REACHABILITY)
        agrees = near & recognised & agree(expected, matches.waypoints[match], SAME_POSE)
        nearest_m = np.full(count, np.inf)
        np.minimum.at(nearest_m, place[near], away_m[near])
        agreement = np.full(count, -np.inf)
        np.maximum.at(agreement, place[agrees], self._log_ratios(matches.reachability[match[agrees]]))
        is_right = np.isfinite(agreement)
        is_known = np.isfinite(nearest_m)
        says = np.where(is_right, agreement, np.where(is_known, np.interp(nearest_m, _NEAREST_M, _DISAGREES), 0.0))
        chosen = np.flatnonzero(agrees)
        chosen = chosen[np.argsort(away_m[chosen], kind="stable")]
        rights, first = np.unique(place[chosen], return_index=True)
        pair = chosen[first]
        measured = compose(self._layout.poses[row[pair]], invert(matches.waypoints[match[pair]]))
        corrected = poses.copy()
        corrected[rights] = compose(poses[rights], _TRUST_IN_MATCH * relative(poses[rights], measured))
        log_weights = self._places.log_weights + self._told_apart(says, is_known)
        self._places = replace(self._places, poses=corrected, log_weights=log_weights)
        return is_right

    def _note_lookalikes(self) -> None:
        """Compare the likeliest hypothesis, which is the first, with the next ones."""
        poses, alike = self._places.poses, self._places.alike.copy()
        compared = slice(1, _COMPARED)
        seen = self._lookalikes.alike(self._layout, poses[0], poses[compared])
        alike[compared] += np.where(np.isnan(seen), -_FORGETS * alike[compared], _LEARNS * (seen - alike[compared]))
        alike[0] = 1.0
        self._places = replace(self._places, alike=alike)

    def _told_apart(self, says: FloatArray, is_known: NDArray[np.bool_]) -> FloatArray:
        """Return the ln likelihood ratios (M,) of an image that `says` (M,) something of each hypothesis, if it had no
        look-alikes.

        Between the likeliest place and its look-alikes, differences come from where images happened to be taken. There
        an image counts less, and nothing where no node `is_known` (M,) to be near: otherwise, of equal rooms, the robot
        would take the one of which the map has most images.
        """
        if not len(says):
            return says
        weights, alike = np.exp(self._places.log_weights), self._places.alike
        of_twins = _NEWS_OF_TWINS * says
        if is_known.any():
            mean = np.average(np.exp(of_twins[is_known]), weights=weights[is_known])
            of_twins = np.where(is_known, of_twins, np.log(mean))
        return alike * (_NEWS * says[0] + of_twins - of_twins[0]) + (1 - alike) * _NEWS * says

    def _log_ratios(self, reachability: FloatArray) -> FloatArray:
        """Return the ln likelihood ratios (N,) of images that agree with r (N,)."""
        below = _log_odds(reachability) - _log_odds(np.clip(self._highest_r, *_HIGHEST_R))
        return np.clip(_AGREES + _PER_LOG_ODDS * below, _LEAST_AGREES, _AGREES)

    def _begin_to_follow(self, matches: Matches) -> None:
        """Start a hypothesis at each match that is not near an existing one."""
        log_weight = self._places.elsewhere + _NEW if len(self._places) else 0.0
        poses = self._places.poses
        for k in np.argsort(matches.distances, kind="stable"):
            if matches.nodes[k] in self._layout.row_of:
                pose = compose(self._layout.poses[self._layout.row_of[matches.nodes[k]]], invert(matches.waypoints[k]))
                if not agree(pose, poses, _SAME_PLACE).any():
                    poses = np.concatenate([poses, pose[None]])
        new = np.full(len(poses) - len(self._places), log_weight)
        log_weights, alike = self._places.log_weights, self._places.alike
        self._places = replace(
            self._places,
            poses=poses,
            log_weights=np.concatenate([log_weights, new]),
            alike=np.concatenate([alike, np.full(len(new), _UNKNOWN)]),
        )

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
        self._places = _Places(places.poses[kept], places.log_weights[kept] - best, places.alike[kept], elsewhere)
        self._is_recognised = bool(kept) and kept[0] < len(agrees) and bool(agrees[kept[0]])
        self._is_sure = self._is_recognised and self._places.probabilities[0] > _SURE

    def _nodes_around(self, pose: Pose, reach_m: float = _AROUND_M) -> dict[NodeId, Pose]:
        rows = np.array(self._layout.tree.query_ball_point(pose[:2], reach_m), np.intp)
        poses = relative(pose, self._layout.poses[rows])
        return {self._layout.nodes[rows[k]]: poses[k] for k in np.argsort(apart(poses), kind="stable")}


def _log_odds(p: ArrayLike) -> FloatArray:
    p = np.clip(np.asarray(p, np.float64), 1e-6, 1 - 1e-6)
    return np.asarray(np.log(p / (1 - p)), np.float64)


def _pairs(found: NDArray[np.object_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all pairs of a place and a node, as rows (P,), from the list of nodes found for each place."""
    counts = [len(rows) for rows in found]
    return np.repeat(np.arange(len(found)), counts), np.array([row for rows in found for row in rows], np.intp)
