"""Maintenance that separates the existence of an edge from its presence: pure functions as in `graph.operators`.

Owns the decision whether an attempt is an observation of presence. Prunes permanently only edges that never existed.
"""

from dataclasses import replace

import numpy as np

from ltvn_core.geometry import agree, relative
from ltvn_core.graph.deltas import Edge, EdgePruned
from ltvn_core.graph.ltvn import LifelongMaintenance
from ltvn_core.graph.navigation_system import Deltas
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.presence.edge_presence import obstructed_deltas, open_deltas
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_SAME_PLACE = (0.4, 0.4)
"""Largest difference from odometry, in metres and radians, at which an edge between consecutive images counts as driven
during mapping."""
_LEAST_FAILURES = 3
"""Least number of queries in which an edge has failed before it may be pruned permanently."""


class PresenceMaintenance(LifelongMaintenance):
    """The paper's maintenance, except that obstacles change presence and not existence."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Return an observation of presence or else an updated belief; prune only an edge that was never driven."""
        if attempt.obstruction is not None and not attempt.succeeded:
            blocked = obstructed_deltas(graph, attempt.obstruction, attempt.stamp, driven=_driven(attempt))
            if any((each.source, each.target) == _driven(attempt) for each in blocked):
                return blocked
            # New things in view make a place hard to recognise, so the failure is only weak evidence against the edge.
            return (*blocked, *self._believe(graph, replace(attempt, hindered=True)))
        opened = open_deltas(graph, _driven(attempt), attempt.stamp) if attempt.succeeded else ()
        return (*opened, *self._believe(graph, attempt))

    def _believe(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        updates = super().after_attempt(graph, attempt)
        kept = (each for each in updates if not isinstance(each, EdgePruned) or never_existed(graph, each))
        return tuple(kept)


def _driven(attempt: AttemptEvidence) -> EdgeKey:
    return attempt.source, attempt.target


def never_existed(graph: TopologicalGraph, pruned: EdgePruned) -> bool:
    """Return whether an edge to be pruned has probably never existed."""
    edge = graph.edges[pruned.source, pruned.target]
    # The current failure is not counted in the map yet.
    failures = edge.attempts + 1
    seen_blocked = (edge.source, edge.target) in graph.presence
    return failures >= _LEAST_FAILURES and not seen_blocked and not _was_driven(graph, edge)


def _was_driven(graph: TopologicalGraph, edge: Edge) -> bool:
    """Return whether an edge was driven successfully, or during mapping.

    The latter is so if it joins two consecutive images and agrees with odometry between them.
    """
    if edge.successes:
        return True
    first, last = sorted((edge.source, edge.target))
    if any(first < node < last for node in graph.nodes):
        return False
    source, target = (np.array(graph.nodes[node].odometry) for node in (edge.source, edge.target))
    return bool(agree(relative(source, target), np.array(edge.waypoint), _SAME_PLACE))
