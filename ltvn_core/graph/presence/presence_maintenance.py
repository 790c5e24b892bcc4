"""Maintenance that keeps apart whether an edge exists and whether it is open: pure functions as in `graph.maintenance`.

Owns what an attempt says of presence, and that only what never existed is pruned for ever.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ltvn_core.config import Method
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import Cause, Edge, EdgePruned, PresenceObserved
from ltvn_core.graph.ltvn import LifelongMaintenance
from ltvn_core.graph.maintenance import AttemptEvidence, UnrecognisedObservation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas
from ltvn_core.graph.presence.obstruction import edges_obstructed
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_ONE_OBSERVATION_S = 20.0
"""What is seen again within this time is the same observation: many tries in one jam are one."""
_SAME_PLACE_M, _SAME_YAW_RAD = 0.4, 0.4
"""An edge that agrees so well with odometry from one image to the next was driven when the map was made."""
_LEAST_FAILURES = 3
"""Queries in which an edge must have failed before it may leave for ever."""


@dataclass(frozen=True, slots=True)
class PresenceMaintenance:
    """The paper's maintenance, in which what stands in the way says nothing about existence."""

    method: Method

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Observe presence, or else update the belief; prune only an edge that has never been driven."""
        if attempt.obstruction is not None and not attempt.succeeded:
            return blocked_deltas(graph, attempt)
        updates = LifelongMaintenance(self.method).after_attempt(graph, attempt)
        kept = (each for each in updates if not isinstance(each, EdgePruned) or never_existed(graph, each))
        return (*open_deltas(graph, attempt), *kept)

    def no_path(
        self, graph: TopologicalGraph, source: NodeId, goal: NodeId, matcher: Matcher, rng: np.random.Generator
    ) -> Deltas:
        """Search the reserve for a path."""
        return LifelongMaintenance(self.method).no_path(graph, source, goal, matcher, rng)

    def unrecognised(self, graph: TopologicalGraph, unrecognised: UnrecognisedObservation, matcher: Matcher) -> Deltas:
        """Make a node of the image once looking around has not helped."""
        return LifelongMaintenance(self.method).unrecognised(graph, unrecognised, matcher)


def blocked_deltas(graph: TopologicalGraph, attempt: AttemptEvidence) -> tuple[PresenceObserved, ...]:
    """Return that the driven edge, and all edges whose ways the same thing lies across, are blocked."""
    driven = (attempt.source, attempt.target)
    others = () if attempt.obstruction is None else edges_obstructed(graph, attempt.obstruction)
    keys = dict.fromkeys((driven, *others)) if driven in graph.edges else dict.fromkeys(others)
    return _observed(graph, keys, attempt, present=False)


def open_deltas(graph: TopologicalGraph, attempt: AttemptEvidence) -> tuple[PresenceObserved, ...]:
    """Return that a driven edge is open, and all edges that were seen blocked together with it; none if never."""
    driven = (attempt.source, attempt.target)
    if not attempt.succeeded or driven not in graph.presence:
        return ()
    moments = {seen.stamp_s for seen in graph.presence[driven] if not seen.present}
    together = [key for key, history in graph.presence.items() if any(seen.stamp_s in moments for seen in history)]
    return _observed(graph, (driven, *(key for key in together if key != driven)), attempt, present=True)


def _observed(
    graph: TopologicalGraph, keys: Iterable[EdgeKey], attempt: AttemptEvidence, *, present: bool
) -> tuple[PresenceObserved, ...]:
    """Return one observation of each edge, but not the same one twice within a short time."""
    deltas = []
    for key in keys:
        last = graph.presence[key][-1] if key in graph.presence else None
        if last is not None and last.present == present and 0 <= attempt.stamp - last.stamp_s < _ONE_OBSERVATION_S:
            continue
        stamp = attempt.stamp if last is None else max(attempt.stamp, last.stamp_s)
        cause = Cause.ATTEMPT if key == (attempt.source, attempt.target) else Cause.SIGHT
        deltas.append(PresenceObserved(*key, present=present, stamp=stamp, cause=cause))
    return tuple(deltas)


def never_existed(graph: TopologicalGraph, pruned: EdgePruned) -> bool:
    """Tell whether an edge that is to be pruned may never have been one that can be driven."""
    edge = graph.edges[pruned.source, pruned.target]
    # The failure under way is not counted in the map yet.
    failures = edge.attempts + 1
    seen_blocked = (edge.source, edge.target) in graph.presence
    return edge.successes == 0 and failures >= _LEAST_FAILURES and not seen_blocked and not _was_driven(graph, edge)


def _was_driven(graph: TopologicalGraph, edge: Edge) -> bool:
    """Tell whether an edge joins two images that followed each other when the map was made, as odometry says."""
    first, last = sorted((edge.source, edge.target))
    if any(first < node < last for node in graph.nodes):
        return False
    source, target = (np.array(graph.nodes[node].odometry) for node in (edge.source, edge.target))
    gap = relative(relative(source, target), np.array(edge.waypoint))
    return bool(np.hypot(gap[0], gap[1]) < _SAME_PLACE_M and abs(gap[2]) < _SAME_YAW_RAD)
