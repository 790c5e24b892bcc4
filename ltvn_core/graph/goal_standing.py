"""Whether a map holds a goal: a way leads there from most of the map, over edges that are rather believed.

Owns the question and how the answer is told in words, so that nobody learns it from a robot that fails. Changes no map.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import NamedTuple

import rustworkx

from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import Localiser
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, NodeId, Predictor

_LIKELY_P = 0.5
_BESIDE_STEPS = 50
"""Control steps, five seconds of the drive, in which a robot does not come far."""
_ASKED = 5
_MOST = 0.5
"""From so large a share of the other nodes a way must lead to a goal."""


class Standing(StrEnum):
    """How a goal stands to a map."""

    HELD = "held"
    UNSURE = "unsure"
    """The only ways there lead over edges that are believed less than a half."""
    NOT_HELD = "not held"
    """It is no node, or no way leads there from most of the map."""


class GoalReport(NamedTuple):
    """What a map says of a goal."""

    goal: FrameId
    standing: Standing
    nearest: NodeId | None = None
    """Of the nodes with a way, one that was taken beside it on the drive, else the one that looks most like it; None
    where the goal is held, or there is none."""
    reachability: float = 0.0
    """How surely the predictor sees that node from the goal, r in [0, 1]."""

    @property
    def text(self) -> str:
        """What is wrong, in words; empty where nothing is."""
        if self.standing is Standing.HELD:
            return ""
        if self.standing is Standing.UNSURE:
            return (
                f"The map is not sure of goal {self.goal}: every way there leads over an edge that is believed less "
                "than a half. The robot may try; drive the way there once more, and the map will know."
            )
        instead = "" if self.nearest is None else f" Nearest to it is node {self.nearest}, r = {self.reachability:.2f}."
        return (
            f"The map does not hold goal {self.goal}: no way leads there from most of the map.{instead} Go there "
            "instead, or drive past the goal once more, slowly."
        )


def standings(graph: TopologicalGraph, goals: Sequence[FrameId]) -> tuple[Standing, ...]:
    """Return how each goal stands to a map; linear in edges for each goal."""
    likely = reached_from_most(graph, goals, lambda edge: edge.belief.p >= _LIKELY_P)
    every = reached_from_most(graph, goals)
    found = {True: Standing.HELD, False: Standing.UNSURE}
    return tuple(found[sure] if any_way else Standing.NOT_HELD for sure, any_way in zip(likely, every, strict=True))


def goal_reports(
    graph: TopologicalGraph,
    goals: Sequence[FrameId],
    keyframes: KeyframeStore,
    predictor: Predictor,
    system: NavigationSystem,
) -> tuple[GoalReport, ...]:
    """Return what a map says of each goal; `keyframes` holds the images of its nodes, and those of most goals."""
    matcher = Matcher(predictor, keyframes, system.method.matching)
    localiser = Localiser(matcher, system.method.localising)
    reports = list[GoalReport]()
    for goal, standing in zip(goals, standings(graph, goals), strict=True):
        if standing is not Standing.NOT_HELD or goal not in keyframes:
            reports.append(GoalReport(goal, standing))
            continue
        features = keyframes.features([goal])
        held = _held(graph, _beside(graph, goal))
        if not held:  # Another place may look more like it than its own, so this comes second.
            held = _held(graph, [node for node, _ in localiser.nearest_nodes(features, graph, _ASKED)])
        if not held:
            reports.append(GoalReport(goal, standing))
            continue
        seen = matcher.match(features, held[:1])
        reports.append(GoalReport(goal, standing, held[0], float(seen.reachability[0])))
    return tuple(reports)


def _beside(graph: TopologicalGraph, goal: FrameId) -> list[NodeId]:
    """Return the nodes that were taken shortly before or after a goal on the same drive, nearest in time first."""
    near = [node for node in graph.nodes if abs(node - goal) <= _BESIDE_STEPS]
    same = [node for node in near if graph.drive_of(node) == graph.drive_of(goal)]
    return sorted(same, key=lambda node: abs(node - goal))[:_ASKED]


def _held(graph: TopologicalGraph, nodes: Sequence[NodeId]) -> list[NodeId]:
    return [node for node, way in zip(nodes, standings(graph, nodes), strict=True) if way is Standing.HELD]


def reached_from_most(
    graph: TopologicalGraph, goals: Sequence[FrameId], over: Callable[[Edge], bool] = lambda edge: True
) -> list[bool]:
    """Tell for each goal whether it is a node to which ways lead from half of the others, `over` such edges."""
    mirror: rustworkx.PyDiGraph[NodeId, None] = rustworkx.PyDiGraph(multigraph=False)
    index = dict(zip(graph.nodes, mirror.add_nodes_from(list(graph.nodes)), strict=True))
    ends = (key for key, edge in graph.edges.items() if over(edge))
    mirror.add_edges_from_no_data([(index[source], index[target]) for source, target in ends])
    enough = _MOST * (len(index) - 1)
    return [goal in index and len(rustworkx.ancestors(mirror, index[goal])) >= enough for goal in goals]
