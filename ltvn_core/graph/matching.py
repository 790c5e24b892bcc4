"""One image against many: reachability, waypoint and distance, with temporal support where needed.

Owns the calls of the predictor. Does not decide what a match means: `graph.operators` and `graph.localiser` do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import MatchingConfig
from ltvn_core.geometry import distance, invert
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import Features, FrameId, NodeId, Prediction, Predictor, Waypoint

_SUPPORT_GAP = 0.8
"""Greatest d by odometry of two frames of a recording that count as neighbours in time."""
_MAX_NODES_BOTH_WAYS_AT_ONCE = 8
"""Number of nodes up to which both directions are compared in one call."""


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Answers of the predictor for one image and N nodes."""

    nodes: tuple[NodeId, ...]
    """The N compared nodes."""
    reachability: NDArray[np.float64]
    """(N,) in [0, 1]."""
    waypoints: Waypoint
    """(N, 3): the nodes in the image's frame."""
    distances: NDArray[np.float64]
    """(N,): d(w), Eq. 2."""
    ahead: NDArray[np.bool_]
    """(N,) whether r is for the way from the image to the node; where false, it is for the way back, and the waypoint
    was inverted."""

    @classmethod
    def of_one(cls, node: NodeId, reachability: float, waypoint: Waypoint) -> "Matches":
        """Return a single match, a node at a waypoint (3,)."""
        row = np.asarray(waypoint, np.float64)[None]
        return cls((node,), np.array([reachability]), row, distance(row), np.ones(1, bool))

    def __len__(self) -> int:
        return len(self.nodes)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "Matches":
        """Return the chosen matches: a mask (N,) or indices."""
        kept = np.arange(len(self))[chosen]
        return Matches(tuple(self.nodes[k] for k in kept), *(each[kept] for each in self._arrays))

    def with_reachability(self, reachability: NDArray[np.float64]) -> "Matches":
        """Return the same matches with another reachability."""
        return replace(self, reachability=reachability)

    def concatenated(self, other: "Matches") -> "Matches":
        """Return these matches and others of the same image."""
        pairs = zip(self._arrays, other._arrays, strict=True)
        return Matches(self.nodes + other.nodes, *map(np.concatenate, pairs))

    @property
    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return self.reachability, self.waypoints, self.distances, self.ahead


