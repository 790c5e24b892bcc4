"""Maps in which every image of the trajectory may be a node, as in most baselines.

Owns the comparison of each image with all others, and the deltas of nodes and edges. Each system decides which pairs it
joins.
"""

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BeliefConfig
from ltvn_core.geometry import distance, invert
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.trajectory import usable_trajectory
from ltvn_core.types import Features, FrameId, Observation, Prediction, Predictor, Waypoint


class EdgeCandidate(NamedTuple):
    """A candidate for a directed edge, from one image of the trajectory to another, both by their row in it."""

    source: int
    target: int
    p: float
    """Reachability, as predicted by the network."""
    waypoint: Waypoint
    """(3,) pose of the target in the frame of the source."""

    def reversed(self) -> "EdgeCandidate":
        """Return the edge back, driven in reverse."""
        return EdgeCandidate(self.target, self.source, self.p, invert(self.waypoint))


def consecutive_rows(ordered: Sequence[Observation], keyframes: KeyframeStore) -> list[tuple[int, int]]:
    """Return the pairs of consecutive images of the same drive, as rows of the trajectory."""
    drives = [keyframes.drive_of(seen.step) for seen in ordered]
    return [(row, row + 1) for row, (before, after) in enumerate(itertools.pairwise(drives)) if before == after]


def encode_trajectory(
    observations: Sequence[Observation], keyframes: KeyframeStore, predictor: Predictor, goals: Collection[FrameId]
) -> tuple[list[Observation], Features]:
    """Return the usable images in order of time, and their features (N, F); `keyframes` keeps only these images.

    Raises MapError like `usable_trajectory`.
    """
    ordered = sorted(usable_trajectory(observations, predictor, goals), key=lambda seen: seen.step)
    frames: list[FrameId] = [seen.step for seen in ordered]
    keyframes.add(ordered)
    keyframes.keep_only(frames)
    return ordered, keyframes.features(frames)


def predict_all_pairs(
    features: Features, predictor: Predictor, progress: ProgressCallback | None
) -> Iterator[Prediction]:
    """Yield the predictions for each of N images against all N, including itself."""
    for k in range(len(features)):
        yield predictor.predict(features[k : k + 1], features)
        if progress is not None:
            progress(k + 1, len(features))


@dataclass(frozen=True, slots=True, eq=False)
class AllPairs:
    """Predictions for all ordered pairs of N images."""

    reachability: NDArray[np.float64]
    """(N, N) r from the row to the column; 0 without a waypoint."""
    waypoints: NDArray[np.float64]
    """(N, N, 3)"""

    @classmethod
    def predict(cls, features: Features, predictor: Predictor, progress: ProgressCallback | None) -> "AllPairs":
        """Compare all ordered pairs of N images."""
        found = list(predict_all_pairs(features, predictor, progress))
        reachability = np.stack([np.where(has_no_waypoint(each.waypoints), 0.0, each.reachability) for each in found])
        return cls(reachability, np.stack([each.waypoints for each in found]))

    def link(self, source: int, target: int, p: float, *, may_reverse: bool = True) -> EdgeCandidate:
        """Return an edge with probability p; it is driven in reverse, if the edge back has the higher r."""
        if may_reverse and self.reachability[target, source] > self.reachability[source, target]:
            return EdgeCandidate(target, source, p, self.waypoints[target, source]).reversed()
        return EdgeCandidate(source, target, p, self.waypoints[source, target])


def surest_links(links: Iterable[EdgeCandidate], *, both_directions: bool) -> list[EdgeCandidate]:
    """Return the link with the highest p for each pair of ends; `both_directions` adds the edge back of each link."""
    surest: dict[tuple[int, int], EdgeCandidate] = {}
    for link in links:
        for each in (link, link.reversed()) if both_directions else (link,):
            ends = each.source, each.target
            if ends not in surest or surest[ends].p < each.p:
                surest[ends] = each
    return list(surest.values())


def cheapest_from_each(costs: NDArray[np.float64], count: int, *, below: float = np.inf) -> list[tuple[int, int]]:
    """Return, for each of N nodes, the `count` edges to other nodes with the least costs (N, N) that are less than
    `below`."""
    edges = []
    for node, row in enumerate(costs):
        best = [int(other) for other in np.argsort(row, kind="stable") if other != node and row[other] < below]
        edges += [(node, other) for other in best[:count]]
    return edges


def has_no_waypoint(waypoints: Waypoint) -> NDArray[np.bool_]:
    """Return a mask (N,) of the images without a waypoint, which the predictor did not compare in full."""
    return np.asarray(~waypoints.any(axis=-1))


def all_image_deltas(
    observations: Sequence[Observation], candidates: Iterable[EdgeCandidate], config: BeliefConfig
) -> Iterator[NodeAdded | EdgeAdded]:
    """Yield all images as nodes, then the candidates as edges."""
    for seen in observations:
        yield NodeAdded(node_from_observation(seen), Cause.BUILD)
    for candidate in candidates:
        belief = Belief(float(candidate.p), float(distance(candidate.waypoint)), config.sigma2)
        ends = observations[candidate.source].step, observations[candidate.target].step
        yield EdgeAdded(Edge(*ends, pose_row(candidate.waypoint), belief), Cause.BUILD)
