"""Write a navigation system of your own: take the paper's and exchange one of its five strategies.

Here plans take the fewest edges instead of the shortest way, and the map never learns. To give your system a name that
`ltvn evaluate --system` and the page know, name `my_system` in your package's entry points `ltvn.systems`.
"""

from dataclasses import replace

import numpy as np

import ltvn_core as ltvn
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.navigation_system import NoMaintenance
from ltvn_core.navigation.events import QueryEnded
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scripted_tour import drive_tour
from ltvn_core.types import CONTROL_STEP_S


def one_per_edge(belief: Belief) -> float:
    """Return what an edge costs: the same for all."""
    return 1.0


def my_system(method: ltvn.Method) -> ltvn.System:
    """Return the paper's system with two other strategies."""
    return replace(
        ltvn.open_system("ltvn", method), name="fewest-edges", edge_weight=one_per_edge, maintenance=NoMaintenance()
    )


def main(queries: int = 3) -> None:
    """Map the demo apartment with it, and drive to a few places."""
    simulation = open_simulation("demo", seed=0)
    rng = np.random.default_rng(0)
    drive = list(drive_tour(simulation.robot, simulation.scene, rng, loops=1))
    oracle = open_predictor("oracle", "demo")
    topological_map = ltvn.build_map(drive, predictor=oracle, system=my_system(ltvn.ROBUST), scene="demo")

    navigator = topological_map.navigator(simulation.robot)
    goals = rng.choice(list(topological_map.graph.nodes), queries, replace=False).tolist()
    for number, goal in enumerate(goals):
        for step in navigator.query(goal, number):
            if isinstance(step, ltvn.Tick):
                simulation.robot.advance(CONTROL_STEP_S)
            elif isinstance(step, QueryEnded):
                print(f"query {number} to node {goal}: {step.outcome} after {step.path_m:.1f} m")


if __name__ == "__main__":
    main()