@dataclass(frozen=True, slots=True, eq=False)
class Matcher:
    """Compares pairs of images with known features, using the predictor."""

    predictor: Predictor
    keyframes: KeyframeStore
    """The images that can be compared against."""
    config: MatchingConfig
    """How images are compared."""

    def match(self, features: Features, nodes: Sequence[NodeId]) -> Matches:
        """Compare an image (1, F) with the images of `nodes`."""
        if not nodes:
            return Matches((), np.empty(0), np.empty((0, 3)), np.empty(0), np.empty(0, bool))
        nodes = tuple(nodes)
        forward, backward = self._answers(features, nodes)
        reachability = np.array(forward.reachability)
        waypoints = np.array(forward.waypoints)
        # For a pair that it skips, a predictor returns a low r and a waypoint of zeros.
        is_skipped = (reachability < 0.5) & ~waypoints.any(axis=1)
        distances = np.where(is_skipped, np.inf, distance(waypoints))
        found = Matches(nodes, reachability, waypoints, distances, np.ones(len(nodes), bool))
        return self._both_ways(features, found, backward) if self.config.both_directions else found

    def promising(self, frame: FrameId, nodes: Sequence[NodeId]) -> tuple[NodeId, ...]:
        """Return the nodes that may look like a stored frame; all of them if the predictor has no cheap test."""
        may_match = getattr(self.predictor, "may_match", None)
        if may_match is None or not nodes:
            return tuple(nodes)
        likely = may_match(self.keyframes.features([frame]), self.keyframes.features(nodes))
        return tuple(node for node, is_likely in zip(nodes, likely, strict=True) if is_likely)

    def match_pairs(self, first: Features, second: Features) -> tuple[NDArray[np.float64], Waypoint]:
        """Compare P pairs of images (P, F), (P, F) in both directions; return the larger r (P,) and its waypoints (P,
        3)."""
        there, back = self.match_both_ways(first, second)
        ahead = there.reachability >= back.reachability
        waypoints = np.where(ahead[:, None], there.waypoints, invert(back.waypoints))
        return np.maximum(there.reachability, back.reachability), waypoints

    def with_mutual_support(self, matches: Matches, frame: FrameId) -> Matches:
        """Return `matches` of a stored frame, each r lowered to the median over both images' neighbours in time.

        A false match between perceptual aliases rarely survives a step to either side, but a true match does.
        """
        own = self.keyframes.temporal_neighbours(frame, _SUPPORT_GAP)
        return self._with_support(matches, self.keyframes.features([frame]), own)

    def with_node_support(self, matches: Matches, features: Features) -> Matches:
        """Return `matches` of a new image (1, F), each r lowered to the median over the nodes' neighbours in time."""
        return self._with_support(matches, features, ())

    def _answers(self, features: Features, nodes: tuple[FrameId, ...]) -> tuple[Prediction, Prediction | None]:
        """Compare an image (1, F) with N nodes.

        If they are few, the same call compares them with the image too, because a second call would cost more.
        """
        if self.config.both_directions and len(nodes) <= _MAX_NODES_BOTH_WAYS_AT_ONCE:
            return self.match_both_ways(np.repeat(features, len(nodes), axis=0), self.keyframes.features(nodes))
        predict_among = getattr(self.predictor, "predict_among", None)
        held = None if predict_among is None else self.keyframes.held(nodes)
        if predict_among is None or held is None:
            return self.predictor.predict(features, self.keyframes.features(nodes)), None
        return predict_among(features, held), None

    def match_both_ways(self, first: Features, second: Features) -> tuple[Prediction, Prediction]:
        """Compare P pairs of images (P, F), (P, F) in both directions in one call."""
        count = len(first)
        both = self.predictor.predict(np.concatenate([first, second]), np.concatenate([second, first]))
        return Prediction(*(part[:count] for part in both)), Prediction(*(part[count:] for part in both))

    def _both_ways(self, features: Features, found: Matches, answered: Prediction | None) -> Matches:
        """Compare the near nodes with the image too, and keep the answer with the higher r."""
        # The network measures a motion by aligning both images, so its waypoint is right even where r is low, and only
        # the nodes that are near by this waypoint need the second comparison.
        close = np.flatnonzero(found.distances < self.config.reverse_within)
        if not len(close):
            return found
        if answered is None:
            targets = self.keyframes.features([found.nodes[k] for k in close])
            backward = self.predictor.predict(targets, np.repeat(features, len(close), axis=0))
        else:
            backward = Prediction(*(part[close] for part in answered))
        better = backward.reachability > found.reachability[close]
        chosen = close[better]
        found.reachability[chosen] = backward.reachability[better]
        found.waypoints[chosen] = invert(backward.waypoints[better])
        found.distances[chosen] = distance(backward.waypoints[better])
        found.ahead[chosen] = False
        return found

    def _with_support(self, matches: Matches, features: Features, own: Sequence[FrameId]) -> Matches:
        if not self.config.temporal_support or not len(matches):
            return matches
        images, nodes, owners = self._neighbouring_pairs(matches, features, own)
        if not len(owners):
            return matches
        ahead = matches.ahead[owners][:, None]
        answers = self.predictor.predict(np.where(ahead, images, nodes), np.where(ahead, nodes, images))
        medians = [
            np.median([matches.reachability[k], *answers.reachability[owners == k]]) for k in range(len(matches))
        ]
        return matches.with_reachability(np.minimum(matches.reachability, medians))

    def _neighbouring_pairs(
        self, matches: Matches, features: Features, own: Sequence[FrameId]
    ) -> tuple[Features, Features, NDArray[np.intp]]:
        """Return P pairs of images (P, F), (P, F) that are neighbours in time of the matches, and the match (P,) of
        each pair."""
        stored = self.keyframes.features
        around = [self.keyframes.temporal_neighbours(node, _SUPPORT_GAP) for node in matches.nodes]
        beside = [(k, frame) for k, frames in enumerate(around) for frame in frames]
        here = np.repeat(features, len(beside), axis=0), np.repeat(stored(own), len(matches), axis=0)
        there = stored([frame for _, frame in beside]), np.tile(stored(matches.nodes), (len(own), 1))
        owners = np.array([k for k, _ in beside], np.intp), np.tile(np.arange(len(matches)), len(own))
        return np.concatenate(here), np.concatenate(there), np.concatenate(owners)
