"""What a navigation system must do: build maps that hold together, the same ones from the same images."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.contracts.contract_check import ContractCheck, require, run_checks
from ltvn_core.contracts.sample_images import SampleImages, sample_images
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.plugins import Plugin
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.request import predictor_card
from ltvn_core.systems.registry import load_system
from ltvn_core.types import Predictor

IMAGES = 12
PARTS = ("build", "edge_weight", "localise", "subgoal")


def system_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Make a navigation system and let it build a small map."""
    contract = SystemContract(plugin, sample_images(IMAGES))
    return run_checks(
        ("is made with the thresholds of a method", contract.is_made),
        [
            ("builds a map of the images that it is given", contract.builds),
            ("builds the same map again", contract.is_deterministic),
            ("weighs edges by finite numbers of at least 0", contract.weighs_edges),
        ],
    )


@dataclass(frozen=True)
class SystemContract:
    """A navigation system and the images that it is tried on."""

    plugin: Plugin
    samples: SampleImages

    @cached_property
    def system(self) -> NavigationSystem:
        """The system with the robust preset."""
        return load_system(self.plugin).factory(ROBUST)

    @cached_property
    def predictor(self) -> Predictor:
        """Needs no weights and no simulator."""
        return GeometricPredictor(self.samples.meta.camera)

    @cached_property
    def deltas(self) -> Deltas:
        """Of its map."""
        return self._build()

    def is_made(self) -> str:
        """Look at its parts."""
        require(
            isinstance(self.system, NavigationSystem),
            f"its factory must return a NavigationSystem, got {type(self.system).__name__}",
        )
        missing = [part for part in PARTS if not callable(getattr(self.system, part))]
        require(not missing, f"these parts cannot be called: {', '.join(missing)}")
        return self.system.name

    def builds(self) -> str:
        """Apply its deltas."""
        graph = TopologicalGraph(self.deltas)
        given = {seen.step for seen in self.samples.observations}
        require(bool(graph.nodes), "its map has no node")
        require({*graph.nodes, *graph.reserve} <= given, "its map has nodes that are no image of the drive")
        return f"{len(graph.nodes)} nodes, {len(graph.edges)} edges of {IMAGES} images"

    def is_deterministic(self) -> str:
        """Build once more with the same random numbers."""
        require(self._build() == self.deltas, "the second map is another one; draw from `rng` alone")
        return ""

    def weighs_edges(self) -> str:
        """Ask what each edge of its map costs."""
        costs = [self.system.edge_weight(edge.belief) for edge in TopologicalGraph(self.deltas).edges.values()]
        require(all(np.isfinite(cost) and cost >= 0 for cost in costs), f"got {costs[:3]}")
        return f"from {min(costs):.2f} to {max(costs):.2f}" if costs else "its map has no edge"

    def _build(self) -> Deltas:
        assert predictor_card(self.predictor).camera == self.samples.meta.camera
        keyframes = KeyframeStore(self.predictor)
        rng = np.random.default_rng(0)
        return tuple(self.system.build(self.samples.observations, keyframes, self.predictor, rng=rng))
