"""What a navigator thinks with: the map, the images of its nodes, the network and the system, in one place.

Owns the one way in which the map changes while the robot navigates. Decides nothing.
"""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.closures import Closures
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.system import System
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.nav.events import GraphChanged
from ltvn_core.types import Intrinsics, Predictor


@dataclass(frozen=True, slots=True, eq=False)
class Mind:
    """Everything that outlives one query."""

    graph: TopologicalGraph
    views: Views
    predictor: Predictor
    system: System
    rng: np.random.Generator
    intrinsics: Intrinsics
    matcher: Matcher
    planner: Planner
    closures: Closures
    attempts: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    """Numbers the legs."""

    @property
    def method(self) -> Method:
        """The system's thresholds."""
        return self.system.method

    @classmethod
    def of(
        cls,
        graph: TopologicalGraph,
        views: Views,
        predictor: Predictor,
        system: System,
        rng: np.random.Generator,
        intrinsics: Intrinsics,
    ) -> "Mind":
        """Put the parts together."""
        matcher = Matcher(predictor, views, system.method.matching)
        planner = Planner(graph, system.method.planning, weight=system.edge_weight)
        return cls(graph, views, predictor, system, rng, intrinsics, matcher, planner, Closures(matcher))

    def change(self, deltas: Iterable[GraphDelta], query: int, attempt: int | None = None) -> Iterator[GraphChanged]:
        """Apply deltas to the map, each with its event."""
        for delta in deltas:
            self.graph.apply(delta)
            self.planner.follow(delta)
            yield GraphChanged(delta, query, attempt)
