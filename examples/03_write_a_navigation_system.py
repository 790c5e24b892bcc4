"""Write a navigation system of your own: take the paper's and exchange one of its five strategies.

Here plans take the fewest edges instead of the shortest way, and the map never learns. To give your system a name that
`ltvn evaluate --system` and the page know, name `my_system` in your package's entry points `ltvn.systems`.
"""

import sys
from dataclasses import replace

import numpy as np

import ltvn_core as ltvn
from ltvn_core.graph.navigation_system import NoMaintenance
from ltvn_core.simulation.scripted_tour import drive_tour


def one_per_edge(belief: ltvn.Belief) -> float:
    """Return what an edge costs: the same for all."""
    return 1.0


def my_system(method: ltvn.Method) -> ltvn.NavigationSystem:
    """Return the paper's system with two other strategies."""
    return replace(
        ltvn.open_system("ltvn", method), name="fewest-edges", edge_weight=one_per_edge, maintenance=NoMaintenance()
    )


def main(scene: str, queries: int = 3) -> None:
    """Map a scene with it, given by its name or as a mesh file, and drive to a few places."""
    simulation = ltvn.open_simulation(scene, seed=0)
    rng = np.random.default_rng(0)
    drive = list(drive_tour(simulation.robot, simulation.scene, rng, loops=1))
    oracle = ltvn.open_predictor("oracle", scene)
    topological_map = ltvn.build_map(drive, predictor=oracle, system=my_system(ltvn.ROBUST), scene=scene)

    navigator = topological_map.navigator(simulation.robot)
    goals = rng.choice(list(topological_map.graph.nodes), queries, replace=False).tolist()
    for number, goal in enumerate(goals):
        ended = navigator.drive_to(goal, query=number)
        print(f"query {number} to node {goal}: {ended.outcome} after {ended.path_m:.1f} m")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "demo")
