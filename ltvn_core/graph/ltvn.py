"""The paper's own system: Algorithm 1, Dijkstra on d, the first node of the path, and lifelong maintenance.

Owns how these parts are put together; each lives in its own module.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ltvn_core.config import LocalisingConfig, Method
from ltvn_core.graph.builder import build
from ltvn_core.graph.expansion import expand
from ltvn_core.graph.localiser import Localisation, LocalisationPrior, Localiser
from ltvn_core.graph.maintenance import AttemptEvidence, UnrecognisedObservation, novel_node, update_edge
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.graph.online_builder import OnlineBuilder
from ltvn_core.graph.planner import edge_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, NodeId


def ltvn_system(method: Method) -> NavigationSystem:
    """Return the paper's system; its map stays as it is if the method does not maintain."""
    return NavigationSystem(
        name="ltvn",
        method=method,
        build=partial(build, method=method),
        edge_weight=partial(edge_cost, config=method.planning),
        localise=partial(_localise, config=method.localising),
        subgoal=choose_first_node,
        maintenance=LifelongMaintenance(method) if method.maintain else NoMaintenance(),
        online=partial(OnlineBuilder, method=method),
        follows_places=method.localising.follow_places,
    )


@dataclass(frozen=True, slots=True)
class LifelongMaintenance:
    """Eq. 3 and Eq. 4, pruning, novel nodes and the search through the reserve."""

    method: Method

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Update the belief of the edge, and prune it if it has failed too often."""
        return update_edge(graph, attempt, self.method.believing)

    def no_path(
        self, graph: TopologicalGraph, source: NodeId, goal: NodeId, matcher: Matcher, rng: np.random.Generator
    ) -> Deltas:
        """Search the reserve for a path."""
        if not self.method.expanding.search_reserve:
            return ()
        return expand(graph, source, goal, matcher, self.method, rng)

    def unrecognised(self, graph: TopologicalGraph, unrecognised: UnrecognisedObservation, matcher: Matcher) -> Deltas:
        """Make a node of the image once looking around has not helped."""
        patience = self.method.expanding.novel_after_looks
        if not patience or unrecognised.consecutive_failures < patience:
            return ()
        return novel_node(graph, unrecognised, matcher, self.method)


def _localise(
    features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher, *, config: LocalisingConfig
) -> Localisation:
    return Localiser(matcher, config).localise(features, graph, prior)
