"""Presence of edges: what an obstruction closes and a success opens, p(open) at a moment, and the plan that follows.

Owns these observations as changes of the map, where many attempts at one blockage count as one; running the filter over
them; and the choice between a detour and a path through a closed edge. All are pure functions.
"""

import itertools
import math
from collections.abc import Collection, Mapping
from typing import TypeAlias

from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.planner import GraphPath, Planner
from ltvn_core.graph.presence.obstruction import Obstruction, edges_obstructed
from ltvn_core.graph.presence.presence_filter import (
    PresenceFilter,
    PresenceObservation,
    PresenceTracks,
    follow_histories,
)
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_SAME_S = 20.0
"""Time in seconds within which equal observations count as one, so that many attempts at one blockage count once."""
_SEEN_SHARE = 0.3
"""Least share of the edges closed by a thing that must be seen free before the thing counts as gone."""
_ONE_THING_S = 1e-3
"""Offset in seconds between the stamps of things seen at once, which identifies the edges that each of them closed."""


def obstructed_deltas(
    graph: TopologicalGraph, obstruction: Obstruction, stamp: float, *, driven: EdgeKey | None = None
) -> tuple[PresenceObserved, ...]:
    """Return observations that all closed edges are blocked, and the driven edge if the robot was stopped there."""
    stopped = [driven] if obstruction.stopped and driven in graph.edges and driven is not None else []
    closed: dict[EdgeKey, float] = dict.fromkeys(stopped, stamp)
    for number, thing in enumerate(obstruction.things()):
        keys = edges_obstructed(graph, thing)
        moment = stamp + number * _ONE_THING_S
        # The time of an earlier observation of the same blockage, if there is one.
        last = (graph.presence[key][-1] for key in keys if key in graph.presence)
        same = (seen.stamp_s for seen in last if not seen.present and 0 <= moment - seen.stamp_s < _SAME_S)
        moment = max(same, default=moment)
        closed |= {key: moment for key in keys}
    return _observed(graph, closed, present=False, driven=driven)


def open_deltas(graph: TopologicalGraph, driven: EdgeKey, stamp: float) -> tuple[PresenceObserved, ...]:
    """Return observations that a driven edge and all edges closed by the same thing are open; none if the driven edge
    was never blocked."""
    if driven not in graph.presence:
        return ()
    together = itertools.chain.from_iterable(_closed_together(graph, {driven}))
    return _observed(graph, dict.fromkeys((driven, *together), stamp), present=True, driven=driven)


def _closed_together(graph: TopologicalGraph, keys: Collection[EdgeKey]) -> list[set[EdgeKey]]:
    """Return, for each moment at which one of `keys` was seen closed, all edges that were last seen closed at that
    moment.

    An edge that was seen closed again later is closed by something else.
    """
    groups = {seen.stamp_s: set[EdgeKey]() for key in keys for seen in graph.presence[key] if not seen.present}
    for key, history in graph.presence.items() if groups else ():
        closed_s = next((seen.stamp_s for seen in reversed(history) if not seen.present), None)
        if closed_s in groups:
            groups[closed_s].add(key)
    return list(groups.values())


def is_open(graph: TopologicalGraph, edge: EdgeKey) -> bool:
    """Return whether an edge was open at its last observation; an edge without observations is open."""
    return edge not in graph.presence or graph.presence[edge][-1].present


def _observed(
    graph: TopologicalGraph, stamps: Mapping[EdgeKey, float], *, present: bool, driven: EdgeKey | None
) -> tuple[PresenceObserved, ...]:
    """Return one observation of each edge, except those with the same observation a short time before."""
    deltas = []
    for key, stamp in stamps.items():
        last = graph.presence[key][-1] if key in graph.presence else None
        if last is not None and last.present == present and 0 <= stamp - last.stamp_s < _SAME_S:
            continue
        in_order = stamp if last is None else max(stamp, last.stamp_s)
        cause = Cause.ATTEMPT if key == driven else Cause.SIGHT
        deltas.append(PresenceObserved(*key, present=present, stamp=in_order, cause=cause))
    return tuple(deltas)


EdgeProbabilities: TypeAlias = Mapping[EdgeKey, float]
"""p(open) of each edge that may be closed; all other edges are open."""


