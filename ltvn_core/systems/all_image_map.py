"""Maps in which every image of the trajectory may be a node, as most baselines build them.

Owns comparing each image with all others, and the deltas of nodes and edges. Does not own which pairs are joined.
"""

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BeliefConfig
from ltvn_core.geometry import distance, invert
from ltvn_core.graph.builder import ProgressCallback
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.trajectory import usable_trajectory
from ltvn_core.types import Features, FrameId, Observation, Prediction, Predictor, Waypoint


class EdgeCandidate(NamedTuple):
    """A directed edge to be: from one image of the trajectory to another, both by their place in it."""

    source: int
    target: int
    p: float
    """Reachability as the network says."""
    waypoint: Waypoint
    """(3,): the target in the frame of the source."""

    def reversed(self) -> "EdgeCandidate":
        """Return the way back, driven in reverse."""
        return EdgeCandidate(self.target, self.source, self.p, invert(self.waypoint))


def consecutive_rows(ordered: Sequence[Observation], keyframes: KeyframeStore) -> list[tuple[int, int]]:
    """Return which images followed each other on a drive, as rows; none across the beginning of another drive."""
    drives = [keyframes.drive_of(seen.step) for seen in ordered]
    return [(row, row + 1) for row, (before, after) in enumerate(itertools.pairwise(drives)) if before == after]


def encode_trajectory(
    observations: Sequence[Observation], keyframes: KeyframeStore, predictor: Predictor, goals: Collection[FrameId]
) -> tuple[list[Observation], Features]:
    """Return the usable images in the order they were taken and their features (N, F); `keyframes` holds just these.

    Raises MapError as `usable_trajectory`.
    """
    ordered = sorted(usable_trajectory(observations, predictor, goals), key=lambda seen: seen.step)
    frames: list[FrameId] = [seen.step for seen in ordered]
    keyframes.add(ordered)
    keyframes.keep_only(frames)
    return ordered, keyframes.features(frames)


def predict_all_pairs(
    features: Features, predictor: Predictor, progress: ProgressCallback | None
) -> Iterator[Prediction]:
    """Yield for each of N images what the network says of it and all N, itself among them."""
    for k in range(len(features)):
        yield predictor.predict(features[k : k + 1], features)
        if progress is not None:
            progress(k + 1, len(features))


@dataclass(frozen=True, slots=True, eq=False)
class AllPairs:
    """What the network says of each of N images and each other."""

    reachability: NDArray[np.float64]
    """(N, N) r from the row to the column; 0 where there is no waypoint."""
    waypoints: NDArray[np.float64]
    """(N, N, 3)"""

    @classmethod
    def predict(cls, features: Features, predictor: Predictor, progress: ProgressCallback | None) -> "AllPairs":
        """Ask about all pairs of N images."""
        found = list(predict_all_pairs(features, predictor, progress))
        reachability = np.stack([np.where(has_no_waypoint(each.waypoints), 0.0, each.reachability) for each in found])
        return cls(reachability, np.stack([each.waypoints for each in found]))

    def link(self, source: int, target: int, p: float, *, may_reverse: bool = True) -> EdgeCandidate:
        """Return a link with probability p; the way back, driven in reverse, where the network is surer of that."""
        if may_reverse and self.reachability[target, source] > self.reachability[source, target]:
            return EdgeCandidate(target, source, p, self.waypoints[target, source]).reversed()
        return EdgeCandidate(source, target, p, self.waypoints[source, target])


def surest_links(links: Iterable[EdgeCandidate], *, both_directions: bool) -> list[EdgeCandidate]:
    """Return of links with the same ends the one of which the network is surest; each is its way back as well, too."""
    surest: dict[tuple[int, int], EdgeCandidate] = {}
    for link in links:
        for each in (link, link.reversed()) if both_directions else (link,):
            ends = each.source, each.target
            if ends not in surest or surest[ends].p < each.p:
                surest[ends] = each
    return list(surest.values())


def cheapest_from_each(costs: NDArray[np.float64], count: int, *, below: float = np.inf) -> list[tuple[int, int]]:
    """Return of each of N nodes the `count` edges of least cost (N, N), itself left out, and only those `below`."""
    edges = []
    for node, row in enumerate(costs):
        best = [int(other) for other in np.argsort(row, kind="stable") if other != node and row[other] < below]
        edges += [(node, other) for other in best[:count]]
    return edges


def has_no_waypoint(waypoints: Waypoint) -> NDArray[np.bool_]:
    """Tell (N,) to which images the network gave no waypoint, because it only glanced at them."""
    return np.asarray(~waypoints.any(axis=-1))


def all_image_deltas(
    observations: Sequence[Observation], candidates: Iterable[EdgeCandidate], config: BeliefConfig
) -> Iterator[NodeAdded | EdgeAdded]:
    """Yield all images as nodes and then the links as edges."""
    for seen in observations:
        yield NodeAdded(node_from_observation(seen), Cause.BUILD)
    for candidate in candidates:
        belief = Belief(float(candidate.p), float(distance(candidate.waypoint)), config.sigma2)
        ends = observations[candidate.source].step, observations[candidate.target].step
        yield EdgeAdded(Edge(*ends, pose_row(candidate.waypoint), belief), Cause.BUILD)
