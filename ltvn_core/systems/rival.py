"""Rivals as rows of a table: what each keeps of a drive, how it weighs edges, and how it localises the robot.

Owns what rivals share: the comparison of images with each other, and the deltas of nodes and edges. A rival keeps
images and joins pairs of them by a function of its own; `ltvn_core.systems.system_table` has the rows.
"""

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.geometry import distance, invert
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore, usable_trajectory
from ltvn_core.graph.localiser import GLOBAL, LOCAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import (
    Deltas,
    LocalisationStrategy,
    MaintenanceStrategy,
    NavigationSystem,
    NoMaintenance,
    SubgoalStrategy,
    choose_first_node,
)
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.planner import EdgeWeight
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.systems.entry import SystemEntry, TemporalLearning
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


@dataclass(frozen=True, slots=True, eq=False)
class AllPairs:
    """Predictions for all ordered pairs of N images."""

    reachability: NDArray[np.float64]
    """(N, N) r from the row to the column; 0 without a waypoint."""
    waypoints: NDArray[np.float64]
    """(N, N, 3)"""
    may_reverse: bool
    """Whether the robot may drive an edge in reverse, so that an edge back is as good as the edge."""

    @property
    def surer(self) -> NDArray[np.float64]:
        """Return r (N, N), of the better direction if the robot may reverse."""
        return np.maximum(self.reachability, self.reachability.T) if self.may_reverse else self.reachability

    def link(self, source: int, target: int, p: float) -> EdgeCandidate:
        """Return an edge with probability p; it is driven in reverse, if the edge back has the higher r."""
        if self.may_reverse and self.reachability[target, source] > self.reachability[source, target]:
            return EdgeCandidate(target, source, p, self.waypoints[target, source]).reversed()
        return EdgeCandidate(source, target, p, self.waypoints[source, target])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DriveImages:
    """The usable images of a drive in order of time; a row is the place of an image among them."""

    observations: Sequence[Observation]
    features: Features
    """(N, F)"""
    keyframes: KeyframeStore
    predictor: Predictor
    method: Method
    rng: np.random.Generator
    goals: frozenset[int]
    """Rows that must become nodes."""
    progress: ProgressCallback | None

    @property
    def rows(self) -> range:
        """All rows."""
        return range(len(self.observations))

    @property
    def may_reverse(self) -> bool:
        """Whether the robot may drive an edge in reverse."""
        return self.method.matching.both_directions

    def consecutive(self) -> list[tuple[int, int]]:
        """Return the pairs of consecutive images of the same drive."""
        drives = [self.keyframes.drive_of(seen.step) for seen in self.observations]
        return [(row, row + 1) for row, (before, after) in enumerate(itertools.pairwise(drives)) if before == after]

    def predictions(self, rows: Sequence[int] | None = None) -> Iterator[Prediction]:
        """Yield the predictions of each of the rows, by default all, against all of them, itself included."""
        features = self.features if rows is None else self.features[rows]
        for k in range(len(features)):
            yield self.predictor.predict(features[k : k + 1], features)
            if self.progress is not None:
                self.progress(k + 1, len(features))

    def all_pairs(self) -> AllPairs:
        """Compare all ordered pairs."""
        found = list(self.predictions())
        reachability = np.stack([np.where(has_no_waypoint(each.waypoints), 0.0, each.reachability) for each in found])
        return AllPairs(reachability, np.stack([each.waypoints for each in found]), self.may_reverse)


KeepRule: TypeAlias = Callable[[DriveImages], tuple[Sequence[int], Iterable[EdgeCandidate]]]
"""Returns the rows that become nodes, in order of time and with all goals, and the edges between them."""


