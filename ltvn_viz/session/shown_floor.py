"""The floor of the map that the page shows.

Owns the choice of a floor, and the part of the map that belongs to it. `ltvn_core.analysis.floors` defines what a floor
is.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.floors import number_floors
from ltvn_core.analysis.map_history import EMPTY_GRAPH, GraphArrays
from ltvn_viz.session.snapshot import FloorChoice, Snapshot


class ShownFloor:
    """Limits the map of a snapshot to one floor; computes only when the map or the floor changed."""

    def __init__(self) -> None:
        """Start without a map."""
        self.chosen: int | None = None
        """The floor that a person chose, from 0; None follows the robot."""
        self._graph = EMPTY_GRAPH
        self._floors: NDArray[np.intp] = np.empty(0, np.intp)
        self._shown = 0
        self._part = EMPTY_GRAPH

    def choose(self, floor: int | None) -> None:
        """Show a floor, from 0; None follows the robot."""
        self.chosen = floor

    def of(self, snapshot: Snapshot) -> Snapshot:
        """Return a snapshot of the chosen floor, else of the robot's floor; the same snapshot if the map has one floor.

        The robot is left out while another floor is shown.
        """
        graph = snapshot.moment.graph
        if graph is not self._graph:
            self._graph = graph
            self._floors = number_floors(graph.ids, graph.edges, graph.acts)
            self._part = EMPTY_GRAPH
        count = int(self._floors.max(initial=0)) + 1
        if count == 1:
            return snapshot
        robots = self._robots_floor(snapshot)
        wanted = self.chosen if self.chosen is not None else self._shown if robots is None else robots
        floor = min(wanted, count - 1)
        if floor != self._shown or self._part is EMPTY_GRAPH:
            self._shown = floor
            self._part = _part(graph, self._floors == floor)
        choice = FloorChoice(floor, count, follows_robot=self.chosen is None, robots=robots)
        moment = replace(snapshot.moment, graph=self._part)
        if robots is not None and robots != floor:
            moment = replace(moment, robot=None, predicted_subgoal=None)
        return replace(snapshot, moment=moment, floor=choice)

    def _robots_floor(self, snapshot: Snapshot) -> int | None:
        """Return the floor of the node where the robot was last localised; None before that."""
        localised = snapshot.moment.progress.localised
        here = self._graph.ids == (None if localised is None else localised.node)
        return int(self._floors[here][0]) if here.any() else None


def _part(graph: GraphArrays, nodes: NDArray[np.bool_]) -> GraphArrays:
    """Return the part of a map with the nodes (N,) that are true, and the edges between them."""
    edges = nodes[graph.edges].all(axis=1)
    return GraphArrays(
        ids=graph.ids[nodes],
        poses=graph.poses[nodes],
        edges=(np.cumsum(nodes) - 1)[graph.edges[edges]],
        p=graph.p[edges],
        attempts=graph.attempts[edges],
        acts=graph.acts[edges],
        exits=graph.exits[nodes],
    )
