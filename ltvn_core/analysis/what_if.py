"""What the robot would have planned, had something been otherwise.

Owns the comparison of both plans. Works on copies: neither the map nor the recording is touched. What a change does is
`analysis.imagined`; counting what other thresholds would do to the map is `analysis.dry_run`.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from ltvn_core.analysis.changes import Change
from ltvn_core.analysis.imagined import Weights, World, imagine, ltvn_weights
from ltvn_core.analysis.situation import Situation
from ltvn_core.config import Method
from ltvn_core.graph.planner import NO_PATH, Path, Planner
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph


@dataclass(frozen=True, slots=True)
class PricedEdge:
    """What one edge of a path costs, part by part."""

    edge: EdgeKey
    mu: float
    """Believed length."""
    doubt: float
    """What the weight of the edge adds: -weight * ln p in the paper's system."""
    penalty: float
    """For failures earlier in the query."""


@dataclass(frozen=True, slots=True)
class Replanned:
    """Two plans side by side."""

    old: Path
    new: Path
    old_edges: tuple[PricedEdge, ...]
    """Along the old path."""
    new_edges: tuple[PricedEdge, ...]
    """Along the new path, under the changes."""
    left: tuple[EdgeKey, ...]
    """Edges of the old path that the new one does without, in order."""
    joined: tuple[EdgeKey, ...]
    """Edges that only the new path has, in order."""
    notes: tuple[str, ...]
    """What these plans cannot tell about the changes, for a person."""

    @property
    def sentence(self) -> str:
        """The difference in one line."""
        old, new = _said(self.old), _said(self.new)
        if self.old.nodes != self.new.nodes:
            return f"{new[0].upper()}{new[1:]}, instead of {old}."
        if not self.new.nodes:
            return "Still no way."
        same = math.isclose(self.old.cost, self.new.cost)
        return f"The same way, {new}." if same else f"The same way, {new} instead of {self.old.cost:.2f}."


def replan(
    graph: TopologicalGraph,
    situation: Situation,
    method: Method,
    changes: Sequence[Change],
    *,
    weights: Weights = ltvn_weights,
) -> Replanned:
    """Plan twice, as it was and as it would be under `changes`, taken in order.

    `weights` are those of the system that planned; the paper's own unless another is named.
    Costs two copies of the map and two searches. Raises MapError where a change names a node or an edge that is not in
    the map, OptionError for values that cannot be.
    """
    before = World(graph, situation, method, weights)
    after = imagine(before, changes)
    old, new = _plan(before), _plan(after)
    old_keys, new_keys = (tuple(itertools.pairwise(path.nodes)) for path in (old, new))
    return Replanned(
        old,
        new,
        tuple(_priced(before, key) for key in old_keys),
        tuple(_priced(after, key) for key in new_keys),
        tuple(key for key in old_keys if key not in new_keys),
        tuple(key for key in new_keys if key not in old_keys),
        tuple(after.notes),
    )


def _plan(world: World) -> Path:
    source, goal = world.situation.source, world.situation.goal
    if source is None or goal is None:
        missing = "where the robot is" if source is None else "where it should go"
        world.notes.append(f"There is no plan because nobody knows {missing}; set it as a change.")
        return NO_PATH
    penalty = world.method.planning.failure_penalty
    penalties = {edge: count * penalty for edge, count in world.situation.failures.items()}
    return Planner(world.graph, world.method.planning, weight=world.weight).plan(source, goal, penalties)


def _priced(world: World, key: EdgeKey) -> PricedEdge:
    belief, planning = world.graph.edges[key].belief, world.method.planning
    penalty = world.situation.failures.get(key, 0) * planning.failure_penalty
    return PricedEdge(key, belief.mu, world.weight(belief) - belief.mu, penalty)


def _said(path: Path) -> str:
    return f"{len(path.nodes)} nodes at cost {path.cost:.2f}" if path.nodes else "no way"