class EdgePresence:
    """Predicts p(open) of edges. What a subclass leaves out needs no observations, and leaves every edge open."""

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return p(open) of the edges that may be closed at a moment on the clock of the world."""
        return {}

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return the deltas for an obstacle that was seen from afar."""
        return ()

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return the deltas for edges whose paths were seen to be free."""
        return ()


ALWAYS_OPEN = EdgePresence()
"""Presence for a system that does not model it: every edge that exists is open."""


class FilteredPresence(EdgePresence):
    """Presence from a filter over the observations in a map; an edge that was never seen blocked is open."""

    def __init__(self, presence_filter: PresenceFilter) -> None:
        """Start without a map."""
        self.presence_filter = presence_filter
        self._known: dict[EdgeKey, tuple[PresenceObservation, ...]] = {}
        self._tracks: PresenceTracks = presence_filter.follow(0)

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return p(open) of the edges that were ever seen blocked; linear in their number without new observations."""
        if not graph.presence:
            return {}
        if graph.presence != self._known:
            self._known = dict(graph.presence)
            self._tracks = follow_histories(self.presence_filter, list(self._known.values()))
        # When a recording continues in another session, its clock may restart.
        latest_s = max(seen[-1].stamp_s for seen in self._known.values())
        found = self._tracks.probability(max(now_s, latest_s))
        return dict(zip(self._known, map(float, found), strict=True))

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return observations that all edges closed by the obstacle are blocked."""
        return obstructed_deltas(graph, obstruction, stamp)

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return observations that edges seen free, and the other edges closed by the same thing, are open.

        The other edges count as open only if a large enough share of the thing's edges was seen free, because a few
        paths may be free although the thing is still there.
        """
        known = [key for key in seen if key in graph.presence]
        groups = _closed_together(graph, known)
        gone = (keys for keys in groups if len(keys.intersection(known)) >= _SEEN_SHARE * len(keys))
        opened = dict.fromkeys((*known, *itertools.chain.from_iterable(gone)), stamp)
        return _observed(graph, opened, present=True, driven=None)


OPEN_ABOVE = 0.5
"""p(open) below which an edge counts as closed."""
HOPELESS_BELOW = 0.2
"""p(open) below which a closed edge is not tried again, even if there is no other path."""


def plan_by_presence(
    planner: Planner,
    source: NodeId,
    goal: NodeId,
    penalties: Mapping[EdgeKey, float],
    open_now: EdgeProbabilities,
    *,
    belief_weight: float,
    tries: int = 0,
) -> GraphPath:
    """Return the path to drive; empty if there is none, or none that is worth a try.

    Edges that are probably open cost `-belief_weight ln p` more; a detour avoids edges that are probably closed. A path
    through a closed edge is used if its expected cost is lower: with probability p the edge is open, otherwise the
    robot must take a detour from there.

    Args:
        planner: Planner of the map.
        source: Node of the robot.
        goal: Node to reach.
        penalties: Additional costs of edges in this query.
        open_now: p(open) of edges that may be closed.
        belief_weight: Weight of -ln p in the cost of an edge.
        tries: Number of times that a closed edge was tried in this query. After the first, a detour is preferred;
            without one, a closed edge is tried again only if its p(open) is at least `HOPELESS_BELOW`.
    """
    closed = {edge for edge, p in open_now.items() if p < OPEN_ABOVE}
    costs = dict(penalties)
    for edge in open_now.keys() - closed:
        costs[edge] = costs.get(edge, 0.0) - belief_weight * math.log(open_now[edge])
    through = planner.plan(source, goal, costs)
    passed = [edge for edge in itertools.pairwise(through.nodes) if edge in closed]
    if not passed:
        return through
    around_costs = costs | dict.fromkeys(closed, math.inf)
    around = planner.plan(source, goal, around_costs)
    p = min(open_now[edge] for edge in passed)
    if not around.nodes:
        return through if not tries or p >= HOPELESS_BELOW else around
    if tries:
        return around
    before = planner.plan(source, passed[0][0], costs)
    back = planner.plan(passed[0][0], goal, around_costs)
    expected = p * through.cost + (1 - p) * (before.cost + back.cost)
    return through if expected < around.cost else around
