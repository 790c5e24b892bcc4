"""Plan between two nodes without an edge, or with another `belief_weight`, and compare paths and costs.

An edge costs its length - belief_weight * ln p. `python examples/12_plan_under_another_threshold.py` plans in the map
of `recordings/demo-fault.rrd` as it was after the first query, in which an edge through a wall failed.
"""

import math
from dataclasses import replace
from pathlib import Path

import ltvn_core as ltvn
from ltvn_core.graph.planner import GraphPath, Planner

DEMO = Path(__file__).parents[1] / "recordings" / "demo-fault.rrd"
START, GOAL = 1489, 2621


def tell(case: str, path: GraphPath) -> None:
    """Print what a plan costs and where it leads."""
    if not path.nodes:
        print(f"{case}: there is no path")
        return
    nodes = [*map(str, path.nodes)]
    shown = nodes if len(nodes) <= 6 else [*nodes[:3], "...", *nodes[-2:]]
    print(f"{case}: cost {path.cost:.2f}, {len(nodes)} nodes: {' -> '.join(shown)}")


def main() -> None:
    """Print the plan as it was, without the edge, and with other weights."""
    timeline = ltvn.Recording.open(DEMO).timeline
    graph = timeline.graph_at(timeline.queries[0].end)
    belief = graph.edges[START, GOAL].belief
    print(f"edge {START} -> {GOAL}: p {belief.p:.2f}, length {belief.mu:.2f}")

    planning = ltvn.ROBUST.planning
    planner = Planner(graph, planning)
    tell(f"as it was, belief_weight {planning.belief_weight:g}", planner.plan(START, GOAL))
    tell("without the edge", planner.plan(START, GOAL, {(START, GOAL): math.inf}))
    for weight in (0.0, 20.0):
        tell(f"belief_weight {weight:g}", Planner(graph, replace(planning, belief_weight=weight)).plan(START, GOAL))


if __name__ == "__main__":
    main()