def rival(
    name: str,
    label: str,
    *,
    keeps: KeepRule,
    weighs: EdgeWeight,
    localises: LocalisationStrategy,
    subgoal: SubgoalStrategy = choose_first_node,
    maintenance: MaintenanceStrategy | None = None,
    scaled: Callable[[Method], Method] | None = None,
    weights: Path = SHIPPED_WEIGHTS,
    learning: TemporalLearning | None = None,
) -> SystemEntry:
    """Return the entry of a navigation system whose map is made of images of the drive.

    Args:
        name: Name on the command line and in files.
        label: Name in tables and figures.
        keeps: Chooses nodes and edges.
        weighs: Cost of an edge by its belief.
        localises: Finds the node that the robot is at.
        subgoal: Chooses the node of a path to drive to.
        maintenance: What it learns from driving, if the method maintains; None learns nothing.
        scaled: Converts the thresholds of a method to the scale of the system's r.
        weights: Default weights of its network.
        learning: Settings if its network learns from time.
    """

    def factory(method: Method) -> NavigationSystem:
        method = scaled(method) if scaled else method
        return NavigationSystem(
            name=name,
            method=method,
            build=partial(_build, keeps=keeps, method=method),
            edge_weight=weighs,
            localise=localises,
            subgoal=subgoal,
            maintenance=NoMaintenance() if maintenance is None or not method.maintain else maintenance,
        )

    return SystemEntry(name=name, label=label, factory=factory, weights=weights, learning=learning)


def _build(
    observations: Sequence[Observation],
    keyframes: KeyframeStore,
    predictor: Predictor,
    *,
    keeps: KeepRule,
    method: Method,
    rng: np.random.Generator,
    goals: Collection[FrameId] = (),
    progress: ProgressCallback | None = None,
) -> Deltas:
    """Return the deltas of a map; raises MapError like `usable_trajectory`."""
    goals = frozenset(goals)
    seen = sorted(usable_trajectory(observations, predictor, goals), key=lambda each: each.step)
    frames: list[FrameId] = [each.step for each in seen]
    keyframes.add(seen)
    keyframes.keep_only(frames)
    images = DriveImages(
        observations=seen,
        features=keyframes.features(frames),
        keyframes=keyframes,
        predictor=predictor,
        method=method,
        rng=rng,
        goals=frozenset(row for row, frame in enumerate(frames) if frame in goals),
        progress=progress,
    )
    nodes, links = keeps(images)
    edges = [
        Edge(
            frames[link.source],
            frames[link.target],
            pose_row(link.waypoint),
            Belief(float(link.p), float(distance(link.waypoint)), method.believing.sigma2),
        )
        for link in links
    ]
    keyframes.keep_only([frames[row] for row in nodes])
    added = [NodeAdded(node_from_observation(seen[row]), Cause.BUILD) for row in nodes]
    return (*added, *(EdgeAdded(edge, Cause.BUILD) for edge in edges))


_LEAST_P = 1e-6
"""Lower limit of p in a cost that depends only on the belief."""


def hop_cost(belief: Belief) -> float:
    """Return 1, so that the cheapest path has the fewest edges."""
    return 1.0


def surprise_cost(belief: Belief) -> float:
    """Return -ln p, so that the cheapest path is the most probable one."""
    return -math.log(max(belief.p, _LEAST_P))


def localise_at_most_reachable(
    features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
) -> Localisation:
    """Find the node with the highest r, without a threshold."""
    matches = matcher.match(features, prior.candidates(graph))
    return best_localisation(matches, -matches.reachability, np.isfinite(matches.distances), GLOBAL)


def on_last_path(
    features: Features,
    graph: TopologicalGraph,
    prior: LocalisationPrior,
    matcher: Matcher,
    least: float,
    *,
    ahead: int | None = None,
) -> Localisation | None:
    """Return the most reachable node among the first `ahead`, by default all, of the last path; None if none has an r
    of at least `least`."""
    nodes = [node for node in prior.plan[:ahead] if node in graph.nodes and node not in prior.doubted]
    near = matcher.match(features, nodes)
    passing = near.reachability >= least
    return best_localisation(near, -near.reachability, passing, LOCAL) if passing.any() else None


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
