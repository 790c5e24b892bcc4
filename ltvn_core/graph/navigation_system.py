"""A navigation system, divided as in the paper's Table I: five strategies that can be exchanged one by one, and three
optional parts: online mapping, presence of edges and a place belief.

Owns the interfaces alone. `graph.ltvn` composes the paper's own system, and `ltvn_core.systems` its baselines; the
navigator works with any `NavigationSystem`:

| system | build | edge_weight | subgoal | localise | maintenance |
|---|---|---|---|---|---|
| LTVN | Algorithm 1 | d | first node | least d near the last plan | Bayes, pruning, new nodes |
| SPTM | all images, the 2,000 best shortcuts | hops | farthest close node | r of the next nodes | none |
| ViNG | all images, edge if near in time | steps | first node | nearest in time | none |
| Meng et al. | greedy anchors, the last image still reachable | -ln p | first node | r of the next anchors | none |
| SGM | two-way consistent merging, 5 nearest out-edges | hops | first node | nearest in time | delete what failed |
| SoRB | 1,000 images at most, edge if an ensemble says near | steps | the goal if nearer | nearest in time | none |
| HTM | all images, the 50 best of a complete graph | 1 / share of a score | first node | best score | none |
| BRM | Algorithm 1 | -ln p | first node | as LTVN | Bayes on noisy observations |
| PlaceNav | Algorithm 1 | d | first node | discrete Bayes filter | as LTVN |

Not here: LEAP, which has no map; `docs/method.md` explains why it is not run.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import Localisation, LocalisationPrior
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.planner import EdgeWeight
from ltvn_core.graph.presence.edge_presence import ALWAYS_OPEN, EdgePresence
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, FrameId, NodeId, Observation, Predictor

Deltas: TypeAlias = tuple[GraphDelta, ...]
"""Changes of the map in order; none if nothing changes."""


class BuildStrategy(Protocol):
    """Chooses which images become nodes, and which edges join them."""

    def __call__(
        self,
        observations: Sequence[Observation],
        keyframes: KeyframeStore,
        predictor: Predictor,
        *,
        rng: np.random.Generator,
        goals: Collection[FrameId] = (),
        progress: ProgressCallback | None = None,
    ) -> Deltas:
        """Return the deltas of a new map.

        Afterwards `keyframes` contains its images, and all `goals` are nodes or in the reserve. Raises MapError for an
        empty trajectory, frame numbers that repeat, and goals that are not frames.
        """
        ...


class OnlineStrategy(Protocol):
    """Grows a map during driving."""

    def offer(self, observation: Observation) -> Deltas:
        """Return what one more image changes; apply the deltas before offering the next."""
        ...


OnlineStrategyFactory: TypeAlias = Callable[[TopologicalGraph, KeyframeStore, Predictor], OnlineStrategy]
"""Starts the growth of a graph, given the images of its nodes."""

LocalisationStrategy: TypeAlias = Callable[[Features, TopologicalGraph, LocalisationPrior, Matcher], Localisation]
"""Finds the node that the robot is at: compares the current image (1, F) with the map, given the state of the query."""

SubgoalStrategy: TypeAlias = Callable[[Sequence[NodeId], Callable[[NodeId], float]], int]
"""Chooses the node of a planned path that the robot drives to next: returns its index in the path, at least 1. The path
has two nodes or more and begins where the robot is. The function returns how reachable a node is from here; each call
costs a comparison."""


class MaintenanceStrategy(Protocol):
    """Updates the map from driving. What a subclass leaves out changes nothing."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Learn from an attempt. Its ends need not be joined by an edge if the subgoal lies farther ahead."""
        return ()

    def no_path(
        self, graph: TopologicalGraph, source: NodeId, goal: NodeId, matcher: Matcher, rng: np.random.Generator
    ) -> Deltas:
        """Search for a path where the map has none; called once per source and query."""
        return ()

    def unrecognised(
        self, graph: TopologicalGraph, seen: Observation, features: Features, looks: int, matcher: Matcher
    ) -> Deltas:
        """Use an image, with features (1, F), in which no node was recognised, or only nodes where the robot cannot be.

        It is the last of `looks` consecutive ones without a node or a path. If it becomes a node, the navigator stores
        it.
        """
        return ()


class NoMaintenance(MaintenanceStrategy):
    """The maintenance of a system that has none: the map stays as it was built."""


def choose_first_node(path: Sequence[NodeId], reachability: Callable[[NodeId], float]) -> int:
    """Choose the node that comes first on the path, as the paper and most baselines do."""
    return 1


@dataclass(frozen=True, slots=True)
class NavigationSystem:
    """A navigation system: five strategies, three parts that a system may have, and the thresholds of all the rest.

    The three parts, `online`, `presence` and `follows_places`, are off by default.
    """

    name: str
    """Name of the system in reports."""
    method: Method
    """Thresholds of everything that is not exchanged: comparing images, the controller, judging, recovering."""
    build: BuildStrategy
    edge_weight: EdgeWeight
    localise: LocalisationStrategy
    subgoal: SubgoalStrategy
    maintenance: MaintenanceStrategy
    online: OnlineStrategyFactory | None = None
    """Grows a map image by image; None for a system that only builds whole maps."""
    presence: EdgePresence = ALWAYS_OPEN
    """Predicts which edges are closed now."""
    follows_places: bool = False
    """Whether it localises, drives and judges by a place belief over all images of a query."""

    @property
    def follows_presence(self) -> bool:
        """Whether the system distinguishes an edge that is closed now from one that does not exist."""
        return type(self.presence) is not EdgePresence
