"""The plan that was made beside the one that would have been made under other conditions.

Owns the comparison of both plans. Works on copies: neither the map nor the recording is touched. What a change does is
`analysis.what_if_scenario`; counting what other thresholds would do to the map is `analysis.threshold_dry_run`.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ltvn_core.analysis.planner_state import PlannerState
from ltvn_core.analysis.what_if_changes import WhatIfChange
from ltvn_core.analysis.what_if_scenario import (
    EdgeWeightFactory,
    PresenceMoment,
    WhatIfScenario,
    apply_what_if_changes,
    ltvn_edge_weight,
)
from ltvn_core.config import Method
from ltvn_core.graph.planner import NO_PATH, GraphPath, Planner
from ltvn_core.graph.presence.presence_plan import plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph


@dataclass(frozen=True, slots=True)
class EdgeCostParts:
    """What one edge of a path costs, part by part."""

    edge: EdgeKey
    mu: float
    """Believed length."""
    doubt: float
    """What the weight of the edge adds: -weight * ln p in the paper's system."""
    penalty: float
    """For failures earlier in the query."""
    open_p: float = 1.0
    """How probably it is open then."""


@dataclass(frozen=True, slots=True)
class PlanDifference:
    """Two plans side by side."""

    old: GraphPath
    new: GraphPath
    old_edges: tuple[EdgeCostParts, ...]
    """Along the old path."""
    new_edges: tuple[EdgeCostParts, ...]
    """Along the new path, under the changes."""
    removed_edges: tuple[EdgeKey, ...]
    """Edges of the old path that the new one does without, in order."""
    added_edges: tuple[EdgeKey, ...]
    """Edges that only the new path has, in order."""
    notes: tuple[str, ...]
    """What these plans cannot tell about the changes, for a person."""
    old_open: Mapping[EdgeKey, float] = field(default_factory=dict)
    """How probably the edges are open that were ever seen blocked,"""
    new_open: Mapping[EdgeKey, float] = field(default_factory=dict)
    """and how probably they would be."""

    @property
    def sentence(self) -> str:
        """The difference in one line."""
        old, new = _path_text(self.old), _path_text(self.new)
        if self.old.nodes != self.new.nodes:
            return f"{new[0].upper()}{new[1:]}, instead of {old}."
        if not self.new.nodes:
            return "Still no way."
        same = math.isclose(self.old.cost, self.new.cost)
        return f"The same way, {new}." if same else f"The same way, {new} instead of {self.old.cost:.2f}."


def replan(
    graph: TopologicalGraph,
    planner_state: PlannerState,
    method: Method,
    changes: Sequence[WhatIfChange],
    *,
    edge_weight_of: EdgeWeightFactory = ltvn_edge_weight,
    presence: PresenceMoment | None = None,
) -> PlanDifference:
    """Plan twice, as it was and as it would be under `changes`, taken in order.

    `edge_weight_of` are those of the system that planned; the paper's own unless another is named. With `presence` both
    plans take into account what is open.
    Costs two copies of the map and two searches. Raises MapError where a change names a node or an edge that is not in
    the map, OptionError for values that cannot be.
    """
    before = WhatIfScenario(
        graph=graph,
        planner_state=planner_state,
        method=method,
        edge_weight_of=edge_weight_of,
        presence=presence,
    )
    after = apply_what_if_changes(before, changes)
    old_open, new_open = _open_edges(before), _open_edges(after)
    old, new = _plan(before, old_open), _plan(after, new_open)
    old_keys, new_keys = (tuple(itertools.pairwise(path.nodes)) for path in (old, new))
    return PlanDifference(
        old=old,
        new=new,
        old_edges=tuple(_cost_parts(before, key, old_open) for key in old_keys),
        new_edges=tuple(_cost_parts(after, key, new_open) for key in new_keys),
        removed_edges=tuple(key for key in old_keys if key not in new_keys),
        added_edges=tuple(key for key in new_keys if key not in old_keys),
        notes=tuple(after.notes),
        old_open=old_open,
        new_open=new_open,
    )


def _open_edges(scenario: WhatIfScenario) -> Mapping[EdgeKey, float]:
    return {} if scenario.presence is None else scenario.presence.probabilities(scenario.graph)


def _plan(scenario: WhatIfScenario, open_edges: Mapping[EdgeKey, float]) -> GraphPath:
    source, goal = scenario.planner_state.source, scenario.planner_state.goal
    if source is None or goal is None:
        missing = "where the robot is" if source is None else "where it should go"
        scenario.notes.append(f"There is no plan because nobody knows {missing}; set it as a change.")
        return NO_PATH
    planning, asked = scenario.method.planning, scenario.planner_state
    penalties = {edge: count * planning.failure_penalty for edge, count in asked.failures.items()}
    planner = Planner(scenario.graph, planning, weight=scenario.weight)
    return plan_by_presence(
        planner, source, goal, penalties, open_edges, belief_weight=planning.belief_weight, tries=asked.tries
    )


def _cost_parts(scenario: WhatIfScenario, key: EdgeKey, open_edges: Mapping[EdgeKey, float]) -> EdgeCostParts:
    belief, planning = scenario.graph.edges[key].belief, scenario.method.planning
    penalty = scenario.planner_state.failures.get(key, 0) * planning.failure_penalty
    doubt = scenario.weight(belief) - belief.mu
    return EdgeCostParts(edge=key, mu=belief.mu, doubt=doubt, penalty=penalty, open_p=open_edges.get(key, 1.0))


def _path_text(path: GraphPath) -> str:
    return f"{len(path.nodes)} nodes at cost {path.cost:.2f}" if path.nodes else "no way"
