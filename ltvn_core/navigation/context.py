"""Context of a navigator: the map, the images of its nodes, the predictor and the system. Decides nothing."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.action_performer import ActionPerformer
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Predictor


@dataclass(frozen=True, slots=True, eq=False)
class NavigationContext:
    """The objects that outlive one query."""

    graph: TopologicalGraph
    keyframes: KeyframeStore
    predictor: Predictor
    system: NavigationSystem
    rng: np.random.Generator
    spec: RobotSpec
    """The robot's size and camera."""
    matcher: Matcher
    planner: Planner
    bystanders: Bystanders = field(default_factory=Bystanders)
    """The people around the robot."""
    world_time: Callable[[], float] | None = None
    """Returns the time of the world in seconds; None if the robot's clock shows the time of the world."""
    actions: ActionPerformer | None = None
    """Performs the actions of edges; if None, each action fails."""
    attempt_numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    """Numbers of the next attempts."""

    @property
    def method(self) -> Method:
        """The system's thresholds."""
        return self.system.method

    def world_time_s(self, stamp: float) -> float:
        """Return the current time of the world in seconds; `stamp` is the current time on the robot's clock."""
        return stamp if self.world_time is None else self.world_time()

    @classmethod
    def create(
        cls,
        graph: TopologicalGraph,
        keyframes: KeyframeStore,
        predictor: Predictor,
        system: NavigationSystem,
        rng: np.random.Generator,
        spec: RobotSpec,
        *,
        bystanders: Bystanders | None = None,
        world_time: Callable[[], float] | None = None,
        actions: ActionPerformer | None = None,
    ) -> "NavigationContext":
        """Create a context with a matcher and a planner for the map."""
        matcher = Matcher(predictor, keyframes, system.method.matching)
        planner = Planner(graph, system.method.planning, weight=system.edge_weight)
        return cls(
            graph=graph,
            keyframes=keyframes,
            predictor=predictor,
            system=system,
            rng=rng,
            spec=spec,
            bystanders=bystanders or Bystanders(),
            world_time=world_time,
            actions=actions,
            matcher=matcher,
            planner=planner,
        )
